"""Ranging messages by their mission names."""

from collections.abc import Mapping

from circnav_mav.mav.ranging.distance_sensor import DISTANCE_SENSOR
from circnav_mav.mav.ranging.interface import RangingMessage
from circnav_mav.mav.ranging.named_value_float import NAMED_VALUE_FLOAT
from circnav_mav.mav.ranging.ranging_beacon import RANGING_BEACON

RANGING_MESSAGES: Mapping[str, RangingMessage] = {
    "ranging_beacon": RANGING_BEACON,
    "distance_sensor": DISTANCE_SENSOR,
    "named_value_float": NAMED_VALUE_FLOAT,
}
