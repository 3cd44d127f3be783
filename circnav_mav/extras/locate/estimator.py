"""The place of a target by batch least squares over positions and ranges: one estimator in flight and for logs.

Unknown are the place, its velocity if it moves, its height, the error of the radio (bias and scale), how much later
positions are stamped than ranges, and the error of the positions: a first-order Gauss-Markov process, linear between
nodes. That error is what makes the covariance honest: a GPS is not white, and a lap averages little of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from circnav_mav.extras.locate.place import SIGNIFICANT, Array, Place, Plane

LEAST = 20
"""Ranges below which nothing is estimated."""
MOST = 1000
"""Most ranges that are used: of more, evenly spread ones."""
GAP = 3.0
"""Longest time, s, between two positions that a range may lie in."""
GUESSED = 150
"""Ranges by which the starting points are tried out."""
GPS_TIME, SPEED_SIGMA = 100.0, 10.0
"""How long, s, the error of a position stays; standard deviation of a target's velocity, each axis, m/s."""
NODES, MOST_NODES = 8, 40
"""Nodes in the correlation time of the positions' error, and most of them. With fewer, what it does between two looks
like a height: a lap at 2 a correlation time claimed heights that were 20 m off."""
HUBER, OUTLIER = 2.0, 4.0
"""Standard deviations: where the loss becomes linear, and from where a range is left out in the end."""
SAME, AMBIGUOUS = 3.0, 12.0
"""Places nearer than so many standard deviations are one; another one that fits worse by less than this in
chi-squared (p = .002) may be the right one."""
MOVING = 18.0
"""Chi-squared of the velocity (two degrees of freedom, p = 1e-4) from which a target is said to move."""
SLOWEST = 0.15
"""Speed, m/s, below which a target stands: the error of a GPS wanders as quickly."""
MOVING_WINDOW = 120.0
"""Newest time, s, by which a moving target is judged: it does not keep its velocity for longer."""
CALIBRATED, UNCALIBRATED = 0.0003, 0.1
"""Standard deviation of a radio's scale error: of a radio that measures true meters, and of one that does not. A quartz
errs by 20 ppm, and air slows radio waves by 300 ppm, which many radios do not take into account."""
EXPLAINED = 1.3
"""Residuals over what the ranges say of themselves, up to which rest explains them."""
UP_KNOWN = 2.0
"""Standard deviation of the height, m, above which it counts as not observed."""
HARDLY = 5.0
"""Noise of ranges and positions together, below whose fivefold the change of the distance tells no offset of clocks:
the wiggles of a GPS, which the ranges do not have, would."""
ROUGH = 0.25
"""Standard deviation of a place, in units of the range, above which it is none."""
E, N, U, BIAS, SCALE, DELAY, VE, VN = range(8)
Fit = Any
"""A result of scipy's `least_squares`."""


@dataclass(frozen=True, slots=True)
class Track:
    """Positions as reported: time, s, rising; east, north, up, m, arrays (n,)."""

    time: Array
    east: Array
    north: Array
    up: Array


