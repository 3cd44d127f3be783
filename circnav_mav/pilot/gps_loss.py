"""Loss of GPS in flight: a copter that circles in GUIDED goes on by attitude setpoints, without a position.

ArduCopter lands 8 s after the loss, because GUIDED requires a position. The loss is read from the health of the GPS in
SYS_STATUS. The position itself is never read.
"""

from pymavlink.dialects.v20.all import MAV_SYS_STATUS_SENSOR_GPS as GPS

from circnav_mav.guidance.estimators.interface import MethodChange
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.codec import Message
from circnav_mav.mav.session import Session
from circnav_mav.pilot.air_path import AirPath
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.pilot.range_tracker import RangeTracker
from circnav_mav.pilot.settings import PilotSettings

LOST_FOR = 1.0
"""Time, s, for which the GPS must be unhealthy: single late messages of a receiver make it unhealthy for less."""


class GpsLoss:
    """Detects the loss of GPS, and changes the steering method once.

    changed_at: time of the change, s, or None. failure: reason why the vehicle refused the mode, human-readable.
    """

    def __init__(
        self, settings: PilotSettings, session: Session, tracker: RangeTracker, controller: Controller, path: AirPath
    ) -> None:
        self._settings, self._session = settings, session
        self._tracker, self._controller, self._path = tracker, controller, path
        self._was_healthy = False
        self._unhealthy_since: float | None = None
        self._request = ModeRequest()
        self.changed_at: float | None = None
        self.failure = ""

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle."""
        if message.get_type() != "SYS_STATUS":
            return
        if message.onboard_control_sensors_health & GPS:
            self._was_healthy = True
            self._unhealthy_since = None
        elif self._was_healthy and self._unhealthy_since is None:
            self._unhealthy_since = now

    def step(self, now: float) -> str:
        """Change the method if the GPS is lost, and request its mode until the vehicle reports it. Call while the
        vehicle is steered. Return a text for the operator at the change, else an empty string."""
        session = self._session
        if self.changed_at is None:
            since = self._unhealthy_since
            method = session.adapter.without_gps
            if not self._settings.flies_without_gps or method is None or since is None or now - since < LOST_FOR:
                return ""
            self._change(method(self._settings.facts), now)
            return f"GPS lost: {session.adapter.guided_name}"
        if session.vehicle.mode == session.adapter.guided_mode:
            session.adapter.our_modes = frozenset((session.adapter.guided_mode,))
        elif not self.failure:
            self.failure = self._request.ask(session, session.adapter.guided_mode, now) or ""
        return ""

    def _change(self, adapter: Autopilot, now: float) -> None:
        """Steer by another method from now on. Target, wind and airspeed scale are kept."""
        self.changed_at = now
        fit, wind = self._path.scale_fit, self._path.wind
        self._session.change_method(adapter)
        self._controller.hold_airspeed(fit.scale)
        self._tracker.estimator.fly_through_air(
            MethodChange((wind.x, wind.y), wind.sigma, fit.scale, fit.sigma, self._settings.estimation_without_gps)
        )
