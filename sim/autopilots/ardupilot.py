"""What the ArduPilot vehicles have in common: modes, arming, the ground station's and the estimator's failsafes."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from sim.agenda import NEVER
from sim.autopilots.contract import ACCEPTED, DENIED, FAILED, FORCE, WARNING, Command, Identity, Say
from sim.body import Body
from sim.config import Event
from sim.params import Parameters
from sim.wire import Message

CUSTOM_MODE_ENABLED = 1
DO_SET_MODE, ARM_DISARM = 176, 400
HEARTBEAT, SET_MODE, SET_ORIGIN = 0, 11, 48
DEAD_RECKONING_US = 8_000_000  # from the loss of the GPS to "EKF variance"

# REQUEST_DATA_STREAM groups (GCS_Mavlink.cpp of the vehicles).
STREAM_GROUPS: Mapping[int, tuple[int, ...]] = {
    1: (27, 116),
    2: (1, 24, 62),
    3: (65,),
    6: (33, 32),
    10: (30,),
    11: (74,),
    12: (2, 132, 147, 168, 193),
}


class Sensed(NamedTuple):
    """Where a vehicle's velocity can come from."""

    gps: bool
    odometry: bool


class Rules(Protocol):
    """What each vehicle decides differently."""

    def obstacle(self, mode: int) -> str | None:
        """Why a mode cannot be entered now, in ArduPilot's words."""

    def entered(self, mode: int, now: int) -> None: ...

    def arming_refusal(self) -> str | None: ...

    def flying(self, body: Body) -> bool: ...

    def disarmed(self) -> None: ...

    def ground_station_lost(self, now: int) -> None: ...

    def estimator_lost(self, now: int) -> None: ...

    def radio_lost(self, now: int) -> None: ...


class Core:
    """Mode, arming and failsafes of one ArduPilot vehicle."""

    def __init__(
        self, identity: Identity, params: Parameters, say: Say, rules: Rules, mode: int, armed: bool, sensed: Sensed
    ) -> None:
        self.identity = identity
        self.params = params
        self.say = say
        self.mode = mode
        self.armed = armed
        self.gps = self.position = sensed.gps
        self._odometry = sensed.odometry
        self.failsafe = False
        self._rules = rules
        self._names = {number: name for name, number in identity.modes.items()}
        self._gcs_switch = "FS_GCS_ENABLE" if "FS_GCS_ENABLE" in params else "FS_GCS_ENABL"  # the plane's name
        self._gcs_heard: int | None = None
        self._position_until = NEVER

    # -- modes and arming ---------------------------------------------------------------------------------------------

    def change_mode(self, number: int, now: int) -> int:
        """Enter a mode unless it is unknown or something stands against it; the ack."""
        if number == self.mode:
            return ACCEPTED
        if number not in self._names:
            self.say(WARNING, f"No such mode {number}")
            return FAILED
        reason = self._rules.obstacle(number)
        if reason is not None:
            self.say(WARNING, self.identity.mode_refusal.format(name=self._names[number], reason=reason))
            return FAILED
        self.force_mode(number, now)
        return ACCEPTED

    def force_mode(self, number: int, now: int) -> None:
        self.mode = number
        self._rules.entered(number, now)

    def command(self, command: Command, now: int, body: Body) -> int | None:
        """The ack of a command that all vehicles share, None of any other."""
        if command.number == DO_SET_MODE:
            base, custom = command.params[0], command.params[1]
            if not (abs(base) < 2**31 and int(base) & CUSTOM_MODE_ENABLED):
                return DENIED
            return self.change_mode(int(custom) if abs(custom) < 2**31 else -1, now)
        if command.number == ARM_DISARM:
            return self._arm(command.params[0], command.params[1] == FORCE, body)
        return None

    def _arm(self, wish: float, force: bool, body: Body) -> int:
        if wish == 1:
            refusal = self._rules.arming_refusal()
            if not self.armed and refusal is not None and not force:
                self.say(WARNING, f"Arm: {refusal}")
                return FAILED
            self.armed = True
            return ACCEPTED
        if wish != 0:
            return DENIED
        if self.armed and self._rules.flying(body) and not force:
            return FAILED
        self.disarm()
        return ACCEPTED

    def disarm(self) -> None:
        self.armed = False
        self._rules.disarmed()

    # -- failsafes ----------------------------------------------------------------------------------------------------

    def heard(self, message: Message, now: int) -> None:
        number = message.get_msgId()
        if number == SET_MODE and message.base_mode & CUSTOM_MODE_ENABLED:  # obeyed, but has no ack
            self.change_mode(message.custom_mode, now)
        if number == HEARTBEAT and message.get_srcSystem() == self.params["SYSID_MYGCS"]:
            self._gcs_heard = now
            self.failsafe = False
        if number == SET_ORIGIN and self._odometry:
            self.position = True

    def wake_us(self) -> int:
        return min(self._gcs_deadline(), self._position_until)

    def wake(self, now: int) -> None:
        if now >= self._position_until:
            self._position_until = NEVER
            self.position = self._odometry
            if self.position:
                return
            self.say(2, "EKF variance")
            self._rules.estimator_lost(now)
        if now >= self._gcs_deadline():
            self.failsafe = True
            self._gcs_heard = None
            self._rules.ground_station_lost(now)

    def happen(self, event: Event, now: int) -> None:
        """A scripted event that ArduPilot itself notices."""
        if event.action == "mode":
            self.change_mode(self.identity.modes[event.mode or ""], now)
        elif event.action == "arm":
            self.armed = True
        elif event.action == "disarm":
            self.disarm()
        elif event.action == "rc_failsafe":
            self.say(WARNING, "Radio Failsafe")
            self._rules.radio_lost(now)
        elif event.action == "gps_off" and self.gps:
            self.gps, self._position_until = False, now + DEAD_RECKONING_US
        elif event.action == "gps_on":
            self.gps, self.position, self._position_until = True, True, NEVER

    def _gcs_deadline(self) -> int:
        if self._gcs_heard is None or not self.armed or self.params[self._gcs_switch] == 0:
            return NEVER
        once_more = self.params.get("FS_TIMEOUT", 0.0)  # the rover's
        return self._gcs_heard + round((self.params["FS_GCS_TIMEOUT"] + once_more) * 1e6)