@dataclass(frozen=True, slots=True)
class Ranges:
    """Slant ranges: time, s; r, m; sigma, m, arrays (n,)."""

    time: Array
    r: Array
    sigma: Array

    def take(self, which: NDArray[Any]) -> "Ranges":
        """Some of them, by a mask or by index."""
        return Ranges(self.time[which], self.r[which], self.sigma[which])


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Prior knowledge; standard deviations in m and s. gps_sigma: of a position, each axis. up: of the target.
    scale_sigma: of the radio's scale error. sigma_known: True if the ranges' own standard deviations are meant."""

    up: float
    up_sigma: float = 50.0
    gps_sigma: float = 1.5
    bias_sigma: float = 2.0
    scale_sigma: float = CALIBRATED
    delay_sigma: float = 0.15
    sigma_known: bool = True


@dataclass(frozen=True, slots=True)
class NotYet:
    """Why there is no place, for people."""

    why: str


def locate(plane: Plane, track: Track, ranges: Ranges, known: Knowledge, near: Place | None = None) -> Place | NotYet:
    """Return the place at the end of the ranges. near: one found before, from which to start."""
    place = _locate(plane, track, ranges, known, near)
    if known.scale_sigma >= UNCALIBRATED:
        return place
    if isinstance(place, Place) and known.sigma_known:
        quiet = place.noise < EXPLAINED * float(np.median(ranges.sigma))
        if quiet and abs(place.bias) < SIGNIFICANT * place.bias_sigma:
            return place
    # Most radios measure true meters, and a scale that the ranges do not show costs certainty of the place. So it is
    # free only if the ranges contradict a scale of 1. The noise shows nothing: an error of scale looks like noise.
    free = _locate(plane, track, ranges, replace(known, scale_sigma=UNCALIBRATED), near)
    return free if isinstance(free, Place) and free.scale_found else place


def _locate(plane: Plane, track: Track, ranges: Ranges, known: Knowledge, near: Place | None) -> Place | NotYet:
    """Return the place with this prior knowledge."""
    kept = np.diff(np.maximum.accumulate(track.time), prepend=-np.inf) > 1e-3  # no position twice, none that is late
    track, heard = Track(track.time[kept], track.east[kept], track.north[kept], track.up[kept]), ranges
    ranges = _covered(track, heard)
    if len(ranges.r) < LEAST:
        return NotYet(f"{len(ranges.r)} ranges with positions round them, {LEAST} are needed{_apart(track, heard)}")
    still = _best(plane, track, ranges, known, near)
    newest = ranges.take(ranges.time >= ranges.time[-1] - MOVING_WINDOW)
    if len(newest.r) < LEAST:
        return still
    if isinstance(still, Place) and known.sigma_known:
        quiet = still.noise < EXPLAINED * float(np.median(ranges.sigma))
        if quiet and still.outliers < 0.2 * still.used:
            return still  # rest explains the ranges: nobody need ask whether the target moves
    moving = _Problem(track, newest, known, moves=True)
    fits = [moving.fit(start) for start in _moving_starts(track, newest, still, near)]
    fit = min(filter(None, fits), key=lambda one: one.cost, default=None)
    # motion contains rest: it must fit better by far, and the velocity be more than the wander of the positions
    at_rest = isinstance(still, Place) and _Problem(track, newest, known).fit(np.array([still.east, still.north]))
    if fit is None or (at_rest and 2 * (at_rest.cost - fit.cost) < MOVING):
        return still
    place = moving.finish(fit, plane)
    if place is None or not _good(place):
        return still
    return place if place.speed > max(np.sqrt(MOVING) * (place.velocity_sigma or 0.0), SLOWEST) else still


def locate_as_it_shows(plane: Plane, track: Track, ranges: Ranges, known: Knowledge) -> Place | NotYet:
    """Return the place. Ranges without a known noise get that of a first fit, with ten times their sigmas."""
    if not known.sigma_known:
        rough = locate(plane, track, replace(ranges, sigma=ranges.sigma * 10), known)
        if isinstance(rough, Place):
            ranges = replace(ranges, sigma=np.full(len(ranges.r), max(rough.noise, 0.01)))
    return locate(plane, track, ranges, known)


def _apart(track: Track, ranges: Ranges) -> str:
    """Where enough ranges came, and positions too, why they do not go together: clocks, or the unit of time."""
    if len(ranges.r) < LEAST or len(track.time) < 2:
        return ""
    of_ranges, of_positions = (f"{time[0]:.6g} .. {time[-1]:.6g} s" for time in (ranges.time, track.time))
    every = f"one every {float(np.median(np.diff(track.time))):.3g} s"
    return f"; ranges of {of_ranges}, positions of {of_positions}, {every}: one clock, in seconds?"


def _moving_starts(track: Track, ranges: Ranges, still: Place | NotYet, near: Place | None) -> Iterator[Array]:
    """Where to begin: the place before; rest; and that the target is what the vehicle went round, in the mean."""
    if near is not None:
        there = near.at(float(ranges.time[-1]))
        yield np.array([there.east, there.north, *near.velocity])
    if isinstance(still, Place):
        yield np.array([still.east, still.north, 0.0, 0.0])
    new = track.time >= ranges.time[0]
    ways = [np.polyfit(track.time[new] - ranges.time[-1], way[new], 1) for way in (track.east, track.north)]
    yield np.array([ways[0][1], ways[1][1], ways[0][0], ways[1][0]])


def _good(place: Place) -> bool:
    """Known well enough to tell, and no stranger than the ranges' bias may be."""
    usual = abs(place.bias) < 5 * place.bias_prior
    return bool(usual and place.sigma < max(ROUGH * place.range_scale, 3.0))


