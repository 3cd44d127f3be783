"""Takeovers by the operator: every way to take over the vehicle and to return it."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Ending, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import Rig, Voice, attitude, decode, heartbeat

GUIDED = 4
LOITER = 5
LAND = 9
RTL = 6
ON_GROUND = 1
IN_AIR = 2
SET_MODE = 176
GIVEN_BACK = 2.0
"""Time, s, in the guided mode within which a returned vehicle is engaged. The guided mode must be
reported for 1.5 s of it."""


@dataclass(frozen=True)
class Takeover:
    """One way to take over the vehicle. before: earlier events. take: messages of the vehicle.
    stays: True if the vehicle stays in another mode or disarmed. left: True if the vehicle left the
    guided mode, so that entering it again returns the vehicle."""

    take: Callable[[Rig], None]
    text: str = "taken over, GUIDED left for LOITER"
    before: Callable[[Rig], None] = lambda rig: None
    stays: bool = True
    left: bool = True


def heartbeats(rig: Rig, *beats: tuple[int, bool]) -> None:
    """Receive several heartbeats (mode, armed) at the same time."""
    for mode, armed in beats:
        rig.receive(heartbeat(mode, armed=armed))


def stays(**changes: object) -> Callable[[Rig], None]:
    """Return an event that changes the vehicle's state, with an immediate heartbeat."""
    return lambda rig: rig.now_is(**changes).heartbeat()


def outage(rig: Rig) -> None:
    """Let the vehicle and the ranging be silent for some seconds."""
    assert rig.run(5.0, speaks=False, ranges=False).pilot.mission.phase is Phase.WAIT_LINK
    rig.now_is(speaks=True, ranges=True)


def outage_until_confirmed(rig: Rig) -> None:
    """Interrupt the link to a vehicle that reports its time since boot. Afterwards its identity
    must be confirmed by this time."""
    rig.receive(attitude(round(rig.now * 1000)))
    outage(rig)


def late_confirmation(rig: Rig) -> None:
    """Report another mode, then the guided mode, and only then the time since boot that confirms
    the identity."""
    heartbeats(rig, (LOITER, True))
    rig.run(0.25)
    heartbeats(rig, (GUIDED, True))
    rig.run(0.25)
    rig.receive(attitude(round(rig.now * 1000)))


def reboots(rig: Rig) -> None:
    """Reboot the vehicle: it is armed in GUIDED again, although the operator has not handed it
    over."""
    for boot_ms in (900_000, 2_000, 2_050):
        rig.receive(mavlink.MAVLink_system_time_message(0, boot_ms))


def backlog(rig: Rig) -> None:
    """Read a backlog after a stall in several steps. The last message is the takeover."""
    for _ in range(4):
        heartbeats(rig, (GUIDED, True))
        rig.range()
        rig.step()
        rig.now += 0.002
    stays(mode=LOITER)(rig)


def holds(rig: Rig) -> None:
    assert rig.run(2.0, ranges=False).pilot.mission.phase is Phase.COASTING


def loses_heartbeats(rig: Rig) -> None:
    """Lose all heartbeats. CURRENT_MODE alone keeps the vehicle engaged."""
    for _ in range(20):
        rig.run(0.5, speaks=False)
        rig.receive(mavlink.MAVLink_current_mode_message(0, GUIDED, GUIDED))
    assert rig.pilot.mission.phase is Phase.ENGAGED


def current_modes(*modes: int) -> Callable[[Rig], None]:
    return lambda rig: (
        [rig.receive(mavlink.MAVLink_current_mode_message(0, mode, 0)) for mode in modes] and None
    )


