"""A mission as the flight uses it: the values of its file in SI units and radians, and values
derived from them."""

from dataclasses import dataclass
from functools import cached_property
from math import inf, radians, tan

from circnav_mav.guidance.circle_change import CircleLimits
from circnav_mav.guidance.copter_air import coefficient_at
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.table import ESTIMATORS, default_estimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.step import LawChoice
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.types import GRAVITY, Direction, Orbit, OwnLaw
from circnav_mav.mav.autopilots.interface import Autopilot, VehicleFacts
from circnav_mav.mav.autopilots.table import allowed, table_key
from circnav_mav.mav.ranging.driver import split_driver
from circnav_mav.mav.ranging.interface import RATE_SIGMA, RangingSettings
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mission.schema import MOST_STALE, MissionFile

STALE_PERIODS = 2.5
"""Default of `limits.stale_s`, in periods of the ranging radio. With it, a single lost range does
not interrupt steering."""
LEAST_STALE = 0.5
"""Lower bound of the default of `limits.stale_s`, s."""
END_SHARE = 0.975
"""Default of `bounds.max_range_m`, as a share of the largest range that the ranging message can
report."""
CARRIES_FAR = 1000.0
"""`bounds.max_range_m` has no default for messages that can report at least this range, m."""
SIM = "sim"
"""Endpoint of the bundled vehicle."""
VEHICLE, RANGING = LINKS = ("vehicle", "ranging")
"""Names of the links: to the vehicle, and to a ranging radio with a separate endpoint."""