def _best(plane: Plane, track: Track, ranges: Ranges, known: Knowledge, near: Place | None) -> Place | NotYet:
    """The place of a target that stands. Ranges alone may fit two places: then there is none yet."""
    problem = _Problem(track, ranges, known)
    if near is not None and not near.moves:
        place = problem.finish(problem.fit(np.array([near.east, near.north])), plane)
        if place is not None and _good(place) and place.noise < 3 * max(near.noise, 0.1):
            return place
    every = max(1, len(ranges.r) // GUESSED)
    rough = _Problem(track, ranges.take(np.arange(0, len(ranges.r), every)), known, nodes=1)
    found = sorted(
        (fit for start in _starts(track, rough.ranges) if (fit := rough.fit(start))), key=lambda fit: fit.cost
    )
    if not found:
        return NotYet("the ranges fit no place")
    place = problem.finish(problem.fit(found[0].x[:2]), plane)
    if place is None or not _good(place):
        return NotYet("the track does not tell where the target is yet: fly a turn")
    for other in found[1:]:
        apart = np.hypot(*(other.x[:2] - found[0].x[:2]))
        if apart > SAME * place.sigma + 1.0 and 2 * (other.cost - found[0].cost) < AMBIGUOUS:
            return NotYet(f"two places {apart:.0f} m apart fit: the track is too straight, fly a turn")
    return place


def _starts(track: Track, ranges: Ranges) -> Iterator[Array]:
    """Where to begin: on circles about the ends and the middle of the track, as far away as was measured there."""
    for share in (0.0, 0.5, 1.0):
        at = int(share * (len(ranges.r) - 1))
        east, north = (np.interp(ranges.time[at], track.time, way) for way in (track.east, track.north))
        for angle in np.arange(8) * np.pi / 4:
            yield np.array([east + ranges.r[at] * np.cos(angle), north + ranges.r[at] * np.sin(angle)])


def _covered(track: Track, ranges: Ranges) -> Ranges:
    """The ranges that positions surround, at most MOST of them."""
    if len(track.time) < 2:
        return ranges.take(np.array([], int))
    after = np.clip(np.searchsorted(track.time, ranges.time), 1, len(track.time) - 1)
    inside = (ranges.time >= track.time[0]) & (ranges.time <= track.time[-1])
    kept = np.flatnonzero(inside & (track.time[after] - track.time[after - 1] <= GAP))
    return ranges.take(kept[:: max(1, -(-len(kept) // MOST))])


class _Problem:
    """Residuals of ranges and of what is known beforehand, both in standard deviations."""

    def __init__(
        self, track: Track, ranges: Ranges, known: Knowledge, *, moves: bool = False, nodes: int = MOST_NODES
    ) -> None:
        self.track, self.ranges, self.known, self.moves = track, ranges, known, moves
        self.end = float(ranges.time[-1])
        self._own = VN + 1 if moves else DELAY + 1
        sigmas = known.up_sigma, known.bias_sigma, known.scale_sigma, known.delay_sigma, SPEED_SIGMA, SPEED_SIGMA
        self._expected_sigma = np.array(sigmas[: self._own - U])
        self._expected = np.zeros(self._own - U)  # of all that is not the place
        self._expected[0] = known.up
        span = self.end - float(ranges.time[0])
        count = int(min(nodes, 1 + np.ceil(NODES * span / GPS_TIME)))
        places = np.linspace(ranges.time[0], self.end, count)
        self._between = np.column_stack([np.interp(ranges.time, places, row) for row in np.eye(count)])
        kernel = known.gps_sigma**2 * np.exp(-np.abs(places[:, None] - places) / GPS_TIME)
        self._whiten = np.linalg.inv(np.linalg.cholesky(kernel))
        # slopes of the track, by which a delay moves the position
        self._rates = [np.gradient(way, track.time) for way in (track.east, track.north, track.up)]

    def fit(self, start: Array) -> Fit | None:
        """Return the robust fit from a start: east, north, maybe velocity; or all but the nodes, by an earlier fit."""
        x = np.zeros(self._own + 2 * self._between.shape[1])
        # begun level with the vehicle, a height would stay there: the range does not change with it
        below = float(np.median(self.track.up)) - 0.2 * float(np.median(self.ranges.r))
        x[:2], x[U] = start[:2], min(self.known.up, below) if self.known.up_sigma > 10 else self.known.up
        if len(start) == self._own:
            x[: self._own] = start
        elif self.moves:
            x[VE : VN + 1] = start[2:4]
        scale = np.ones_like(x)
        scale[[E, N, U]], scale[DELAY], scale[SCALE] = 10.0, 0.1, 0.01
        found = least_squares(
            self._residuals, x, self._jacobian, loss=self._loss, f_scale=HUBER, x_scale=scale, max_nfev=60, ftol=1e-5,
            xtol=1e-5,
        )  # fmt: skip
        return found if np.isfinite(found.cost) else None

    def _loss(self, z: Array) -> Array:
        """Huber for ranges; quadratic for what is known beforehand, which is no outlier. z: squares, as scipy wants."""
        far = z > 1
        far[len(self.ranges.r) :] = False
        root = np.sqrt(np.where(far, z, 1.0))
        return np.array([np.where(far, 2 * root - 1, z), 1 / root, np.where(far, -0.5 / root**3, 0.0)])

    def finish(self, fit: Fit | None, plane: Plane) -> Place | None:
        """The place by a robust fit: again without its outliers, and with the noise that the ranges show. None where
        nothing fits."""
        if fit is None:
            return None
        count = len(self.ranges.r)
        off = fit.fun[:count]
        scale = 1.4826 * float(np.median(np.abs(off)))
        least = 1.0 if self.known.sigma_known else 1e-6
        keep = np.abs(off) <= OUTLIER * max(scale, least)
        if keep.sum() < LEAST:
            return None
        spread, kept = float(np.sqrt(np.mean(off[keep] ** 2))), self.ranges.take(keep)
        worse = max(spread, least) * np.sqrt(_correlation(off[keep]))
        again = _Problem(self.track, replace(kept, sigma=kept.sigma * worse), self.known, moves=self.moves)
        last = again.fit(fit.x[: self._own])
        if last is None:
            return None
        try:
            covariance = again.covariance(last)
        except np.linalg.LinAlgError:
            return None
        x = last.x
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        velocity = (float(x[VE]), float(x[VN])) if self.moves else (0.0, 0.0)
        noise = spread * float(np.median(self.ranges.sigma))
        both = [BIAS, SCALE]
        radio, radio_covariance = x[both], covariance[np.ix_(both, both)]
        nearest, farthest = np.percentile(kept.r, [5, 95])
        if farthest - nearest < HARDLY * (noise + self.known.gps_sigma):
            sd[DELAY] = self.known.delay_sigma  # on a circle round the target a clock fits as well as any other
            radio, radio_covariance = self._of_one_length(radio, radio_covariance)
        return Place(
            time=self.end, plane=plane, east=float(x[E]), north=float(x[N]), up=float(x[U]),
            covariance=covariance[:2, :2], up_sigma=float(sd[U]),
            up_known=bool(sd[U] <= UP_KNOWN and again.one_sided(last, float(sd[U]))),
            bias=float(radio[0]), scale=float(radio[1]), radio_covariance=radio_covariance,
            bias_prior=self.known.bias_sigma,
            delay=float(x[DELAY]), delay_sigma=float(sd[DELAY]),
            noise=noise, used=int(keep.sum()), outliers=int((~keep).sum()),
            velocity=velocity, velocity_sigma=float(max(sd[VE], sd[VN])) if self.moves else None,
            range_scale=float(np.median(self.ranges.r)),
        )  # fmt: skip

    def _of_one_length(self, radio: Array, covariance: Array) -> tuple[Array, Array]:
        """Return bias and scale, with their covariance, from their sum at the median length and the prior alone."""
        # On a circle round the target the lengths change by the wander of the GPS, which the ranges do not have. The
        # fit takes it for a slope: a scale of 1.07 with a free bias once came out as 0.80 +-0.06.
        slope = np.array([1.0, (float(np.median(self.ranges.r)) - radio[0]) / (1 + radio[1])])
        prior = np.diag([self.known.bias_sigma**2, self.known.scale_sigma**2])
        gain = prior @ slope / (slope @ prior @ slope + slope @ covariance @ slope)
        return gain * (slope @ radio), prior - np.outer(gain, slope @ prior)

    def covariance(self, fit: Fit) -> Array:
        """Return the covariance of the states. Raises LinAlgError."""
        covariance: Array = np.linalg.inv(fit.jac.T @ fit.jac).astype(float)
        # Level with the vehicle, a range does not change with the height at first, and the derivatives promise a bias
        # and a scale that a height would explain. It changes with the square of the height above the track. The
        # standard deviation of that square gives the height from which on the slope is taken instead.
        count, (far, _, _) = len(self.ranges.r), self._line_of_sight(fit.x)
        off = float(np.median(np.abs(np.interp(self.ranges.time, self.track.time, self.track.up) - fit.x[U])))
        if off > self.known.up_sigma:
            return covariance
        table = fit.jac.copy()
        slope = table[:count, BIAS] * (1 + fit.x[SCALE]) / np.maximum(far, 1e-3)  # outliers weigh as in that column
        table[:count, U] = self.known.up_sigma * slope
        wide: Array = np.linalg.inv(table.T @ table).astype(float)
        least = float(np.sqrt(self.known.up_sigma * np.sqrt(wide[U, U])))
        if off > least:
            return covariance
        table[:count, U] = least * slope
        return np.linalg.inv(table.T @ table).astype(float)

    def one_sided(self, fit: Fit, sigma: float) -> bool:
        """True if the ranges or the prior reject the height that is mirrored at the track. sigma: of the height, m."""
        # A level track fits a target as far above it as below, and near the level of the track the covariance, which is
        # that of a straight line, promises too much. A UWB radio on a cart once gave -1.5 +-0.7 m for +0.9 m so.
        known, start = self.known, fit.x[: self._own].copy()
        mirror = 2 * float(np.median(self.track.up)) - float(fit.x[U])
        if abs(mirror - fit.x[U]) < sigma:
            return True
        start[U] = mirror
        there = replace(known, up=mirror, up_sigma=sigma / 10)
        other = _Problem(self.track, self.ranges, there, moves=self.moves).fit(start)
        if other is None:
            return True
        off = (mirror - known.up) / known.up_sigma
        return bool(2 * (other.cost - fit.cost) + off**2 > AMBIGUOUS)

    def _line_of_sight(self, x: Array) -> tuple[Array, list[Array], Array]:
        """Distance, its direction, and the time to take positions at."""
        time = self.ranges.time + x[DELAY]
        ways = (self.track.east, self.track.north, self.track.up)
        east, north, up = (np.interp(time, self.track.time, way) for way in ways)
        nodes = x[self._own :].reshape(2, -1)
        ahead = self.ranges.time - self.end
        way = [x[E] - east + self._between @ nodes[0], x[N] - north + self._between @ nodes[1], x[U] - up]
        if self.moves:
            way[0], way[1] = way[0] + x[VE] * ahead, way[1] + x[VN] * ahead
        far = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        return far, [part / np.maximum(far, 1e-3) for part in way], time

    def _residuals(self, x: Array) -> Array:
        far, _, _ = self._line_of_sight(x)
        nodes = x[self._own :].reshape(2, -1)
        before = (x[U : self._own] - self._expected) / self._expected_sigma
        off = ((1 + x[SCALE]) * far + x[BIAS] - self.ranges.r) / self.ranges.sigma
        return np.concatenate([off, before, self._whiten @ nodes[0], self._whiten @ nodes[1]])

    def _jacobian(self, x: Array) -> Array:
        far, directions, time = self._line_of_sight(x)
        east, north, up = (part * (1 + x[SCALE]) for part in directions)
        count, own, nodes = len(far), self._own, self._between.shape[1]
        priors = self._own - U
        table = np.zeros((count + priors + 2 * nodes, own + 2 * nodes))
        table[:count, E], table[:count, N], table[:count, U] = east, north, up
        table[:count, BIAS], table[:count, SCALE] = 1.0, far
        slopes = [np.interp(time, self.track.time, rate) for rate in self._rates]
        table[:count, DELAY] = -(east * slopes[0] + north * slopes[1] + up * slopes[2])
        if self.moves:
            ahead = self.ranges.time - self.end
            table[:count, VE], table[:count, VN] = east * ahead, north * ahead
        table[:count, own : own + nodes] = east[:, None] * self._between
        table[:count, own + nodes :] = north[:, None] * self._between
        table[:count] /= self.ranges.sigma[:, None]
        table[count : count + priors, U:own] = np.diag(1 / self._expected_sigma)
        table[count + priors : count + priors + nodes, own : own + nodes] = self._whiten
        table[count + priors + nodes :, own + nodes :] = self._whiten
        return table


def _correlation(residuals: Array) -> float:
    """How many residuals in a row tell as much as one that stands alone: 1 + 2 sum of the autocorrelation, up to where
    it is noise. A radio whose error wanders is not as good as its count of ranges says."""
    count, variance = len(residuals), float(np.mean(residuals**2))
    if variance == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, count // 4):
        rho = float(np.mean(residuals[lag:] * residuals[:-lag])) / variance
        if rho < 2 / np.sqrt(count):
            break
        total += 2 * rho
    return total
