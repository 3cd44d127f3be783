"""Fleet on one circle: spacing law, link and commands."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    tables={"fleet": "circnav_mav.extras.fleet.settings:FleetTable"},
    checks=["circnav_mav.extras.fleet.settings:check_fleet"],
    preflight=["circnav_mav.extras.fleet.settings:preflight_fleet"],
    fly_options=[
        f"circnav_mav.extras.fleet.commands:{name}"
        for name in ("COMPASS", "DELAY", "LOSS", "FLEET")
    ],
    flies={"fleet": "circnav_mav.extras.fleet.fly:fly_fleet"},
    listener="circnav_mav.extras.fleet.settings:open_listener",
    report_section="circnav_mav.extras.fleet.section:report_section",
    order=15,
)
