"""Profile names to autopilots."""

from sim.autopilots.arducopter import ArduCopter
from sim.autopilots.arduplane import ArduPlane
from sim.autopilots.ardurover import ArduRover
from sim.autopilots.contract import Autopilot, Say
from sim.autopilots.px4_copter import Px4Copter
from sim.autopilots.px4_plane import Px4Plane
from sim.body import Body
from sim.config import VehicleConfig


def build_autopilot(config: VehicleConfig, say: Say, start: Body) -> Autopilot:
    """The autopilot of `config.vehicle.profile`, with the vehicle where `start` says."""
    profile = config.vehicle.profile
    if profile == "arduplane":
        return ArduPlane(config, say, start)
    if profile == "ardurover":
        return ArduRover(config, say)
    if profile == "px4_copter":
        return Px4Copter(config, say, start)
    if profile == "px4_plane":
        return Px4Plane(config, say, start)
    return ArduCopter(config, say)
