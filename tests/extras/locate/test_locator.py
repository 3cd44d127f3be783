"""The locator beside a pilot in a rig: received frames and failures."""

from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from circnav_mav.extras.locate import listener
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.rig import Rig, scattering


def beside(rig):
    return Locator(194, rig.pilot)


def test_locator_uses_every_range_of_datagram():
    rig = Rig()
    locator = beside(rig)

    def receive(*messages):
        rig.pilot.receive(b"".join(map(rig.vehicle.pack, messages)), rig.now, "vehicle", VEHICLE)
        locator.on_frames(VEHICLE, "vehicle", rig.pilot.take_frames(), rig.now)

    rig.run(3.0)
    receive()
    before = len(locator._ranges)
    stamp = 1_000_000 + round(rig.now * 1000)
    rig.pass_time(0.3)
    receive(*(scattering(15_000, stamp + 100 * number) for number in range(1, 4)))
    assert len(locator._ranges) == before + 3


@pytest.mark.parametrize("broken", ["job", "_say"])
def test_failing_locator_raises_an_alarm(monkeypatch, broken):
    answer = Future()
    answer.set_exception(RuntimeError("the process is gone"))
    pool = SimpleNamespace(submit=lambda *job: answer, shutdown=lambda **how: None)
    monkeypatch.setattr(listener, "start_solver", lambda: pool)
    rig = Rig()
    rig.run(3.0)
    locator = beside(rig)
    monkeypatch.setattr(locator, "job", lambda now: ())
    if broken != "job":  # simulate a broken worker process
        monkeypatch.setattr(locator, broken, lambda *given: 1 / 0)
    listeners = Listeners([listener.LocateListener(locator, waits=True)])
    for _ in range(3):
        rig.run(0.05)
        listeners.on_step(None, LoopStep(rig.now), None)
    status = StatusSource(rig.pilot, listeners).status(rig.pilot.take_records()[-1], rig.now)
    assert any(alarm.startswith("locate: stopped at 3.") for alarm in status.alarms)
