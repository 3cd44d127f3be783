"""Common part of the ArduPilot vehicles: modes, arming, and failsafes for a lost ground station or
a lost position estimate."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from ..agenda import NEVER
from ..body import Body
from ..config import Event, VehicleConfig
from ..links import Message
from ..params import Parameters
from ..world import HOME_AMSL_M, from_degrees
from .contract import (
    CUSTOM_MODE_ENABLED,
    FORCE,
    STANDBY,
    Ack,
    Autopilot,
    Command,
    Identity,
    Say,
    Severity,
)

STABILIZED = 16
DO_SET_MODE = 176
ARM_DISARM = 400
DO_REPOSITION = 192
# Measured on 4.6.3: time from the loss of GPS to the loss of the reported location
LOCATION_LOSS_US = 15_000_000
# MAV_FRAMEs with altitudes above sea level, and above home
SEA_LEVEL = (0, 5)
ABOVE_HOME = (3, 6)

# Message ids by group of REQUEST_DATA_STREAM (GCS_Mavlink.cpp of the vehicles).
STREAM_GROUPS: Mapping[int, tuple[int, ...]] = {
    1: (27, 116, 129, 29),
    2: (1, 24, 62),
    3: (65,),
    6: (33, 32),
    10: (30,),
    11: (74,),
    12: (2, 132, 147, 168, 193),
}


class ArduPilot(Autopilot):
    """Modes, arming and failsafes. Each vehicle lists its modes with special properties in sets."""

    # Measured on 4.6.3 from the loss of GPS: modes "require position", then "EKF variance"
    POSITION_LOSS_US = 7_500_000
    VARIANCE_US = 8_000_000
    NEEDS_POSITION: frozenset[int] = frozenset()
    NOT_ARMABLE: frozenset[int]
    MANUAL_MODES: frozenset[int]
    GUIDED_MODES: frozenset[int]  # modes without pilot input
    MODE_COMMANDS: ClassVar[Mapping[int, int]]
    BASE_MODE = CUSTOM_MODE_ENABLED | STABILIZED

    def __init__(
        self, identity: Identity, params: Parameters, config: VehicleConfig, say: Say, body: Body
    ) -> None:
        super().__init__(identity, params, config, say, body)
        self._odometry = config.vehicle.odometry
        self.failsafe = False
        self._variance_at = NEVER  # time of the failsafe for the loss of the position
        # The parameter has a shorter name on a plane.
        self._gcs_switch = "FS_GCS_ENABLE" if "FS_GCS_ENABLE" in params else "FS_GCS_ENABL"
        self._gcs_heartbeat_at: int | None = None

    @abstractmethod
    def disarmed(self) -> None: ...

    @abstractmethod
    def failsafe_mode(self) -> int:
        """Return the mode of a failsafe."""

    @abstractmethod
    def ground_station_lost(self, now: int) -> None: ...

    def estimator_lost(self, now: int) -> None:
        """React to the loss of the position estimate. A plane never loses its estimate, because the
        estimator continues with airspeed."""

    @abstractmethod
    def go_to(self, north: float, east: float, down: float, now: int) -> None:
        """Fly to a place in GUIDED and stay there."""

    def own_command(self, command: Command, now: int) -> int:
        return Ack.UNSUPPORTED

    def change_mode(self, mode: int, now: int) -> int:
        if mode == self.mode:
            return Ack.ACCEPTED
        if mode not in self.identity.modes.values():
            self.say(Severity.WARNING, f"No such mode {mode}")
            return Ack.FAILED
        lost = mode in self.NEEDS_POSITION and not self.position
        if lost or (mode == self.identity.modes["AUTO"] and self.waypoint is None):
            reason = "requires position" if lost else "missing mission"
            self.say(
                Severity.WARNING,
                self.identity.mode_refusal.format(name=self.mode_name(mode), reason=reason),
            )
            return Ack.FAILED
        self.force_mode(mode, now)
        return Ack.ACCEPTED

    def force_mode(self, mode: int, now: int) -> None:
        self.mode = self.intended = mode
        self.entered(mode, now)

    def command(self, command: Command, now: int) -> tuple[int, ...]:
        if command.number == DO_SET_MODE:
            base, custom = command.params[:2]
            if not (abs(base) < 2**31 and int(base) & CUSTOM_MODE_ENABLED):
                return (Ack.DENIED,)
            return (self.change_mode(int(custom) if abs(custom) < 2**31 else -1, now),)
        if command.number == ARM_DISARM:
            return (self._arm(command.params[0], command.params[1] == FORCE),)
        if command.number == DO_REPOSITION:
            return (self._reposition(command, now),)
        mode = self.MODE_COMMANDS.get(command.number)
        return (self.own_command(command, now) if mode is None else self.change_mode(mode, now),)

    def _reposition(self, command: Command, now: int) -> int:
        """Handle DO_REPOSITION in GUIDED, or with the flag that enters GUIDED
        (handle_command_int_do_reposition).

        A real vehicle also accepts it on the ground and stays there. Here it is refused.
        """
        guided = self.identity.modes["GUIDED"]
        flags = command.params[1]
        changes_mode = 0 <= flags < 2**31 and int(flags) & 1
        if self.mode != guided and not changes_mode:
            return Ack.DENIED
        place = abs(command.x) <= 90 and abs(command.y) <= 180 and abs(command.z) < 10_000
        if not place or command.frame not in SEA_LEVEL + ABOVE_HOME:
            return Ack.DENIED
        standing = not self.armed or self.system_status() == STANDBY
        if standing or self.change_mode(guided, now) != Ack.ACCEPTED:
            return Ack.FAILED
        height = command.z - (HOME_AMSL_M if command.frame in SEA_LEVEL else 0.0)
        self.go_to(*from_degrees(command.x, command.y), -height, now)
        return Ack.ACCEPTED

    def _arm(self, wish: float, force: bool) -> int:
        if wish not in (0, 1):
            return Ack.DENIED
        if wish == 1 and not self.armed and not force:
            lost = self.mode in self.NEEDS_POSITION and not self.position
            if lost or self.mode in self.NOT_ARMABLE:
                why = (
                    "Mode not armable"
                    if self.mode in self.NOT_ARMABLE
                    else "Need Position Estimate"
                )
                self.say(Severity.WARNING, f"Arm: {why}")
                return Ack.FAILED
        if wish == 0 and self.armed and not force and self.flying():
            return Ack.FAILED
        self.set_armed(wish == 1)
        return Ack.ACCEPTED

    def set_armed(self, armed: bool, now: int = 0) -> None:
        self.armed = armed
        if not armed:
            self.disarmed()

    def on_event(self, event: Event, now: int) -> None:
        if event.action == "gps_off" and self.gps:
            self._variance_at = now + self.VARIANCE_US
        super().on_event(event, now)

    def on_message(self, message: Message, now: int) -> None:
        super().on_message(message, now)
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.get_srcSystem() == self.params["SYSID_MYGCS"]:
            self._gcs_heartbeat_at = now
            self.failsafe = False
        if kind == "SET_GPS_GLOBAL_ORIGIN" and self._odometry:
            self.position = True

    def locates(self, now: int) -> bool:
        return self.position or now < self._gps_lost_at + LOCATION_LOSS_US

    def wake_us(self) -> int:
        return min(super().wake_us(), self._gcs_deadline(), self._variance_at)

    def wake(self, now: int) -> None:
        if now >= self._position_until:
            self._position_until = NEVER
            self.position = self._odometry
        if now >= self._variance_at:
            self._variance_at = NEVER
            if not self.position:
                self.say(Severity.CRITICAL, "EKF variance")
                self.estimator_lost(now)
        if now >= self._gcs_deadline():
            self.failsafe = True
            self._gcs_heartbeat_at = None
            self.ground_station_lost(now)

    def fail_to(self, mode: int, now: int, severity: int, text: str) -> None:
        self.failsafe = True
        self.say(severity, text)
        self.force_mode(mode, now)

    def radio_lost(self, now: int) -> None:
        self.fail_to(self.failsafe_mode(), now, Severity.WARNING, "Radio Failsafe")

    def _gcs_deadline(self) -> int:
        if self._gcs_heartbeat_at is None or not self.armed or self.params[self._gcs_switch] == 0:
            return NEVER
        once_more = self.params.get("FS_TIMEOUT", 0.0)  # the rover waits for this time in addition
        return self._gcs_heartbeat_at + round((self.params["FS_GCS_TIMEOUT"] + once_more) * 1e6)

    def base_mode(self) -> int:
        manual = 64 if self.mode in self.MANUAL_MODES else 0
        guided = 8 if self.mode in self.GUIDED_MODES else 0
        return self.BASE_MODE | manual | guided | (128 if self.armed else 0)

    def active(self) -> bool:
        return self.flying()
