"""`circnav ranging watch`: shows the ranges of a radio, without a vehicle."""

from collections import deque
from contextlib import closing
from itertools import groupby, pairwise
from math import inf, isfinite
from statistics import median, mode

from circnav_mav.cli.exits import Exit, refusing, say, warn
from circnav_mav.guidance.white_noise import bulk_sigma
from circnav_mav.mav.clocks import quick_span, span_speed
from circnav_mav.preflight.listener import ReceivedRange
from circnav_mav.preflight.ranging import outliers_among, residuals_of
from circnav_mav.runtime.clock import Clock
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.radio_link import RadioLink, open_radio
from circnav_mav.runtime.runner import StopRequest, wait

PERIOD = 1.0
"""Time between two printed lines of a beacon, s."""
SPAN = 10.0
"""Time span that each line summarizes, s."""
MOST_KEPT = 20_000
"""Largest number of ranges stored per beacon. It bounds the memory, because the link is not
authenticated."""
MOST_BEACONS = 32
"""Largest number of beacons shown. It bounds the memory, too."""
FEW = 5
"""Smallest number of ranges for which scatter, outliers, and speed and jitter of the radio's clock
are computed."""


def watch_radio(endpoint: str, seconds: float | None) -> int:
    """Print a line per second for each beacon until the time is over or a Unix signal arrives.
    Raises Refused."""
    with refusing(endpoint, LinkError):
        link = open_radio(endpoint)
    with closing(link):
        received = _listen(link, seconds or inf)
        for words, count in link.troubles.items():
            if count > 1:
                warn(f"{words} ({count} times)")
    return Exit.DONE if received else Exit.NOTHING_RECEIVED


def _listen(link: RadioLink, seconds: float) -> bool:
    """Print the lines, and each new trouble once. Return True if any range was received."""
    beacons: dict[int, deque[ReceivedRange]] = {}
    appeared: dict[int, float] = {}
    shown: set[str] = set()
    clock = Clock()
    stop = StopRequest()
    due = PERIOD
    now = 0.0
    while now < seconds and stop.signal_name is None:
        wait({"radio": link}, stop, min(clock.until(due), clock.longest_wait))
        readings = link.read(now)
        now = clock.now()
        for words in link.troubles.keys() - shown:
            shown.add(words)
            warn(words)
        for reading, _ in readings:
            measured = isfinite(reading.range) and reading.range > 0
            if measured and (reading.beacon in beacons or len(beacons) < MOST_BEACONS):
                stamp = now if reading.stamp is None else reading.stamp
                received = ReceivedRange(stamp, stamp, now, reading.range, reading.sigma or 0.0)
                beacons.setdefault(reading.beacon, deque(maxlen=MOST_KEPT)).append(received)
                appeared.setdefault(reading.beacon, now)
        if now >= due:
            due += PERIOD
            for line in _lines(beacons, appeared, now):
                say(f"{now:6.1f} s  {line}")
    return bool(beacons)


def _lines(
    beacons: dict[int, deque[ReceivedRange]], appeared: dict[int, float], now: float
) -> list[str]:
    """Return a line for each beacon. appeared: time of each beacon's first range, s."""
    if not beacons:
        return ["no range yet"]
    for ranges in beacons.values():
        while len(ranges) > 1 and now - ranges[0].arrival > SPAN:
            ranges.popleft()
    return [
        _describe(beacon, list(ranges), appeared, now) for beacon, ranges in sorted(beacons.items())
    ]


