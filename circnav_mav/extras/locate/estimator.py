"""Target place by batch least squares over vehicle positions and ranges. The same estimator serves
flights and logs.

States of the target: the place, its height, and its velocity if it moves. States of the radio:
bias, scale, and the delay of positions relative to ranges. Further states are the errors of the
positions on three axes.

The error of the positions is a first-order Gauss-Markov process, linear between nodes. A realistic
covariance needs these states: GPS errors are correlated, and a lap averages little of them. Without
the vertical error, an altitude that wandered by 1 m gave a wrong height: a beacon at the height of
the track was fitted 40 m too high, with a bias of 6 m.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from circnav_mav.extras.locate.place import SIGNIFICANT, Array, Place, Plane

LEAST = 20
"""Smallest number of ranges for an estimate."""
MOST = 1000
"""Largest number of ranges used. Of more ranges, evenly distributed ones are used."""
GPS_TIME = 100.0
"""Correlation time of the GPS error, s."""
SPEED_SIGMA = 10.0
"""Prior standard deviation of the target's velocity, per axis, m/s."""
NODES = 8
"""Number of nodes of the GPS error per correlation time. With too few nodes, the error between them
is fitted as a height: with 2 per correlation time, heights were 20 m off after one lap."""
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
MOVING = 18.0
"""Chi-squared of the velocity above which a target is treated as moving (two degrees of freedom, p
= 1e-4)."""
CALIBRATED = 0.0003
"""Standard deviation of the scale error of a calibrated radio. A quartz clock errs by 20 ppm. Air
slows radio waves by 300 ppm, which many radios do not correct."""
UNCALIBRATED = 0.1
"""Standard deviation of the scale error of an uncalibrated radio."""
OFFSET = 300.0
"""Standard deviation of the bias of a radio whose antenna delay was never set, m."""
ROUGH = 0.25
"""Largest standard deviation of a valid place, as a share of the median range."""
E, N, U, BIAS, SCALE, DELAY, VE, VN = range(8)
Fit = Any
"""Result of scipy's `least_squares`."""


@dataclass(frozen=True, slots=True)
class Track:
    """Reported vehicle positions, arrays (n,). time: s, increasing. east, north, up: coordinates,
    m."""

    time: Array
    east: Array
    north: Array
    up: Array


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
    up_sigma: float = 50.0
    gps_sigma: float = 1.5
    bias_sigma: float = 2.0
    scale_sigma: float = CALIBRATED
    delay_sigma: float = 0.15
    sigma_known: bool = True


@dataclass(frozen=True, slots=True)
class NotLocated:
    """Result if no place could be estimated.

    why: human-readable reason.
    range_error: error of the ranges if it is the reason, m, else 0.
    noise: standard deviation of the range residuals with this error, m.
    """

    why: str
    range_error: float = 0.0
    noise: float = 0.0


STRAIGHT = NotLocated("two places, on either side of the straight track, fit the ranges: turn")


def locate(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, near: Place | None = None
) -> Place | NotLocated:
    """Return the place at the time of the last range. near: an earlier result, used as a starting
    point."""
    place = _locate(plane, track, ranges, known, near)
    if known.scale_sigma >= UNCALIBRATED or place is STRAIGHT:
        return place
    if not _explains(place, ranges, known) or abs(place.bias) >= SIGNIFICANT * place.bias_sigma:
        # Most radios measure true meters, and a free scale that is hardly observable makes the
        # place less certain. Therefore, the scale is estimated only if the ranges contradict a
        # scale of 1. Residuals cannot decide this: a scale error looks like noise.
        free = _locate(plane, track, ranges, replace(known, scale_sigma=UNCALIBRATED), near)
        if isinstance(free, Place) and free.scale_found:
            place = free
    moves = isinstance(place, Place) and place.moves
    if isinstance(place, Place) and not moves and abs(place.scale) < UNCALIBRATED:
        return place
    # A radio whose antenna delay was never set measures up to 155 m too long. Without a free bias,
    # this offset is fitted as a scale, a height and a delay, as a moving target, or fits no place.
    offset = _locate(plane, track, ranges, replace(known, bias_sigma=OFFSET), near)
    if isinstance(offset, Place) and isinstance(place, NotLocated):
        found = abs(offset.bias) > SIGNIFICANT * offset.bias_sigma
        return _miscalibrated(offset) if found else place
    if isinstance(offset, Place) or not offset.range_error:
        return place
    # 1.3: largest ratio of two noises: of a stationary target with an offset, and of a moving
    # target. Above it, the target moves.
    if isinstance(place, Place) and moves and offset.noise > 1.3 * place.noise:
        return place
    return offset


