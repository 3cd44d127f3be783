"""Alarm conditions of the survey, in addition to `circnav_mav.pilot.conditions`."""

from circnav_mav.pilot.conditions import Condition

GPS_WATCH = Condition(
    "gps_watch",
    short="GPS WATCH: most likely wrong: {found}",
    long="GPS WATCH: {found}",
    over="GPS and ranges agree again",
)
HAND_BACK = Condition("hand_back", long="HAND-BACK: {found}")
SURVEY_STOPPED = Condition("survey_stopped", long="SURVEY: {found}")
RADIUS = Condition(
    "radius",
    short="{found}",
    long="RANGING: {found}. Calibrate the radio: circnav ranging calibrate RUN",
    over="radius error within its limit again",
)
