"""Alarm condition of the hand-back, in addition to `circnav_mav.pilot.conditions`."""

from circnav_mav.pilot.conditions import Condition

HAND_BACK = Condition("hand_back", long="HAND-BACK: {found}")
