"""What every autopilot is to the vehicle around it, and what all of them do alike."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from ..agenda import NEVER
from ..body import Body
from ..config import Event, VehicleConfig
from ..demands import Bank, Demand, Glide
from ..links import Message
from ..params import Parameters

Say = Callable[[int, str], None]
"""Send a STATUSTEXT of this severity."""

CUSTOM_MODE_ENABLED = 1
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4  # MAV_LANDED_STATE
FORCE = 21196  # the magic number that overrides arming checks


class Ack(IntEnum):
    """MAV_RESULT."""

    ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY, CRITICAL, ERROR, WARNING, INFO = 0, 2, 3, 4, 6


def message_ids(text: str) -> frozenset[int]:
    """Numbers and ranges, "24 30-33"."""
    parts = (part.split("-") for part in text.split())
    return frozenset(number for part in parts for number in range(int(part[0]), int(part[-1]) + 1))


class Command(NamedTuple):
    """COMMAND_LONG and COMMAND_INT alike; x and y in degrees, as the LONG carries them. frame: of x, y and z; a LONG
    has none, and ArduPilot takes its height as above home."""

    number: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    sender: tuple[int, int]
    frame: int


@dataclass(frozen=True)
class Identity:
    """What does not change: who this autopilot says it is and how it treats its links."""

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
    adopts_strays: bool = True  # acts on what is addressed to a component of its system that nobody has heard
    mode_refusal: str = "Mode change to {name} failed: {reason}"
    texts_for_gcs_only: bool = False  # STATUSTEXT only where a ground station's heartbeat was seen
    ranges_on_update: bool = False  # DISTANCE_SENSOR once per sample, not once per interval


class Autopilot(ABC):
    """Decides what the airframe shall do. Times are sim time in microseconds; acks are MAV_RESULT values.

    body: what is flown, moved by whoever calls `fly`. gps: whether the receiver has a fix. position: whether the
    estimator knows where it is.
    """

    FIRST_MODE: str
    failsafe: bool
    POSITION_LOSS_US: int  # from the loss of the GPS to the estimator's

    def __init__(self, identity: Identity, params: Parameters, config: VehicleConfig, say: Say, body: Body) -> None:
        self.identity = identity
        self.params = params
        self.say = say
        self.body = body
        self.mode = self.intended = identity.modes[config.start.mode or self.FIRST_MODE]
        self.armed = config.start.armed
        self.gps = self.position = config.vehicle.gps
        self._position_until = NEVER
        self._think_at = 0  # when it next decides anew what to fly
        self._placed: tuple[float, float] | None = None

    def take_placed(self) -> tuple[float, float] | None:
        """Where somebody else has said that it is, north and east, m, once; None: nobody has, or it does not obey."""
        placed, self._placed = self._placed, None
        return placed

    def wake_us(self) -> int:
        """When something may change by itself (a timeout, a waypoint leg)."""
        return min(self._position_until, self.next_thought())

    def next_thought(self) -> int:
        """When the demand may change by itself."""
        return self._think_at if self.armed else NEVER

    @abstractmethod
    def wake(self, now: int) -> None: ...

    @abstractmethod
    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        """The body after `dt` seconds of the present demand."""

    @abstractmethod
    def setpoint(self, message: Message, now: int) -> bool:
        """Take a setpoint; True if it is now flown."""

    @abstractmethod
    def command(self, command: Command, now: int) -> tuple[int, ...]:
        """The acks to send, in order."""

    @abstractmethod
    def change_mode(self, mode: int, now: int) -> int:
        """Enter a mode unless something stands against it; the ack."""

    @abstractmethod
    def entered(self, mode: int, now: int) -> None:
        """A mode has begun."""

    @abstractmethod
    def set_armed(self, armed: bool, now: int) -> None: ...

    @abstractmethod
    def radio_lost(self, now: int) -> None:
        """The pilot's radio is gone."""

    def heard(self, message: Message, now: int) -> None:
        """Any other message for the autopilot (a mode, a ground station's heartbeat, sticks)."""
        if message.get_type() == "SET_MODE" and message.base_mode & CUSTOM_MODE_ENABLED:  # obeyed, but has no ack
            self.change_mode(message.custom_mode, now)

    def happen(self, event: Event, now: int) -> None:
        """A scripted event that the autopilot itself notices."""
        if event.action == "mode":
            self.change_mode(self.identity.modes[event.mode or ""], now)
        elif event.action in ("arm", "disarm"):
            self.set_armed(event.action == "arm", now)
        elif event.action == "rc_failsafe":
            self.radio_lost(now)
        elif event.action == "gps_off" and self.gps:
            self.gps, self._position_until = False, now + self.POSITION_LOSS_US
        elif event.action == "gps_on":
            self.gps, self.position, self._position_until = True, True, NEVER

    def reckons(self) -> bool:
        """Whether the estimator goes on without any position measured."""
        return self.position and not self.gps and self._position_until == NEVER

    def mode_name(self, mode: int) -> str:
        return next((name for name, number in self.identity.modes.items() if number == mode), str(mode))

    def flying(self) -> bool:
        return self.armed and self.body.down < -0.1

    @abstractmethod
    def base_mode(self) -> int: ...

    def system_status(self) -> int:
        if self.failsafe:
            return CRITICAL
        return ACTIVE if self.active() else STANDBY

    def active(self) -> bool:
        """Whether HEARTBEAT calls it active."""
        return self.armed

    @abstractmethod
    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        """VFR_HUD.airspeed: what this vehicle reports, which need not be the true airspeed."""

    def flown(self) -> Demand | Bank | Glide | None:
        """The setpoint being flown, of vehicles that echo it (POSITION_TARGET_LOCAL_NED, ATTITUDE_TARGET)."""
        return None

    def wanted_roll(self) -> float | None:
        """The bank asked for after its limits, rad, of vehicles that tell (NAV_CONTROLLER_OUTPUT)."""
        return None

    def landed_state(self) -> int:
        return IN_AIR if self.flying() else ON_GROUND