DISARMED = "taken over, vehicle disarmed"
REBOOTED = "taken over, autopilot rebooted"
TAKEOVERS = {
    "another mode": Takeover(stays(mode=LOITER)),
    "return to launch": Takeover(stays(mode=RTL), "taken over, GUIDED left for RTL"),
    "disarmed": Takeover(stays(armed=False), DISARMED, left=False),
    "rebooted": Takeover(reboots, REBOOTED, stays=False, left=False),
    "another mode while coasting": Takeover(stays(mode=LOITER), before=holds),
    "CURRENT_MODE without heartbeats": Takeover(current_modes(LOITER), before=loses_heartbeats),
    "between two steps, another mode": Takeover(
        lambda rig: heartbeats(rig, (LOITER, True), (GUIDED, True)), stays=False
    ),
    "between two steps, CURRENT_MODE": Takeover(current_modes(LOITER, GUIDED), stays=False),
    "between two steps, disarmed": Takeover(
        lambda rig: heartbeats(rig, (GUIDED, False), (GUIDED, True)),
        DISARMED,
        stays=False,
        left=False,
    ),
    "in the buffers of a stall": Takeover(
        stays(mode=LOITER), before=lambda rig: rig.pass_time(2.0)
    ),
    "last in the buffers of a stall": Takeover(backlog, before=lambda rig: rig.pass_time(6.0)),
    "in an outage": Takeover(stays(mode=LOITER), before=outage),
    "in an outage, then returned": Takeover(
        lambda rig: heartbeats(rig, (LOITER, True), (GUIDED, True)), before=outage, stays=False
    ),
    "disarmed in an outage, then armed": Takeover(
        lambda rig: heartbeats(rig, (GUIDED, False), (GUIDED, True)),
        DISARMED,
        before=outage,
        stays=False,
        left=False,
    ),
    "after an outage, before its identity is confirmed": Takeover(
        late_confirmation, before=outage_until_confirmed, stays=False
    ),
    "with a pending mode request": Takeover(stays(mode=LOITER)),
}


def taken(how: str, *, end: bool) -> tuple[Rig, float]:
    """Fly a rig, then take over its vehicle. Return the rig after the step that received the
    takeover, and the time before this step."""
    rig = Rig(
        f"engage.on_takeover={'end' if end else 'wait'}",
        "engage.request_mode=true",
        "exit.action=rtl",
    )
    takeover = TAKEOVERS[how]
    # The acknowledgement of the mode request was lost. Repeating the request would undo the
    # takeover.
    if "pending" in how:
        while not rig.commands(SET_MODE):
            rig.run(0.05, mode=LOITER)
        assert rig.run(0.6, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED
    else:
        rig.engage()
    takeover.before(rig)
    if rig.pilot.mission.phase in (Phase.ENGAGED, Phase.COASTING):
        assert rig.setpoints()
    since = rig.now
    rig.now = round(rig.now + 0.02, 6)
    takeover.take(rig)
    rig.range()
    rig.step()
    return rig, since


@pytest.mark.parametrize("how", TAKEOVERS)
def test_takeover_ends_mission_in_same_step(how):
    """After a takeover the operator controls the vehicle: no setpoint, no safe setpoint, no mode
    request and no exit action is sent."""
    rig, since = taken(how, end=True)
    rig.run(0.3)
    assert rig.pilot.mission.phase is Phase.ENDED
    rig.run(10.0)
    assert rig.setpoints(since) == [] and rig.commands(SET_MODE, since) == []
    text = TAKEOVERS[how].text
    assert f"circnav: {text}" in rig.texts(since)
    outcome = rig.pilot.mission.outcome
    if text in (DISARMED, REBOOTED):
        assert (outcome.ending, outcome.reason) == (Ending.ABORTED, text)
    else:
        reason = rf"pilot or failsafe switched to {text.rpartition(' ')[2]} after \d+ s"
        assert outcome.ending is Ending.TAKEN_OVER and re.fullmatch(reason, outcome.reason)


@pytest.mark.parametrize("how", TAKEOVERS)
def test_takeover_stops_commands_until_guided_mode_is_reentered(how):
    rig, since = taken(how, end=False)
    takeover = TAKEOVERS[how]
    rig.run(0.3)
    assert rig.pilot.mission.phase in {Phase.YIELDED, Phase.READY}
    rig.run(10.0 if takeover.stays else 0.7)
    assert rig.setpoints(since) == [] and rig.commands(SET_MODE, since) == []
    assert f"circnav: {takeover.text}" in rig.texts(since)
    assert rig.pilot.mission.outcome is None
    rig.now_is(speaks=True, ranges=True, armed=True)
    if takeover.stays or not takeover.left:
        rig.run(1.25, mode=GUIDED)
        assert rig.setpoints(since) == [], "the operator's mode switch may only pass through GUIDED"
        rig.run(4.0)
    else:
        rig.run(GIVEN_BACK)
    assert (rig.pilot.mission.phase is Phase.ENGAGED) == takeover.left
    for _ in range(3):  # the operator may take over and return the vehicle repeatedly
        since = rig.run(0.3, mode=LOITER).now
        rig.run(0.7)
        assert rig.setpoints(since) == []
        assert rig.run(GIVEN_BACK, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED


# --- events that are neither a return nor a takeover


@pytest.fixture
def waiting() -> Rig:
    """A flying rig that may request the mode. After a takeover it waits until the vehicle is
    returned."""
    return Rig("engage.request_mode=true", "engage.on_takeover=wait").engage()


NO_HEARTBEATS = {"speaks": False}
LANDED = {"landed_state": ON_GROUND}


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        # without heartbeats, the operator may have selected another mode meanwhile
        (
            [({}, LOITER, 1.0), ({}, GUIDED, 1.0), (NO_HEARTBEATS, GUIDED, 4.0), ({}, GUIDED, 1.0)],
            "operator",
        ),
        ([(LANDED, LAND, 3.0), (LANDED, GUIDED, 3.0)], "the vehicle is on the ground"),
        (
            [({}, LAND, 5.0), ({**LANDED, "armed": False}, LAND, 5.0), (LANDED, GUIDED, 5.0)],
            "on the ground",
        ),
        # returned on the ground; in the air the operator's switch only passes through the guided
        # mode
        (
            [
                (LANDED, LAND, 3.0),
                (LANDED, GUIDED, 3.0),
                ({}, LOITER, 3.0),
                ({}, GUIDED, 1.0),
                ({}, LOITER, 1.0),
            ],
            "operator",
        ),
    ],
    ids=[
        "no heartbeats until the guided mode",
        "on the ground",
        "landed and disarmed",
        "on the ground, then taken over in the air",
    ],
)
def test_no_setpoint_before_confirmed_return(waiting, what, reason):
    since = waiting.run(0.2, mode=what[0][1]).now  # wait for the next heartbeat
    for state, mode, seconds in what:
        waiting.run(
            seconds, mode=mode, **{"speaks": True, "armed": True, "landed_state": IN_AIR, **state}
        )
    assert waiting.setpoints(since) == [] and waiting.commands(SET_MODE, since) == []
    assert reason in waits_for(waiting.pilot, waiting.now)
    assert waiting.run(2.0, mode=GUIDED, landed_state=IN_AIR).pilot.mission.phase is Phase.ENGAGED


