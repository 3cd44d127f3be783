"""Many flights of a mission with varied values: table, summary and pictures."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    commands={"campaign": "circnav_mav.extras.campaign.commands:campaign"},
    functions={"campaign": "circnav_mav.extras.campaign.api:campaign"},
    schemas={"campaign": "circnav_mav.extras.campaign.plan:CampaignFile"},
    order=50,
)
