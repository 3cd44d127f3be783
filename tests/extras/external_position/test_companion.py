"""The external position beside a pilot in a rig: received frames, requests, output and failures."""

from cmath import phase
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.external_position.companion import AFTER, Companion
from circnav_mav.extras.external_position.external_position import PositionEstimate
from circnav_mav.extras.external_position.listener import ExternalPositionListener
from circnav_mav.extras.external_position.settings import ExternalPositionSettings
from circnav_mav.extras.locate.listener import LocateListener
from circnav_mav.extras.locate.locator import STREAMS, Locator
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listeners
from tests.extras.external_position.external_position_flight import COMPONENT
from tests.rig import Rig, decode

PLACE = Place(0.0, Plane(47.3, 8.5), 30.0, 40.0, 584.0, np.eye(2), up_sigma=0.5, up_known=True)


class Beside:
    """Locator and external position beside a rig, as in the loop of a flight. The locator computes
    no position."""

    def __init__(self, monkeypatch, rig=None):
        self.rig = rig or Rig()
        self.locator = Locator(194, self.rig.pilot)
        monkeypatch.setattr(self.locator, "job", lambda now: None)
        monkeypatch.setattr("circnav_mav.extras.locate.listener.start_solver", lambda: None)
        self.companion = Companion(
            ExternalPositionSettings(COMPONENT, (47.3, 8.5)), self.rig.pilot, self.locator
        )
        self.listener = ExternalPositionListener(self.companion)
        self.listeners = Listeners([LocateListener(self.locator, waits=True), self.listener])
        self.rig.run(3.0)

    def steps(self, seconds, *others, called_off=False):
        """Return the messages of the external position while GPS and estimator report a lost
        position.
        others: further messages of the vehicle."""
        sent_messages = []
        for _ in range(round(seconds / 0.05)):
            self.rig.run(0.05)
            lost = (mavlink.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 1, 1, 0, 0, 9),
                    mavlink.MAVLink_ekf_status_report_message(0x12F, 0, 0, 0, 0, 0, 0))  # fmt: skip
            frames = [self.rig.vehicle.pack(message) for message in (*lost, *others)]
            step = LoopStep(self.rig.now, received=[(VEHICLE, "vehicle", frames)])
            sent_messages += self.listeners.on_step(None, step, None, called_off=called_off)
        return [
            message
            for frame in sent_messages
            for message in decode(frame)
            if message.get_srcComponent() == COMPONENT
        ]


@pytest.fixture
def lost(monkeypatch):
    """An external position that is sending positions."""
    beside = Beside(monkeypatch)
    monkeypatch.setattr(beside.companion, "_own", lambda now: OwnMotion(now, 0.0, 0.0, 15.0))
    beside.companion.reckoning.where = PositionEstimate(
        beside.rig.now, 0.0, 0.0, 3.0, 0j, 1.0, False
    )
    return beside


def test_compass_bias_is_learned_with_fresh_ranges(monkeypatch):
    beside = Beside(monkeypatch)
    now = beside.rig.now
    learnt = []
    monkeypatch.setattr(
        beside.companion.reckoning.compass, "learn", lambda off, now: learnt.append(phase(off))
    )
    relative = SimpleNamespace(x=0.0, y=150.0, sigma=1.0, trusted=True)
    estimator = SimpleNamespace(at=lambda time: SimpleNamespace(relative=relative))
    monkeypatch.setattr(beside.rig.pilot.tracker, "estimator", estimator)
    beside.locator.found(PLACE)
    for time, east, north, later in (
        (1.0, 30.0, 190.0, 0.0),
        (1.0, 9.0, 9.0, 0.0),
        (2.0, 180.0, 40.0, 0.0),
        (3.0, 30.0, 190.0, 2.0),
    ):
        beside.locator._track.append((time, east, north, 600.0))
        beside.companion.on_frames(VEHICLE, "vehicle", [], now + later)
    assert learnt == pytest.approx([0.0, pi / 2])


