"""What a pilot is told before the flight."""

from dataclasses import dataclass, field
from enum import Enum

from circnav_mav.guidance.circle_change import CircleLimits
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.step import LawChoice
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.types import Orbit
from circnav_mav.guidance.watches import Bounds
from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.identity import LinkSettings
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.pilot.mission_state import Timing

VEHICLE, RANGING = LINKS = ("vehicle", "ranging")
"""The links: to the vehicle, and to a ranging radio that has an endpoint of its own."""


class OutputMode(Enum):
    """What a pilot may send. FLY: all. DRY_RUN: no setpoint and no mode. SHADOW: heartbeat and plot values only."""

    FLY = "fly"
    DRY_RUN = "dry run"
    SHADOW = "shadow"


@dataclass(frozen=True, slots=True)
class HeightSettings:
    """What the mission says of the height, at most one of them, m. above_target: of the vehicle above the target when
    guidance engages. target_altitude: of the target above sea level. target_above_home: of the target above home."""

    above_target: float | None = None
    target_altitude: float | None = None
    target_above_home: float | None = None

    @property
    def needs_altitude(self) -> bool:
        """Whether nothing is known of the height before the vehicle reports its altitude."""
        return self.target_altitude is not None or self.target_above_home is not None


@dataclass(frozen=True, slots=True)
class PilotSettings:
    """A mission, in SI units and radians, as the pilot needs it.

    autopilot, kind: keys of the adapter table ("auto", None: whatever is heard). turn_gain: realised over commanded
    turn rate when it is known, None to learn it in flight. turn_lag: of the vehicle, s. radius_trim: rate of the radius
    integral, 1/s. request_mode: ask for the guided mode (else wait for the operator to enter it). end_on_takeover:
    whether the operator's leaving the mode ends the mission (else it waits to be given the vehicle again). exit: name
    of the exit action, None for the autopilot's default. ranging_apart: ranging comes on a link of its own.
    stream_links: links that are byte streams (TCP, serial), not datagrams. unsigned_links: those on which unsigned
    frames are believed even where there is a signing key. height: what is said of it, above the target. later_radii:
    of the circles after the first, m. tuning: the law on any circle. circle_limits: of a change of the circle.
    unsigned_parameters: accept PARAM_SET on a link that is not signed.
    """

    orbit: Orbit
    law: LawChoice
    tuning: LawTuning
    circle_limits: CircleLimits
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
    output_mode: OutputMode = OutputMode.FLY
    ranging_apart: bool = False
    stream_links: frozenset[str] = frozenset()
    unsigned_links: frozenset[str] = frozenset()
    height: HeightSettings = field(default_factory=HeightSettings)
    later_radii: tuple[float, ...] = ()
    unsigned_parameters: bool = False

    @property
    def circles(self) -> str:
        """All circles, for people."""
        return self.orbit.words(*self.later_radii)
