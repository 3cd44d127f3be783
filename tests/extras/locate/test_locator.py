"""The survey beside a pilot on a bench: received frames, requests, output and failures."""

from cmath import phase
from concurrent.futures import Future
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.locate import onlooker
from circnav_mav.extras.locate.handback import HandBackSettings, PositionEstimate
from circnav_mav.extras.locate.locator import AFTER, STREAMS, LocateSettings, Locator
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.status import StatusSource
from tests.rig import Rig, decode, scattering

HERE = Plane(47.3, 8.5)
PLACE = Place(0.0, HERE, 30.0, 40.0, 584.0, np.eye(2), up_sigma=0.5, up_known=True)


class Beside:
    """A locator beside a rig. said: (time, message) sent by the locator."""

    def __init__(self, rig=None, **settings):
        self.rig = rig or Rig()
        self.locator = Locator(LocateSettings(194, **settings), self.rig.pilot)
        self.said = []

    def hear(self, *messages):
        """Receive messages in one datagram."""
        data = b"".join(map(self.rig.vehicle.say, messages))
        self.rig.pilot.receive(data, self.rig.now, "vehicle", VEHICLE)
        self.locator.on_frames(VEHICLE, "vehicle", self.rig.pilot.take_frames(), self.rig.now)

    def run(self, seconds):
        def step():
            for frame in self.locator.step(self.rig.now):
                self.said += [(self.rig.now, message) for message in decode(frame)]

        self.rig.run(seconds, also=step)
        return self


def test_every_range_of_a_datagram_counts():
    beside = Beside().run(3.0)
    beside.hear()
    before, stamp = len(beside.locator._ranges), 1_000_000 + round(beside.rig.now * 1000)
    beside.rig.pass_time(0.3)
    beside.hear(*(scattering(15_000, stamp + 100 * number) for number in range(1, 4)))
    assert len(beside.locator._ranges) == before + 3


def test_compass_bias_is_learnt_while_a_range_is_fresh(monkeypatch):
    beside = Beside().run(3.0)
    beside.locator.found(PLACE)
    learnt = []
    monkeypatch.setattr(beside.locator._reckoning.compass, "learn", lambda off, now: learnt.append(phase(off)))
    relative = SimpleNamespace(x=0.0, y=150.0, sigma=1.0)
    monkeypatch.setattr(beside.locator, "_relative", lambda time: relative)
    now = beside.rig.now
    beside.locator._learn_compass(30.0, 190.0, now, now)
    beside.locator._learn_compass(180.0, 40.0, now, now)
    beside.locator._learn_compass(30.0, 190.0, now, now + 2.0)
    assert learnt == pytest.approx([0.0, pi / 2])


@pytest.fixture
def failing(monkeypatch):
    """A hand-back in progress, beside a survey whose process breaks, as in the loop of a flight."""
    answer = Future()
    answer.set_exception(RuntimeError("the process is gone"))
    pool = SimpleNamespace(submit=lambda *job: answer, shutdown=lambda **how: None)
    monkeypatch.setattr(onlooker, "start_solver", lambda: pool)
    beside = Beside(handback=HandBackSettings(place=(47.3, 8.5))).run(3.0)
    monkeypatch.setattr(beside.locator, "job", lambda now: ())
    monkeypatch.setattr(beside.locator, "_own", lambda now: OwnMotion(now, 0.0, 0.0, 15.0))
    beside.locator._reckoning.where = PositionEstimate(beside.rig.now, 0.0, 0.0, 3.0, 0j, 1.0, False)
    return beside, onlooker.LocateOnlooker(beside.locator, waits=True)


def turns(beside, locating, seconds, *others):
    """Return the frames sent while GPS and estimator report a lost position. others: further messages of the
    vehicle."""
    said = []
    for _ in range(round(seconds / 0.05)):
        beside.rig.run(0.05)
        lost = (mavlink.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 1, 1, 0, 0, 9),
                mavlink.MAVLink_ekf_status_report_message(0x12F, 0, 0, 0, 0, 0, 0))  # fmt: skip
        frames = [beside.rig.vehicle.say(message) for message in (*lost, *others)]
        said += locating.on_step(None, LoopStep(beside.rig.now, received=[(VEHICLE, "vehicle", frames)]), None)
    return [message for frame in said for message in decode(frame)]


@pytest.mark.parametrize("broken", ["job", "_say", "_range"])
def test_a_survey_that_fails_is_an_alarm_in_flight_and_leaves_the_hand_back_alone(failing, monkeypatch, broken):
    beside, locating = failing
    if broken != "job":  # the process breaks
        monkeypatch.setattr(beside.locator, broken, lambda *given: 1 / 0)
    given = [one for one in turns(beside, locating, 6.0) if one.get_type() == "COMMAND_INT"]
    assert given and beside.locator.handback.begun
    status = StatusSource(beside.rig.pilot, Onlookers([locating])).status(
        beside.rig.pilot.take_records()[-1], beside.rig.now
    )
    assert any("survey of the target stopped at" in alarm for alarm in status.alarms)


@pytest.mark.parametrize(("fix", "is_given"), [(3, False), (1, True)], ids=["has a fix", "has none"])
def test_a_vehicle_with_two_receivers_is_given_nothing_while_the_second_has_a_fix(failing, fix, is_given):
    beside, locating = failing
    second = mavlink.MAVLink_gps2_raw_message(0, fix, 473_000_000, 85_000_000, 0, 1, 1, 0, 0, 9, 0, 0)
    given = {one.get_type() for one in turns(beside, locating, 8.0, second)} & {"COMMAND_INT"}
    assert bool(given) is is_given


@pytest.mark.parametrize("how", ["the position is back", "a signal"])
def test_streams_are_given_back_when_the_hand_back_ends_that_outlasts_guidance(how):
    beside = Beside(Rig(exit="stop"), handback=HandBackSettings(place=(47.3, 8.5))).run(3.0)
    locating = onlooker.LocateOnlooker(beside.locator, waits=True)
    turns(beside, locating, 3.0)
    beside.rig.pilot.interrupt(beside.rig.now, "SIGINT")
    turns(beside, locating, 1.0)
    assert beside.rig.pilot.done and locating.busy
    back = mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 1, 1, 0, 0, 9)
    locating.called_off = how == "a signal"
    said = []
    while locating.busy and beside.rig.now < 30.0:
        said += turns(beside, locating, 0.05, *([back] if how == "the position is back" else ()))
    restored = [one.param1 for one in said if one.get_type() == "COMMAND_LONG" and one.param2 == 0]
    assert {int(ident) for ident in restored} >= {*STREAMS, *AFTER}


def test_a_hand_back_that_fails_ends_too(failing, monkeypatch):
    beside, locating = failing
    turns(beside, locating, 0.1)
    monkeypatch.setattr(beside.locator, "step", lambda now: 1 / 0)
    assert turns(beside, locating, 1.0) == [] and not locating.busy
    assert beside.locator.problem.startswith("hand-back stopped at")
