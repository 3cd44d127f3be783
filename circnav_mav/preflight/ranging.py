"""Preflight checks of the ranging."""

from collections.abc import Iterator, Sequence
from math import sqrt
from statistics import median

from circnav_mav.guidance.maths import radius_sensitivity
from circnav_mav.guidance.white_noise import bulk_sigma, residual
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check
from circnav_mav.mav.clocks import quick_span, span_speed
from circnav_mav.mav.ranging.interface import OTHERS, RATE_SIGMA, describe_rejected
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.preflight.listener import PreflightListener, ReceivedRange

FULL_RATE = 0.8
"""A measured rate passes from this share of the expected rate on. Expected is `ranging.rate_hz`, or
the requested rate of a stream."""
SPEED_OFF = 0.03
"""Largest relative difference between the speeds of another clock and of this computer's clock. A
larger difference means a simulator at another speed, or a wrong clock."""
NOISE_NEAR = 1.5
"""Ratio of measured to assumed noise up to which the noise check passes. For n residuals the bound
is multiplied by 1 + 1/sqrt(n). If the assumption of 0.5 m is correct, the check does not pass in 3
of 1000 preflights with 10 ranges, and in none of 20,000 with 50 ranges."""
NOISE_FAR = 4.0
"""Ratio of measured to assumed noise above which the noise check fails. For n residuals the bound
is multiplied by 1 + 1/sqrt(n)."""


