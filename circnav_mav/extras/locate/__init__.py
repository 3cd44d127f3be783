"""Localization of the target, live and from logs.

The package does not steer: the core cannot import it.
"""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    commands={
        "locate": "circnav_mav.extras.locate.commands:locate",
        "ranging calibrate": "circnav_mav.extras.locate.commands:calibrate",
    },
    tables={
        "locate": "circnav_mav.extras.locate.settings:LocateTable",
    },
    listener="circnav_mav.extras.locate.listener:open_listener",
    report_section="circnav_mav.extras.locate.report:report_section",
    position_forecast="circnav_mav.extras.locate.forecast:position_sigma",
    order=10,
)