def _locate(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, near: Place | None
) -> Place | NotLocated:
    """Return the place for fixed prior knowledge."""
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
    problem = Problem(track, ranges, known)
    # A straight track does not determine the side of the target, except by the errors of the
    # positions. With an unknown height, every place on a ring around the track fits.
    if problem.straight:
        return STRAIGHT
    still = _best(problem, plane, near)
    # 120.0: window of ranges for a moving target, s. Its velocity is not constant for longer.
    newest = ranges.take(ranges.time >= ranges.time[-1] - 120.0)
    if len(newest.r) < LEAST or known.bias_sigma >= OFFSET:
        return still
    if _explains(still, ranges, known) and still.outliers < 0.2 * still.used:
        return still
    moving = Problem(track, newest, known, moves=True)
    fits = [moving.fit(start) for start in _moving_starts(track, newest, still, near)]
    found = [fit for fit in fits if fit is not None]
    place = _decided(moving, found, plane)
    if not isinstance(place, Place):
        return still
    # The model of a moving target always fits at least as well as that of a stationary one. Accept
    # it only if it fits much better and the velocity exceeds the drift of the GPS error.
    if isinstance(still, Place):
        at_rest = Problem(track, newest, known).fit(np.array([still.east, still.north]))
        better = at_rest is None or at_rest.cost - min(fit.cost for fit in found)
        if better < MOVING / 2 * max(1.0, place.noise / float(np.median(newest.sigma))) ** 2:
            return still
    # 0.15: smallest speed of a moving target, m/s. The GPS error drifts as fast.
    if place.speed > max(np.sqrt(MOVING) * (place.velocity_sigma or 0.0), 0.15):
        return place
    return still


def locate_as_it_shows(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge
) -> Place | NotLocated:
    """Return the place. If the range noise is unknown, measure it by a first fit with sigmas ten
    times larger."""
    if not known.sigma_known:
        rough = locate(plane, track, replace(ranges, sigma=ranges.sigma * 10), known)
        if isinstance(rough, Place):
            ranges = replace(ranges, sigma=np.full(len(ranges.r), max(rough.noise, 0.01)))
    return locate(plane, track, ranges, known)


def _explains(place: Place | NotLocated, ranges: Ranges, known: Knowledge) -> TypeGuard[Place]:
    """True if a place explains the ranges: their noise is about the known sigma."""
    if not isinstance(place, Place) or not known.sigma_known:
        return False
    # 1.3: largest ratio of the residual noise to the reported sigma with which a stationary target
    # explains the ranges.
    return place.noise < 1.3 * float(np.median(ranges.sigma))


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


def _moving_starts(
    track: Track, ranges: Ranges, still: Place | NotLocated, near: Place | None
) -> Iterator[Array]:
    """Yield starting points for the fit of a moving target: the previous place, the stationary
    result, and a line fitted to the vehicle's track.

    The line assumes that the vehicle circles the target. Then the mean motion of the vehicle is the
    target's motion.
    """
    if near is not None:
        there = near.at(float(ranges.time[-1]))
        yield np.array([there.east, there.north, *near.velocity])
    if isinstance(still, Place):
        yield np.array([still.east, still.north, 0.0, 0.0])
    new = track.time >= ranges.time[0]
    ways = [
        np.polyfit(track.time[new] - ranges.time[-1], way[new], 1)
        for way in (track.east, track.north)
    ]
    yield np.array([ways[0][1], ways[1][1], ways[0][0], ways[1][0]])


