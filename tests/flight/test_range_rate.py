"""Complete flights over MAVLink with a radio that measures the range rate, and with a radio that
freezes."""

import numpy as np
import pytest

from circnav_mav.pilot import Phase
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import (
    Flight,
    clockwise_turns,
    flight,
    last_third,
    mean_radius,
    rms_error,
)

RADIO = (
    "ranging.message=named_value_float",
    "ranging.rate_name=RRATE",
    "sim.ranging.message=named_value_float",
    "sim.ranging.rate_name=RRATE",
    "sim.ranging.outlier_fraction=0.0",
)


def flown(until, *overrides, law="smooth"):
    """Return a quickstart flight with a radio that measures the range rate, and the time of each
    alarm by its first words."""
    under_way = flight("quickstart", *RADIO, *overrides, law=law)
    alarms = {}
    watch = StatusSource(under_way.pilot, Listeners())

    def look(now: Flight) -> None:
        if len(now.ticks) % 5 == 1:
            for alarm in watch.status(now.ticks[-1], now.now).alarms:
                alarms.setdefault(
                    " ".join(word for word in alarm.partition(":")[0].split() if word.isupper()),
                    now.now,
                )

    return under_way.fly(until, look), alarms


def test_measured_range_rate_flies_the_circle_without_filter():
    one, alarms = flown(
        60.0,
        "guidance.estimator=measured",
        "ranging.rate_sign=closing",
        "sim.ranging.rate_sign=closing",
    )
    truths = last_third(one)
    assert mean_radius(truths) == pytest.approx(100.0, abs=0.5)
    assert rms_error(truths, 100.0) < 0.6
    assert clockwise_turns(truths) > 0.4
    assert not alarms
    measured = np.array([tick.measured_rate for tick in one.ticks if tick.phase is Phase.ENGAGED])
    assert np.mean(measured[-400:].astype(float)) == pytest.approx(0.0, abs=0.15)


def test_frozen_radio_is_treated_as_lost_range():
    events = (
        'sim.events=[{at_s=30.0,action="freeze_ranging"},{at_s=44.0,action="unfreeze_ranging"}]'
    )
    one, alarms = flown(48.0, events)
    assert 30.0 < alarms["RANGE RATE NOT USED"] <= 33.0
    assert 39.5 <= alarms["RANGE FROZEN"] <= 41.0
    held = [tick.time for tick in one.ticks if tick.phase is Phase.COASTING]
    assert 40.0 <= held[0] <= 41.5
    assert held[-1] < 46.0
    assert one.pilot.mission.phase is Phase.ENGAGED
    assert one.pilot.tracker.ranging.rejected["frozen"] > 30
