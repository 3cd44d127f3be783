"""Steering method of a flight. At a loss of GPS, a copter that circles in GUIDED continues by
attitude setpoints, without a position.

ArduCopter lands 8 s after the loss, because GUIDED requires a position. The loss is detected from
the fix type of the receivers (GPS_RAW_INT, GPS2_RAW), and from the position flags of
EKF_STATUS_REPORT. ArduCopter clears these flags 7 s after the loss. Positions and velocities in
these messages are never read.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.estimators.interface import MethodChange
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.session import Session
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.mission_state import Event, Outcome
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.timers import Every, Hysteresis

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot

RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
READS = (
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
    dialect.MAVLINK_MSG_ID_GPS2_RAW,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
)
"""Ids of the messages that show a loss of GPS."""
RATE = 4.0
"""Requested rate of these messages, Hz. ArduCopter clears its estimator flags only 0.8 s before its
failsafe acts."""
WITHOUT_STREAM = {
    "GPS_RAW_INT": "a loss of GPS is detected only 1 s before the failsafe",
    "EKF_STATUS_REPORT": "a loss of GPS is detected only by the fix type",
}
"""Consequence of a missing stream, human-readable."""
POSITION_FLAGS = dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS


def streams(mission: Mission) -> Mapping[int, float]:
    """Return the streams that show when to change the method, message id -> Hz. Empty if the
    mission flies one method."""
    changes = any(len(mission.methods(vehicle)) > 1 for vehicle in mission.vehicles)
    # Many vehicles have no second receiver, so its stream is not monitored.
    return {READS[0]: RATE, READS[2]: RATE} if changes else {}


class MethodMonitor:
    """Monitor that replaces the steering method once.

    reads: types of the messages that `receive` processes.
    failure: None before the change. Then the reason why the vehicle refused the new mode,
        human-readable, or an empty string.
    """

    reads = frozenset(dialect.mavlink_map[ident].msgname for ident in READS)

    def __init__(self) -> None:
        self._fixes: dict[str, bool] = {}
        """True for the receivers that have a 3D fix now, False for those that have lost it. The key
        is the message type."""
        # 1.0: time without a fix of any receiver, s, after which the GPS is treated as lost. The
        # autopilot's estimator bridges shorter gaps.
        self._without_fix = Hysteresis(raise_after=1.0)
        self._without_position = -inf
        """Number of consecutive EKF_STATUS_REPORT without a position, after one with a position."""
        self._second_receiver = Every(inf)
        self._request = ModeRequest()
        self.failure: str | None = None

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle."""
        kind = message.get_type()
        if kind in RECEIVERS:
            has_fix = message.fix_type >= dialect.GPS_FIX_TYPE_3D_FIX
            if has_fix or kind in self._fixes:
                self._fixes[kind] = has_fix
            self._is_without_fix(now)
        elif message.flags & POSITION_FLAGS:
            self._without_position = 0
        else:
            self._without_position += 1

    def __call__(self, pilot: Pilot, now: float) -> tuple[Event | Outcome, ...]:
        """Change the method of a steered vehicle if it has lost its GPS. Then request the mode of
        the new method until the vehicle reports it."""
        for method in pilot.settings.methods(type(pilot.session.adapter))[1:]:
            if self._fixes and self._second_receiver.due(now):
                # The stream of a second receiver is requested once, without a check that it
                # arrives.
                stream = Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (READS[1], 1e6 / RATE))
                pilot.session.commands.send(stream)
            if pilot.flies and pilot.mission.steering and self._is_lost(now):
                self._change(pilot, method(pilot.settings.facts))
                return ()
        if self.failure is not None and pilot.mission.steering:
            self._request_mode(pilot.session, now)
        return ()

    def _request_mode(self, session: Session, now: float) -> None:
        mode = session.adapter.guided_mode
        self.failure = self.failure or self._request.ask(session, mode, now) or ""
        if session.vehicle.mode == mode:
            # From now on the mode of the old method is a takeover.
            session.adapter.our_modes = frozenset((mode,))

    def _is_lost(self, now: float) -> bool:
        """True if the vehicle loses its position now, or soon."""
        # A single report without flags is no loss: the copter would fly without GPS until its end.
        if self._is_without_fix(now) or self._without_position >= 2:
            return True
        return self._without_position > 0 and self._without_fix.since is not None

    def _is_without_fix(self, now: float) -> bool:
        """True if all receivers have lost their fix for long enough."""
        lost = bool(self._fixes) and not any(self._fixes.values())
        return self._without_fix.update(lost, now)

    def _change(self, pilot: Pilot, adapter: Autopilot) -> None:
        """Steer by another method from now on. Target, wind and airspeed scale are kept."""
        self.failure = ""
        fit = pilot.path.scale_fit
        wind = pilot.path.wind
        pilot.session.change_method(adapter)
        pilot.controller.hold_airspeed(fit.scale)
        pilot.tracker.estimator.fly_through_air(
            MethodChange(
                (wind.x, wind.y),
                wind.sigma,
                fit.scale,
                fit.sigma,
                pilot.settings.estimation_of(type(adapter)),
            )
        )
        pilot.second_controller.reset()
        text = f"GPS lost, {adapter.guided_name}"
        pilot.session.announcer.say("gps", text, severity=dialect.MAV_SEVERITY_WARNING)