@pytest.mark.parametrize("offset", [20, 60, 100, 150, 200, 250])
def test_delayed_heartbeats_of_second_link_do_not_return_control(offset):
    """Over each of two links one heartbeat per second arrives, numbered separately. The second link
    is 1.2 s slower, so it reports GUIDED after the takeover."""
    rig = Rig("engage.on_takeover=wait")
    late = Voice(1, 1)
    for _ in range(offset):
        late.pack(heartbeat(GUIDED))
    began = rig.engage().tick
    left = rig.now + 3.0

    def both_ways() -> None:
        if (rig.tick - began) % 20 == 0:
            rig.receive(heartbeat(LOITER if rig.now >= left else GUIDED))
        if (rig.tick - began) % 20 == 4:
            rig.receive(heartbeat(LOITER if rig.now - 1.2 >= left else GUIDED), voice=late)

    rig.run(10.0, both_ways, speaks=False)
    assert rig.setpoints(left + 0.05) == []
    assert rig.pilot.mission.phase is Phase.YIELDED


def test_current_mode_message_with_mode_0_is_ignored(rig):
    """In CURRENT_MODE, mode 0 means an unset field. It is neither a mode change nor a sign of
    life."""
    nothing = mavlink.MAVLink_current_mode_message(0, 0, 0)
    rig.engage().run(0.5, lambda: rig.receive(nothing))
    assert (rig.pilot.mission.phase, rig.pilot.session.vehicle.mode) == (Phase.ENGAGED, GUIDED)
    assert (
        rig.run(4.0, lambda: rig.receive(nothing), speaks=False).pilot.mission.phase
        is Phase.WAIT_LINK
    )


@pytest.mark.parametrize(
    ("limits", "before", "how", "ends"),
    [
        ("limits.coast_s=10.0", 5.0, {"mode": LOITER}, None),
        ("limits.duration_s=10.0", 0.0, {"mode": LOITER}, Ending.ABORTED),
        ("limits.duration_s=10.0", 0.0, {"speaks": False}, Ending.ABORTED),
    ],
    ids=[
        "outage before takeover",
        "timeout after takeover",
        "timeout without link",
    ],
)
def test_taken_over_mission_never_completes(limits, before, how, ends):
    rig = Rig("engage.on_takeover=wait", limits).engage()
    rig.run(before, speaks=False).run(12.0, **{"speaks": True, **how})
    assert (rig.pilot.mission.outcome and rig.pilot.mission.outcome.ending) is ends


