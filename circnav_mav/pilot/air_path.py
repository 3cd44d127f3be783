"""The vehicle's motion through the air: from telemetry to the estimators and to the learning of its
turn response."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.copter_air import CopterAir
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.own_motion import ACCELERATIONS
from circnav_mav.mav.session import Session
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.height import READ
from circnav_mav.pilot.mission_state import MissionState
from circnav_mav.pilot.range_tracker import RangeTracker

OTHER_IMUS = dialect.MAVLINK_MSG_ID_SCALED_IMU2, dialect.MAVLINK_MSG_ID_SCALED_IMU3
"""Messages of the IMUs beside the first."""


class AirPath:
    """Passes the motion of the vehicle to tracker and controller.

    own: newest motion through the air, or None before an attitude was received.
    implausible_airspeed: measured airspeed (m/s) that is ignored, or None while it is plausible.
    """

    reads = READ | {"GLOBAL_POSITION_INT", "ATTITUDE", "ATTITUDE_QUATERNION", *ACCELERATIONS}
    """Types of the messages that `receive` processes."""

    def __init__(
        self,
        session: Session,
        tracker: RangeTracker,
        controller: Controller,
        mission: MissionState,
        *,
        flies: bool,
    ) -> None:
        """flies: False in a dry run."""
        self._session = session
        self._mission = mission
        self._flies = flies
        self._tracker = tracker
        self._controller = controller
        self._other_imus_requested = False
        self.own: OwnMotion | None = None
        self.implausible_airspeed: float | None = None

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle. Update the height and, if the message is an attitude,
        the turn response and the estimators."""
        steering = self._mission.steering
        adapter = self._session.adapter
        motion = self._session.motion
        controller = self._controller
        motion.keeps_heading = steering
        is_attitude = motion.receive(message, now)
        if motion.accelerations.failed and not self._other_imus_requested:
            self._request_other_imus()
        if message.get_type() in READ:
            self._tracker.height.receive(message, motion.at(now), now)
        if not is_attitude:
            return
        nose = motion.own(now, self._airspeed(now), banks=adapter.fixed_wing)
        if nose is None:
            return
        own = self._along_path(nose, now)
        self.own = own
        controller.vehicle.on_motion(own, nose)
        # A vehicle without an airspeed sensor has the commanded airspeed while it follows its
        # commands. In a dry run another program commands the vehicle: assume the commanded airspeed
        # while the vehicle turns as our commands would turn it.
        follows = controller.vehicle.at_speed if self._flies else controller.vehicle.followed
        if not adapter.holds_ground_speed or (steering and follows):
            self._tracker.estimator.move(own)

    def _along_path(self, nose: OwnMotion, now: float) -> OwnMotion:
        """Return the motion of the vehicle along its path."""
        adapter = self._session.adapter
        if adapter.air is not None:
            return self._by_air(adapter.air, nose, now)
        # A rover drives along its nose: its acceleration shows no wind.
        return nose._replace(acceleration=None) if adapter.holds_ground_speed else nose

    def _by_air(self, air: CopterAir, nose: OwnMotion, now: float) -> OwnMotion:
        """Return the motion of a copter along its path."""
        thrust_acceleration, force = self._session.motion.forces(now)
        steering = self._mission.steering
        if self._session.adapter.airspeed_from_drag:
            relative = self._tracker.relative
            scale = None if relative is None else relative.scale
            return air.through_air(nose, force, steering=steering, scale=scale)
        settled = self._controller.vehicle.at_speed
        return air.over_ground(nose, thrust_acceleration, force, steering=steering, settled=settled)

    def _request_other_imus(self) -> None:
        """Request the other IMUs once, without a check that they arrive: the vehicle may have
        none."""
        self._other_imus_requested = True
        for ident in OTHER_IMUS:
            # 25: rate, Hz, as of the first IMU.
            interval = Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (ident, 1e6 / 25))
            self._session.commands.send(interval)

    def _airspeed(self, now: float) -> float:
        """Return the true airspeed, m/s: the measured airspeed if a plausible one is available,
        else the commanded speed."""
        adapter = self._session.adapter
        motion = self._session.motion.at(now)
        measured = motion.airspeed if adapter.fixed_wing else None
        used = adapter.airspeed(measured)
        self.implausible_airspeed = measured if measured != used else None
        return (
            motion.true_airspeed(used)
            if adapter.fixed_wing
            else self._controller.speed(self._session)
        )