@dataclass(frozen=True)
class Mission:
    """A validated mission.

    file: values of the mission file, with units in the names. The core does not read the tables of
        extras in it.
    text: text of the file with overrides and absolute paths, to record with the flight.
    """

    file: MissionFile
    text: str

    @cached_property
    def orbit(self) -> Orbit:
        """Circle, in SI units and radians. max_turn_rate is the smaller of the given limit and the
        rate of a coordinated turn at the bank limit."""
        vehicle = self.file.vehicle
        banked = (
            GRAVITY * tan(radians(vehicle.max_bank_deg)) / vehicle.speed_mps
            if vehicle.max_bank_deg
            else inf
        )
        given = radians(vehicle.max_turn_rate_deg_s) if vehicle.max_turn_rate_deg_s else inf
        direction = Direction(self.file.orbit.direction)
        return Orbit(self.file.orbit.radius_m, direction, vehicle.speed_mps, min(banked, given))

    @cached_property
    def tuning(self) -> LawTuning:
        """Law, and the values that determine its gain on any circle."""
        guidance = self.file.guidance
        ranging = self.file.ranging
        return LawTuning(
            guidance.law,
            self.estimation,
            self.file.vehicle.turn_lag_s,
            ranging.sigma_m,
            1 / ranging.rate_hz,
            guidance.gain,
            RATE_SIGMA if self.estimator == "measured" else None,
        )

    @cached_property
    def law(self) -> LawChoice:
        """Law with its gain. The gain is that of the file, or the default of the law."""
        return self.tuning.choice(self.orbit)

    @property
    def estimator(self) -> str:
        """Name of the estimator: that of the file, or the default of the law."""
        return self.file.guidance.estimator or default_estimator(self.file.guidance.law)

    @property
    def own_code(self) -> list[str]:
        """Names of the law and the estimator, if they are user-defined."""
        names = ((self.law.name, LAWS), (self.estimator, ESTIMATORS))
        return [name for name, table in names if name not in table]

    def import_own_code(self) -> OwnLaw | None:
        """Import law and estimator if they are user-defined, and create each of them once. Return
        the law, None if it is built in. Raises OwnCodeError."""
        own_law: OwnLaw | None = None
        if self.law.name not in LAWS:
            own_law = LAWS[self.law.name].function(self.orbit)
        if self.estimator not in ESTIMATORS:
            ESTIMATORS[self.estimator](self.estimation)
        return own_law

    @cached_property
    def estimation(self) -> EstimatorSettings:
        """Settings of the estimator for the method that begins the flight."""
        return self.estimation_of(next(iter(self.vehicles), Autopilot))

    def estimation_of(self, method: type[Autopilot]) -> EstimatorSettings:
        """Return the settings of the estimator for a method."""
        return method.estimation(self.orbit.speed, self.orbit.max_turn_rate)

    def methods(self, vehicle: type[Autopilot]) -> tuple[type[Autopilot], ...]:
        """Return the adapters that may steer a vehicle in one flight, in their order. After a loss
        of GPS, a method that needs no position continues the flight, if the mission permits it."""
        continues = self.file.engage.on_gps_loss == "attitude"
        return (vehicle, vehicle.replacement) if continues and vehicle.replacement else (vehicle,)

    @property
    def by_attitude(self) -> list[type[Autopilot]]:
        """Methods of this flight that steer a copter by attitude."""
        methods = [method for vehicle in self.vehicles for method in self.methods(vehicle)]
        return [method for method in methods if method.airspeed_from_drag]

    @property
    def max_range(self) -> float:
        """Largest range that the ranging message can report, m."""
        return RANGING_MESSAGES[self.file.ranging.message].farthest

    @property
    def farthest(self) -> float | None:
        """Horizontal range at which the flight ends, m, or None: the file's bound, or END_SHARE of
        the largest range if the ranging message has a short one."""
        end = self.max_range
        return self.file.bounds.max_range_m or (END_SHARE * end if end < CARRIES_FAR else None)

    @cached_property
    def stale(self) -> float:
        """Largest age of the newest range with which the vehicle is steered, s: the file's value,
        or a default that tolerates one lost range."""
        usual = min(max(STALE_PERIODS / self.file.ranging.rate_hz, LEAST_STALE), MOST_STALE)
        return self.file.limits.stale_s or usual

    @property
    def slowest_answer(self) -> float:
        """Largest round trip of the link with which the vehicle is engaged, s. Half of the round
        trip adds to the age of each range."""
        # 1.2: this round trip as a multiple of `limits.stale_s`.
        return 1.2 * self.stale

    @property
    def ranging_driver(self) -> str | None:
        """Driver of the ranging radio, or None if the radio sends MAVLink."""
        return split_driver(self.file.ranging.endpoint or "")[0]

    @property
    def flies_sim(self) -> bool:
        """True if the bundled vehicle is flown."""
        return self.file.link.endpoint == SIM

    def run_speed(self, speed: float | None = None, pace: float | None = None) -> float:
        """Return the speed of the run relative to real time. Infinity: as fast as possible.

        speed: requested by the user.
        pace: requested by a listener.

        A real vehicle or a separate ranging radio requires real time.
        """
        if not self.flies_sim:
            return 1.0
        if speed is not None:
            return speed
        if self.file.ranging.endpoint not in (None, SIM):
            return 1.0
        return inf if pace is None else pace

    @cached_property
    def vehicle_key(self) -> tuple[str, str]:
        """Key of the vehicle in the table of vehicles."""
        vehicle = self.file.vehicle
        return table_key(vehicle.autopilot, vehicle.kind, vehicle.method)

    @cached_property
    def vehicles(self) -> tuple[type[Autopilot], ...]:
        """Adapters of the vehicles that may be flown. Empty if the requested vehicle is not
        supported."""
        return tuple(allowed(*self.vehicle_key).values())

    @property
    def least_turn_gain(self) -> float:
        """Smallest expected ratio of realized to commanded turn rate."""
        given = self.file.vehicle.turn_gain
        return (
            given
            if isinstance(given, float)
            else min((one.least_turn_gain for one in self.vehicles), default=1.0)
        )

    @property
    def turn_gain(self) -> float | None:
        """Ratio of realized to commanded turn rate, None to learn it in flight."""
        given = self.file.vehicle.turn_gain
        return given if isinstance(given, float) else None

    @cached_property
    def facts(self) -> VehicleFacts:
        """Vehicle data for the adapters and the controller."""
        vehicle = self.file.vehicle
        return VehicleFacts(
            speed=vehicle.speed_mps,
            max_bank=radians(vehicle.max_bank_deg or 0.0),
            drag=coefficient_at(vehicle.drag_per_s, vehicle.speed_mps),
        )

    @cached_property
    def circle_limits(self) -> CircleLimits:
        """Limits of a change of the circle in flight."""
        bounds = self.file.bounds
        return CircleLimits(
            speed=self.orbit.speed,
            nearest=bounds.min_range_m or 0.0,
            farthest=min(bounds.max_range_m or inf, self.max_range),
            keeps_speed=any(
                one.fixed_wing and one.airspeed_command is None for one in self.vehicles
            ),
            turn_gain=self.least_turn_gain,
        )

    @property
    def ranging_apart(self) -> bool:
        """True if the radio has a separate link."""
        return self.file.ranging.endpoint is not None

    @property
    def stream_links(self) -> frozenset[str]:
        """Links that are byte streams (TCP, serial), not datagrams."""
        endpoints = {VEHICLE: self.file.link.endpoint, RANGING: self.file.ranging.endpoint or ""}
        return frozenset(
            link for link, endpoint in endpoints.items() if endpoint.startswith(("tcp", "serial"))
        )

    @property
    def unsigned_links(self) -> frozenset[str]:
        """Links on which unsigned frames are accepted despite a signing key."""
        accepted = self.file.signing.accept_unsigned if self.file.signing else False
        if accepted == "ranging" or (
            self.ranging_driver and not accepted
        ):  # circnav itself produces a driver's frames
            return frozenset((RANGING,))
        return frozenset(LINKS if accepted else ())

    @cached_property
    def ranging(self) -> RangingSettings:
        """Selection of the ranging telemetry."""
        calibration = {"scale", "bias_m", "delay_s", "points_m"}
        given = self.file.ranging.model_dump(exclude={"endpoint", *calibration})
        # 0.5: largest useful standard deviation of a range, as a share of the radius.
        most = max(0.5 * self.orbit.radius, 3 * self.file.ranging.sigma_m)
        return RangingSettings(
            **given,
            max_age=self.stale,
            max_sigma=most,
            calibration=self.file.ranging.calibration,
            apart=self.ranging_apart,
        )
