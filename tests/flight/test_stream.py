"""How setpoints flow: every range is answered at once, a tick follows, and the rest of our talk goes beside them."""

import itertools
from functools import cache

import pytest

from tests.flight.lockstep import Flight, flight, message_ids

HEARTBEAT = 0


def rates(hz: float) -> tuple[str, ...]:
    return f"ranging.rate_hz={hz}", f"sim.ranging.rate_hz={hz}", "sim.ranging.dropout_fraction=0.0"


def gaps(times: list[float]) -> list[float]:
    return [after - before for before, after in itertools.pairwise(times)]


@cache
def flown(hz: float) -> Flight:
    return flight("quickstart", "limits.duration_s=20.0", *rates(hz)).fly(20.0)


@pytest.mark.parametrize(("hz", "expected"), [(10.0, 20), (4.0, 20), (50.0, 50), (9.98, 20), (19.98, 20)])
def test_a_tick_follows_the_newest_range_so_that_setpoints_come_evenly(hz: float, expected: int) -> None:
    """Also where the radio's clock is a little slow, so that each range would come just after a tick."""
    times = [time for time in flown(hz).setpoint_times if time > 10.0]
    assert len(times) == pytest.approx(10 * expected, rel=0.06)
    assert max(gaps(times)) <= 0.075 + 1e-6
    assert min(gaps(times)) > 0.018


def test_every_fresh_range_is_answered_by_the_step_that_heard_it_and_many_do_not_crowd_out_heartbeats() -> None:
    beats = [time for time, data in flown(50.0).sent if HEARTBEAT in message_ids(data) and time > 5.0]
    assert max(gaps(beats)) < 1.15
    ticks = [tick for tick in flown(10.0).ticks if tick.time > 10.0]
    assert all(tick.yaw_rate_sent is not None for tick in ticks)
    heard = [after for before, after in itertools.pairwise(ticks) if after.accepted > before.accepted]
    assert len(heard) > 90
    assert max(tick.range_age for tick in heard if tick.range_age is not None) < 0.02
