"""Alarm conditions of the survey, in addition to `circnav_mav.pilot.conditions`."""

from circnav_mav.pilot.conditions import Condition

RADIUS = Condition(
    "radius",
    short="{found}",
    long="RANGING: {found}. Calibrate the radio: circnav ranging calibrate RUN",
    over="radius error within its limit again",
)
