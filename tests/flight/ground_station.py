"""A ground station on a link of its own: the emulator hears it, the pilot does not."""

import struct

from pymavlink.dialects.v20 import all as dialect

from sim.vehicle import Vehicle


class Operator:
    """Says what a pilot's ground station says."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)

    def set_mode(self, *numbers: int) -> None:
        """MAV_CMD_DO_SET_MODE: ArduPilot's mode number, or PX4's main and sub mode."""
        self._command(176, 1, *numbers)

    def set_px4_integer(self, name: str, value: int) -> None:
        """PARAM_SET; PX4 carries the bytes of an integer in the field of a float."""
        (carried,) = struct.unpack("<f", struct.pack("<i", value))
        message = dialect.MAVLink_param_set_message(1, 1, name.encode(), carried, dialect.MAV_PARAM_TYPE_INT32)
        self._say(message)

    def disarm(self) -> None:
        """MAV_CMD_COMPONENT_ARM_DISARM, forced."""
        self._command(400, 0, 21196)

    def change_altitude(self, above_home: float) -> None:
        """MAV_CMD_DO_CHANGE_ALTITUDE, as a plane in GUIDED obeys it."""
        self._command(186, above_home)

    def _command(self, number: int, *params: float) -> None:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self._say(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def _say(self, message: dialect.MAVLink_message) -> None:
        self._vehicle.receive(bytes(message.pack(self._mav)), "gcs")
