"""Kinematic fleet: vehicles with a turn-rate limit and lag, the product's drift law, and own
positions with 1 m of error. Without MAVLink and estimator, the results are an upper bound of the
fleet law's quality."""

from dataclasses import dataclass, field
from math import atan2, cos, exp, hypot, inf, pi, sin, sqrt

import numpy as np

from circnav_mav.extras.fleet.evenness import even_from, gap_error
from circnav_mav.extras.fleet.law import Adjustment, OwnState, Spacing, SpacingSettings
from circnav_mav.extras.fleet.phase import PhaseMap, circle_angle
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.guidance.step import LawChoice, Steering
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate, RelativeMotion

STEP = 0.1
LAG = 0.4
MAX_TURN = 0.35
PLACE_SIGMA = 1.0
PLACE_TIME = 2.0


@dataclass
class World:
    """Conditions of a fleet flight. drift: east, north, m/s. loss: share of lost reports. delay: of
    the reports, s. report_every: period of the reports, s. compass: heading bias of each member,
    rad. speeds: airspeed factor of each member. speed_share: largest speed change as a share of the
    airspeed. speed_lag: time constant of the airspeed, s. room: usable width inside the circle,
    m."""

    n: int = 6
    speed: float = 15.0
    radius: float = 100.0
    drift: tuple[float, float] = (0.0, 0.0)
    loss: float = 0.0
    delay: float = 0.0
    report_every: float = 0.2
    compass: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    speed_share: float = 0.0
    speed_lag: float = 0.0
    room: float = 20.0
    seed: int = 1
    leaves: dict[int, float] = field(default_factory=dict)
    joins: dict[int, float] = field(default_factory=dict)


class Fleet:
    """State and history of the flying fleet. phases, radii: true temporal phase (rad) and range (m)
    of each member by time step."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.rng = np.random.default_rng(world.seed)
        n = world.n
        R = world.radius
        self.orbit = Orbit(R, Direction.COUNTERCLOCKWISE, world.speed, MAX_TURN)
        angle = np.radians(12.0) * np.arange(n)
        self.x, self.y = R * np.cos(angle), R * np.sin(angle)
        self.psi = angle + pi / 2
        self.turn = np.zeros(n)
        self.wrong = PLACE_SIGMA * self.rng.normal(size=(2, n))
        settings = [
            SpacingSettings(i + 1, R, world.speed, 1, world.speed_share, inward=world.room)
            for i in range(n)
        ]
        self.spacings = [Spacing(one) for one in settings]
        self.steerings = [Steering(self.orbit, LawChoice("drift", 1.0, LAG)) for _ in range(n)]
        self.adjusted: list[Adjustment | None] = [None] * n
        self.map = PhaseMap.of(world.speed, world.drift, 1)
        self.mail: list[tuple[float, int, MemberReport]] = []
        self.time = 0.0
        self.reported = -1.0
        self.speeds = np.array(world.speeds or [1.0] * n) * world.speed
        self.flown = self.speeds.copy()
        self.compass = world.compass or [0.0] * n
        self.phases: list[list[float]] = []
        self.radii: list[list[float]] = []
        self.ring: list[list[bool]] = []
        self.nearest = float("inf")

    def fly(self, seconds: float) -> "Fleet":
        for _ in range(round(seconds / STEP)):
            self._step()
        return self

    def active(self, i: int) -> bool:
        world = self.world
        return world.joins.get(i, 0.0) <= self.time < world.leaves.get(i, 1e9)

    def _step(self) -> None:
        world = self.world
        n = self.world.n
        keep = exp(-STEP / PLACE_TIME)
        self.wrong = keep * self.wrong + PLACE_SIGMA * sqrt(1 - keep**2) * self.rng.normal(
            size=(2, n)
        )
        reports = self.time - self.reported >= world.report_every - 1e-9
        if reports:
            self.reported = self.time
        for _, i, report in [one for one in self.mail if one[0] <= self.time]:
            self.spacings[i].take([report])
        self.mail = [one for one in self.mail if one[0] > self.time]
        for i in range(n):
            self._member(i, reports)
        self.phases.append([self.map.at(atan2(self.y[i], self.x[i]))[0] for i in range(n)])
        self.radii.append([hypot(self.x[i], self.y[i]) for i in range(n)])
        self.ring.append([a is not None and a.state is State.ON_CIRCLE for a in self.adjusted])
        self.time += STEP

    def _member(self, i: int, reports: bool) -> None:
        world = self.world
        c = cos(self.compass[i])
        s = sin(self.compass[i])
        x, y = self.x[i] + self.wrong[0, i], self.y[i] + self.wrong[1, i]
        x, y = c * x - s * y, s * x + c * y  # the compass bias rotates all estimates of the member
        drift = c * world.drift[0] - s * world.drift[1], s * world.drift[0] + c * world.drift[1]
        phase, rate = PhaseMap.of(world.speed, drift, 1).at(circle_angle(x, y, 1))
        sigma = PLACE_SIGMA / world.radius * rate
        r = hypot(x, y)
        adjusted = None
        if self.active(i):
            leaving = world.leaves.get(i, 1e9) - self.time < 20.0
            adjusted = self.spacings[i].step(self.time, OwnState(phase, sigma, r, leaving))
        self.adjusted[i] = adjusted
        radius = world.radius + (adjusted.offset if adjusted else 5 * world.radius)
        wanted = self.speeds[i] * (adjusted.speed if adjusted else 1.0)
        self.flown[i] += (wanted - self.flown[i]) * STEP / (world.speed_lag + STEP)
        speed = self.flown[i]
        self.steerings[i].change(
            Orbit(radius, Direction.COUNTERCLOCKWISE, speed, MAX_TURN),
            LawChoice("drift", 1.0, LAG),
        )
        psi = self.psi[i] + self.compass[i]
        relative = RelativeMotion(x, y, PLACE_SIGMA, *drift, psi, self.turn[i], speed, 1.0, True)
        r_dot = ((speed * cos(psi) + drift[0]) * x + (speed * sin(psi) + drift[1]) * y) / r
        command = self.steerings[i](RangeEstimate(self.time, r, r_dot, 0.5, 0.3, relative=relative))
        self.turn[i] += (command.turn_rate - self.turn[i]) * STEP / (LAG + STEP)
        self.psi[i] += self.turn[i] * STEP
        self.x[i] += (speed * cos(self.psi[i]) + world.drift[0]) * STEP
        self.y[i] += (speed * sin(self.psi[i]) + world.drift[1]) * STEP
        if reports and adjusted is not None:
            period = self.map.lap_time * radius
            report = MemberReport(
                i + 1,
                adjusted.state,
                self.time,
                phase,
                sigma,
                period,
                radius,
                15.0 * i,
                1,
                drift,
                (1.0, 0.0, 1.0),
            )
            for other in range(world.n):
                if other != i and self.rng.random() >= world.loss:
                    self.mail.append((self.time + world.delay, other, report))

    def gap_errors(self) -> np.ndarray:
        """Return the largest gap error of the members on the circle at every step, deg; nan if
        fewer than two members are on the circle."""
        pairs = zip(np.array(self.phases), np.array(self.ring), strict=True)
        return np.degrees([gap_error(phases[ring].tolist()) for phases, ring in pairs])


def time_to_even(errors: np.ndarray, since: float = 0.0) -> float:
    """Return the time from `since` until all gap errors are below 5 deg for 20 s, s; infinite if
    this never happens."""
    found = even_from(STEP * np.arange(len(errors)), np.radians(errors), since)
    return inf if found is None else found - since
