"""Even spacing of the members on one circle, from their reported temporal phases.

Every member receives all reports and computes the same slots: no leader, no fixed number of members
and no positions are needed. The slots are evenly spaced and as near as possible to the members
(least squares). Phase lag u_i of member i behind its slot, from the phases tau of n members:

    u_i = c + 2 pi k_i / n - tau_i,   c = mean over k of (tau_k - 2 pi k / n)
    k: rank of the phase on the ring

A member that is behind its slot (u > 0) flies a smaller circle, or faster. A slow integral corrects
lasting differences between vehicles, such as in airspeed: with 2 % difference they stay even only
on circles whose radii differ by 2 %.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import exp, log, pi, sqrt

from circnav_mav.extras.fleet.phase import LAP, wrapped
from circnav_mav.extras.fleet.report import MemberReport, State

SILENT = 10.0
"""Age of a report, s, up to which the member's phase is extrapolated. Later the other members close
the gap."""
GAIN = 0.6
"""Relative change of the angular rate per slot error (1/rad)."""
LEAD = 4.0
"""Time in which the radius follows a command, s: 3 s inward and 6 s outward for a plane at 15
m/s."""
MAX_TRIM = 0.08
"""Largest value of the integral, as a share of the angular rate."""
FORGET = 300.0
FORGET_ALONE = 30.0
"""Decay time of the integral, s, in a ring and alone. In a ring, decay removes the part common to
all members."""
SMOOTHING = 2.0
"""Time constant of the filter on the slot error, s."""
MAX_RADIUS_CHANGE = 20.0
MAX_RADIUS_SHARE = 0.2
MAX_SPEED_SHARE = 0.15
"""Limits of the changes that space the members: radius in m, radius as a share, speed as a
share."""
LANE = 25.0
LANE_SHARE = 0.25
"""Distance of the outer lane from the circle, m, and its limit as a share of the radius."""


def slot_errors(phases: Mapping[int, float]) -> dict[int, float]:
    """Return u of every member by id: its phase lag behind its slot, rad.

    The result does not depend on which member is first in the ring.
    """
    ring = sorted(phases, key=lambda member: phases[member] % LAP)
    n = len(ring)
    for _ in ring:
        for i in range(n - 1):
            one = ring[i]
            other = ring[i + 1]
            # Phase difference, rad, below which two members are ordered by id: noise would swap
            # them repeatedly.
            if one > other and phases[other] % LAP - phases[one] % LAP < 0.035:
                ring[i], ring[i + 1] = other, one
    behind = [phases[member] % LAP - LAP * rank / n for rank, member in enumerate(ring)]
    mean = sum(behind) / n if n else 0.0
    return {member: mean - here for member, here in zip(ring, behind, strict=True)}


def gaps(phases: Iterable[float]) -> list[float]:
    """Return the gaps between neighbors on the ring, rad. Their sum is one lap."""
    ring = sorted(phase % LAP for phase in phases)
    if not ring:
        return []
    return [after - before for before, after in zip(ring, [*ring[1:], ring[0] + LAP], strict=True)]


@dataclass(frozen=True, slots=True)
class SpacingSettings:
    """Settings of one member.

    radius, speed: of the circle, m, m/s.
    sense: +1 counter-clockwise, -1 clockwise.
    by_speed: True to space by the speed instead of the radius (copters).
    trims_speed: True to apply the integral to the speed; the vehicle must follow speed commands.
    inward, outward: room beside the circle allowed by the mission, m.
    """

    member: int
    radius: float
    speed: float
    sense: int
    by_speed: bool = False
    trims_speed: bool = False
    inward: float = MAX_RADIUS_CHANGE
    outward: float = LANE

    @property
    def most(self) -> float:
        """Largest relative change of the angular rate, equal for both signs so that the changes in
        a fleet sum to 0."""
        if self.by_speed:
            return MAX_SPEED_SHARE
        return min(
            min(MAX_RADIUS_CHANGE, self.inward, self.outward) / self.radius, MAX_RADIUS_SHARE
        )

    @property
    def lane(self) -> float:
        """Distance of the outer lane from the circle, m."""
        return min(LANE, LANE_SHARE * self.radius, self.outward)


@dataclass(frozen=True, slots=True)
class OwnState:
    """State of this member at one time.

    phase, phase_sigma: temporal phase, rad; None if unknown.
    range: m.
    shares_layer: True if a member with priority is in the same height layer.
    """

    phase: float | None
    phase_sigma: float
    range: float
    leaving: bool = False
    shares_layer: bool = False


@dataclass(frozen=True, slots=True)
class Adjustment:
    """Result of a step.

    offset: m outward from the circle.
    speed: factor of the speed.
    error: smoothed lag u, rad, None while not on the circle.
    counted: phases of the members on the circle including this one, rad, by id.
    """

    state: State
    offset: float
    speed: float
    error: float | None
    counted: dict[int, float] = field(default_factory=dict)


class Spacing:
    """Fleet law of one member: reports and its phase in, changes of radius and speed out. Times: s,
    on one clock."""

    def __init__(self, settings: SpacingSettings) -> None:
        self.settings = settings
        self.known: dict[int, MemberReport] = {}
        """Newest report of every other member."""
        self.sense = settings.sense
        """Current sense of rotation, which the operator may reverse."""
        self.trim = 0.0
        self._error: float | None = None
        self._before: float | None = None
        self._entered = False
        self._known_at = float("-inf")

    def take(self, reports: Iterable[MemberReport]) -> None:
        """Store newer reports of other members."""
        for report in reports:
            before = self.known.get(report.member)
            if report.member != self.settings.member and (
                before is None or report.stamp >= before.stamp
            ):
                self.known[report.member] = report

    def present(self, now: float) -> dict[int, MemberReport]:
        """Return the newest reports of the members that are not silent."""
        return {
            member: report for member, report in self.known.items() if now - report.stamp <= SILENT
        }

    def phases(self, now: float) -> dict[int, float]:
        """Return the extrapolated phases of the other members on the circle."""
        ring = {
            member: report
            for member, report in self.present(now).items()
            if report.state is State.ON_CIRCLE and report.sense == self.sense
        }
        # Skip phases with a sigma above half the even gap: their rank on the ring is uncertain.
        sure = {m: r for m, r in ring.items() if r.phase_sigma <= pi / (len(ring) + 1)}
        return {member: report.phase_at(now) % LAP for member, report in sure.items()}

    def step(self, now: float, own: OwnState) -> Adjustment:
        """Return the adjustment to fly now."""
        dt = 0.0 if self._before is None else min(max(now - self._before, 0.0), 1.0)
        self._before = now
        others = self.phases(now)
        state = self._state(now, own, others)
        if state is not State.ON_CIRCLE or own.phase is None:
            self._error = None
            self._decay(dt, FORGET_ALONE)
            # Members that leave, or wait for a gap in a formed ring or for a free layer, fly in the
            # outer lane.
            outside = own.shares_layer or self._formed(others)
            waits = state is State.LEAVING or (state is State.PHASE_KNOWN and outside)
            return Adjustment(state, self.settings.lane if waits else 0.0, 1.0, None, others)
        counted = others | {self.settings.member: own.phase}
        error = slot_errors(counted)[self.settings.member]
        before = error if self._error is None else self._error
        # A change of ranks moves the slot by a step: let the smoothed error follow without delay.
        jumped = abs(error - before) > pi / len(counted)
        self._error = error if jumped else before + (error - before) * dt / (SMOOTHING + dt)
        self._integrate(dt, alone=not others)
        return self._adjustment(state, counted, own)

    def _state(self, now: float, own: OwnState, others: Mapping[int, float]) -> State:
        """Return the state of this member. Enter the circle if there is room."""
        settings = self.settings
        if own.leaving:
            return State.LEAVING
        if own.phase is None:
            self._entered &= now - self._known_at <= SILENT
            return State.SEARCH
        self._known_at = now
        # Only the layers separate members that pass each other: do not enter a layer that is taken.
        if self._entered or own.shares_layer or own.phase_sigma > pi / (len(others) + 1):
            return State.ON_CIRCLE if self._entered else State.PHASE_KNOWN
        # Join a formed ring only where both neighbors are far enough away. Otherwise enter as soon
        # as the vehicle is near the circle: the members then space themselves.
        if self._formed(others):
            near = min(abs(wrapped(phase - own.phase)) for phase in others.values())
            # Smallest phase difference to both neighbors, in units of half the even gap, to enter
            # from the outer lane.
            room = near >= 0.7 * pi / len(others)
            self._entered = room and own.range <= settings.radius + 1.5 * settings.lane
        else:
            self._entered = own.range <= settings.radius + settings.lane
        return State.ON_CIRCLE if self._entered else State.PHASE_KNOWN

    def _formed(self, others: Mapping[int, float]) -> bool:
        """True if the other members already form an even ring."""
        # Largest slot error, rad, in a formed ring. A member that joins a formed ring waits in the
        # outer lane for a gap.
        # 2: smallest number of members in a formed ring.
        return len(others) >= 2 and max(map(abs, slot_errors(others).values())) <= 0.35

    def _integrate(self, dt: float, *, alone: bool) -> None:
        assert self._error is not None
        settings = self.settings
        self._decay(dt, FORGET_ALONE if alone else FORGET)
        # Largest slot error, rad, for which the integral runs. If it ran at larger errors, the
        # member would overshoot.
        if abs(self._error) <= 0.15 and not alone:
            # Rate of the integral, in units of GAIN^2 times the angular rate: below 0.25 the loop
            # does not overshoot.
            rate = 0.2 * GAIN**2 * settings.speed / settings.radius
            self.trim = min(max(self.trim + rate * self._error * dt, -MAX_TRIM), MAX_TRIM)

    def _closing(self, range_: float) -> float:
        """Return the part of the error that the present radius removes within LEAD, rad.

        The error u changes at -w x, with the angular rate w and the relative reduction x of the
        radius. The radius follows a command K u with the lag T: T x' + x = K u. This loop
        overshoots for T > 1 / (4 K w). The command K (u - w T x) cancels the lag: the poles become
        -1 / T and -K w, as if the radius followed at once. K is GAIN, T is LEAD.
        """
        settings = self.settings
        if settings.by_speed:
            return 0.0
        # The integral's change of the radius, which compensates a different airspeed, does not
        # change the error.
        lasting = 0.0 if settings.trims_speed else self.trim
        inward = (settings.radius - range_) / settings.radius - lasting
        return (
            LEAD
            * settings.speed
            / settings.radius
            * min(max(inward, -settings.most), settings.most)
        )

    def _decay(self, dt: float, time: float) -> None:
        self.trim *= exp(-dt / time)

    def _adjustment(self, state: State, counted: dict[int, float], own: OwnState) -> Adjustment:
        """Return the change of speed or radius for the error. The integral changes the speed if it
        can be commanded."""
        assert self._error is not None
        settings = self.settings
        most = self.settings.most
        quick = min(max(GAIN * (self._error - self._closing(own.range)), -most), most)
        if settings.by_speed:
            faster = min(max(quick + self.trim, -most), most)
            inward = 0.0
        elif settings.trims_speed:
            faster = self.trim
            inward = quick
        else:
            faster = 0.0
            inward = min(max(quick + self.trim, -most), most)
        return Adjustment(state, -inward * settings.radius, 1 + faster, self._error, counted)


def least_time_to_even(n: int, angular_rate: float, most: float, apart: float = 0.0) -> float:
    """Return the shortest time, s, to space n members evenly: the time that the outermost members
    need.

    angular_rate: rad/s.
    most: largest relative change of this rate.
    apart: initial gap between neighbors, rad.
    """
    outermost = (n - 1) / 2 * (LAP / n - apart)
    return outermost * (1 + most) / (angular_rate * most)


def evenness_floor(n: int, sigma: float) -> float:
    """Return the expected largest of n gap errors, rad. sigma: unobservable error of each phase,
    rad.

    A gap has the errors of two members. The largest of n normal variables is near sqrt(2 ln n)
    standard deviations.
    """
    return sqrt(2) * sigma * max(sqrt(2 * log(n)), 1.0)