def _good(place: Place) -> bool:
    """True if the place is accurate enough and the estimated range bias is plausible."""
    usual = abs(place.bias) < 5 * place.bias_prior
    return bool(usual and place.sigma < max(ROUGH * place.range_scale, 3.0))


def _best(problem: "Problem", plane: Plane, near: Place | None) -> Place | NotLocated:
    """Return the place of a stationary target, or `NotLocated` if no place or two places fit."""
    track = problem.track
    ranges = problem.ranges
    if near is not None and not near.moves:
        fit = problem.fit(np.array([near.east, near.north]))
        place = _decided(problem, [] if fit is None else [fit], plane)
        if isinstance(place, Place) and place.noise < 3 * max(near.noise, 0.1):
            return place
    # 150: number of ranges with which the starting points are compared.
    every = max(1, len(ranges.r) // 150)
    thin = ranges.take(np.arange(0, len(ranges.r), every))
    rough = Problem(track, thin, problem.known, nodes=1)
    found = sorted(
        (fit for start in _starts(track, rough.ranges) if (fit := rough.fit(start))),
        key=lambda fit: fit.cost,
    )
    # Refine the two best fits of different places. The place mirrored at the track is tried later
    # in any case.
    near_by = 0.05 * float(np.median(ranges.r))
    others = [fit for fit in found if _apart(fit.x, found[0].x) > near_by]
    refined = [problem.fit(fit.x[:2]) for fit in found[:1] + others[:1]]
    return _decided(problem, [fit for fit in refined if fit is not None], plane)


def _decided(problem: "Problem", fits: list[Fit], plane: Plane) -> Place | NotLocated:
    """Return the place of the best fit. Return `NotLocated` if the fit is poor or another place
    fits as well."""
    if not fits:
        return NotLocated("no place fits the ranges")
    if problem.straight:
        return STRAIGHT
    best = min(fits, key=lambda fit: fit.cost)
    settled = problem.settle(best)
    place = None if settled is None else problem.finish(settled, plane)
    if settled is None or place is None or not _good(place):
        return NotLocated("the track does not determine the target's place yet: fly a turn")
    if contradiction := _contradiction(place, settled.problem):
        return contradiction
    # On a straight track, the place mirrored at the track fits as well. The chi-squared of two
    # places is comparable only if both are refined, with the noise that the ranges show.
    starts = [fit.x[: problem.own] for fit in fits if fit is not best]
    for start in [*starts, problem.mirrored(settled.fit.x)]:
        other = settled.problem.fit(start)
        if other is None:
            continue
        apart = _apart(other.x, settled.fit.x)
        if apart > SAME * place.sigma + 1.0 and 2 * (other.cost - settled.fit.cost) < AMBIGUOUS:
            return NotLocated(
                f"two places {apart:.0f} m apart fit the ranges: the track is too straight, fly a"
                " turn"
            )
    return place


def _apart(one: Array, other: Array) -> float:
    """Return the horizontal distance of the places of two fits, m."""
    return float(np.hypot(*(one[:2] - other[:2])))


def _contradiction(place: Place, problem: "Problem") -> NotLocated | None:
    """Return the reason why the ranges cannot be distances to this place, or None."""
    ranges = problem.ranges
    constant = NotLocated("the ranges do not change with the vehicle's position: they fit no place")
    if np.ptp(ranges.r) == 0:
        return constant
    if place.noise > ROUGH * place.range_scale:
        return NotLocated(
            f"the ranges scatter by {place.noise:.0f} m: they fit no place. Are two tags mixed?"
        )
    error, sigma = place.range_error(place.distance_scale)
    if abs(error) > max(ROUGH * place.range_scale, 2 * sigma):
        return _miscalibrated(place)
    # Ranges that do not depend on the position (noise, a repeated value) fit a constant as well as
    # a place. Real ranges do so only on a circle around the target.
    spread = float(np.std(ranges.r))
    east, north = problem.seen_from(place)
    far = np.hypot(east, north)
    one_side = np.hypot(np.mean(east / far), np.mean(north / far))
    around = one_side < 0.85 and np.ptp(np.percentile(far, [10, 90])) < 0.15 * np.median(far)
    # 0.9: largest ratio of the noise around a place to the spread of the ranges. Above it, a
    # constant range fits as well as the place.
    if place.noise > 0.9 * spread and not around:
        return constant
    return None


def _miscalibrated(place: Place) -> NotLocated:
    """Return `NotLocated` with the error of the ranges as the reason."""
    return NotLocated(
        f"for the place that fits best, the ranges are {place.range_error_words()}: does the target"
        " move, or is the radio not calibrated?",
        place.range_error(place.distance_scale)[0],
        place.noise,
    )


def _starts(track: Track, ranges: Ranges) -> Iterator[Array]:
    """Yield starting points on circles around the start, middle and end of the track, with the
    ranges as radii."""
    for share in (0.0, 0.5, 1.0):
        at = int(share * (len(ranges.r) - 1))
        east, north = (
            np.interp(ranges.time[at], track.time, way) for way in (track.east, track.north)
        )
        for angle in np.arange(8) * np.pi / 4:
            yield np.array(
                [east + ranges.r[at] * np.cos(angle), north + ranges.r[at] * np.sin(angle)]
            )


def _covered(track: Track, ranges: Ranges) -> Ranges:
    """Return the ranges with a position before and after them, thinned to at most MOST."""
    if len(track.time) < 2:
        return ranges.take(np.array([], int))
    after = np.clip(np.searchsorted(track.time, ranges.time), 1, len(track.time) - 1)
    inside = (ranges.time >= track.time[0]) & (ranges.time <= track.time[-1])
    # 3.0: longest time between the two positions around a range, s.
    kept = np.flatnonzero(inside & (track.time[after] - track.time[after - 1] <= 3.0))
    return ranges.take(kept[:: max(1, -(-len(kept) // MOST))])


class Problem:
    """Least-squares problem: residuals of the ranges and of the priors, in standard deviations."""

    def __init__(
        self,
        track: Track,
        ranges: Ranges,
        known: Knowledge,
        *,
        moves: bool = False,
        nodes: int = MOST_NODES,
    ) -> None:
        self.track = track
        self.ranges = ranges
        self.known = known
        self.moves = moves
        self.end = float(ranges.time[-1])
        self.own = VN + 1 if moves else DELAY + 1
        sigmas = (
            known.up_sigma,
            known.bias_sigma,
            known.scale_sigma,
            known.delay_sigma,
            SPEED_SIGMA,
            SPEED_SIGMA,
        )
        self._expected_sigma = np.array(sigmas[: self.own - U])
        self._expected = np.zeros(self.own - U)  # prior means of all states except east and north
        self._expected[0] = known.up
        span = self.end - float(ranges.time[0])
        count = int(min(nodes, 1 + np.ceil(NODES * span / GPS_TIME)))
        places = np.linspace(ranges.time[0], self.end, count)
        self._between = np.column_stack(
            [np.interp(ranges.time, places, row) for row in np.eye(count)]
        )
        kernel = known.gps_sigma**2 * np.exp(-np.abs(places[:, None] - places) / GPS_TIME)
        self._whiten = np.linalg.inv(np.linalg.cholesky(kernel))
        # Velocity of the vehicle. A delay shifts the positions along it.
        self._rates = [np.gradient(way, track.time) for way in (track.east, track.north, track.up)]

    def fit(self, start: Array) -> Fit | None:
        """Return the robust fit, or None if it fails.

        start: east, north and, for a moving target, velocity; or all states except the nodes.
        """
        from scipy.optimize import least_squares  # imported here because it takes half a second

        x = np.zeros(self.own + 3 * self._between.shape[1])
        # Start below the track. At the vehicle's own height, the derivative of the range with
        # respect to the height is zero, and the fit would stay there.
        below = float(np.median(self.track.up)) - 0.2 * float(np.median(self.ranges.r))
        x[:2], x[U] = (
            start[:2],
            min(self.known.up, below) if self.known.up_sigma > 10 else self.known.up,
        )
        if len(start) == self.own:
            x[: self.own] = start
        elif self.moves:
            x[VE : VN + 1] = start[2:4]
        scale = np.ones_like(x)
        scale[[E, N, U]] = 10.0
        scale[DELAY] = 0.1
        scale[SCALE] = 0.01
        found = least_squares(
            self._residuals,
            x,
            self._jacobian,
            loss=self._loss,
            f_scale=HUBER,
            x_scale=scale,
            max_nfev=60,
            ftol=1e-5,
            xtol=1e-5,
        )
        return found if np.isfinite(found.cost) else None

    def _loss(self, z: Array) -> Array:
        """Return the loss and its two derivatives for scipy: Huber for ranges, quadratic for
        priors. z: squared residuals."""
        far = z > 1
        far[len(self.ranges.r) :] = False
        root = np.sqrt(np.where(far, z, 1.0))
        return np.array(
            [np.where(far, 2 * root - 1, z), 1 / root, np.where(far, -0.5 / root**3, 0.0)]
        )

    def settle(self, fit: Fit) -> "_Settled | None":
        """Fit again without outliers and with the measured noise. None if too few ranges remain or
        the fit fails."""
        count = len(self.ranges.r)
        off = fit.fun[:count]
        scale = 1.4826 * float(np.median(np.abs(off)))
        least = 1.0 if self.known.sigma_known else 1e-6
        keep = np.abs(off) <= OUTLIER * max(scale, least)
        if keep.sum() < LEAST:
            return None
        spread = float(np.sqrt(np.mean(off[keep] ** 2)))
        kept = self.ranges.take(keep)
        # A radio with correlated errors gives less information than its number of ranges suggests:
        # enlarge the sigmas.
        worse = max(spread, least) * np.sqrt(_correlation(off[keep]))
        again = Problem(
            self.track, replace(kept, sigma=kept.sigma * worse), self.known, moves=self.moves
        )
        last = again.fit(fit.x[: self.own])
        return None if last is None else _Settled(again, last, spread)

    def _line(self) -> tuple[Array, Array, Array]:
        """Return middle, direction and RMS extent (along, across; m) of the track."""
        inside = (self.track.time >= self.ranges.time[0]) & (self.track.time <= self.end)
        way = np.column_stack([self.track.east, self.track.north])[inside]
        middle = way.mean(axis=0)
        _, extent, lines = np.linalg.svd(way - middle, full_matrices=False)
        return middle, lines[0], extent / np.sqrt(len(way))

    @property
    def straight(self) -> bool:
        """True if the RMS distance of the track from a straight line is within the error of its
        positions."""
        along, across = self._line()[2]
        return bool(across < min(2 * self.known.gps_sigma, 0.15 * along))

    def mirrored(self, x: Array) -> Array:
        """Return the states with place and velocity mirrored at the line fitted to the track."""
        middle, line, _ = self._line()
        flip = 2 * np.outer(line, line) - np.eye(2)
        mirror = x[: self.own].copy()
        mirror[:2] = middle + flip @ (x[:2] - middle)
        mirror[VE : VN + 1] = flip @ mirror[VE : VN + 1] if self.moves else ()
        return mirror

    def seen_from(self, place: Place) -> tuple[Array, Array]:
        """Return the vehicle's positions relative to a place at the times of the ranges, east and
        north, m."""
        time = self.ranges.time
        ahead = time - self.end
        east, north = (
            np.interp(time, self.track.time, way) for way in (self.track.east, self.track.north)
        )
        return (
            east - place.east - place.velocity[0] * ahead,
            north - place.north - place.velocity[1] * ahead,
        )

    def finish(self, settled: "_Settled", plane: Plane) -> Place | None:
        """Return the place of a settled fit. None if its covariance is singular."""
        again = settled.problem
        last = settled.fit
        kept = again.ranges
        try:
            covariance = again.covariance(last)
        except np.linalg.LinAlgError:
            return None
        x = last.x
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        velocity = (float(x[VE]), float(x[VN])) if self.moves else (0.0, 0.0)
        noise = settled.spread * float(np.median(self.ranges.sigma))
        both = [BIAS, SCALE]
        radio = x[both]
        radio_covariance = covariance[np.ix_(both, both)]
        nearest, farthest = np.percentile(kept.r, [5, 95])
        # 5.0: smallest spread of the ranges that makes the clock offset observable, in units of
        # range noise plus GPS sigma. With a smaller spread, variations of the GPS error would be
        # fitted as an offset.
        if farthest - nearest < 5.0 * (noise + self.known.gps_sigma):
            sd[DELAY] = (
                self.known.delay_sigma
            )  # on a circle around the target, every clock offset fits
            radio, radio_covariance = self._at_median_range(radio, radio_covariance, float(x[U]))
        # 2.0: largest standard deviation of an observed height, m.
        return Place(
            time=self.end, plane=plane, east=float(x[E]), north=float(x[N]), up=float(x[U]),
            covariance=covariance[:2, :2], up_sigma=float(sd[U]),
            up_known=bool(sd[U] <= 2.0 and again.one_sided(last, float(sd[U]))),
            bias=float(radio[0]), scale=float(radio[1]), radio_covariance=radio_covariance,
            bias_prior=self.known.bias_sigma,
            delay=float(x[DELAY]), delay_sigma=float(sd[DELAY]),
            noise=noise, used=len(kept.r), outliers=len(self.ranges.r) - len(kept.r),
            velocity=velocity, velocity_sigma=float(max(sd[VE], sd[VN])) if self.moves else None,
            range_scale=float(np.median(self.ranges.r)),
        )  # fmt: skip

    def _at_median_range(self, radio: Array, covariance: Array, up: float) -> tuple[Array, Array]:
        """Return bias and scale of the radio with their covariance, for nearly equal ranges. They
        follow from the prior and from the range error at the median range. up: fitted height, m."""
        # On a circle around the target, the computed lengths change only by the GPS error, which
        # the ranges do not contain. The fit mistakes this error for a slope of the ranges: with a
        # free bias, a true scale of 1.07 was fitted as 0.80 ±0.06.
        length = (float(np.median(self.ranges.r)) - radio[0]) / (1 + radio[1])
        slope = np.array([1.0, length])
        prior = np.diag([self.known.bias_sigma**2, self.known.scale_sigma**2])
        variance = slope @ covariance @ slope
        # With another range error, any height fits the circle, so add the uncertainty of the
        # height. An implausibly large range error is kept, because it shows that the place is
        # wrong.
        plausible = abs(slope @ radio) <= ROUGH * float(np.median(self.ranges.r))
        if self.known.up_sigma > 10 and plausible:
            above = float(np.median(self.track.up)) - np.array([
                self.known.up - self.known.up_sigma, self.known.up
            ])  # fmt: skip
            across = length**2 - (float(np.median(self.track.up)) - up) ** 2
            lengths = np.sqrt(np.maximum(across + above**2, 0.0))
            variance += np.max(np.abs(lengths - length)) ** 2
        gain = prior @ slope / (slope @ prior @ slope + variance)
        return gain * (slope @ radio), prior - np.outer(gain, slope @ prior)

    def covariance(self, fit: Fit) -> Array:
        """Return the covariance of the states. Raises LinAlgError."""
        covariance: Array = np.linalg.inv(fit.jac.T @ fit.jac).astype(float)
        # For a target at the vehicle's height, the derivative of a range with respect to the height
        # is zero. The covariance then ignores that a height error changes the ranges as a bias and
        # a scale do. The range depends on the square of the height difference. The root of the
        # standard deviation of this square is the smallest observable height difference. Below it,
        # use the slope at this difference instead of the derivative.
        count = len(self.ranges.r)
        (far, _, _) = self._line_of_sight(fit.x)
        off = float(
            np.median(
                np.abs(np.interp(self.ranges.time, self.track.time, self.track.up) - fit.x[U])
            )
        )
        if off > self.known.up_sigma:
            return covariance
        table = fit.jac.copy()
        # The column of the bias holds the weight of each range. The weights of outliers are
        # reduced.
        slope = table[:count, BIAS] * (1 + fit.x[SCALE]) / np.maximum(far, 1e-3)
        table[:count, U] = self.known.up_sigma * slope
        wide: Array = np.linalg.inv(table.T @ table).astype(float)
        least = float(np.sqrt(self.known.up_sigma * np.sqrt(wide[U, U])))
        if off > least:
            return covariance
        table[:count, U] = least * slope
        return np.linalg.inv(table.T @ table).astype(float)

    def one_sided(self, fit: Fit, sigma: float) -> bool:
        """True if the ranges or the prior reject the height mirrored at the track. sigma: standard
        deviation of the height, m."""
        # From a level track, a target fits equally well above and below the track. Near the height
        # of the track, the linear covariance is too small: a UWB radio on a cart once gave -1.5
        # ±0.7 m for a true height of +0.9 m.
        known = self.known
        start = fit.x[: self.own].copy()
        mirror = 2 * float(np.median(self.track.up)) - float(fit.x[U])
        if abs(mirror - fit.x[U]) < sigma:
            return True
        start[U] = mirror
        there = replace(known, up=mirror, up_sigma=sigma / 10)
        other = Problem(self.track, self.ranges, there, moves=self.moves).fit(start)
        if other is None:
            return True
        off = (mirror - known.up) / known.up_sigma
        return bool(2 * (other.cost - fit.cost) + off**2 > AMBIGUOUS)

    def _line_of_sight(self, x: Array) -> tuple[Array, list[Array], Array]:
        """Return the distances from the target to the vehicle (m), their directions (east, north,
        up), and the times of the positions (s)."""
        time = self.ranges.time + x[DELAY]
        ways = (self.track.east, self.track.north, self.track.up)
        east, north, up = (np.interp(time, self.track.time, way) for way in ways)
        nodes = x[self.own :].reshape(3, -1)
        ahead = self.ranges.time - self.end
        way = [
            x[E] - east + self._between @ nodes[0],
            x[N] - north + self._between @ nodes[1],
            x[U] - up + self._between @ nodes[2],
        ]
        if self.moves:
            way[0], way[1] = way[0] + x[VE] * ahead, way[1] + x[VN] * ahead
        far = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        return far, [part / np.maximum(far, 1e-3) for part in way], time

    def _residuals(self, x: Array) -> Array:
        far, _, _ = self._line_of_sight(x)
        nodes = x[self.own :].reshape(3, -1)
        before = (x[U : self.own] - self._expected) / self._expected_sigma
        off = ((1 + x[SCALE]) * far + x[BIAS] - self.ranges.r) / self.ranges.sigma
        return np.concatenate([off, before, *(nodes @ self._whiten.T)])

    def _jacobian(self, x: Array) -> Array:
        far, directions, time = self._line_of_sight(x)
        east, north, up = (part * (1 + x[SCALE]) for part in directions)
        count = len(far)
        own = self.own
        nodes = self._between.shape[1]
        priors = self.own - U
        table = np.zeros((count + priors + 3 * nodes, own + 3 * nodes))
        table[:count, E], table[:count, N], table[:count, U] = east, north, up
        table[:count, BIAS], table[:count, SCALE] = 1.0, far
        slopes = [np.interp(time, self.track.time, rate) for rate in self._rates]
        table[:count, DELAY] = -(east * slopes[0] + north * slopes[1] + up * slopes[2])
        if self.moves:
            ahead = self.ranges.time - self.end
            table[:count, VE], table[:count, VN] = east * ahead, north * ahead
        for axis, part in enumerate((east, north, up)):
            of_axis = slice(own + axis * nodes, own + (axis + 1) * nodes)
            table[:count, of_axis] = part[:, None] * self._between
            table[count + priors - own :][of_axis, of_axis] = self._whiten
        table[:count] /= self.ranges.sigma[:, None]
        table[count : count + priors, U:own] = np.diag(1 / self._expected_sigma)
        return table


@dataclass(frozen=True, slots=True)
class _Settled:
    """Fit without outliers.

    problem: problem with the measured noise.
    fit: result of the fit.
    spread: standard deviation of the residuals, in reported sigmas.
    """

    problem: Problem
    fit: Fit
    spread: float


def _correlation(residuals: Array) -> float:
    """Return the number of consecutive residuals that together give as much information as one
    independent residual.

    The number is 1 + 2 * the sum of the autocorrelation, up to the lag where the autocorrelation is
    noise.
    """
    count = len(residuals)
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
