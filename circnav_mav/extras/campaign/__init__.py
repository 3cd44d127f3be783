"""A mission flown many times with varied values: a table, a summary and pictures."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    commands={"campaign": "circnav_mav.extras.campaign.commands:campaign"},
    schemas={"campaign": "circnav_mav.extras.campaign.plan:CampaignFile"},
    order=50,
)
