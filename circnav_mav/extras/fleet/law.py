"""Even spacing of the members on one circle, from their reported temporal phases.

Every member receives all reports and computes the same slots: no leader, no fixed number of members
and no positions are needed. The slots are evenly spaced and as near as possible to the members
(least squares). Phase lag u_i of member i behind its slot, from the phases tau of n members:

    u_i = c + 2 pi k_i / n - tau_i,   c = mean over k of (tau_k - 2 pi k / n)
    k: rank of the phase on the ring

A member that is behind its slot (u > 0) flies faster. If its speed is at the limit, or cannot be
commanded, it also flies a smaller circle. A slow integral corrects lasting differences between
vehicles, such as in airspeed.

A phase is measured from the member's own north. `Spacing.offsets` holds the estimated differences
of these directions, which are added to the received phases.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import exp, log, pi, sqrt

from circnav_mav.extras.fleet.offset import PhaseOffset
from circnav_mav.extras.fleet.phase import LAP
from circnav_mav.extras.fleet.report import MemberReport, State

SILENT = 10.0
"""Age of a report, s, up to which the member's phase is extrapolated. Later, the other members
close the gap of the silent member."""
GAIN = 0.6
"""Relative change of the angular rate on the circle per slot error, 1/rad."""
LEAD = 4.0
"""Lag of the radius behind its command, s: about 3 s inward and 6 s outward for a plane at 15
m/s."""
MAX_TRIM = 0.08
"""Largest value of the integral of the slot error, as a share of the angular rate."""
FORGET = 300.0
"""Decay time of the integral, s, while other members are on the circle. The decay removes the part
that is common to all members."""
FORGET_ALONE = 30.0
"""Decay time of the integral without other members on the circle, s."""
SMOOTHING = 2.0
"""Time constant of the filter on the slot error, s."""
MAX_RADIUS_CHANGE = 20.0
"""Largest change of the radius for the spacing, m."""
MAX_RADIUS_SHARE = 0.2
"""Largest change of the radius for the spacing, as a share of the radius."""
MAX_SPEED_SHARE = 0.15
"""Largest change of the speed for the spacing, as a share of the speed."""
LANE = 25.0
"""Distance of the outer lane from the circle, m. Members that wait or leave fly in this lane."""
LANE_SHARE = 0.25
"""Largest distance of the outer lane from the circle, as a share of the radius."""


def slot_errors(phases: Mapping[int, float]) -> dict[int, float]:
    """Return the phase lag u of every member behind its slot, rad, by id.

    The result does not depend on which member is first in the ring.
    """
    ring = sorted(phases, key=lambda member: phases[member] % LAP)
    n = len(ring)
    for _ in ring:
        for i in range(n - 1):
            one = ring[i]
            other = ring[i + 1]
            # 0.035: phase difference, rad, below which two members are ordered by id. Ordered by
            # phase, noise would swap them repeatedly.
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

    radius: radius of the circle, m.
    speed: speed on the circle, m/s.
    sense: +1 counter-clockwise, -1 clockwise.
    speed_share: largest relative change of the speed, 0 if the speed cannot be commanded.
    inward, outward: room on both sides of the circle allowed by the mission, m.
    """

    member: int
    radius: float
    speed: float
    sense: int
    speed_share: float = 0.0
    inward: float = MAX_RADIUS_CHANGE
    outward: float = LANE

    @property
    def radius_share(self) -> float:
        """Largest relative change of the radius. The limit is the same inward and outward, so that
        the changes in a fleet sum to 0."""
        room = min(MAX_RADIUS_CHANGE, self.inward, self.outward)
        return min(room / self.radius, MAX_RADIUS_SHARE)

    @property
    def most(self) -> float:
        """Largest relative change of the angular rate."""
        return self.speed_share + self.radius_share

    @property
    def lane(self) -> float:
        """Distance of the outer lane from the circle, m."""
        return min(LANE, LANE_SHARE * self.radius, self.outward)


@dataclass(frozen=True, slots=True)
class OwnState:
    """State of this member at one time.

    phase: temporal phase, rad, None if unknown.
    phase_sigma: standard deviation of the phase, rad.
    range: range to the target, m.
    leaving: True if the member leaves the circle.
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

    state: state to report.
    offset: change of the radius, outward, m.
    speed: factor of the speed.
    error: smoothed phase lag u behind the slot, rad, None while not on the circle.
    counted: phases of the members on the circle including this one, rad, by id.
    own: state of this member at this step.
    """

    own: OwnState
    state: State
    offset: float
    speed: float
    error: float | None
    counted: dict[int, float] = field(default_factory=dict)


