"""Settings of `Pilot`, fixed before the flight."""

from dataclasses import dataclass, field
from enum import Enum

from circnav_mav.guidance.circle_change import CircleLimits
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.monitors import Bounds
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.types import Orbit
from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.identity import LinkSettings
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.pilot.mission_state import Timing

VEHICLE, RANGING = LINKS = ("vehicle", "ranging")
"""Names of the links: to the vehicle, and to a ranging radio with a separate endpoint."""


class OutputMode(Enum):
    """Messages that `Pilot` may send.

    FLY: all.
    DRY_RUN: all but setpoints and mode requests.
    SHADOW: heartbeats and plot values only.
    """

    FLY = "fly"
    DRY_RUN = "dry run"
    SHADOW = "shadow"


@dataclass(frozen=True, slots=True)
class HeightSettings:
    """Height in the mission, m. At most one value is given.

    above_target: height of the vehicle above the target at the engagement.
    target_altitude: altitude of the target above sea level.
    target_above_home: height of the target above home.
    """

    above_target: float | None = None
    target_altitude: float | None = None
    target_above_home: float | None = None

    @property
    def needs_altitude(self) -> bool:
        """True if the height is unknown until the vehicle reports its altitude."""
        return self.target_altitude is not None or self.target_above_home is not None


@dataclass(frozen=True, slots=True)
class PilotSettings:
    """Settings of a mission, in SI units and radians.

    tuning: law, with its gain for any circle.
    autopilot, kind: keys of the adapter table. "auto" and None: any, as the vehicle reports.
    turn_gain: ratio of realized to commanded turn rate, None to learn it in flight.
    request_mode: True to request the guided mode, False to wait until the operator enters it.
    end_on_takeover: True if a takeover ends the mission. False: the mission waits until the
        operator gives control back.
    min_height: least height above the place of arming at which an aircraft is engaged, m. None: as
        the vehicle's adapter. 0: no least height.
    exit: name of the exit action, None for the autopilot's default.
    ranging_apart: True if the radio has a separate link.
    stream_links: links that are byte streams (TCP, serial), not datagrams.
    unsigned_links: links on which unsigned frames are accepted despite a signing key.
    height: height above the target.
    circle_limits: limits of a change of the circle.
    unsigned_parameters: True to accept PARAM_SET on a link that is not signed.

    flies_without_gps: True to continue by attitude setpoints if the GPS is lost.
    estimation_without_gps: settings of the estimator after this loss.
    """

    orbit: Orbit
    tuning: LawTuning
    circle_limits: CircleLimits
    estimator: str
    ranging: RangingSettings
    link: LinkSettings
    autopilot: str
    kind: str | None
    facts: VehicleFacts
    timing: Timing
    bounds: Bounds
    turn_gain: float | None = 1.0
    request_mode: bool = False
    end_on_takeover: bool = True
    min_height: float | None = None
    exit: str | None = None
    output_mode: OutputMode = OutputMode.FLY
    ranging_apart: bool = False
    stream_links: frozenset[str] = frozenset()
    unsigned_links: frozenset[str] = frozenset()
    height: HeightSettings = field(default_factory=HeightSettings)
    unsigned_parameters: bool = False
    flies_without_gps: bool = False
    estimation_without_gps: EstimatorSettings = field(
        default_factory=lambda: EstimatorSettings(5.0, 0.5)
    )
