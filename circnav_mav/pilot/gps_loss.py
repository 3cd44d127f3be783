"""Loss of GPS in flight: a copter that circles in GUIDED continues by attitude setpoints, without a
position.

ArduCopter lands 8 s after the loss, because GUIDED requires a position. The loss is detected from
the fix type of the receivers (GPS_RAW_INT, GPS2_RAW), and from the position flags of
EKF_STATUS_REPORT. ArduCopter clears these flags 7 s after the loss. Positions and velocities in
these messages are never read.
"""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.estimators.interface import MethodChange
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.session import Session
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.air_path import AirPath
from circnav_mav.pilot.connection import GPS_HEALTH_RATE
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.pilot.range_tracker import RangeTracker

RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
POSITION_FLAGS = dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS


class GpsLoss:
    """Detects the loss of GPS, and changes the steering method once.

    reads: types of the messages that `receive` processes.
    path: motion through the air.
    changed_at: time of the change, s, or None before it.
    failure: human-readable reason why the vehicle refused the new mode, or empty.
    """

    reads = frozenset((*RECEIVERS, "EKF_STATUS_REPORT"))

    def __init__(
        self,
        settings: Mission,
        session: Session,
        tracker: RangeTracker,
        controller: Controller,
        path: AirPath,
    ) -> None:
        self._settings = settings
        self._session = session
        self._tracker = tracker
        self._controller = controller
        self.path = path
        self._fixes: dict[str, bool] = {}
        """True for the receivers that have a 3D fix, by message type."""
        self._without_fix_since: float | None = None
        self._had_position = False
        self._without_position = 0
        """Number of consecutive EKF_STATUS_REPORT without a position, after one with a position."""
        self._request = ModeRequest()
        self.changed_at: float | None = None
        self.failure = ""

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle."""
        kind = message.get_type()
        if kind in RECEIVERS:
            if not self._fixes and self._settings.flies_without_gps:
                # Many vehicles have no second receiver. So its stream is requested once, without a
                # check that it arrives.
                second = dialect.MAVLINK_MSG_ID_GPS2_RAW, 1e6 / GPS_HEALTH_RATE
                self._session.commands.send(Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, second))
            had_fix = any(self._fixes.values())
            self._fixes[kind] = message.fix_type >= dialect.GPS_FIX_TYPE_3D_FIX
            if any(self._fixes.values()):
                self._without_fix_since = None
            elif had_fix:
                self._without_fix_since = now
        else:
            has_position = bool(message.flags & POSITION_FLAGS)
            self._had_position |= has_position
            lost = self._had_position and not has_position
            self._without_position = self._without_position + 1 if lost else 0

    def _is_lost(self, now: float) -> bool:
        """True if the vehicle loses its position now, or soon."""
        since = self._without_fix_since
        # A single report without flags is no loss: the copter would fly without GPS until its end.
        if self._without_position >= 2 or (self._without_position and since is not None):
            return True
        # 1.0: time without a fix of any receiver, s, after which the GPS is treated as lost. The
        # autopilot's estimator bridges shorter gaps.
        return since is not None and now - since >= 1.0

    def step(self, now: float) -> str:
        """If the GPS is lost, change to the setpoint method without GPS. Request the mode of this
        method until the vehicle reports it.

        Call while the vehicle is steered. Return a text for the operator at the change, else an
        empty string.
        """
        session = self._session
        if self.changed_at is None:
            method = session.adapter.without_gps
            if not self._settings.flies_without_gps or method is None or not self._is_lost(now):
                return ""
            self._change(method(self._settings.facts), now)
            return f"GPS lost, {session.adapter.guided_name}"
        if not self.failure:
            self.failure = self._request.ask(session, session.adapter.guided_mode, now) or ""
        if session.vehicle.mode == session.adapter.guided_mode:
            session.adapter.our_modes = frozenset((session.adapter.guided_mode,))
        return ""

    def _change(self, adapter: Autopilot, now: float) -> None:
        """Steer by another method from now on. Target, wind and airspeed scale are kept."""
        self.changed_at = now
        fit = self.path.scale_fit
        wind = self.path.wind
        self._session.change_method(adapter)
        self._controller.hold_airspeed(fit.scale)
        self._tracker.estimator.fly_through_air(
            MethodChange(
                (wind.x, wind.y),
                wind.sigma,
                fit.scale,
                fit.sigma,
                self._settings.estimation_by_drag,
            )
        )
