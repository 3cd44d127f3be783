"""A ground station on a link of its own: the emulator hears it, the pilot does not."""

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

    def disarm(self) -> None:
        """MAV_CMD_COMPONENT_ARM_DISARM, forced."""
        self._command(400, 0, 21196)

    def change_altitude(self, above_home: float) -> None:
        """MAV_CMD_DO_CHANGE_ALTITUDE, as a plane in GUIDED obeys it."""
        self._command(186, above_home)

    def _command(self, number: int, *params: float) -> None:
        padded = (*params, *(0.0,) * (7 - len(params)))
        message = dialect.MAVLink_command_long_message(1, 1, number, 0, *padded)
        self._vehicle.receive(bytes(message.pack(self._mav)), "gcs")