@pytest.mark.parametrize("broken", ["_say", "_range"])
def test_external_position_continues_when_locate_fails(lost, monkeypatch, broken):
    monkeypatch.setattr(lost.locator, broken, lambda *given: 1 / 0)
    given = [one for one in lost.steps(6.0) if one.get_type() == "COMMAND_INT"]
    assert given and lost.companion.external_position.begun
    assert [one.partition(" at ")[0] for one in lost.listeners.problems] == ["locate: stopped"]


@pytest.mark.parametrize(
    ("fix", "is_given"),
    [(3, False), (1, True)],
    ids=["second GPS with fix", "second GPS without fix"],
)
def test_external_position_stops_when_second_gps_has_fix(lost, fix, is_given):
    second = mavlink.MAVLink_gps2_raw_message(
        0, fix, 473_000_000, 85_000_000, 0, 1, 1, 0, 0, 9, 0, 0
    )
    given = {one.get_type() for one in lost.steps(8.0, second)} & {"COMMAND_INT"}
    assert bool(given) is is_given


@pytest.mark.parametrize("how", ["the position is back", "a signal"])
def test_external_position_restores_stream_rates_at_its_end(monkeypatch, how):
    beside = Beside(monkeypatch, Rig("exit.action=stop"))
    beside.steps(3.0)
    beside.rig.pilot.interrupt(beside.rig.now, "SIGINT")
    beside.steps(1.0)
    assert beside.rig.pilot.done and beside.listeners.busy
    back = mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 1, 1, 0, 0, 9)
    others = [back] if how == "the position is back" else []
    sent_messages = []
    while beside.listeners.busy and beside.rig.now < 30.0:
        sent_messages += beside.steps(0.05, *others, called_off=how == "a signal")
    restored = [
        one.param1 for one in sent_messages if one.get_type() == "COMMAND_LONG" and one.param2 == 0
    ]
    assert {int(ident) for ident in restored} >= {*STREAMS, *AFTER}


def test_working_external_position_raises_no_alarm_after_guidance(monkeypatch):
    beside = Beside(monkeypatch, Rig("exit.action=stop"))
    beside.companion.reckoning.where = PositionEstimate(
        beside.rig.now, 0.0, 0.0, 3.0, 0j, 1.0, False
    )
    monkeypatch.setattr(beside.companion.reckoning, "step", lambda *given: None)
    beside.steps(4.0)
    beside.rig.pilot.interrupt(beside.rig.now, "SIGINT")
    beside.steps(1.0)
    assert beside.listener.alarms(beside.rig.now) == {}
    words = beside.listener.facts(beside.rig.now)["external position"]
    assert words.startswith("autopilot lost its position, sent it") and "until" in words
    beside.companion.external_position._end("the autopilot does not answer")
    assert "does not answer" in beside.listener.alarms(beside.rig.now)["external_position"]
    assert beside.listener.facts(beside.rig.now) == {}


def test_external_position_ends_with_message_after_internal_error(lost, monkeypatch):
    lost.steps(0.1)
    monkeypatch.setattr(lost.companion, "step", lambda now: 1 / 0)
    assert lost.steps(1.0) == [] and not lost.listeners.busy
    assert [one.partition(" at ")[0] for one in lost.listeners.problems] == [
        "external position: stopped"
    ]


def test_external_position_cannot_send_setpoints(lost):
    for message in (
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(
            1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0
        ),
    ):
        with pytest.raises(ValueError, match="must not send"):
            lost.companion._encode(message)


def test_verdict_counts_positions_of_external_position(lost):
    summary = {"notes": []}
    assert lost.listener.finish(summary) == {} and summary["notes"] == []
    given = [one for one in lost.steps(6.0) if one.get_type() == "COMMAND_INT"]
    files = lost.listener.finish(summary)
    assert (
        summary["external_position"]["sent"]
        == len(given)
        == len(files["external_position.csv"].splitlines()) - 1
    )
    assert summary["notes"] == [
        f"  external position  {len(given)} positions sent, 0 accepted; going on"
    ]
