"""What a pilot is told before the flight, and what it tells of it."""

from dataclasses import dataclass, field
from enum import Enum

from circnav_mav.guidance.bounds import Bounds
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.phases import Phase
from circnav_mav.guidance.step import LawChoice
from circnav_mav.guidance.types import Orbit
from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.height import HeightSettings
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.session import LinkSettings

VEHICLE, RANGING = LINKS = ("vehicle", "ranging")
"""The links: to the vehicle, and to a ranging radio that has an endpoint of its own."""


class Voice(Enum):
    """What a pilot may say. FLY: all. DRY_RUN: no setpoint and no mode. SHADOW: heartbeat and plot values only."""

    FLY = "fly"
    DRY_RUN = "dry run"
    SHADOW = "shadow"


def phase_name(phase: Phase, voice: Voice) -> str:
    """The phase for people: one that sends no setpoints would only steer."""
    return phase.value if voice is Voice.FLY else _WOULD.get(phase, phase.value)


_WOULD = {Phase.ENGAGED: "would steer", Phase.HOLDING: "would hold"}


class Ending(Enum):
    """How a flight ended."""

    COMPLETED = "completed"
    INTERRUPTED = "interrupted"
    ABORTED = "aborted"
    NOTHING_HEARD = "nothing heard"


@dataclass(frozen=True, slots=True)
class Outcome:
    """An ending, with the reason for people."""

    ending: Ending
    reason: str


@dataclass(frozen=True, slots=True)
class Timing:
    """All in seconds. duration: of the flight after engaging. wait_link, wait_ranging: patience before the first
    engagement. stale: age of the newest range up to which the prediction steers. hold: how long to hold after that.
    outage: longest silence of the vehicle after which the mission resumes. round_trip: to the vehicle and back, above
    which it is not engaged. tick: period without fresh ranges."""

    duration: float
    wait_link: float = 30.0
    wait_ranging: float = 30.0
    stale: float = 0.5
    hold: float = 10.0
    outage: float = 60.0
    round_trip: float = 0.6
    tick: float = 0.05


@dataclass(frozen=True, slots=True)
class PilotSettings:
    """A mission, in SI units and radians, as the pilot needs it.

    autopilot, kind: keys of the adapter table ("auto", None: whatever is heard). turn_gain: realised over commanded
    turn rate when it is known, None to learn it in flight. turn_lag: of the vehicle, s. radius_trim: rate of the radius
    integral, 1/s. request_mode: ask for the guided mode (else wait for the operator to enter it). end_on_takeover:
    whether the operator's leaving the mode ends the mission (else it waits to be given the vehicle again). exit: name
    of the exit action, None for the autopilot's default. ranging_apart: ranging comes on a link of its own.
    stream_links: links that are byte streams (TCP, serial), not datagrams. unsigned_links: those on which unsigned
    frames are believed even where there is a signing key. height: what is said of it, above the target.
    """

    orbit: Orbit
    law: LawChoice
    estimator: str
    estimation: EstimatorSettings
    ranging: RangingSettings
    link: LinkSettings
    autopilot: str
    kind: str | None
    facts: VehicleFacts
    timing: Timing
    bounds: Bounds
    turn_gain: float | None = 1.0
    turn_lag: float = 0.4
    radius_trim: float = 0.0
    request_mode: bool = False
    end_on_takeover: bool = True
    exit: str | None = None
    max_yaw_acceleration: float | None = None
    voice: Voice = Voice.FLY
    ranging_apart: bool = False
    stream_links: frozenset[str] = frozenset()
    unsigned_links: frozenset[str] = frozenset()
    height: HeightSettings = field(default_factory=HeightSettings)


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One tick, for the log and the display. Rates are the paper's (counter-clockwise positive) except yaw_rate_sent,
    which is MAVLink's. turn_gain, turn_delay (s), gain_share: how the vehicle answers turn commands, and what is left
    of the gains once the command was found swinging. law, x .. airspeed_scale: which law flies, and the relative motion
    where an estimator tells it (vehicle minus target, m; wind minus target velocity, m/s; paper's frame). height: above
    the target, m, by which slant ranges are made horizontal. None stands for "not known" or "not sent"."""

    time: float
    phase: Phase
    measured: float | None
    r: float | None
    r_dot: float | None
    r_sigma: float | None
    r_dot_sigma: float | None
    nis: float | None
    demanded: float | None
    turn_rate: float | None
    saturated: bool
    yaw_rate_sent: float | None
    turn_gain: float
    turn_delay: float
    gain_share: float
    law: str
    x: float | None
    y: float | None
    drift_x: float | None
    drift_y: float | None
    airspeed_scale: float | None
    heading: float | None
    airspeed: float | None
    altitude: float | None
    height: float | None
    range_age: float | None
    link_age: float | None
    mode: str
    accepted: int
    rejected: int
