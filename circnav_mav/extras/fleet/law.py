"""Even spacing of the members on one circle, from the temporal phases that they report.

Every member receives the reports of all, so that each finds the same slots by itself: no leader, no fixed number, no
position. The slots are evenly spaced and as near as possible to where the members are (least squares). Fleet law:

    u_i = c + 2 pi k_i / n - tau_i,   c = mean over k of (tau_k - 2 pi k / n),   k: rank of the phase on the ring

A member that is behind its slot (u > 0) flies a smaller circle, or faster. A slow integral takes out what differs for
good, such as airspeeds: two vehicles with 2 % between them stay even only on circles whose radii differ by 2 %.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import exp, log, pi, sqrt

from circnav_mav.extras.fleet.phase import LAP, wrapped
from circnav_mav.extras.fleet.report import MemberReport, State

SILENT = 10.0
"""Age of a report, s, up to which a member is extrapolated. Older ones do not count, and the others close the gap."""
GAIN = 0.6
"""Relative change of the angular rate by an error of 1 rad."""
INTEGRAL = 0.2
"""Rate of the integral, in units of the angular rate times GAIN squared: below 0.25 the loop does not overshoot."""
MAX_TRIM = 0.08
"""Largest value of the integral."""
TRIM_WITHIN = 0.15
"""Error, rad, up to which the integral runs: a larger one is on the way to its slot, and would be overshot."""
FORGET, FORGET_ALONE = 300.0, 30.0
"""Time constants, s, with which the integral decays: so that a part common to all does not stay, and when alone."""
SMOOTHING = 2.0
"""Time constant of the error, s."""
MAX_RADIUS_CHANGE, MAX_RADIUS_SHARE, MAX_SPEED_SHARE = 20.0, 0.2, 0.15
"""Limits of the modulation: of the radius in m and as a share of it, and of the speed as a share."""
LANE, LANE_SHARE = 25.0, 0.25
"""The outer lane lies so far outside of the circle, m, and at most so much of its radius."""
CLOSE = 0.035
"""Phase difference, rad, below which two members are ordered by their ids: noise would swap them again and again."""
FORMED = 0.35
"""Largest error, rad, in a ring that counts as formed: who joins it waits in the outer lane for a gap."""
LEAST_RING = 2
"""Members from which a ring can be formed."""
CLEARANCE = 0.7
"""Distance to both neighbors, in units of half the even gap, at which a member in the outer lane enters."""


def slot_errors(phases: Mapping[int, float]) -> dict[int, float]:
    """Return u of every member, rad, by id: how far it is behind its slot.

    The ring may be cut anywhere: moving the first member to the end turns all slots by one rank, and changes none.
    """
    ring = sorted(phases, key=lambda member: phases[member] % LAP)
    n = len(ring)
    for _ in ring:
        for i in range(n - 1):
            one, other = ring[i], ring[i + 1]
            if one > other and phases[other] % LAP - phases[one] % LAP < CLOSE:
                ring[i], ring[i + 1] = other, one
    behind = [phases[member] % LAP - LAP * rank / n for rank, member in enumerate(ring)]
    mean = sum(behind) / n if n else 0.0
    return {member: mean - here for member, here in zip(ring, behind, strict=True)}


def gaps(phases: Iterable[float]) -> list[float]:
    """Return the gaps between neighbors round the ring, rad; they add up to a lap."""
    ring = sorted(phase % LAP for phase in phases)
    if not ring:
        return []
    return [after - before for before, after in zip(ring, [*ring[1:], ring[0] + LAP], strict=True)]


@dataclass(frozen=True, slots=True)
class SpacingSettings:
    """Facts of one member. radius, speed: of the circle, m and m/s. by_speed: True to modulate the speed (copters).
    trims_speed: True if the vehicle follows speed commands, so that the integral moves the speed. inward, outward:
    room that the mission leaves beside the circle, m."""

    member: int
    radius: float
    speed: float
    sense: int
    by_speed: bool = False
    trims_speed: bool = False
    inward: float = MAX_RADIUS_CHANGE
    outward: float = LANE

    def limited(self, room: tuple[float, float]) -> "SpacingSettings":
        """Return the settings with so much room inward and outward, m."""
        return replace(self, inward=room[0], outward=room[1])

    @property
    def most(self) -> float:
        """Largest relative change of the angular rate. The same to both sides: a sum of zero stays zero."""
        if self.by_speed:
            return MAX_SPEED_SHARE
        return min(min(MAX_RADIUS_CHANGE, self.inward, self.outward) / self.radius, MAX_RADIUS_SHARE)

    @property
    def lane(self) -> float:
        """Distance of the outer lane from the circle, m."""
        return min(LANE, LANE_SHARE * self.radius, self.outward)


@dataclass(frozen=True, slots=True)
class Own:
    """Own flight at one moment. phase, phase_sigma: temporal phase, rad; None if unknown. range: m."""

    phase: float | None
    phase_sigma: float
    range: float
    leaving: bool = False


@dataclass(frozen=True, slots=True)
class Adjustment:
    """Result of a step. offset: m outward from the circle. speed: factor of the speed. error: smoothed u, rad, or None
    while not counted. counted: phases of the members on the circle, own one included, rad, by id."""

    state: State
    offset: float
    speed: float
    error: float | None
    counted: dict[int, float] = field(default_factory=dict)


class Spacing:
    """Spacing of one member: reports and own phase in, changes of radius and speed out. Times in s, of one clock."""

    def __init__(self, settings: SpacingSettings) -> None:
        self.settings = settings
        self.known: dict[int, MemberReport] = {}
        """Newest report of every other member."""
        self.sense = settings.sense
        """Sense of rotation now: the operator may reverse it."""
        self.trim = 0.0
        self._error: float | None = None
        self._before: float | None = None
        self._entered, self._known_at = False, float("-inf")

    def take(self, reports: Iterable[MemberReport]) -> None:
        """Take in reports of other members."""
        for report in reports:
            before = self.known.get(report.member)
            if report.member != self.settings.member and (before is None or report.stamp >= before.stamp):
                self.known[report.member] = report

    def present(self, now: float) -> dict[int, MemberReport]:
        """Return the newest reports of the members that are not silent."""
        return {member: report for member, report in self.known.items() if now - report.stamp <= SILENT}

    def phases(self, now: float) -> dict[int, float]:
        """Return the phases of the other members on the circle, extrapolated: a phase grows steadily in any wind."""
        ring = {
            member: report
            for member, report in self.present(now).items()
            if report.state is State.ON_CIRCLE and report.sense == self.sense
        }
        sure = {m: r for m, r in ring.items() if r.phase_sigma <= pi / (len(ring) + 1)}
        return {
            member: (report.phase + LAP * (now - report.stamp) / report.lap_period) % LAP
            for member, report in sure.items()
        }

    def step(self, now: float, own: Own) -> Adjustment:
        """Return what to fly now."""
        dt = 0.0 if self._before is None else min(max(now - self._before, 0.0), 1.0)
        self._before = now
        others = self.phases(now)
        state = self._state(now, own, others)
        if state is not State.ON_CIRCLE or own.phase is None:
            self._error = None
            self._decay(dt, FORGET_ALONE)
            waits = state is State.LEAVING or (state is State.PHASE_KNOWN and self._formed(others))
            return Adjustment(state, self.settings.lane if waits else 0.0, 1.0, None, others)
        counted = others | {self.settings.member: own.phase}
        error = slot_errors(counted)[self.settings.member]
        before = error if self._error is None else self._error
        # A change of ranks moves the slot at once: the error follows at once, too.
        jumped = abs(error - before) > pi / len(counted)
        self._error = error if jumped else before + (error - before) * dt / (SMOOTHING + dt)
        self._integrate(dt, alone=not others)
        return self._adjustment(state, counted)

    def _state(self, now: float, own: Own, others: Mapping[int, float]) -> State:
        """Return the own state; enter the circle where there is room."""
        settings = self.settings
        if own.leaving:
            return State.LEAVING
        if own.phase is None:
            self._entered &= now - self._known_at <= SILENT
            return State.SEARCH
        self._known_at = now
        if self._entered or own.phase_sigma > pi / (len(others) + 1):
            return State.ON_CIRCLE if self._entered else State.PHASE_KNOWN
        if self._formed(others):
            near = min(abs(wrapped(phase - own.phase)) for phase in others.values())
            room = near >= CLEARANCE * pi / len(others)
            self._entered = room and own.range <= settings.radius + 1.5 * settings.lane
        else:
            self._entered = own.range <= settings.radius + settings.lane
        return State.ON_CIRCLE if self._entered else State.PHASE_KNOWN

    def _formed(self, others: Mapping[int, float]) -> bool:
        """True if the other members are a ring that is even already."""
        return len(others) >= LEAST_RING and max(map(abs, slot_errors(others).values())) <= FORMED

    def _integrate(self, dt: float, *, alone: bool) -> None:
        assert self._error is not None
        settings = self.settings
        self._decay(dt, FORGET_ALONE if alone else FORGET)
        if abs(self._error) <= TRIM_WITHIN and not alone:
            rate = INTEGRAL * GAIN**2 * settings.speed / settings.radius
            self.trim = min(max(self.trim + rate * self._error * dt, -MAX_TRIM), MAX_TRIM)

    def _decay(self, dt: float, time: float) -> None:
        self.trim *= exp(-dt / time)

    def _adjustment(self, state: State, counted: dict[int, float]) -> Adjustment:
        """Turn the error into a change of speed or radius. The integral moves the speed where the vehicle follows."""
        assert self._error is not None
        settings, most = self.settings, self.settings.most
        quick = min(max(GAIN * self._error, -most), most)
        if settings.by_speed:
            faster, inward = min(max(quick + self.trim, -most), most), 0.0
        elif settings.trims_speed:
            faster, inward = self.trim, quick
        else:
            faster, inward = 0.0, min(max(quick + self.trim, -most), most)
        return Adjustment(state, -inward * settings.radius, 1 + faster, self._error, counted)


def least_time_to_even(n: int, angular_rate: float, most: float, apart: float = 0.0) -> float:
    """Return the shortest time, s, in which n members get even that are `apart` (rad) from each other: the outermost
    ones need it. angular_rate: rad/s. most: largest relative change of it."""
    outermost = (n - 1) / 2 * (LAP / n - apart)
    return outermost * (1 + most) / (angular_rate * most)


def evenness_floor(n: int, sigma: float) -> float:
    """Return the expected worst of n gap errors, rad. sigma: error of each phase that no member can measure, rad.

    A gap has the errors of two members. The largest of n normal variables is near sqrt(2 ln n) standard deviations.
    """
    return sqrt(2) * sigma * max(sqrt(2 * log(n)), 1.0)
