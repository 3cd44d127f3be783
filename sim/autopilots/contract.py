"""Interface of the autopilots, and their common behavior."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from ..agenda import NEVER
from ..body import Body
from ..config import Event, VehicleConfig
from ..demands import Bank, Demand
from ..ground import copter_touches
from ..links import Message
from ..params import Parameters

Say = Callable[[int, str], None]
"""Function (severity, text) that sends a STATUSTEXT."""

CUSTOM_MODE_ENABLED = 1
# MAV_STATE
STANDBY = 3
ACTIVE = 4
CRITICAL = 5
# MAV_LANDED_STATE
ON_GROUND = 1
IN_AIR = 2
TAKING_OFF = 3
LANDING = 4
LAST_ITEM = 5  # landing, the last item of the mission that AUTO flies
TRANSITION_TO_WINGS = 1  # MAV_VTOL_STATE_TRANSITION_TO_FW
FORCE = 21196  # the magic number that overrides arming checks


class Ack(IntEnum):
    """MAV_RESULT."""

    ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


def message_ids(text: str) -> frozenset[int]:
    """Parse message ids and ranges, as in "24 30-33"."""
    parts = (part.split("-") for part in text.split())
    return frozenset(number for part in parts for number in range(int(part[0]), int(part[-1]) + 1))


class Command(NamedTuple):
    """A COMMAND_LONG or COMMAND_INT.

    params: param1 to param4.
    x, y: latitude and longitude, degrees, as in COMMAND_LONG.
    z: altitude, m.
    sender: system and component id.
    frame: MAV_FRAME of x, y and z. A COMMAND_LONG has no frame. ArduPilot reads the altitude of a
        COMMAND_LONG as above home.
    """

    number: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    sender: tuple[int, int]
    frame: int


@dataclass(frozen=True)
class Identity:
    """Constant properties: the identity that this autopilot reports and its behavior on links."""

    mav_type: int
    autopilot: int
    version: int
    capabilities: int
    modes: Mapping[str, int]
    streamable: frozenset[int]
    fastest_us: int
    unknown_ids: frozenset[int]
    default_streams: Mapping[int, int] = field(default_factory=dict)
    interval_refusal: Ack = Ack.DENIED
    # True if the autopilot handles messages to a component of its system that has never sent a
    # message
    adopts_strays: bool = True
    mode_refusal: str = "Mode change to {name} failed: {reason}"
    texts_for_gcs_only: bool = False  # STATUSTEXT only on links with a ground station's heartbeat
    ranges_on_update: bool = False  # DISTANCE_SENSOR once per sample, not once per interval


class Autopilot(ABC):
    """Interface of an autopilot, which computes the demands on the airframe. Times are simulated
    microseconds. Acks are MAV_RESULT values.

    body: the vehicle's state; the caller of `fly` stores it.
    gps: True if the receiver has a fix.
    position: True if the estimator has a position.
    throttle: pilot's throttle stick, 0 to 1. None: not moved yet.
    """

    FIRST_MODE: str
    failsafe: bool
    # Function (body before, body after) -> (body, True for a crash): contact with the ground
    touches: Callable[[Body, Body], tuple[Body, bool]] = staticmethod(copter_touches)
    POSITION_LOSS_US: int  # time from the loss of GPS to the loss of the position estimate

    def __init__(
        self, identity: Identity, params: Parameters, config: VehicleConfig, say: Say, body: Body
    ) -> None:
        self.identity = identity
        self.params = params
        self.say = say
        self.body = body
        self.mode = self.intended = identity.modes[config.start.mode or self.FIRST_MODE]
        self.armed = config.start.armed
        self.throttle: float | None = None
        self.heading_error = 0.0  # of the compass, rad
        self.stuck_airspeed: float | None = None  # constant reading of a failed sensor, m/s
        self.vtol_state = 0  # MAV_VTOL_STATE, 0: no quadplane
        self.waypoint: int | None = None  # item that AUTO flies to, None: no mission
        self.gps = self.position = config.vehicle.gps
        self._position_until = NEVER
        self._gps_lost_at = -NEVER  # time of the loss of GPS; -NEVER: before the start
        self._decide_at = 0  # time of the next new demand
        self._external_position: tuple[float, float] | None = None

    def take_external_position(self) -> tuple[float, float] | None:
        """Return an external position (north, east in m) and clear it. None if there is none or
        this autopilot ignores it."""
        placed = self._external_position
        self._external_position = None
        return placed

    def wake_us(self) -> int:
        """Return the time of the next call of `wake` (a timeout, a waypoint leg)."""
        return min(self._position_until, self.next_decision())

    def next_decision(self) -> int:
        """Return the time at which the demand may change without a message."""
        return self._decide_at if self.armed else NEVER

    @abstractmethod
    def wake(self, now: int) -> None: ...

    @abstractmethod
    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        """Return the body after `dt` seconds of the present demand."""

    @abstractmethod
    def setpoint(self, message: Message, now: int) -> bool:
        """Handle a setpoint. Return True if it is accepted and flown."""

    @abstractmethod
    def command(self, command: Command, now: int) -> tuple[int, ...]:
        """Handle a command. Return the acks to send, in order."""

    @abstractmethod
    def change_mode(self, mode: int, now: int) -> int:
        """Enter a mode if its requirements are met. Return the ack."""

    @abstractmethod
    def entered(self, mode: int, now: int) -> None:
        """Set up the mode that has just begun."""

    @abstractmethod
    def set_armed(self, armed: bool, now: int) -> None: ...

    @abstractmethod
    def radio_lost(self, now: int) -> None:
        """React to the loss of the pilot's radio."""

    def on_message(self, message: Message, now: int) -> None:
        """Handle any other message for the autopilot (a mode, a ground station's heartbeat,
        sticks)."""
        # SET_MODE is obeyed, but has no ack.
        if message.get_type() == "SET_MODE" and message.base_mode & CUSTOM_MODE_ENABLED:
            self.change_mode(message.custom_mode, now)

    def on_event(self, event: Event, now: int) -> None:
        """Handle a scripted event that affects the autopilot."""
        if event.action == "mode":
            self.change_mode(self.identity.modes[event.mode or ""], now)
        elif event.action in ("arm", "disarm"):
            self.set_armed(event.action == "arm", now)
        elif event.action == "throttle":
            self.throttle = event.value
            self.throttle_moved(now)
        elif event.action.startswith("airspeed_"):
            self.stuck_airspeed = event.value if event.action == "airspeed_stuck" else None
        elif event.action == "vtol":
            self.vtol_state = round(event.value or 0)
        elif event.action == "waypoint":
            self.waypoint = round(event.value or 0)
        elif event.action == "rc_failsafe":
            self.radio_lost(now)
        elif event.action == "gps_off" and self.gps:
            self.gps = False
            self._gps_lost_at = now
            delay = self.POSITION_LOSS_US if event.value is None else round(event.value * 1e6)
            self._position_until = now + delay
        elif event.action == "gps_on":
            self.gps = True
            self.position = True
            self._position_until = NEVER

    def throttle_moved(self, now: int) -> None:  # noqa: B027
        """React to the pilot's throttle stick."""

    def reckons(self) -> bool:
        """True if the estimator continues without a measured position."""
        return self.position and not self.gps and self._position_until == NEVER

    def locates(self, now: int) -> bool:
        """True if the estimator has a location. Without one, the reports of the location repeat the
        last one."""
        return True

    def relative_hud(self) -> bool:
        """True if VFR_HUD.alt is the height above home."""
        return False

    def mode_name(self, mode: int) -> str:
        return next(
            (name for name, number in self.identity.modes.items() if number == mode), str(mode)
        )

    def flying(self) -> bool:
        return self.armed and self.body.down < -0.1

    @abstractmethod
    def base_mode(self) -> int: ...

    def system_status(self) -> int:
        if self.failsafe:
            return CRITICAL
        return ACTIVE if self.active() else STANDBY

    def active(self) -> bool:
        """True if HEARTBEAT reports MAV_STATE_ACTIVE."""
        return self.armed

    @abstractmethod
    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        """Return the value of VFR_HUD.airspeed, m/s. It may differ from the true airspeed."""

    def flown(self) -> Demand | Bank | None:
        """Return the setpoint being flown, if this vehicle reports it (POSITION_TARGET_LOCAL_NED,
        ATTITUDE_TARGET)."""
        return None

    def commanded_roll(self) -> float | None:
        """Return the commanded and limited bank, rad, if this vehicle reports it
        (NAV_CONTROLLER_OUTPUT)."""
        return None

    def landed_state(self) -> int:
        return IN_AIR if self.flying() else ON_GROUND
