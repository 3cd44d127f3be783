"""Common part of the PX4 vehicles: modes and their requirements, OFFBOARD's watchdog, double
acks."""

import math
from abc import abstractmethod

from ..agenda import NEVER
from ..body import Body
from ..config import Event, VehicleConfig
from ..demands import Spin, Tilt
from ..links import Message
from ..params import Parameters
from ..world import HOME_AMSL_M, from_degrees
from .contract import FORCE, Ack, Autopilot, Command, Identity, Say, Severity
from .modes import PX4 as MODES
from .px4_targets import Rejected, Trajectory, read_setpoint
from .sticks import Sticks

MANUAL = MODES["MANUAL"]
ALTCTL = MODES["ALTCTL"]
POSCTL = MODES["POSCTL"]
TAKEOFF = MODES["TAKEOFF"]
LOITER = MODES["LOITER"]
RTL = MODES["RTL"]
LAND = MODES["LAND"]
OFFBOARD = MODES["OFFBOARD"]
NEEDS_STICKS = frozenset(
    MODES[name] for name in ("MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "ALT_CRUISE")
)
NEEDS_POSITION = frozenset({POSCTL, LOITER, RTL, TAKEOFF, MODES["MISSION"]})
MAIN_AUTO = 4
DO_SET_MODE = 176
ARM_DISARM = 400
DO_CHANGE_SPEED = 178
DO_REPOSITION = 192
TAKEOFF_COMMAND = 22
MODE_COMMANDS = {20: RTL, 21: LAND, 17: LOITER}
NOT_GIVEN = (2**31 - 1) * 1e-7  # degrees, "not given" in a COMMAND_INT; in a COMMAND_LONG it is NaN
LOSS_DELAY_US = 50_000
LOSS_ACTIONS = {
    3: RTL,
    4: LAND,
    5: LOITER,
}  # mode by COM_OBL_RC_ACT; without sticks, any other value means RTL
STICK_LOSS_ACTIONS = {
    1: LOITER,
    2: RTL,
    3: LAND,
}  # mode by NAV_RCL_ACT; 5 (terminate) and 6 (disarm) stop the motors
STICK_LOSS_EXCEPTIONS = {
    MODES["MISSION"]: 1,
    LOITER: 2,
    TAKEOFF: 2,
    OFFBOARD: 4,
}  # bit of COM_RCL_EXCEPT by mode: no failsafe for lost sticks


class Px4(Autopilot):
    """PX4's Commander: the intended mode, the flown mode, and the watchdogs that change the flown
    mode."""

    FIRST_MODE = "LOITER"
    POSITION_LOSS_US = 5_000_000

    def __init__(
        self, identity: Identity, params: Parameters, config: VehicleConfig, say: Say, body: Body
    ) -> None:
        super().__init__(identity, params, config, say, body)
        self.sticks = Sticks(config.vehicle.system_id)
        self.take_off_to: float | None = None
        self.cruise: float | None = None  # m/s, from DO_CHANGE_SPEED, for modes without pilot input
        self._setpoint: Trajectory | Tilt | Spin | None = None
        self._setpoint_at: int | None = 0 if self.mode == OFFBOARD else None
        self._sticks_lost = False  # failsafe of lost sticks is active, until a mode is commanded
        # Time of the last stick message before a loss that was handled
        self._missed: int | None = None
        self._act_at = NEVER

    @abstractmethod
    def hold_at(self, place: tuple[float, float] | None, down: float | None) -> None:
        """Hold at a place (north, east) and a height (down), m. None: the present one."""

    def needs_velocity(self) -> bool:
        """True if the setpoint in OFFBOARD requires a velocity estimate."""
        return not isinstance(self._setpoint, (Tilt, Spin))

    @property
    def failsafe(self) -> bool:  # type: ignore[override]
        return self._sticks_lost or self.mode != self.intended

    def setpoint(self, message: Message, now: int) -> bool:
        """Handle a setpoint. An accepted setpoint feeds the watchdog, and returns to OFFBOARD if
        OFFBOARD is still intended."""
        if message.get_type() == "MANUAL_CONTROL":
            return self.sticks.receive(message, now, None)
        taken = read_setpoint(message, self.body)
        if isinstance(taken, Rejected):
            self.say(Severity.ERROR, taken.text)
            return False
        if taken is None:
            return False
        self._setpoint = taken
        self._setpoint_at = now
        self._return_to_offboard(now)
        return True

    def _return_to_offboard(self, now: int) -> None:
        """Return to OFFBOARD after the failsafe of OFFBOARD. After the failsafe of lost sticks, PX4
        does not return."""
        fell_out = self.mode != self.intended and not self._sticks_lost
        if fell_out and self.intended == OFFBOARD and self._obstacle(OFFBOARD, now) is None:
            self._fly_mode(OFFBOARD, now)

    def wake_us(self) -> int:
        return min(
            super().wake_us(), self._offboard_deadline(), self._sticks_deadline(), self._act_at
        )

    def wake(self, now: int) -> None:
        if now >= self._position_until:
            self._position_until = NEVER
            self.position = False
            if self.mode == POSCTL or (self.mode == OFFBOARD and self.needs_velocity()):
                self._fail_to(ALTCTL, now)
        if now >= self._offboard_deadline():
            action = int(self.params["COM_OBL_RC_ACT"])
            self._fail_to(LOSS_ACTIONS.get(action, RTL), now)
        if now >= self._sticks_deadline():
            self._lose_sticks(now)
        if now >= self._act_at:
            self._act_at = NEVER
            self._fail_to(STICK_LOSS_ACTIONS.get(int(self.params["NAV_RCL_ACT"]), LOITER), now)

    def _lose_sticks(self, now: int) -> None:
        """Hold, so that a pilot can select a mode. After COM_FAIL_ACT_T, do the action of
        NAV_RCL_ACT, even if the sticks have returned."""
        self._missed = self.sticks.last
        number = int(self.params["NAV_RCL_ACT"])
        delay = self.params["COM_FAIL_ACT_T"]
        action = STICK_LOSS_ACTIONS.get(number)
        if action is None:
            if number in (5, 6):
                self.set_armed(False, now)
        elif action == RTL and self.intended == LAND:
            # Only warn: the vehicle is landing already.
            self.say(Severity.CRITICAL, "Failsafe activated")
        else:
            self._sticks_lost = True
            self._act_at = now + round(delay * 1e6)
            self._fail_to(LOITER, now, f"Failsafe activated: entering Hold for {delay:.0f} seconds")

    def _fail_to(self, mode: int, now: int, text: str = "Failsafe activated") -> None:
        self.say(Severity.CRITICAL, text)
        self._fly_mode(mode, now)

    def _offboard_deadline(self) -> int:
        if self.mode != OFFBOARD or not self.armed or self._setpoint_at is None:
            return NEVER
        return self._setpoint_at + self.params.microseconds("COM_OF_LOSS_T") + LOSS_DELAY_US

    def _sticks_deadline(self) -> int:
        """Return the time at which silent sticks are treated as lost. Sticks are lost once per
        silence, and never in the modes of COM_RCL_EXCEPT."""
        last = self.sticks.last
        excepted = int(self.params["COM_RCL_EXCEPT"]) & STICK_LOSS_EXCEPTIONS.get(self.intended, 0)
        if not self.armed or self.failsafe or last is None or last == self._missed or excepted:
            return NEVER
        return last + self.params.microseconds("COM_RC_LOSS_T")

    def change_mode(self, mode: int, now: int) -> int:
        reason = self._obstacle(mode, now)
        if reason is not None:
            self.say(
                Severity.CRITICAL,
                f"Switching to mode '{self.mode_name(mode).capitalize()}' is currently not"
                f" available: {reason}",
            )
            return Ack.TEMPORARILY_REJECTED
        self.intended = mode
        self._sticks_lost = False
        self._act_at = NEVER
        if self.mode != mode:
            self._fly_mode(mode, now)
        return Ack.ACCEPTED

    def _fly_mode(self, mode: int, now: int) -> None:
        self.mode = mode
        self.entered(mode, now)

    def _obstacle(self, mode: int, now: int) -> str | None:
        if mode not in self.identity.modes.values():
            return "no such mode"
        if not self.armed:
            return None
        if mode == OFFBOARD:
            age = NEVER if self._setpoint_at is None else now - self._setpoint_at
            if age > self.params["COM_OF_LOSS_T"] * 1e6:
                return "no offboard signal"
            return "no velocity estimate" if self.needs_velocity() and not self.position else None
        if mode in NEEDS_STICKS and not self.sticks_alive(now):
            return "no manual control input"
        return "no position estimate" if mode in NEEDS_POSITION and not self.position else None

    def sticks_alive(self, now: int) -> bool:
        return self.sticks.alive(now, self.params.microseconds("COM_RC_LOSS_T"))

    def command(self, command: Command, now: int) -> tuple[int, ...]:
        number = command.number
        # PX4's MAVLink receiver acknowledges every mode request as accepted. Then Commander sends a
        # second ack with the result.
        if number == DO_SET_MODE:
            return (Ack.ACCEPTED, self._set_mode(command, now))
        if number == ARM_DISARM:
            return (self._arm(command.params[0], command.params[1] == FORCE, now),)
        if number == TAKEOFF_COMMAND:
            self.take_off_to = command.z
            return (self.change_mode(TAKEOFF, now),)
        if number == DO_REPOSITION:
            return (self._reposition(command, now),)
        if number == DO_CHANGE_SPEED:
            return (self._change_speed(command.params[1]),)
        mode = MODE_COMMANDS.get(number)
        return (Ack.UNSUPPORTED if mode is None else self.change_mode(mode, now),)

    def _reposition(self, command: Command, now: int) -> int:
        """Hold at a place (degrees, meters above sea level). Values that are not given stay the
        same.

        A real vehicle also accepts this command on the ground and stays there. Here it is refused,
        as is an invalid place.
        """
        given = [abs(degrees) < NOT_GIVEN for degrees in (command.x, command.y)]
        place = abs(command.x) <= 90 and abs(command.y) <= 180
        if not self.flying() or (any(given) and not place):
            self.say(
                Severity.CRITICAL,
                f"Reposition denied: {'no such place' if self.flying() else 'not in the air'}",
            )
            return Ack.DENIED if self.flying() else Ack.TEMPORARILY_REJECTED
        ack = self.change_mode(LOITER, now)
        if ack == Ack.ACCEPTED:
            there = from_degrees(command.x, command.y) if place else None
            self.hold_at(there, HOME_AMSL_M - command.z if math.isfinite(command.z) else None)
        return ack

    def _change_speed(self, speed: float) -> int:
        """Set the speed in m/s. -1: no change, -2: the default."""
        if not (0 < speed < math.inf or speed in (-1, -2)):
            self.say(Severity.CRITICAL, f"Change speed denied: {speed:g} m/s")
            return Ack.DENIED
        if speed != -1:
            self.cruise = speed if speed > 0 else None
        return Ack.ACCEPTED

    def _set_mode(self, command: Command, now: int) -> int:
        base = command.params[0]
        main = command.params[1]
        sub = command.params[2]
        if not all(0 <= v < 256 for v in (base, main)) or not int(base) & 1:
            return Ack.TEMPORARILY_REJECTED
        sub = sub if main == MAIN_AUTO and 0 <= sub < 256 else 0
        return self.change_mode(int(main) << 16 | int(sub) << 24, now)

    def _arm(self, wish: float, force: bool, now: int) -> int:
        if wish not in (0, 1):
            return Ack.DENIED
        if wish == 0 and self.armed and self.flying() and not force:
            self.say(Severity.CRITICAL, "Disarming denied: not landed")
            return Ack.TEMPORARILY_REJECTED
        if (
            wish == 1
            and not self.armed
            and not force
            and self.mode in NEEDS_STICKS
            and not self.sticks_alive(now)
        ):
            self.say(Severity.CRITICAL, "Arming denied: no manual control input")
            return Ack.TEMPORARILY_REJECTED
        if self.armed != (wish == 1):
            self.set_armed(wish == 1, now)
            self.say(
                Severity.INFO,
                "Armed by external command" if self.armed else "Disarmed by external command",
            )
        return Ack.ACCEPTED

    def set_armed(self, armed: bool, now: int) -> None:
        """Arm or disarm. Sticks that are silent at arming are treated as lost only after they have
        sent again."""
        self.armed = armed
        self._sticks_lost = False
        self._act_at = NEVER
        if not self.sticks_alive(now):
            self._missed = self.sticks.last
        self.entered(self.mode, now)

    def on_event(self, event: Event, now: int) -> None:
        super().on_event(event, now)
        if event.action == "gps_on":
            self._return_to_offboard(now)

    def radio_lost(self, now: int) -> None:
        self.intended = RTL
        self._fail_to(RTL, now)

    def base_mode(self) -> int:
        if self.mode in NEEDS_STICKS:
            flags = 64 | (16 if self.mode != MANUAL else 0)
        else:
            flags = 16 | 8 | (4 if self.mode != OFFBOARD else 0)
        return 1 | flags | (128 if self.armed else 0)