class Spacing:
    """Fleet law of one member. Input: reports of the other members and this member's phase. Output:
    changes of radius and speed. All times are of one clock, s."""

    def __init__(self, settings: SpacingSettings) -> None:
        self.settings = settings
        self.known: dict[int, MemberReport] = {}
        """Newest report of every other member."""
        self.offsets: dict[int, PhaseOffset] = {}
        """Correction of the phase of every other member for the difference of the compasses."""
        self.sense = settings.sense
        """Current sense of rotation, which the operator may reverse."""
        self.trim = 0.0
        self._error: float | None = None
        self._before: float | None = None
        self._entered = False
        self._known_at = float("-inf")

    def take(self, reports: Iterable[MemberReport]) -> None:
        """Store reports of other members, in the order in which they were sent."""
        own = self.settings.member
        self.known |= {report.member: report for report in reports if report.member != own}

    def present(self, now: float) -> dict[int, MemberReport]:
        """Return the newest reports of the members that are not silent."""
        return {
            member: report
            for member, report in self.known.items()
            if abs(now - report.stamp) <= SILENT
        }

    def phases(self, now: float) -> dict[int, float]:
        """Return the extrapolated and corrected phases of the other members on the circle."""
        ring = {
            member: report
            for member, report in self.present(now).items()
            if report.state is State.ON_CIRCLE and report.sense == self.sense
        }
        # Skip phases with a sigma above half the even gap: their rank on the ring is uncertain.
        sure = {m: r for m, r in ring.items() if r.phase_sigma <= pi / (len(ring) + 1)}
        known = {m: one.value for m, one in self.offsets.items()}
        return {m: (r.phase_at(now) + known.get(m, 0.0)) % LAP for m, r in sure.items()}

    def step(self, now: float, own: OwnState) -> Adjustment:
        """Return the changes of radius and speed for this time."""
        dt = 0.0 if self._before is None else min(max(now - self._before, 0.0), 1.0)
        self._before = now
        others = self.phases(now)
        state = self._state(now, own, others)
        if state is not State.ON_CIRCLE or own.phase is None:
            self._error = None
            self._decay(dt, FORGET_ALONE)
            # Members that leave, or wait for a free height layer, fly in the outer lane.
            waits = state is State.LEAVING or (state is State.PHASE_KNOWN and own.shares_layer)
            return Adjustment(own, state, self.settings.lane if waits else 0.0, 1.0, None, others)
        counted = others | {self.settings.member: own.phase}
        error = slot_errors(counted)[self.settings.member]
        before = error if self._error is None else self._error
        # A change of ranks makes the slot jump. Let the smoothed error follow the jump without
        # delay.
        jumped = abs(error - before) > pi / len(counted)
        self._error = error if jumped else before + (error - before) * dt / (SMOOTHING + dt)
        self._integrate(dt, alone=not others)
        return self._adjustment(state, counted, own)

    def _state(self, now: float, own: OwnState, others: Mapping[int, float]) -> State:
        """Return the state of this member. The member enters the circle as soon as it is near the
        circle: height layers separate the members, and all of them make room at the same time."""
        settings = self.settings
        if own.leaving:
            return State.LEAVING
        if own.phase is None:
            self._entered &= now - self._known_at <= SILENT
            return State.SEARCH
        self._known_at = now
        # Members that pass each other are separated only by their height layers: do not enter the
        # circle in an occupied layer.
        if not own.shares_layer and own.phase_sigma <= pi / (len(others) + 1):
            self._entered |= own.range <= settings.radius + settings.lane
        return State.ON_CIRCLE if self._entered else State.PHASE_KNOWN

    def _integrate(self, dt: float, *, alone: bool) -> None:
        assert self._error is not None
        settings = self.settings
        self._decay(dt, FORGET_ALONE if alone else FORGET)
        # 0.15: slot error up to which the integral runs, rad. If it ran at larger errors, the
        # member would overshoot.
        if abs(self._error) <= 0.15 and not alone:
            # 0.2: rate of the integral, in units of GAIN^2 times the angular rate. Below 0.25 the
            # loop does not overshoot.
            rate = 0.2 * GAIN**2 * settings.speed / settings.radius
            self.trim = min(max(self.trim + rate * self._error * dt, -MAX_TRIM), MAX_TRIM)

    def _closing(self, range_: float) -> float:
        """Return the part of the error, rad, that the present difference of the radius removes
        within LEAD.

        The error u changes at -w x, with the angular rate w and the relative reduction x of the
        radius. The radius follows a command K u with the lag T: T x' + x = K u. This loop
        overshoots for T > 1 / (4 K w). The command K (u - w T x) cancels the lag: the poles become
        -1 / T and -K w, as if the radius had no lag. K is GAIN, T is LEAD.
        """
        settings = self.settings
        # Without speed commands, the integral changes the radius. This part of the radius
        # compensates a different airspeed and does not reduce the error.
        lasting = 0.0 if settings.speed_share else self.trim
        inward = (settings.radius - range_) / settings.radius - lasting
        most = settings.radius_share
        return LEAD * settings.speed / settings.radius * min(max(inward, -most), most)

    def _decay(self, dt: float, time: float) -> None:
        self.trim *= exp(-dt / time)

    def _adjustment(self, state: State, counted: dict[int, float], own: OwnState) -> Adjustment:
        """Return the changes that reduce the error: first of the speed, and of the radius for the
        remainder."""
        assert self._error is not None
        settings = self.settings
        quick = GAIN * (self._error - self._closing(own.range)) + self.trim
        faster = min(max(quick, -settings.speed_share), settings.speed_share)
        inward = min(max(quick - faster, -settings.radius_share), settings.radius_share)
        return Adjustment(own, state, -inward * settings.radius, 1 + faster, self._error, counted)


def least_time_to_even(n: int, angular_rate: float, most: float) -> float:
    """Return the shortest time to space n members evenly from one place, s. The outermost members
    need the longest time.

    angular_rate: angular rate on the circle, rad/s.
    most: largest relative change of this rate.
    """
    outermost = (n - 1) / 2 * LAP / n
    return outermost * (1 + most) / (angular_rate * most)


def evenness_floor(n: int, sigma: float) -> float:
    """Return the expected largest of n gap errors, rad. sigma: standard deviation of the error of
    each phase, which cannot be observed, rad.

    A gap has the errors of two members. The largest of n normal variables is near sqrt(2 ln n)
    standard deviations.
    """
    return sqrt(2) * sigma * max(sqrt(2 * log(n)), 1.0)