def _describe(
    beacon: int, received: list[ReceivedRange], appeared: dict[int, float], now: float
) -> str:
    """Return a line: rate, newest range, scatter, outliers, longest gap, clock and faults."""
    ranges, times = _measured(received)
    silent = now - received[-1].arrival
    gap = max([silent, *(after.arrival - before.arrival for before, after in pairwise(ranges))])
    words = [
        f"beacon {beacon:<5}",
        f"{len(received) / times / min(now, SPAN):5.1f} Hz",
        f"{ranges[-1].r:8.2f} m",
    ]
    if len(ranges) < FEW:
        return "  ".join([*words, f"longest gap {gap:.2f} s"])
    residuals = residuals_of(ranges)
    scatter = bulk_sigma(residuals)
    # 5.0: residual from which a range is an outlier, in standard deviations: the default of the
    # mission's gate.
    share = outliers_among(residuals, 5.0 * scatter)
    words += [
        f"scatter {scatter:.3f} m",
        f"outliers {100 * share:.0f} %",
        f"longest gap {gap:.2f} s",
        _clock(ranges),
    ]
    if times > 1:
        words.append(f"each range is sent {times} times")
    faults = (_frozen(received), _two_values(ranges), _changed_by(beacon, ranges, appeared, now))
    return "  ".join([*words, *(f"WARNING {fault}" for fault in faults if fault)])


def _measured(ranges: list[ReceivedRange]) -> tuple[list[ReceivedRange], int]:
    """Return the ranges without repetitions, and the number of times that the radio sends each
    range.

    A radio that repeats each range the same number of times is recognized. A radio of coarse
    resolution also sends equal ranges, but in runs of different lengths.
    """
    runs = [list(run) for _, run in groupby(ranges, key=lambda one: one.r)]
    lengths = [len(run) for run in runs[1:-1]]
    times = mode(lengths) if len(lengths) >= FEW else 1
    # 0.8: share of the runs with this length. The others lost a datagram, or two equal ranges
    # followed each other.
    if times == 1 or lengths.count(times) < 0.8 * len(lengths):
        return ranges, 1
    return [run[0] for run in runs], times


def _frozen(ranges: list[ReceivedRange]) -> str:
    """Return a text if the newest ranges are all equal for 5.0 s, as of a sensor that prints its
    last range after a loss."""
    newest = ranges[-1]
    since = newest.arrival
    for one in reversed(ranges):
        if one.r != newest.r:
            break
        since = one.arrival
    same = newest.arrival - since
    return f"the same range for {same:.0f} s: radio frozen, or beacon lost?" if same >= 5.0 else ""


def _two_values(ranges: list[ReceivedRange]) -> str:
    """Return a text if the ranges alternate between two values, as of two anchors with one id."""
    rising = sorted(one.r for one in ranges)
    gap, limit = max((after - before, after) for before, after in pairwise(rising))
    low = [r for r in rising if r < limit]
    high = [r for r in rising if r >= limit]
    if min(len(low), len(high)) < max(FEW, 0.2 * len(ranges)):
        return ""
    # 5.0: gap between the values in units of the width of each. 4: number of changes from one to
    # the other value. A radio that is moved once changes its value once.
    changes = sum((a.r < limit) != (b.r < limit) for a, b in pairwise(ranges))
    if gap < 5.0 * max(low[-1] - low[0], high[-1] - high[0]) or changes < 4:
        return ""
    return f"alternates between {median(low):.2f} m and {median(high):.2f} m: two anchors, one id?"


def _changed_by(
    beacon: int, ranges: list[ReceivedRange], appeared: dict[int, float], now: float
) -> str:
    """Return a text if the ranges changed when another beacon appeared."""
    for other, at in appeared.items():
        before = [one.r for one in ranges if one.arrival < at]
        after = [one.r for one in ranges if one.arrival >= at]
        if other == beacon or now - at > SPAN or min(len(before), len(after)) < FEW:
            continue
        change = median(after) - median(before)
        width = max(before) - min(before)
        if abs(change) > max(width, 0.1):  # 0.1: resolution of a coarse radio, m
            return f"changed by {change:+.2f} m when beacon {other} appeared"
    return ""


def _clock(ranges: list[ReceivedRange]) -> str:
    """Return the speed of the radio's clock and the jitter of the arrival times, as text."""
    if all(one.stamp == one.arrival for one in ranges):
        return "no clock"
    span = quick_span([(one.arrival, one.stamp) for one in ranges])
    assert span is not None
    delays = sorted(one.arrival - one.stamp for one in ranges)
    jitter = delays[int(0.95 * (len(delays) - 1))] - delays[0]
    return f"clock {span_speed(span):.4f} times our speed, jitter {1000 * jitter:.0f} ms"
