"""The echo watch: it compares the setpoint that the vehicle reports with the sent setpoints, and
detects another sender despite delays and filters."""

from math import cos, sin

import pytest

from circnav_mav.pilot.second_controller import WITHIN, EchoMonitor

TICK = 0.05


def watched(
    ours, reported, *, seconds=20.0, rate=4, limited=False, trip=0.0, sends=lambda now: True
):
    """Return the time (s) at which another sender was first detected, or None. ours, reported:
    functions of time; sent and reported turn rate, rad/s."""
    watch = EchoMonitor()
    found = None
    for step in range(round(seconds / TICK)):
        now = step * TICK
        if sends(now):
            watch.sent(ours(now), now)
        if step % round(1 / (rate * TICK)) == 0:
            watch.reported(reported(now), now, trip, limited=limited)
        if found is None and watch.other(now):
            found = now
    return found


def weaving(now):
    return 0.3 * sin(2 * now)


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("trip", [0.0, 0.5, 2.0])
def test_echo_monitor_accepts_own_delayed_setpoint(trip, limited):
    assert (
        watched(
            weaving, lambda now: weaving(max(now - trip - 0.1, 0.0)), limited=limited, trip=trip
        )
        is None
    )


def test_echo_monitor_rejects_larger_or_opposite_bank():
    for reported, found in ((0.35, False), (0.0, False), (0.6, False), (0.85, True), (-0.25, True)):
        assert (
            watched(lambda now: 0.6, lambda now, turn=reported: turn, limited=True) is not None
        ) is found


@pytest.mark.parametrize(
    "other", [lambda now: 0.1, lambda now: -0.17, lambda now: 0.24, lambda now: None]
)
@pytest.mark.parametrize("every", [1, 2, 3])
def test_echo_monitor_detects_other_sender_within_5_s(other, every):
    def reported(now):
        return other(now) if round(4 * now) % every == 0 else 0.17

    found = watched(lambda now: 0.17, reported)
    assert found is not None
    assert found <= 2.0 + WITHIN


def test_echo_monitor_detects_other_sender_by_reports_of_1_hz():
    assert watched(lambda now: 0.17, lambda now: 0.5, rate=1) is not None


def test_echo_monitor_tolerates_small_difference_from_straight_flight():
    assert watched(lambda now: 0.0, lambda now: 0.025) is None


def test_echo_monitor_ignores_single_reports():
    assert watched(lambda now: 0.17, lambda now: 0.5 if now % 2.0 < 0.1 else 0.17) is None


def test_echo_monitor_is_inactive_without_steady_setpoints():
    for sends in (lambda now: False, lambda now: now % 2.0 < 1.0):
        assert watched(lambda now: 0.17, lambda now: 0.5, sends=sends) is None


def test_echo_monitor_cannot_distinguish_similar_smooth_turns():
    """A sender with nearly the same turn rates is harmless (docs/safety.md)."""
    assert watched(weaving, lambda now: weaving(now) + 0.02 * cos(now)) is None