def test_control_can_be_returned_after_link_was_slow(waiting):
    waiting.run(10.0, mode=LOITER, round_trip=0.8)
    assert waiting.run(GIVEN_BACK, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED


def test_replacement_radio_is_accepted_after_takeover(waiting):
    other = Voice(system=77, component=192)
    waiting.run(6.0, mode=LOITER, ranges=False)
    waiting.run(5.0, lambda: waiting.tick % 2 and waiting.range(voice=other), mode=GUIDED)
    assert waiting.pilot.mission.phase is Phase.ENGAGED


# --- any order of events

REPORTS = [(GUIDED, True), (LOITER, True), (GUIDED, False)]
FOREVER = ("limits.duration_s=1e9", "limits.coast_s=3600.0")


class Watched(Rig):
    """A flying rig with an independent witness. In each step the witness determines from the
    vehicle's reports alone if circnav has control."""

    def __init__(self) -> None:
        super().__init__("engage.on_takeover=wait", "engage.request_mode=true", *FOREVER)
        self.ours = True
        self.left = False
        self.proven = True
        self.back_since = self.reported_at = 0.0
        self.received: list[bytes] = []
        self.engage()

    def report(self, mode: int, armed: bool, frame: bytes | None = None) -> None:
        """Receive a heartbeat or repeat an earlier one, which may end circnav's control but not
        begin it."""
        if mode != GUIDED or not armed:
            self.ours = False
            self.left = self.left or mode != GUIDED
            self.back_since = float("inf")
        elif frame is None:
            self.back_since = min(self.back_since, self.now)
            self.ours |= self.left and self.now - self.back_since >= 1.5 - 1e-6
            self.left &= not self.ours
        self.reported_at = self.now
        self.received.append(frame or self.vehicle.pack(heartbeat(mode, armed=armed)))
        self.pilot.receive(self.received[-1], self.now, self.source)

    def heartbeat(self) -> None:
        self.report(self.mode, self.armed)
        self.receive(mavlink.MAVLink_extended_sys_state_message(0, IN_AIR))
        self.proven = True

    def step(self) -> list:
        sent = super().step()
        kinds = [getattr(message, "command", message.get_type()) for message in sent]
        commanded = {"SET_POSITION_TARGET_LOCAL_NED", SET_MODE} & set(kinds)
        fresh = self.proven and self.now - self.reported_at < 3.1
        assert not commanded or (self.ours and fresh)
        return sent


class AnyOrder(RuleBasedStateMachine):
    """Random events of the operator, the link, the computer and other senders."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = Watched()

    @rule(seconds=st.sampled_from([0.25, 0.6, 1.3, 2.0, 4.0]))
    def time_passes(self, seconds: float) -> None:
        self.rig.run(seconds)

    @rule(
        mode=st.sampled_from([GUIDED, LOITER, RTL]),
        armed=st.sampled_from([True, True, True, False]),
    )
    def the_operator_acts(self, mode: int, armed: bool) -> None:
        self.rig.run(0.25, mode=mode, armed=armed)

    @rule(speaks=st.booleans(), ranges=st.booleans())
    def the_link_changes(self, speaks: bool, ranges: bool) -> None:
        self.rig.now_is(speaks=speaks, ranges=ranges)

    @rule(reports=st.lists(st.sampled_from(REPORTS), min_size=1, max_size=3))
    def reports_come_between_two_steps(self, reports: list[tuple[int, bool]]) -> None:
        for report in reports:
            self.rig.report(*report)
        self.rig.run(0.05)

    @rule(
        seconds=st.sampled_from([0.3, 0.7, 5.0]),
        waiting=st.lists(st.sampled_from(REPORTS), max_size=3),
    )
    def the_computer_stalls(self, seconds: float, waiting: list[tuple[int, bool]]) -> None:
        self.rig.pass_time(seconds)
        self.rig.proven &= seconds < 0.5
        for report in waiting:
            self.rig.report(*report)
        self.rig.range()
        self.rig.step()

    @rule(number=st.integers(2, 6))
    def an_earlier_report_comes_again_and_another_sender_has_the_same_ids(
        self, number: int
    ) -> None:
        frame = self.rig.run(0.25, speaks=True).received[-number]
        (again,) = decode(frame)
        self.rig.report(
            again.custom_mode, bool(again.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED), frame
        )
        self.rig.receive(heartbeat(GUIDED), voice=Voice(1, 1), source="elsewhere")
        self.rig.run(0.25)

    def teardown(self) -> None:
        """At the end the operator returns the vehicle, and the pilot must engage again."""
        self.rig.run(3.0, mode=LOITER, armed=True, speaks=True, ranges=True)
        assert self.rig.run(10.0, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED


def test_no_command_without_control_in_any_event_order():
    run_state_machine_as_test(AnyOrder, settings=settings(max_examples=25, stateful_step_count=15))
