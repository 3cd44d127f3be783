"""What every autopilot profile offers to the vehicle around it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from sim.body import Body
from sim.config import Event
from sim.demands import Demand
from sim.params import Parameters
from sim.wire import Message

Say = Callable[[int, str], None]
"""Send a STATUSTEXT of this severity."""

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
EMERGENCY, CRITICAL, ERROR, WARNING, NOTICE, INFO = 0, 2, 3, 4, 5, 6
STATUS_STANDBY, STATUS_ACTIVE, STATUS_CRITICAL = 3, 4, 5
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
FORCE = 21196  # the magic number that overrides arming checks


def message_ids(text: str) -> frozenset[int]:
    """Numbers and ranges, "24 30-33"."""
    parts = (part.split("-") for part in text.split())
    return frozenset(number for part in parts for number in range(int(part[0]), int(part[-1]) + 1))


class Command(NamedTuple):
    """COMMAND_LONG and COMMAND_INT alike; x and y in degrees, as the LONG carries them."""

    number: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    sender: tuple[int, int]


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
    interval_refusal: int = DENIED
    adopts_strays: bool = True  # acts on what is addressed to a component of its system that nobody has heard
    mode_refusal: str = "Mode change to {name} failed: {reason}"
    texts_for_gcs_only: bool = False  # STATUSTEXT only where a ground station's heartbeat was seen
    ranges_on_update: bool = False  # DISTANCE_SENSOR once per sample, not once per interval


class Autopilot(Protocol):
    """Decides what the airframe shall do. Times are sim time in microseconds; acks are MAV_RESULT values."""

    @property
    def identity(self) -> Identity: ...

    @property
    def params(self) -> Parameters: ...

    @property
    def mode(self) -> int: ...

    @property
    def armed(self) -> bool: ...

    def wake_us(self) -> int:
        """When the demand may change by itself (a timeout, a waypoint leg)."""

    def wake(self, now: int, body: Body) -> None: ...

    def fly(self, body: Body, dt: float, wind: tuple[float, float]) -> Body:
        """The body after `dt` seconds of the present demand."""

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        """Take a setpoint; True if it is now flown."""

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        """The acks to send, in order."""

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        """VFR_HUD.airspeed: what this vehicle reports, which need not be the true airspeed."""

    def has_position(self) -> bool:
        """Whether the estimator knows where it is."""

    def has_gps(self) -> bool:
        """Whether the receiver has a fix."""

    def happen(self, event: Event, now: int) -> None:
        """A scripted event."""

    def heard(self, message: Message, now: int) -> None:
        """Any other message for the autopilot (a ground station's heartbeat, sticks)."""

    def base_mode(self) -> int: ...

    def system_status(self, body: Body) -> int: ...

    def flown(self) -> Demand | None:
        """The setpoint being flown, of vehicles that echo it (POSITION_TARGET_LOCAL_NED, ATTITUDE_TARGET)."""

    def wanted_roll(self) -> float | None:
        """The bank asked for after its limits, rad, of vehicles that tell (NAV_CONTROLLER_OUTPUT)."""

    def intended_mode(self) -> int:
        """The mode that is wanted, which a failsafe may keep from being flown."""

    def landed_state(self, body: Body) -> int: ...
