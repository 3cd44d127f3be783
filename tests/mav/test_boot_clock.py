"""The speed of the autopilot's time: found when three windows agree, and not by one hiccup."""

import pytest

from circnav_mav.mav.clocks import ClockSpeed


def found(times: list[tuple[float, float]]) -> list[float | None]:
    """What is found after each (time since boot, our time)."""
    clock, seen = ClockSpeed(), []
    for boot, now in times:
        clock.heard(boot, now)
        seen.append(clock.found)
    return seen


@pytest.mark.parametrize("speed", [0.0, 0.5, 8.0])
def test_a_steady_speed_is_found_after_three_windows_of_three_seconds(speed: float) -> None:
    seen = found([(100 + speed * 0.1 * n, 0.1 * n) for n in range(120)])
    assert seen[88] is None
    assert seen[91] == pytest.approx(speed, abs=0.01)


def test_one_stall_is_no_speed() -> None:
    """For 2 s nothing is heard; then all comes at once."""
    assert set(found([(0.1 * n, max(0.1 * n, 6.0) if 4.0 < 0.1 * n < 6.0 else 0.1 * n) for n in range(200)])) == {None}


def test_a_link_that_becomes_a_second_slower_is_no_speed() -> None:
    assert set(found([(0.1 * n, 0.1 * n + (1.0 if n > 50 else 0.0)) for n in range(200)])) == {None}


def test_a_radio_whose_buffer_fills_is_no_speed() -> None:
    """For 7 s each message comes 0.15 s a second later."""
    assert set(found([(0.1 * n, 0.1 * n + min(max(0.015 * (n - 50), 0.0), 1.05)) for n in range(200)])) == {None}


def test_a_reboot_begins_anew() -> None:
    fast = [(8 * 0.1 * n, 0.1 * n) for n in range(100)]
    seen = found([*fast, *((0.1 * n, 10.0 + 0.1 * n) for n in range(100))])
    assert seen[99] == pytest.approx(8.0, rel=0.01)
    assert seen[-1] is None