def judge_ranging(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    """Check reception, rate, delay, noise and timestamps of the ranges."""
    ranges = listener.ranges
    height = listener.height.at(listener.end)
    yield from _height(mission, listener, height)
    if choice := listener.ranging.sources.choice(listener.end):
        # For ranges to two targets, the checks of noise, age and distance have no meaning.
        yield Check(FAIL, "ranging", f"{choice}. A flight would not engage the vehicle")
        return
    yield _received(mission, listener)
    yield _rejected(mission, listener)
    if len(ranges) >= 10:
        yield from _noise(mission, ranges)
    if mission.file.ranging.rate_name is not None:
        yield from _rates(mission, listener)
    if ranges:
        yield _age(mission, listener)
        yield from _stamps(mission, listener)
        yield _distance(ranges, height or 0.0)
        yield from _calibrated(mission, ranges)


def _received(mission: Mission, listener: PreflightListener) -> Check:
    message = mission.file.ranging.message.upper()
    if not listener.ranges:
        if carriers := listener.carriers or listener.other_ranging:
            received = "; ".join(
                f"{count} of {sender}" for sender, count in sorted(carriers.items())
            )
            return Check(
                FAIL,
                "ranging",
                f"no usable {message}. Received: {received}. Compare with the mission's [ranging]",
            )
        link = listener.connection.counts[RANGING if mission.file.ranging.endpoint else VEHICLE]
        return Check(FAIL, "ranging", f"no {message}; {link.describe()}")
    wanted = mission.file.ranging.rate_hz
    stale = mission.stale
    rate = len(listener.ranges) / listener.seconds
    grade = FAIL if rate < 1 / stale else PASS if rate >= FULL_RATE * wanted else WARN
    words = (
        f"{len(listener.ranges)} ranges in {listener.seconds:.1f} s, {rate:.1f} Hz, ranging.rate_hz"
        f" = {wanted:g}"
    )
    return Check(grade, "ranging", f"{words}; newest {listener.ranges[-1].r:.2f} m")


def _rejected(mission: Mission, listener: PreflightListener) -> Check:
    """Check the share of rejected ranges. Only one source is used, so rejected messages of other
    sources are not included in the share."""
    rejected = listener.ranging.rejected
    counts = {reason: count for reason, count in rejected.items() if reason not in OTHERS}
    words = describe_rejected(dict(sorted(rejected.items())))
    share = sum(counts.values()) / max(sum(counts.values()) + len(listener.ranges), 1)
    # 0.1: share of rejected ranges above which preflight warns (chosen, not measured).
    return Check(WARN if share > 0.1 else PASS, "rejected", words)


def _rates(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    """Check reception and noise of the measured range rate, and its consistency with the ranges."""
    table = mission.file.ranging
    values = listener.rates
    name = table.rate_name
    wanted = table.rate_hz
    if trouble := listener.rate_reader.trouble:
        yield Check(FAIL, "range rate", f"{name}: {trouble}")
        return
    if len(values) < 10:
        yield Check(
            FAIL,
            "range rate",
            f"only {len(values)} NAMED_VALUE_FLOAT {name} with sender and clock of the ranges",
        )
        return
    if len(set(values)) == 1:
        words = (
            f"all {len(values)} {name} are {values[0]:+.2f} m/s: frozen, or its resolution is too"
            " coarse"
        )
        yield Check(WARN, "range rate", f"{words}; move the radio and repeat preflight")
        return
    rate = len(values) / listener.seconds
    timed = list(enumerate(values))
    noise = bulk_sigma(
        [residual(*three) for three in zip(timed, timed[1:], timed[2:], strict=False)]
    )
    enough = rate >= FULL_RATE * wanted
    quiet = noise <= NOISE_NEAR * RATE_SIGMA * (1 + 1 / sqrt(len(values)))
    spread = f"standard deviation {noise:.2f} m/s, {RATE_SIGMA} m/s assumed"
    advice = "" if quiet else ": in flight the measured standard deviation is used"
    words = f"{name} {rate:.1f} Hz, newest {values[-1]:+.2f} m/s; {spread}{advice}"
    yield Check(PASS if enough and quiet else WARN, "range rate", words)


def _noise(mission: Mission, ranges: Sequence[ReceivedRange]) -> Iterator[Check]:
    if len({one.r for one in ranges}) == 1:
        words = (
            f"all {len(ranges)} ranges are {ranges[0].r:.2f} m: the radio is frozen, or its"
            " resolution is too coarse"
        )
        yield Check(WARN, "noise", f"{words}; move the radio and repeat preflight")
        return
    residuals = residuals_of(ranges)
    noise = bulk_sigma(residuals)
    assumed = median(one.sigma for one in ranges)
    ratio = noise / assumed
    doubt = 1 + 1 / sqrt(len(residuals))
    grade = PASS if ratio <= NOISE_NEAR * doubt else WARN if ratio <= NOISE_FAR * doubt else FAIL
    advice = "" if grade is PASS else f": set ranging.sigma_m = {noise:.2g}"
    yield Check(
        grade, "noise", f"standard deviation {noise:.2f} m, assumed {assumed:.2f} m{advice}"
    )
    gate = mission.estimation.gate * assumed
    share = outliers_among(residuals, gate)
    words = f"about {100 * share:.0f} % of the ranges are outliers, wrong by more than {gate:.1f} m"
    # 0.05: share of outliers above which preflight warns: half of the benchmark's share.
    yield Check(PASS if share <= 0.05 else WARN, "outliers", words)


def outliers_among(residuals: Sequence[float], gate: float) -> float:
    """Return the share of ranges with an error above the gate (m). Each outlier appears in three
    residuals."""
    return sum(abs(residual) > gate for residual in residuals) / 3 / len(residuals)


def residuals_of(ranges: Sequence[ReceivedRange]) -> list[float]:
    """Return the noise residuals of ranges, m. An acceleration of 1 m/s^2 contributes only 4 mm at
    10 Hz."""
    moments = [(one.time, one.r) for one in ranges]
    threes = zip(moments, moments[1:], moments[2:], strict=False)
    return [
        float(residual(*three)) for three in threes if three[0][0] < three[1][0] < three[2][0]
    ] or [0.0]


def _age(mission: Mission, listener: PreflightListener) -> Check:
    age = listener.end - listener.ranges[-1].time
    delays = sorted(one.arrival - one.time for one in listener.ranges)
    late = delays[int(0.95 * (len(delays) - 1))]
    stale = mission.stale
    # 0.1: delay of a range on the link, s, above which preflight warns: two ticks.
    grade = FAIL if age > stale else WARN if late > 0.1 else PASS
    words = (
        f"95 % arrive within {1000 * late:.0f} ms of the fastest (a constant delay cannot be"
        " measured)"
    )
    return Check(grade, "age", f"newest range {age:.2f} s old (stale from {stale:g} s); {words}")


def _stamps(mission: Mission, listener: PreflightListener) -> Iterator[Check]:
    """Check the speed of the sensor's clock. If the autopilot's clock is wrong by the same factor,
    there is no line here, because `preflight` checks the autopilot's clock."""
    ranges = listener.ranges
    boot = listener.boot
    if mission.file.ranging.stamp == "arrival":
        yield Check(PASS, "stamps", 'arrival times are used (ranging.stamp = "arrival")')
        return
    if not listener.ranging.stamped:
        words = 'the messages have no timestamp: arrival times are used (ranging.stamp = "arrival")'
        yield Check(WARN, "stamps", words)
        return
    span = quick_span([(one.arrival, one.stamp) for one in ranges])
    if span is None or span[1][0] - span[0][0] < 1.0:
        yield Check(WARN, "stamps", "too few ranges to check the sensor's clock")
        return
    speed = span_speed(span)
    words = f"the sensor's clock runs at {speed:.3f} times our speed"
    if abs(speed - 1) <= SPEED_OFF:
        yield Check(PASS, "stamps", words)
    elif boot is None or abs(speed / (span_speed(boot) or 1.0) - 1) > SPEED_OFF:
        yield Check(
            FAIL, "stamps", f'{words}: its timestamps cannot be used, set ranging.stamp = "arrival"'
        )


def _height(mission: Mission, listener: PreflightListener, height: float | None) -> Iterator[Check]:
    """Check the height if it is computed from the vehicle's altitude. A height given in the mission
    is checked by `circnav check`."""
    if unknown := listener.height.why_unknown(listener.end):
        yield Check(FAIL, "height", unknown)
    elif mission.file.orbit.needs_altitude and height is not None:
        words = (
            f"{height:.1f} m above the target. {radius_sensitivity(mission.orbit.radius, height)}"
        )
        yield Check(PASS, "height", words)


def _calibrated(mission: Mission, ranges: Sequence[ReceivedRange]) -> Iterator[Check]:
    """Report the newest range before and after the mission's calibration, for comparison with a
    tape measure."""
    calibration = mission.file.ranging.calibration
    if calibration.is_set:
        r = ranges[-1].r
        words = (
            f"{calibration.describe()}: {calibration.reported(r):.2f} m reported, {r:.2f} m true"
        )
        yield Check(PASS, "calibration", words)


def _distance(ranges: Sequence[ReceivedRange], height: float) -> Check:
    r = ranges[-1].r
    if r <= abs(height):
        words = (
            f"{r:.1f} m is less than the height of {height:.1f} m above the target: possible on the"
            " ground only"
        )
        return Check(WARN, "distance", words)
    across = sqrt(r * r - height * height)
    return Check(
        PASS,
        "distance",
        f"{r:.1f} m, horizontally {across:.1f} m at a height of {height:.1f} m above the target",
    )
