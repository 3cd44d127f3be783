"""What the PX4 vehicles have in common: modes and what they require, OFFBOARD's watchdog, the double acks."""

from typing import Protocol

from sim.agenda import NEVER
from sim.autopilots.contract import (
    ACCEPTED,
    CRITICAL,
    DENIED,
    FORCE,
    INFO,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    Identity,
    Say,
)
from sim.autopilots.modes import PX4 as MODES
from sim.autopilots.sticks import Sticks
from sim.body import Body
from sim.config import Event, VehicleConfig
from sim.params import Parameters
from sim.wire import Message

MANUAL, ALTCTL, POSCTL, TAKEOFF = MODES["MANUAL"], MODES["ALTCTL"], MODES["POSCTL"], MODES["TAKEOFF"]
LOITER, RTL, LAND, OFFBOARD = MODES["LOITER"], MODES["RTL"], MODES["LAND"], MODES["OFFBOARD"]
NEEDS_STICKS = frozenset(MODES[name] for name in ("MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "ALT_CRUISE"))
NEEDS_POSITION = frozenset({POSCTL, LOITER, RTL, TAKEOFF, MODES["MISSION"]})
MAIN_AUTO = 4
SET_MODE = 11
DO_SET_MODE, ARM_DISARM, DO_CHANGE_SPEED, DO_REPOSITION, TAKEOFF_COMMAND = 176, 400, 178, 192, 22
MODE_COMMANDS = {20: RTL, 21: LAND, 17: LOITER}
LOSS_DELAY_US = 50_000
POSITION_LOSS_US, HOLD_US = 5_000_000, 5_000_000
LOSS_ACTIONS = {3: RTL, 4: LAND, 5: LOITER}  # COM_OBL_RC_ACT; anything else falls through to RTL without sticks


class Rules(Protocol):
    """What copter and plane decide differently."""

    def entered(self, mode: int, now: int) -> None: ...

    def needs_velocity(self) -> bool:
        """Whether what OFFBOARD flies needs a velocity estimate."""

    def flying(self, body: Body) -> bool: ...


class Core:
    """Commander: the mode that is wanted, the mode that is flown, and the watchdogs between them."""

    def __init__(self, identity: Identity, params: Parameters, config: VehicleConfig, say: Say, rules: Rules) -> None:
        self.identity = identity
        self.params = params
        self.say = say
        self.sticks = Sticks(config.vehicle.system_id)
        self.mode = self.intended = MODES[config.start.mode or "LOITER"]
        self.armed = config.start.armed
        self.gps = self.position = config.vehicle.gps
        self.take_off_to: float | None = None
        self._rules = rules
        self._setpoint_at: int | None = 0 if self.mode == OFFBOARD else None
        self._position_until = NEVER
        self._hold_until = NEVER

    @property
    def failsafe(self) -> bool:
        return self.mode != self.intended

    # -- setpoints and their absence ----------------------------------------------------------------------------------

    def setpoint_taken(self, now: int) -> None:
        """An accepted setpoint feeds the watchdog, and brings OFFBOARD back by itself when that is still wanted."""
        self._setpoint_at = now
        if self.failsafe and self.intended == OFFBOARD and self._obstacle(OFFBOARD, now) is None:
            self._fly_mode(OFFBOARD, now)

    def wake_us(self) -> int:
        return min(self._offboard_deadline(), self._sticks_deadline(), self._position_until, self._hold_until)

    def wake(self, now: int) -> None:
        if now >= self._position_until:
            self._position_until, self.position = NEVER, False
            if self.mode == POSCTL or (self.mode == OFFBOARD and self._rules.needs_velocity()):
                self._fail_to(ALTCTL, now)
        if now >= self._offboard_deadline():
            action = int(self.params["COM_OBL_RC_ACT"])
            self._fail_to(LOSS_ACTIONS.get(action, RTL), now)
        if now >= self._sticks_deadline():
            self._fail_to(LOITER, now)
            self.intended = LOITER  # no automatic return
            self._hold_until = now + HOLD_US
        if now >= self._hold_until:
            self._hold_until = NEVER
            self.intended = RTL
            self._fail_to(RTL, now)

    def _fail_to(self, mode: int, now: int) -> None:
        self.say(CRITICAL, "Failsafe activated")
        self._fly_mode(mode, now)

    def _offboard_deadline(self) -> int:
        if self.mode != OFFBOARD or not self.armed or self._setpoint_at is None:
            return NEVER
        return self._setpoint_at + round(self.params["COM_OF_LOSS_T"] * 1e6) + LOSS_DELAY_US

    def _sticks_deadline(self) -> int:
        if self.mode not in NEEDS_STICKS or not self.armed or self.failsafe or self.sticks.last is None:
            return NEVER
        return self.sticks.last + round(self.params["COM_RC_LOSS_T"] * 1e6)

    # -- modes --------------------------------------------------------------------------------------------------------

    def change_mode(self, mode: int, now: int) -> int:
        """What somebody wants; the ack."""
        reason = self._obstacle(mode, now)
        if reason is not None:
            self.say(CRITICAL, f"Switching to mode '{self._name(mode)}' is currently not available: {reason}")
            return TEMPORARILY_REJECTED
        self.intended = mode
        self._hold_until = NEVER
        if self.mode != mode:
            self._fly_mode(mode, now)
        return ACCEPTED

    def _fly_mode(self, mode: int, now: int) -> None:
        self.mode = mode
        self._rules.entered(mode, now)

    def _obstacle(self, mode: int, now: int) -> str | None:
        if mode not in self.identity.modes.values():
            return "no such mode"
        if not self.armed:
            return None
        if mode == OFFBOARD:
            age = NEVER if self._setpoint_at is None else now - self._setpoint_at
            if age > self.params["COM_OF_LOSS_T"] * 1e6:
                return "no offboard signal"
            return "no velocity estimate" if self._rules.needs_velocity() and not self.position else None
        if mode in NEEDS_STICKS and not self.sticks_alive(now):
            return "no manual control input"
        return "no position estimate" if mode in NEEDS_POSITION and not self.position else None

    def sticks_alive(self, now: int) -> bool:
        return self.sticks.alive(now, round(self.params["COM_RC_LOSS_T"] * 1e6))

    def _name(self, mode: int) -> str:
        return next((name.capitalize() for name, number in self.identity.modes.items() if number == mode), str(mode))

    # -- commands -----------------------------------------------------------------------------------------------------

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        number = command.number
        if number == DO_SET_MODE:  # the receiver accepts whatever it is, then Commander decides
            return (ACCEPTED, self._set_mode(command, now))
        if number == ARM_DISARM:
            return (self._arm(command.params[0], command.params[1] == FORCE, now, body),)
        if number == TAKEOFF_COMMAND:
            self.take_off_to = command.z
            return (self.change_mode(TAKEOFF, now),)
        if number == DO_REPOSITION:
            return (self.change_mode(LOITER, now),)
        if number == DO_CHANGE_SPEED:
            return (ACCEPTED,)
        mode = MODE_COMMANDS.get(number)
        return (UNSUPPORTED if mode is None else self.change_mode(mode, now),)

    def _set_mode(self, command: Command, now: int) -> int:
        base, main, sub = command.params[0], command.params[1], command.params[2]
        if not all(0 <= v < 256 for v in (base, main)) or not int(base) & 1:
            return TEMPORARILY_REJECTED
        sub = sub if main == MAIN_AUTO and 0 <= sub < 256 else 0
        return self.change_mode(int(main) << 16 | int(sub) << 24, now)

    def _arm(self, wish: float, force: bool, now: int, body: Body) -> int:
        if wish not in (0, 1):
            return DENIED
        if wish == 0 and self.armed and self._rules.flying(body) and not force:
            self.say(CRITICAL, "Disarming denied: not landed")
            return TEMPORARILY_REJECTED
        if wish == 1 and not self.armed and not force and self.mode in NEEDS_STICKS and not self.sticks_alive(now):
            self.say(CRITICAL, "Arming denied: no manual control input")
            return TEMPORARILY_REJECTED
        changed = self.armed != (wish == 1)
        self.armed = wish == 1
        if changed:
            self.say(INFO, "Armed by external command" if self.armed else "Disarmed by external command")
            self._rules.entered(self.mode, now)
        return ACCEPTED

    def disarm(self, now: int) -> None:
        self.armed = False
        self._rules.entered(self.mode, now)

    def heard(self, message: Message, now: int) -> None:
        if message.get_msgId() == SET_MODE and message.base_mode & 1:
            self.change_mode(message.custom_mode, now)

    def happen(self, event: Event, now: int) -> None:
        if event.action == "mode":
            self.change_mode(self.identity.modes[event.mode or ""], now)
        elif event.action in ("arm", "disarm"):
            self.armed = event.action == "arm"
            self._rules.entered(self.mode, now)
        elif event.action == "rc_failsafe":
            self.intended = RTL
            self._fail_to(RTL, now)
        elif event.action == "gps_off" and self.gps:
            self.gps, self._position_until = False, now + POSITION_LOSS_US
        elif event.action == "gps_on":
            self.gps, self.position, self._position_until = True, True, NEVER
            if self.failsafe and self.intended == OFFBOARD and self._obstacle(OFFBOARD, now) is None:
                self._fly_mode(OFFBOARD, now)

    # -- reports ------------------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        if self.mode in NEEDS_STICKS:
            flags = 64 | (16 if self.mode != MANUAL else 0)
        else:
            flags = 16 | 8 | (4 if self.mode != OFFBOARD else 0)
        return 1 | flags | (128 if self.armed else 0)

    def system_status(self) -> int:
        if self.failsafe:
            return 5
        return 4 if self.armed else 3
