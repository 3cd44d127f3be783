"""The conditions that the survey adds to those of `circnav_mav.pilot.conditions`."""

from circnav_mav.pilot.conditions import Condition

GPS_WATCH = Condition(
    "gps_watch", short="GPS WATCH: {culprit} likeliest wrong", long="GPS WATCH: {words}", over="GPS, ranges agree again"
)
HAND_BACK = Condition("hand_back", long="HAND-BACK: {words}")
SURVEY_STOPPED = Condition("survey_stopped", long="SURVEY: {problem}")
