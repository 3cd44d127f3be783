"""Preflight checks of the ranging."""

from collections.abc import Iterator, Sequence
from math import sqrt
from statistics import median

from circnav_mav.guidance.white_noise import bulk_sigma, residual
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check
from circnav_mav.mav.clocks import quick_span, span_speed
from circnav_mav.mav.ranging.interface import OTHERS, RATE_SIGMA, describe_rejected
from circnav_mav.mission.checks_ranging import height_cost
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.pilot.survey import RangeHeard, Survey

FULL_RATE = 0.8
"""Share of the requested rate above which a rate counts as full."""
SPEED_OFF = 0.03
"""Largest relative difference of the autopilot's clock from ours. Above it, it is a simulator at another speed."""
NOISE_NEAR, NOISE_FAR = 1.5, 4.0
"""Ratio of measured to assumed noise: PASS up to the first, FAIL above the second. For n residuals both bounds are
multiplied by 1 + 1/sqrt(n). A correct 0.5 m is then doubted in 3 of 1000 surveys of 10 ranges, and in none of 20,000
surveys of 50 ranges."""
MOST_REJECTED = 0.1
"""Share of rejected ranges above which preflight warns; chosen."""
MOST_OUTLIERS = 0.05
"""Share of outliers above which preflight warns; chosen, half of that in the benchmark."""
LATE = 0.1
"""Delay of a range on the link, s, above which preflight warns; chosen, two ticks."""


def judge_ranging(mission: Mission, survey: Survey) -> Iterator[Check]:
    """Check reception, rate, delay, noise and timestamps of the ranges."""
    ranges, height = survey.ranges, survey.height.at(survey.end)
    yield from _height(mission, survey, height)
    if choice := survey.ranging.sources.choice(survey.end):
        # noise, age and distance of ranges to two targets have no meaning
        yield Check(FAIL, "ranging", f"{choice}. A flight does not engage")
        return
    yield _heard(mission, survey)
    yield _rejected(mission, survey)
    if len(ranges) >= 10:
        yield from _noise(mission, ranges)
    if mission.file.ranging.rate_name is not None:
        yield from _rates(mission, survey)
    if ranges:
        yield _age(mission, survey)
        yield from _stamps(mission, survey)
        yield _distance(ranges, height or 0.0)
        yield from _calibrated(mission, ranges)


def _heard(mission: Mission, survey: Survey) -> Check:
    message = mission.file.ranging.message.upper()
    if not survey.ranges:
        if survey.carriers:
            heard = "; ".join(f"{count} of {sender}" for sender, count in sorted(survey.carriers.items()))
            return Check(FAIL, "ranging", f"no usable {message}. Heard: {heard}. Compare with the mission's [ranging]")
        link = survey.connection.counts[RANGING if mission.file.ranging.endpoint else VEHICLE]
        return Check(FAIL, "ranging", f"no {message}; {link.describe()}")
    wanted, stale = mission.file.ranging.rate_hz, mission.stale
    rate = len(survey.ranges) / survey.seconds
    grade = FAIL if rate < 1 / stale else PASS if rate >= FULL_RATE * wanted else WARN
    words = f"{len(survey.ranges)} ranges in {survey.seconds:.1f} s, {rate:.1f} Hz, the mission says {wanted:g} Hz"
    return Check(grade, "ranging", f"{words}; newest {survey.ranges[-1].r:.2f} m")


def _rejected(mission: Mission, survey: Survey) -> Check:
    """Check the share of rejected ranges. Messages of other sources do not count: only one source is used."""
    rejected = survey.ranging.rejected
    counts = {reason: count for reason, count in rejected.items() if reason not in OTHERS}
    words = describe_rejected(dict(sorted(rejected.items())))
    share = sum(counts.values()) / max(sum(counts.values()) + len(survey.ranges), 1)
    return Check(WARN if share > MOST_REJECTED else PASS, "rejected", words)


def _rates(mission: Mission, survey: Survey) -> Iterator[Check]:
    """Check reception, noise and consistency with the ranges of the measured range rate."""
    table, values = mission.file.ranging, survey.rates
    name, wanted = table.rate_name, table.rate_hz
    if trouble := survey.rate_reader.trouble:
        yield Check(FAIL, "range rate", f"{name}: {trouble}")
        return
    if len(values) < 10:
        yield Check(FAIL, "range rate", f"{len(values)} NAMED_VALUE_FLOAT {name} of the ranges' sender and clock")
        return
    if len(set(values)) == 1:
        words = f"all {len(values)} {name} are {values[0]:+.2f} m/s: frozen, or too coarse to show its noise"
        yield Check(WARN, "range rate", f"{words}; move it and look again")
        return
    rate = len(values) / survey.seconds
    timed = list(enumerate(values))
    noise = bulk_sigma([residual(*three) for three in zip(timed, timed[1:], timed[2:], strict=False)])
    enough, quiet = rate >= FULL_RATE * wanted, noise <= NOISE_NEAR * RATE_SIGMA * (1 + 1 / sqrt(len(values)))
    spread = f"{noise:.2f} m/s standard deviation, {RATE_SIGMA} m/s assumed"
    advice = "" if quiet else ": the measured value is used in flight"
    words = f"{name} {rate:.1f} Hz, newest {values[-1]:+.2f} m/s; {spread}{advice}"
    yield Check(PASS if enough and quiet else WARN, "range rate", words)


