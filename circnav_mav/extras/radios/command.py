"""`circnav ranging watch`: shows the ranges of a radio, without a vehicle."""

from collections import deque
from contextlib import closing
from itertools import pairwise
from math import inf, isfinite

from circnav_mav.cli.exits import Exit, refusing, say
from circnav_mav.guidance.white_noise import bulk_sigma
from circnav_mav.mav.clocks import quick_span, span_speed
from circnav_mav.mission.preflight_ranging import outliers_among, residuals_of
from circnav_mav.pilot.preflight_listener import ReceivedRange
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
                say(f"  WARNING    {words} ({count} times)")
    return Exit.DONE if received else Exit.NOTHING_RECEIVED


def _listen(link: RadioLink, seconds: float) -> bool:
    """Print the lines, and each new trouble once. Return True if any range was received."""
    beacons: dict[int, deque[ReceivedRange]] = {}
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
            say(f"  WARNING    {words}")
        for reading, _ in readings:
            measured = isfinite(reading.range) and reading.range > 0
            if measured and (reading.beacon in beacons or len(beacons) < MOST_BEACONS):
                stamp = now if reading.stamp is None else reading.stamp
                received = ReceivedRange(stamp, stamp, now, reading.range, reading.sigma or 0.0)
                beacons.setdefault(reading.beacon, deque(maxlen=MOST_KEPT)).append(received)
        if now >= due:
            due += PERIOD
            for line in _lines(beacons, now):
                say(f"{now:6.1f} s  {line}")
    return bool(beacons)


def _lines(beacons: dict[int, deque[ReceivedRange]], now: float) -> list[str]:
    if not beacons:
        return ["no range yet"]
    for ranges in beacons.values():
        while len(ranges) > 1 and now - ranges[0].arrival > SPAN:
            ranges.popleft()
    return [_describe(beacon, list(ranges), now) for beacon, ranges in sorted(beacons.items())]


def _describe(beacon: int, ranges: list[ReceivedRange], now: float) -> str:
    """Return a line: rate, newest range, scatter, outliers, longest gap and clock."""
    silent = now - ranges[-1].arrival
    gap = max([silent, *(after.arrival - before.arrival for before, after in pairwise(ranges))])
    words = [
        f"beacon {beacon:<5}",
        f"{len(ranges) / min(now, SPAN):5.1f} Hz",
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
    return "  ".join(words)


def _clock(ranges: list[ReceivedRange]) -> str:
    """Return the speed of the radio's clock and the jitter of the arrival times, as text."""
    if all(one.stamp == one.arrival for one in ranges):
        return "no clock"
    span = quick_span([(one.arrival, one.stamp) for one in ranges])
    assert span is not None
    delays = sorted(one.arrival - one.stamp for one in ranges)
    jitter = delays[int(0.95 * (len(delays) - 1))] - delays[0]
    return f"clock {span_speed(span):.4f} times our speed, jitter {1000 * jitter:.0f} ms"
