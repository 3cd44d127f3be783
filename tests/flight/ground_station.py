"""A ground station on its own link: only the emulator receives its messages, not the pilot."""

import struct

from circnav_sim.vehicle import Vehicle
from pymavlink.dialects.v20 import all as dialect

from tests.sim.station import Station


class Operator(Station):
    """Sends the messages of an operator's ground station."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle, 255, 190, "gcs")

    def set_px4_integer(self, name: str, value: int) -> None:
        """Send PARAM_SET. PX4 transmits the bytes of an integer in the float field."""
        (carried,) = struct.unpack("<f", struct.pack("<i", value))
        self.send(
            dialect.MAVLink_param_set_message(
                1, 1, name.encode(), carried, dialect.MAV_PARAM_TYPE_INT32
            )
        )

    def disarm(self) -> None:
        """Send MAV_CMD_COMPONENT_ARM_DISARM with force."""
        self.command(400, 0, 21196)

    def change_altitude(self, above_home: float) -> None:
        """Send MAV_CMD_DO_CHANGE_ALTITUDE, which a plane in GUIDED obeys."""
        self.command(186, above_home)
