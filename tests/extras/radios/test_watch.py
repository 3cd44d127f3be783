"""`circnav ranging watch`: the printed figures of a radio, and the faults that it names."""

from collections import deque
from random import Random

from circnav_mav.extras.radios.command import _lines
from circnav_mav.preflight.listener import ReceivedRange


def lines(seconds, **beacons):
    """Return the printed lines at a time. beacons: (arrival, range) by name, as b3=[...]."""
    received = {}
    for name, ranges in beacons.items():
        made = [ReceivedRange(at, at, at, r, 0.0) for at, r in ranges if at <= seconds]
        received[int(name[1:])] = deque(made)
    appeared = {beacon: ranges[0].arrival for beacon, ranges in received.items() if ranges}
    return _lines(
        {beacon: ranges for beacon, ranges in received.items() if ranges}, appeared, seconds
    )


def noisy(rate, seconds, r=20.0, since=0.0, sigma=0.03):
    chance = Random(1)
    return [
        (since + n / rate, round(r + chance.gauss(0, sigma), 3))
        for n in range(round(rate * seconds))
    ]


def test_ranging_watch_prints_true_rate_of_repeated_ranges():
    repeated = [(at + 0.01 * n, r) for at, r in noisy(20, 10) for n in range(5)]
    (line,) = lines(10.0, b0=repeated)
    assert "20.0 Hz" in line and "each range is sent 5 times" in line
    assert "scatter 0.0" in line and "scatter 0.000 m" not in line
    (line,) = lines(10.0, b0=repeated[1:] + repeated[7:9])
    assert "each range is sent 5 times" in line


def test_ranging_watch_counts_equal_ranges_of_coarse_radio():
    coarse = [(at, round(r, 1)) for at, r in noisy(10, 10, sigma=0.1)]
    (line,) = lines(10.0, b0=coarse)
    assert "10.0 Hz" in line and "times" not in line.replace("times our", "") and "WARN" not in line


def test_ranging_watch_reports_frozen_radio_within_ten_seconds():
    ranges = noisy(10, 10)
    ranges += [(10 + 0.1 * n, ranges[-1][1]) for n in range(80)]
    assert "WARNING the same range for" not in lines(13.0, b0=ranges)[0]
    assert "WARNING the same range for" in lines(17.0, b0=ranges)[0]


def test_ranging_watch_reports_second_anchor_that_changes_ranges():
    first = noisy(10, 8) + noisy(10, 8, r=21.3, since=8.0)
    second = noisy(10, 8, r=35.0, since=8.0)
    line, other = lines(10.0, b3=first, b4=second)
    assert "WARNING changed by +1.3" in line and line.endswith("m when beacon 4 appeared")
    assert "WARNING" not in other
    assert "WARNING" not in lines(10.0, b3=noisy(10, 16), b4=second)[0]


def test_ranging_watch_reports_two_anchors_with_one_id():
    mixed = sorted(noisy(5, 10) + noisy(5, 10, r=35.0, since=0.1))
    (line,) = lines(10.0, b0=mixed)
    assert "WARNING alternates between 20.0" in line and "35.0" in line
    moved = noisy(10, 5) + noisy(10, 5, r=35.0, since=5.0)
    assert "WARNING" not in lines(10.0, b0=moved)[0]
