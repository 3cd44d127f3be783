"""Target place by batch least squares over vehicle positions and ranges. The same estimator serves
flights and logs.

States of the target: the place, its height, and its velocity. States of the radio: bias, logarithm
of the scale, and the delay of positions relative to ranges. Further states are the errors of the
positions on three axes.

A hypothesis is a row of prior standard deviations of these states. A batch of Gauss-Newton steps
fits all hypotheses from all starting points. `_best` chooses the hypothesis by its penalized
chi-squared. `_undetermined` returns the reason why its place may be wrong.

The error of the positions is a first-order Gauss-Markov process, linear between nodes. A realistic
covariance needs these states: GPS errors are correlated, and a lap averages little of them. Without
the vertical error, an altitude that wandered by 1 m gave a wrong height: a beacon at the height of
the track was fitted 40 m too high, with a bias of 6 m.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.extras.locate.place import Array, Place, Plane

LEAST = 20
"""Smallest number of ranges for an estimate."""
MOST = 1000
"""Largest number of ranges used. Of more ranges, evenly distributed ones are used."""
GPS_TIME = 100.0
"""Correlation time of the GPS error, s."""
NODES = 8
"""Number of nodes of the GPS error per correlation time. With too few nodes, the fit explains the
error between them by a height. With 2 nodes, heights were 20 m off after one lap."""
MOST_NODES = 40
"""Largest number of nodes of the GPS error."""
HUBER = 2.0
"""Residual from which the loss of the robust fit is linear, in standard deviations."""
OUTLIER = 4.0
"""Residual above which a range is excluded from the final fit, in standard deviations."""
SAME = 3.0
"""Distance up to which two fits are the same place, in standard deviations."""
AMBIGUOUS = 12.0
"""Difference in chi-squared below which the second-best place may be the right one (p = 0.002)."""
CALIBRATED = 0.0003
"""Standard deviation of the scale error of a calibrated radio. A quartz clock errs by 20 ppm. Air
slows radio waves by 300 ppm, which many radios do not correct."""
HEIGHT_UNKNOWN = 50.0
"""Standard deviation of the target's height, m, if it is only assumed: at home, or below the
track."""
GPS_SIGMA = 1.5
"""Standard deviation of a position without RTK, per axis, m, unless the receiver reports more."""
UNCALIBRATED = 0.1
"""Standard deviation of the scale error of an uncalibrated radio."""
ROUGH = 0.25
"""Largest standard deviation of a valid place, as a share of the median range."""
E, N, U, BIAS, SCALE, DELAY, VE, VN = range(8)
OWN = VN + 1
"""Number of states before the nodes of the GPS error."""


@dataclass(frozen=True, slots=True)
class Track:
    """Reported vehicle positions, arrays (n,). time: s, increasing. east, north, up: coordinates,
    m."""

    time: Array
    east: Array
    north: Array
    up: Array

    def at(self, time: Array) -> Array:
        """Return the positions at other times, (3, ...)."""
        ways = (self.east, self.north, self.up)
        return np.array([np.interp(time, self.time, way) for way in ways])

    def period(self) -> float:
        """Return the median time between two positions, s."""
        return float(np.median(np.diff(self.time)))

    def late(self, time: Array, delay: Array, period: float) -> tuple[Array, Array]:
        """Return the positions at the given times plus a delay, and their derivatives with respect
        to the delay. period: median time between two positions, s."""
        # Between two positions, an interpolation averages their noise or rounding. A free delay
        # would then fit half a period between positions, and height and scale would follow: with
        # positions rounded to 11 m, correct ranges were found 7 m too short. Therefore the delay
        # is a whole number of periods, and the rest is a motion at the mean velocity.
        whole = time + period * np.round(delay / period)
        # 1.0: half of the time over which the velocity is averaged, s, at least 2 periods.
        half = max(1.0, 2 * period)
        at, after, before = self.at(np.array([whole, whole + half, whole - half])).swapaxes(0, 1)
        rate = (after - before) / (2 * half)
        return at + rate * (time + delay - whole), rate


@dataclass(frozen=True, slots=True)
class Ranges:
    """Slant ranges, arrays (n,). time: s. r: range, m. sigma: standard deviation, m."""

    time: Array
    r: Array
    sigma: Array

    def take(self, which: NDArray[Any]) -> "Ranges":
        """Return the ranges selected by a mask or by indices."""
        return Ranges(self.time[which], self.r[which], self.sigma[which])


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Prior knowledge about target, GPS and radio. Names that end in `_sigma` are standard
    deviations.

    up: height of the target, m.
    up_sigma: standard deviation of this height, m.
    gps_sigma: standard deviation of a position, per axis, m.
    bias_sigma: standard deviation of the radio's bias, m.
    scale_sigma: standard deviation of the radio's scale error.
    delay_sigma: standard deviation of the delay between positions and ranges, s.
    sigma_known: True if the sigmas of the ranges are measured or reported.
    """

    up: float
    up_sigma: float = HEIGHT_UNKNOWN
    gps_sigma: float = GPS_SIGMA
    bias_sigma: float = 2.0
    scale_sigma: float = CALIBRATED
    delay_sigma: float = 0.15
    sigma_known: bool = True


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Assumption about target and radio, for which one place is fitted.

    penalty: chi-squared by which the fit must be better than the fit without such an error.
    bias: prior standard deviation of the radio's bias, m, if larger than that of `Knowledge`.
    scale: prior standard deviation of its scale error, if larger than that of `Knowledge`.
    speed: prior standard deviation of the target's velocity, per axis, m/s.
    """

    # 18.0: without such an error, chi-squared differs by this much with a probability of 2e-5 (one
    # additional state) or 1e-4 (two states).
    penalty: float = 18.0
    bias: float = 0.0
    scale: float = 0.0
    speed: float = 1e-6

    def prior(self, known: Knowledge) -> Array:
        """Return the prior standard deviations of the states."""
        bias = max(known.bias_sigma, self.bias)
        scale = max(known.scale_sigma, self.scale)
        return np.array(
            [inf, inf, known.up_sigma, bias, scale, known.delay_sigma, self.speed, self.speed]
        )


AT_REST = (
    Hypothesis(penalty=0.0),
    # Most radios measure true meters, and a free scale makes the place less certain.
    Hypothesis(scale=UNCALIBRATED),
    # A radio whose antenna delay was never set measures up to 155 m too long.
    Hypothesis(bias=300.0),
)
"""Hypotheses of a target at rest."""
MOVING = Hypothesis(speed=10.0)
"""Hypothesis of a moving target."""


@dataclass(frozen=True, slots=True)
class NotLocated:
    """Result if no place could be estimated.

    why: human-readable reason.
    range_error: error of the ranges if it is the reason, m, else 0.
    """

    why: str
    range_error: float = 0.0


def locate(
    plane: Plane,
    track: Track,
    ranges: Ranges,
    known: Knowledge,
    hypotheses: Sequence[Hypothesis] = (*AT_REST, MOVING),
) -> Place | NotLocated:
    """Return the place at the time of the last range."""
    # Drop repeated and late positions.
    kept = np.diff(np.maximum.accumulate(track.time), prepend=-np.inf) > 1e-3
    track = Track(track.time[kept], track.east[kept], track.north[kept], track.up[kept])
    received = ranges
    ranges = _covered(track, received)
    if len(ranges.r) < LEAST:
        return NotLocated(
            f"{len(ranges.r)} ranges have positions before and after them, {LEAST} are"
            f" needed{_time_spans(track, received)}"
        )
    if _straight(track, ranges, known):
        # A straight track does not determine the side of the target, except by the errors of the
        # positions. With an unknown height, every place on a ring around the track fits.
        return NotLocated("two places, on either side of the straight track, fit the ranges: turn")
    # 120.0: window of ranges for a moving target, s. Its velocity is not constant for longer.
    newest = ranges.take(ranges.time >= ranges.time[-1] - 120.0)
    if len(newest.r) == len(ranges.r):
        return _contest(plane, track, ranges, known, hypotheses)
    if MOVING in hypotheses and len(newest.r) >= LEAST and not _straight(track, newest, known):
        place = _contest(plane, track, newest, known, hypotheses)
        if isinstance(place, Place) and place.moves:
            return place
    return _contest(plane, track, ranges, known, [one for one in hypotheses if one is not MOVING])


def _contest(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, hypotheses: Sequence[Hypothesis]
) -> Place | NotLocated:
    """Fit all hypotheses and return the place of the chosen one."""
    start, prior, penalty, noise = _candidates(track, ranges, known, hypotheses)
    if not known.sigma_known:
        ranges = replace(ranges, sigma=np.full(len(ranges.r), noise))
    problem = Problem(track, ranges, known)
    fit = problem.fit(start, prior)
    # Use the ranges that the best hypothesis explains, and their noise, for the fits of all
    # hypotheses. So their values of chi-squared can be compared.
    chosen = [_best(fit.chi2, penalty, len(ranges.r))]
    residual, sigma = (part[0] for part in problem.residual(fit.x[chosen]))
    off = residual / sigma
    keep = np.abs(off) <= OUTLIER * max(spread(off), 1.0)
    if keep.sum() < LEAST:
        return NotLocated("no place fits the ranges")
    kept = ranges.take(keep)
    noise = _noise(float(np.mean(residual[keep] ** 2)), sigma[keep], kept)
    factor = noise / float(np.sqrt(np.mean(kept.sigma**2)))
    # A radio with correlated errors gives less information than its number of ranges suggests:
    # enlarge the sigmas.
    worse = np.sqrt(_correlation(off[keep]))
    kept = replace(kept, sigma=kept.sigma * max(factor, float(known.sigma_known)))
    problem = Problem(track, kept, known, worse=worse)
    # On a straight track, the place mirrored at the track fits as well.
    best = _best(fit.chi2, penalty, len(problem.ranges.r))
    start = np.concatenate([fit.x, problem.mirrored(fit.x[best])[None]])
    prior = np.concatenate([prior, prior[best][None]])
    penalty = np.append(penalty, penalty[best])
    fit = problem.fit(start, prior)
    best = _best(fit.chi2, penalty, len(problem.ranges.r))
    place = problem.place(fit.x[best], fit.chi2[best], prior[best], plane, len(ranges.r))
    if place is not None and not place.moves:
        place = _with_model_uncertainty(place, fit, prior, best)
    same = np.all(prior == prior[best], axis=1)
    others = fit.x[same & (fit.chi2 < fit.chi2[best] + AMBIGUOUS)]
    if place is None:
        return UNCERTAIN
    return _undetermined(place, problem, others) or place


def _best(chi2: Array, penalty: Array, count: int) -> int:
    """Return the number of the fit with the least penalized chi-squared. count: number of
    ranges."""
    # The ranges have at least the noise of the best fit. This noise is not quite white or normal,
    # so with many ranges a small difference of chi-squared would look significant. 200: number of
    # ranges above which the penalty grows with their number.
    scale = min(1.0, count / float(chi2.min()))
    return int(np.argmin(scale * chi2 + penalty * (1 + count / 200)))


def _with_model_uncertainty(place: Place, fit: "Fit", prior: Array, best: int) -> Place:
    """Return the place with a larger covariance if another hypothesis fits much better (by
    `AMBIGUOUS`) before its penalty. The displacement to the place of that fit is then a part of the
    error."""
    # Without this part, a radio that measured 7 % too far was located with an error of 2.1 m, and
    # the stated error was 0.4 m. A bias of 3.6 standard deviations fitted nearly as well as the
    # scale.
    rests = np.flatnonzero(prior[:, VE] == prior[best, VE])
    other = rests[np.argmin(fit.chi2[rests])]
    if fit.chi2[best] - fit.chi2[other] < AMBIGUOUS:
        return place
    apart = fit.x[other, :U] - fit.x[best, :U]
    return replace(place, covariance=place.covariance + np.outer(apart, apart))


UNCERTAIN = NotLocated("the track does not determine the target's place yet: fly a turn")


def _undetermined(place: Place, problem: "Problem", others: Array) -> NotLocated | None:
    """Return the reason why a place may be wrong, or None. others: states that fit as well."""
    ranges = problem.ranges
    constant = NotLocated("the ranges do not change with the vehicle's position: they fit no place")
    if np.ptp(ranges.r) == 0:
        return constant
    if place.sigma > max(ROUGH * place.range_scale, 3.0):
        return UNCERTAIN
    if place.noise > ROUGH * place.range_scale:
        return NotLocated(
            f"the ranges scatter by {place.noise:.0f} m: they fit no place. Are two tags mixed?"
        )
    error, sigma = place.range_error(place.distance_scale)
    if abs(error) > max(ROUGH * place.range_scale, 2 * sigma):
        return NotLocated(
            f"for the place that fits best, the ranges are {place.range_error_words()}: does the"
            " target move, or is the radio not calibrated?",
            error,
        )
    # Ranges that do not depend on the position (noise, a repeated value) fit a constant as well as
    # a place. Real ranges do so only on a circle around the target.
    ahead = ranges.time - place.time
    way = problem.track.at(ranges.time)[:2].T - (place.east, place.north)
    way -= np.outer(ahead, place.velocity)
    far = np.hypot(*way.T)
    one_side = np.hypot(*np.mean(way.T / far, axis=1))
    around = one_side < 0.85 and np.ptp(np.percentile(far, [10, 90])) < 0.15 * np.median(far)
    # 0.9: largest ratio of the noise around a place to the spread of the ranges. Above it, a
    # constant range fits as well as the place.
    if place.noise > 0.9 * float(np.std(ranges.r)) and not around:
        return constant
    apart = float(np.max(np.hypot(*(others[:, :U] - (place.east, place.north)).T)))
    if apart > SAME * place.sigma + 1.0:
        return NotLocated(
            f"two places {apart:.0f} m apart fit the ranges: the track is too straight, fly a turn"
        )
    return None


def _candidates(
    track: Track, ranges: Ranges, known: Knowledge, hypotheses: Sequence[Hypothesis]
) -> tuple[Array, Array, Array, float]:
    """Return starting points of the fits with their priors and penalties, and the noise of the
    ranges: for each hypothesis, the two best different places of a coarse search."""
    # 150: number of ranges with which the starting points are compared.
    thin = ranges.take(np.arange(0, len(ranges.r), max(1, len(ranges.r) // 150)))
    noise = 40.0

    def problem() -> Problem:
        # A small sigma makes the loss linear: outliers do not shift the fit.
        sigma = thin.sigma if known.sigma_known else np.full(len(thin.r), noise / 4)
        return Problem(track, replace(thin, sigma=sigma), known, nodes=1)

    rows = []
    for one in hypotheses:
        points = problem().starts(moves=one is MOVING)
        fit = problem().fit(points, np.tile(one.prior(known), (len(points), 1)))
        order = np.argsort(fit.chi2)
        apart = np.hypot(*(fit.x[order, :U] - fit.x[order[0], :U]).T)
        other = order[apart > 0.05 * float(np.median(thin.r))]
        rows += [(fit.x[at], one.prior(known), one.penalty) for at in (order[0], *other[:1])]
    start, prior, penalty = (np.array(part) for part in zip(*rows, strict=True))
    # 3: number of steps that suffices. One is too few, because outliers shift a fit with too large
    # an assumed noise.
    for _ in range(3):
        fit = problem().fit(start, prior)
        start = fit.x
        best = [_best(fit.chi2, penalty, len(thin.r))]
        residual, sigma = problem().residual(start[best])
        noise = _noise(spread(residual) ** 2, sigma, problem().ranges)
    # A jump of the positions can keep the fitted delay at a wrong number of whole periods: start
    # the next fit without a delay.
    start[:, DELAY] = 0.0
    return start[:, :OWN], prior, penalty, noise


def _noise(variance: float, sigma: Array, ranges: Ranges) -> float:
    """Return the noise of the ranges, m, without the white noise of the positions.

    variance: variance of the residuals.
    sigma: assumed standard deviations of the residuals.
    """
    white = float(np.mean(sigma**2 - ranges.sigma**2))
    # 0.01: smallest share of the variance that is noise of the ranges, and their least noise, m.
    return float(max(variance - white, 0.01 * variance, _rounding(ranges.r) ** 2, 0.01**2) ** 0.5)


def spread(values: Array) -> float:
    """Return the standard deviation of normal noise around 0 by its median magnitude, which
    tolerates outliers."""
    return 1.4826 * float(np.median(np.abs(values)))


def _rounding(values: Array) -> float:
    """Return the standard deviation of values by their rounding to a grid, 0 without a grid."""
    steps = np.diff(np.unique(values))
    step = float(steps.min(initial=inf))
    # 0.05: largest deviation of a step from a multiple of the grid, as a share of the grid. 12: a
    # rounding error is distributed uniformly.
    if len(steps) and np.all(np.abs(steps / step - np.round(steps / step)) < 0.05):
        return step / 12**0.5
    return 0.0


def _white(track: Track, known: Knowledge) -> Array:
    """Return the variances of the white noise of the positions, by rounding or by the receiver,
    (3,), m^2."""
    variances = np.zeros(3)
    for axis, way in enumerate((track.east, track.north, track.up)):
        # The fifth difference of a smooth motion is small. That of white noise has 252 times its
        # variance.
        rough = spread(np.diff(way, 5)) if len(way) > LEAST else 0.0
        variances[axis] = max(min(rough / 252**0.5, known.gps_sigma), _rounding(way)) ** 2
    return variances


def _time_spans(track: Track, ranges: Ranges) -> str:
    """Return text with both time spans, as a hint that clocks or time units may differ. Empty for
    few ranges or positions."""
    if len(ranges.r) < LEAST or len(track.time) < 2:
        return ""
    # Count the times from the first range: the digits of a time of day or of 1970 would hide the
    # difference.
    of_ranges, of_positions = (
        f"{time[0] - ranges.time[0]:.6g} to {time[-1] - ranges.time[0]:.6g} s"
        for time in (ranges.time, track.time)
    )
    every = f"one every {float(np.median(np.diff(track.time))):.3g} s"
    return f"; ranges at {of_ranges}, positions at {of_positions}, {every}: same clock, in seconds?"


def _covered(track: Track, ranges: Ranges) -> Ranges:
    """Return the ranges with a position before and after them, thinned to at most MOST."""
    if len(track.time) < 2:
        return ranges.take(np.array([], int))
    after = np.clip(np.searchsorted(track.time, ranges.time), 1, len(track.time) - 1)
    inside = (ranges.time >= track.time[0]) & (ranges.time <= track.time[-1])
    # 3.0: longest time between the two positions around a range, s.
    kept = np.flatnonzero(inside & (track.time[after] - track.time[after - 1] <= 3.0))
    return ranges.take(kept[:: max(1, -(-len(kept) // MOST))])


def _line(track: Track, ranges: Ranges) -> tuple[Array, Array, Array]:
    """Return middle, direction and RMS extent (along, across; m) of the track during the ranges."""
    inside = (track.time >= ranges.time[0]) & (track.time <= ranges.time[-1])
    way = np.column_stack([track.east, track.north])[inside]
    middle = way.mean(axis=0)
    _, extent, lines = np.linalg.svd(way - middle, full_matrices=False)
    return middle, lines[0], extent / np.sqrt(len(way))


def _straight(track: Track, ranges: Ranges, known: Knowledge) -> bool:
    """True if the RMS distance of the track from a straight line is within the error of its
    positions."""
    along, across = _line(track, ranges)[2]
    return bool(across < min(2 * known.gps_sigma, 0.15 * along))


@dataclass(frozen=True, slots=True)
class Fit:
    """Batch of fits. x: states, (fits, states). chi2: chi-squared, robust, with the priors."""

    x: Array
    chi2: Array


class Problem:
    """Least-squares problem of a batch of fits: residuals of the ranges, in standard deviations,
    and priors. worse: factor of all standard deviations of ranges."""

    def __init__(
        self,
        track: Track,
        ranges: Ranges,
        known: Knowledge,
        *,
        nodes: int = MOST_NODES,
        worse: float = 1.0,
    ) -> None:
        self.track = track
        self.ranges = replace(ranges, sigma=ranges.sigma * worse)
        self.known = known
        self.end = float(ranges.time[-1])
        self._period = track.period()
        self._ahead = ranges.time - self.end
        self._white = _white(track, known)[:, None, None] * worse**2
        span = self.end - float(ranges.time[0])
        count = int(min(nodes, 1 + np.ceil(NODES * span / GPS_TIME)))
        places = np.linspace(ranges.time[0], self.end, count)
        self._between = np.array([np.interp(ranges.time, places, row) for row in np.eye(count)])
        kernel = known.gps_sigma**2 * np.exp(-np.abs(places[:, None] - places) / GPS_TIME)
        self._nodes = np.kron(np.eye(3), np.linalg.inv(kernel))

    def starts(self, *, moves: bool) -> Array:
        """Return starting points on circles around the start, middle and end of the track, with the
        ranges as radii. For a moving target also the mean motion of the vehicle: it may circle the
        target."""
        ranges = self.ranges
        at = np.array([0, len(ranges.r) // 2, len(ranges.r) - 1])
        angle = np.arange(8) * np.pi / 4
        round_ = ranges.r[at] * np.array([np.cos(angle), np.sin(angle)])[:, :, None]
        points = (self.track.at(ranges.time[at])[:2, None] + round_).reshape(2, -1).T
        x = np.zeros((len(points) + 1, OWN))
        x[:-1, :2] = points
        # Start below the track. At the vehicle's own height, the derivative of the range with
        # respect to the height is zero, and the fit would stay there.
        below = float(np.median(self.track.up)) - 0.2 * float(np.median(ranges.r))
        x[:, U] = min(self.known.up, below) if self.known.up_sigma > 10 else self.known.up
        if not moves:
            return x[:-1]
        here = self.track.at(ranges.time)[:2].T
        velocity, x[-1, :2] = np.polyfit(self._ahead, here, 1)
        along = x.copy()
        along[:, VE:] = velocity
        return np.concatenate([x, along])

    def fit(self, start: Array, prior: Array, up: float | None = None) -> Fit:
        """Return the robust fits of all hypotheses, by damped Gauss-Newton steps.

        start: initial states, (fits, states). Without columns for the nodes, the nodes begin at 0.
        prior: standard deviations of the states before the fit, (fits, OWN).
        up: height of the target before the fit, m. None: the height in `known`.
        """
        nodes = len(self._nodes)
        x = np.zeros((len(start), OWN + nodes))
        x[:, : start.shape[1]] = start
        mean = np.zeros(OWN + nodes)
        mean[U] = self.known.up if up is None else up
        precision = self._precision(prior)
        damping = np.full(len(x), 1e-3)
        chi2 = self._chi2(x, mean, precision)
        open_ = np.arange(len(x))
        # 60: largest number of steps. Most fits take ten.
        for _ in range(60):
            table, weight, off = self._table(x[open_])
            normal = self._normal(table, weight, precision[open_])
            slope = np.einsum("fsn,fn->fs", table, weight * off)
            slope += np.einsum("fst,ft->fs", precision[open_], x[open_] - mean)
            diagonal = np.einsum("fss->fs", normal)
            # The ranges of a vehicle that has not moved are all along one line, and the matrix is
            # singular. The damping, and 1e-9, keep it regular.
            diagonal *= 1 + damping[open_, None]
            diagonal += 1e-9
            new = x[open_] - np.linalg.solve(normal, slope[:, :, None])[:, :, 0]
            after = self._chi2(new, mean, precision[open_])
            better = after < chi2[open_]
            gain = chi2[open_] - after
            damping[open_] = np.maximum(damping[open_] * np.where(better, 0.1, 10.0), 1e-9)
            x[open_[better]] = new[better]
            chi2[open_[better]] = after[better]
            done = (better & (gain < 1e-5 * after)) | (damping[open_] > 1e6)
            open_ = open_[~done]
            if not len(open_):
                break
        return Fit(x, chi2)

    def _sight(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return the directions from the vehicle to the target (3, fits, ranges), the distances, m,
        the vehicle's velocities, m/s, and the standard deviations of the residuals, m."""
        nodes = x[:, OWN:].reshape(len(x), 3, -1)
        place, rate = self.track.late(self.ranges.time, x[:, DELAY, None], self._period)
        way = x[:, :3].T[:, :, None] - place
        way += np.moveaxis(nodes @ self._between, 1, 0)
        way[:2] += x[:, VE:OWN].T[:, :, None] * self._ahead
        far = np.maximum(np.sqrt((way**2).sum(axis=0)), 1e-3)
        way /= far
        # The white noise of the positions enters by its part along the line of sight, and by the
        # scale.
        white = (self._white * way**2).sum(axis=0)
        sigma = np.sqrt(self.ranges.sigma**2 + np.exp(x[:, SCALE, None]) ** 2 * white)
        return way, far, rate, sigma

    def residual(self, x: Array) -> tuple[Array, Array]:
        """Return the residuals of the ranges and their standard deviations, m, (fits, ranges)."""
        _, far, _, sigma = self._sight(x)
        return np.exp(x[:, SCALE, None]) * far + x[:, BIAS, None] - self.ranges.r, sigma

    def _chi2(self, x: Array, mean: Array, precision: Array) -> Array:
        residual, sigma = self.residual(x)
        off = np.abs(residual / sigma)
        loss = np.where(off > HUBER, HUBER * (2 * off - HUBER), off**2).sum(axis=1)
        apart = x - mean
        return np.asarray(loss + np.einsum("fs,fst,ft->f", apart, precision, apart))

    def _precision(self, prior: Array) -> Array:
        """Return the inverse prior covariances."""
        nodes = len(self._nodes)
        table = np.zeros((len(prior), OWN + nodes, OWN + nodes))
        table[:, OWN:, OWN:] = self._nodes
        at = np.arange(OWN)
        table[:, at, at] = prior**-2.0
        return table

    def _table(self, x: Array) -> tuple[Array, Array, Array]:
        """Return the derivatives of the residuals (fits, states, ranges), their weights, and the
        residuals in standard deviations (fits, ranges)."""
        way, far, rate, sigma = self._sight(x)
        stretch = np.exp(x[:, SCALE, None])
        off = (stretch * far + x[:, BIAS, None] - self.ranges.r) / sigma
        # The standard deviations depend on the states. Without their derivatives, a scale below 1
        # or a low target, which make the effect of this noise small, would fit best.
        white = (self._white * way**2).sum(axis=0)
        share = off * stretch / sigma
        slope = way * stretch * (1 - share * (self._white - white) / far)
        count = len(self._between)
        table = np.empty((len(x), OWN + 3 * count, far.shape[1]))
        table[:, : U + 1] = np.moveaxis(slope, 0, 1)
        table[:, BIAS] = 1.0
        table[:, SCALE] = stretch * (far - share * white)
        table[:, DELAY] = -(slope * rate).sum(axis=0)
        table[:, VE:OWN] = table[:, :U] * self._ahead
        nodes = table[:, OWN:].reshape(len(x), 3, count, -1)
        np.multiply(table[:, : U + 1, None], self._between, out=nodes)
        table /= sigma[:, None]
        return table, 1 / np.maximum(np.abs(off) / HUBER, 1.0), off

    @staticmethod
    def _normal(table: Array, weight: Array, precision: Array) -> Array:
        return (table * weight[:, None]) @ np.swapaxes(table, 1, 2) + precision

    def mirrored(self, x: Array) -> Array:
        """Return the states with place and velocity mirrored at the line fitted to the track."""
        middle, line, _ = _line(self.track, self.ranges)
        flip = 2 * np.outer(line, line) - np.eye(2)
        mirror = x.copy()
        mirror[:2] = middle + flip @ (x[:2] - middle)
        mirror[VE:OWN] = flip @ x[VE:OWN]
        mirror[OWN:] = 0.0
        return mirror

    def place(self, x: Array, chi2: float, prior: Array, plane: Plane, count: int) -> Place | None:
        """Return the place of a fit, None if its covariance is singular. count: number of ranges
        with the outliers."""
        try:
            covariance = self.covariance(x, prior)
        except np.linalg.LinAlgError:
            return None
        known = self.known
        r = self.ranges.r
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        moves = bool(prior[VE] == MOVING.speed)
        residual, _ = self.residual(x[None])
        noise = float(np.sqrt(np.mean(residual**2)))
        both = [BIAS, SCALE]
        stretch = np.array([1.0, np.exp(x[SCALE])])
        radio = np.array([x[BIAS], np.expm1(x[SCALE])])
        radio_covariance = covariance[np.ix_(both, both)] * np.outer(stretch, stretch)
        nearest, farthest = np.percentile(r, [5, 95])
        # 5.0: smallest spread of the ranges that makes the clock offset observable, in units of
        # range noise plus GPS sigma. With a smaller spread, variations of the GPS error would be
        # fitted as an offset: on a circle around the target, every clock offset fits.
        if farthest - nearest < 5.0 * (noise + known.gps_sigma):
            sd[DELAY] = known.delay_sigma
            radio, radio_covariance = self._at_median_range(radio, radio_covariance, prior, x[U])
        # 2.0: largest standard deviation of an observed height, m.
        return Place(
            time=self.end, plane=plane, east=float(x[E]), north=float(x[N]), up=float(x[U]),
            covariance=covariance[:2, :2], up_sigma=float(sd[U]),
            up_known=bool(sd[U] <= 2.0 and self._one_sided(x, prior, chi2, float(sd[U]))),
            bias=float(radio[0]), scale=float(radio[1]), radio_covariance=radio_covariance,
            delay=float(x[DELAY]), delay_sigma=float(sd[DELAY]),
            noise=noise, used=len(r), outliers=count - len(r),
            velocity=(float(x[VE]), float(x[VN])) if moves else (0.0, 0.0),
            velocity_sigma=float(max(sd[VE:OWN])) if moves else None,
            range_scale=float(np.median(r)),
        )  # fmt: skip

    def _at_median_range(
        self, radio: Array, covariance: Array, prior: Array, up: float
    ) -> tuple[Array, Array]:
        """Return bias and scale of the radio with their covariance, for nearly equal ranges. They
        follow from the prior and from the range error at the median range. up: fitted height, m."""
        # On a circle around the target, the computed lengths change only by the GPS error, which
        # the ranges do not contain. The fit mistakes this error for a slope of the ranges: with a
        # free bias, a true scale of 1.07 was fitted as 0.80 ±0.06.
        known = self.known
        middle = float(np.median(self.ranges.r))
        above = float(np.median(self.track.up))
        length = (middle - radio[0]) / (1 + radio[1])
        slope = np.array([1.0, length])
        before = np.diag(prior[[BIAS, SCALE]] ** 2)
        variance = slope @ covariance @ slope
        # With another range error, any height fits the circle, so add the uncertainty of the
        # height. An implausibly large range error is kept, because it shows that the place is
        # wrong.
        if known.up_sigma > 10 and abs(slope @ radio) <= ROUGH * middle:
            across = length**2 - (above - up) ** 2
            heights = above - known.up + np.array([0.0, known.up_sigma])
            lengths = np.sqrt(np.maximum(across + heights**2, 0.0))
            variance += np.max(np.abs(lengths - length)) ** 2
        gain = before @ slope / (slope @ before @ slope + variance)
        return gain * (slope @ radio), before - np.outer(gain, slope @ before)

    def covariance(self, x: Array, prior: Array) -> Array:
        """Return the covariance of the states. Raises LinAlgError."""
        table, weight, _ = self._table(x[None])
        precision = self._precision(prior[None])

        def inverse() -> Array:
            return np.asarray(np.linalg.inv(self._normal(table, weight, precision))[0])

        covariance = inverse()
        # For a target at the vehicle's height, the derivative of a range with respect to the height
        # is zero. The covariance then ignores that a height error changes the ranges as a bias and
        # a scale do. The range depends on the square of the height difference. The root of the
        # standard deviation of this square is the smallest observable height difference. Below it,
        # use the slope at this difference instead of the derivative.
        known = self.known
        off = float(np.median(np.abs(self.track.at(self.ranges.time)[2] - x[U])))
        if off > known.up_sigma:
            return covariance
        _, far, _, deviation = self._sight(x[None])
        slope = np.exp(x[SCALE]) / far / deviation
        table[:, U] = known.up_sigma * slope
        least = float(np.sqrt(known.up_sigma * np.sqrt(inverse()[U, U])))
        if off > least:
            return covariance
        table[:, U] = least * slope
        return inverse()

    def _one_sided(self, x: Array, prior: Array, chi2: float, sigma: float) -> bool:
        """True if the ranges or the prior reject the height mirrored at the track. sigma: standard
        deviation of the height, m."""
        # From a level track, a target fits equally well above and below the track. Near the height
        # of the track, the linear covariance is too small: a UWB radio on a cart once gave -1.5
        # ±0.7 m for a true height of +0.9 m.
        known = self.known
        start = x.copy()
        mirror = 2 * float(np.median(self.track.up)) - float(x[U])
        if abs(mirror - x[U]) < sigma:
            return True
        start[U] = mirror
        narrow = prior.copy()
        narrow[U] = sigma / 10
        other = self.fit(start[None], narrow[None], mirror).chi2[0]
        off = (mirror - known.up) / known.up_sigma
        return bool(other - chi2 + off**2 > AMBIGUOUS)


def _correlation(residuals: Array) -> float:
    """Return the number of consecutive residuals that together give as much information as one
    independent residual.

    The number is 1 + 2 * the sum of the autocorrelation, up to the lag where the autocorrelation is
    noise.
    """
    count = len(residuals)
    residuals = residuals - residuals.mean()
    variance = float(np.mean(residuals**2))
    if variance == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, count // 4):
        rho = float(np.mean(residuals[lag:] * residuals[:-lag])) / variance
        if rho < 2 / np.sqrt(count):
            break
        total += 2 * rho
    return total