def _noise(mission: Mission, ranges: Sequence[RangeHeard]) -> Iterator[Check]:
    if len({one.r for one in ranges}) == 1:
        words = f"all {len(ranges)} ranges are {ranges[0].r:.2f} m: a frozen radio, or one too coarse to show its noise"
        yield Check(WARN, "noise", f"{words}; move it and look again")
        return
    residuals = residuals_of(ranges)
    noise, assumed = bulk_sigma(residuals), median(one.sigma for one in ranges)
    ratio = noise / assumed
    doubt = 1 + 1 / sqrt(len(residuals))
    grade = PASS if ratio <= NOISE_NEAR * doubt else WARN if ratio <= NOISE_FAR * doubt else FAIL
    advice = "" if grade is PASS else ": set ranging.sigma_m to it"
    yield Check(grade, "noise", f"{noise:.2f} m standard deviation, {assumed:.2f} m assumed{advice}")
    gate = mission.estimation.gate * assumed
    share = outliers_among(residuals, gate)
    words = f"about {100 * share:.0f} % of the ranges are off by more than {gate:.1f} m"
    yield Check(PASS if share <= MOST_OUTLIERS else WARN, "outliers", words)


def outliers_among(residuals: Sequence[float], gate: float) -> float:
    """Return the share of ranges with an error above the gate (m). Each outlier appears in three residuals."""
    return sum(abs(residual) > gate for residual in residuals) / 3 / len(residuals)


def residuals_of(ranges: Sequence[RangeHeard]) -> list[float]:
    """Return the noise residuals of ranges, m. A turn with 1 m/s^2 at 10 Hz contributes only 4 mm."""
    moments = [(one.time, one.r) for one in ranges]
    threes = zip(moments, moments[1:], moments[2:], strict=False)
    return [float(residual(*three)) for three in threes if three[0][0] < three[1][0] < three[2][0]] or [0.0]


def _age(mission: Mission, survey: Survey) -> Check:
    age = survey.end - survey.ranges[-1].time
    delays = sorted(one.arrival - one.time for one in survey.ranges)
    late = delays[int(0.95 * (len(delays) - 1))]
    stale = mission.stale
    grade = FAIL if age > stale else WARN if late > LATE else PASS
    words = f"95 % come within {1000 * late:.0f} ms of the quickest (a constant delay cannot be seen)"
    return Check(grade, "age", f"newest {age:.2f} s old (stale from {stale:g} s); {words}")


def _stamps(mission: Mission, survey: Survey) -> Iterator[Check]:
    """Check the speed of the sensor's clock. No line if it is wrong by the same factor as the autopilot's clock, which
    is checked separately."""
    ranges, boot = survey.ranges, survey.boot
    if mission.file.ranging.stamp == "arrival":
        yield Check(PASS, "stamps", "arrival times, as the mission says")
        return
    if all(one.stamp == one.arrival for one in ranges):
        words = 'the messages carry no time: arrival counts, delay and all (ranging.stamp = "arrival")'
        yield Check(WARN, "stamps", words)
        return
    span = quick_span([(one.arrival, one.stamp) for one in ranges])
    if span is None or span[1][0] - span[0][0] < 1.0:
        yield Check(WARN, "stamps", "too few to tell whether the sensor's clock is usable")
        return
    speed = span_speed(span)
    words = f"the sensor's clock runs at {speed:.3f} of ours"
    if abs(speed - 1) <= SPEED_OFF:
        yield Check(PASS, "stamps", words)
    elif boot is None or abs(speed / (span_speed(boot) or 1.0) - 1) > SPEED_OFF:
        yield Check(FAIL, "stamps", f'{words}: its stamps are of no use, set ranging.stamp = "arrival"')


def _height(mission: Mission, survey: Survey, height: float | None) -> Iterator[Check]:
    """Check a height that is computed from the vehicle's altitude. `check` covers a height given in the mission."""
    if unknown := survey.height.why_unknown(survey.end):
        yield Check(FAIL, "height cost", unknown)
    elif mission.height.needs_altitude and height is not None:
        yield height_cost(mission, height)


def _calibrated(mission: Mission, ranges: Sequence[RangeHeard]) -> Iterator[Check]:
    """Report the newest range before and after the mission's calibration, for comparison with a tape measure."""
    calibration = mission.file.ranging.calibration
    if calibration.is_set:
        r = ranges[-1].r
        words = f"{calibration.describe()}: {calibration.reported(r):.2f} m reported, {r:.2f} m true"
        yield Check(PASS, "calibration", words)


def _distance(ranges: Sequence[RangeHeard], height: float) -> Check:
    r = ranges[-1].r
    if r <= abs(height):
        words = f"{r:.1f} m is less than the {height:.1f} m above the target: fine on the ground only"
        return Check(WARN, "distance", words)
    across = sqrt(r * r - height * height)
    return Check(PASS, "distance", f"{r:.1f} m, {across:.1f} m on the map at {height:.1f} m above the target")
