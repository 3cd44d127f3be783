"""Attacks on the fleet link, one row each: the attacker's frames, and the victim's reaction.

Member 1 is the victim. Member 2 is honest and sends at 5 Hz for 10 s. The attacker reads everything
on the link and sends from another address, or from the address of member 2. In every row the honest
member is still received, and no false report under its id is accepted. The work and memory of the
victim are bounded.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, nan, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.fleet.acceptance import MOST_MEMBERS, Rejection, check_numbers
from circnav_mav.extras.fleet.frames import COMPONENT, to_message
from circnav_mav.extras.fleet.link import MOST_DATAGRAMS, FleetLink
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.mav.codec import Encoder
from tests.extras.fleet.reports import KEY, NOON, OTHER_KEY, frame, report

STEP = 0.05
LASTS = 10.0
STRANGER = ("10.0.0.66", 14560)
HONEST = ("10.0.0.2", 14560)
WITH_KEY = KEY
WITHOUT = None


@dataclass
class Air:
    """Data available to the attacker. captured: datagrams of member 2. key: the fleet's signing
    key; None if the fleet does not sign."""

    now: float = NOON
    key: bytes | None = None
    captured: list[bytes] = field(default_factory=list)
    victim: list[bytes] = field(default_factory=list)
    """Frames that the victim sent."""

    def since(self) -> float:
        return self.now - NOON


Attack = Callable[[Air], list[bytes]]


def sends_report(member: int, *, key: bytes | None = None, **changes) -> Attack:
    """Return an attack: a report with these changes at every step of 0.2 s."""

    def attack(air: Air) -> list[bytes]:
        if round(air.since() / STEP) % 4 != 1:
            return []
        stamp = air.now + changes.get("late", 0.0)
        one = report(
            member, stamp, **{name: value for name, value in changes.items() if name != "late"}
        )
        return [frame(one, key or air.key)]

    return attack


def patched(index: int, value: float) -> Attack:
    """Return an attack: a report of a new member in which a 32-bit number is replaced by a value
    that no honest encoder sends."""

    def attack(air: Air) -> list[bytes]:
        message = to_message(report(9, air.now))
        message.data[index] = value
        return [Encoder(9, COMPONENT).encode(message)]

    return attack


def half(air: Air) -> list[bytes]:
    return [one[: len(one) // 2] for one in air.captured[-1:]]


def changed(air: Air) -> list[bytes]:
    """Return member 2's newest frame with another phase, a right CRC, and the old signature."""
    return [
        frame(report(2, air.now, phase=0.1), OTHER_KEY)[:-13] + one[-13:]
        for one in air.captured[-1:]
    ]


def replayed(delay: float) -> Attack:
    """Return an attack: frames of member 2 that were captured some time ago."""
    return lambda air: (
        air.captured[-1 - round(delay * 5) :][:1] if len(air.captured) > delay * 5 else []
    )


def two_in_one(air: Air) -> list[bytes]:
    return [air.captured[-1] + frame(report(9, air.now))] if air.captured else []


def ghosts(air: Air) -> list[bytes]:
    """A report of a new member id at every step."""
    return [frame(report(3 + round(air.since() / STEP) % 250, air.now), air.key)]


def flood(air: Air) -> list[bytes]:
    return [bytes([n % 256]) * 200 for n in range(3 * MOST_DATAGRAMS)]


def heartbeat(air: Air) -> list[bytes]:
    return [Encoder(1, 1).encode(mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3))]


def takeover(air: Air) -> list[bytes]:
    """A command to the autopilot, which the fleet link must not pass on."""
    return [
        Encoder(255, 190).encode(
            mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
        )
    ]


def other_version(air: Air) -> list[bytes]:
    message = to_message(report(9, air.now))
    newer = mavlink.MAVLink_debug_float_array_message(
        message.time_usec, b"circfleet2", 0, message.data
    )
    return [Encoder(9, COMPONENT).encode(newer)]


def wandering(air: Air) -> list[bytes]:
    """Reports of an invented member with a phase that jumps by half a circle each time."""
    step = round(air.since() / STEP)
    return [frame(report(9, air.now, phase=pi * (step // 4 % 2)), air.key)] if step % 4 == 1 else []


def hasty(air: Air) -> list[bytes]:
    return [frame(report(9, air.now), air.key)]


R = Rejection


@dataclass(frozen=True)
class Row:
    """An attack, with the expected rejection reason and alarm. key: the fleet's signing key.
    address: the attacker's address. ghosts: number of invented members that are accepted, because
    only a key could stop them. share: smallest share of the
    honest reports that must be received. beside: other expected rejection reasons."""

    name: str
    attack: Attack
    reason: Rejection | None
    alarm: str
    key: bytes | None = WITHOUT
    address: tuple = STRANGER
    ghosts: int = 0
    share: float = 1.0
    beside: frozenset = frozenset()


ROWS = [
    Row(
        "noise",
        lambda air: [b"\xfd" * 90, b"", b"GET / HTTP/1.1\r\n\r\n"],
        R.MALFORMED,
        "not complete",
    ),
    Row("half a frame", half, R.MALFORMED, "not complete"),
    Row("two frames in one datagram", two_in_one, R.MALFORMED, "not complete"),
    Row("a datagram of 60 kB", lambda air: [bytes(60_000)], R.MALFORMED, "not complete"),
    Row("heartbeat of an autopilot", heartbeat, R.OTHER_MESSAGE, ""),
    Row("command to an autopilot", takeover, R.OTHER_MESSAGE, ""),
    Row("another version of the format", other_version, R.OTHER_MESSAGE, ""),
    Row(
        "unsigned where a key is",
        lambda air: [frame(report(9, air.now))],
        R.UNSIGNED,
        "not signed",
        WITH_KEY,
    ),
    Row(
        "signed with another key",
        sends_report(2, key=OTHER_KEY),
        R.WRONG_KEY,
        "another key",
        WITH_KEY,
        HONEST,
    ),
    Row("changed on the way", changed, R.WRONG_KEY, "another key", WITH_KEY, HONEST),
    Row("replayed after 1 s", replayed(1.0), R.REPLAYED, "repeated or late"),
    Row("replayed after 1 s, with a key", replayed(1.0), R.REPLAYED, "repeated or late", WITH_KEY),
    Row("replayed at once from another address", replayed(0.0), None, "", WITH_KEY),
    Row(
        "own frames replayed after 1 s",
        lambda air: air.victim[-6:-5],
        R.REPLAYED,
        "repeated or late",
        WITH_KEY,
    ),
    Row("this member's id", sends_report(1), R.SAME_ID, "another sender has this member's id 1"),
    Row(
        "this member's id by a member with the key",
        sends_report(1),
        R.SAME_ID,
        "has this member's id 1",
        WITH_KEY,
    ),
    Row(
        "the id of another, from a second address",
        sends_report(2, phase=0.1),
        R.SAME_ID,
        "10.0.0.66:14560",
    ),
    Row("a phase that is not a number", patched(2, nan), R.NOT_FINITE, "phase nan"),
    Row("an infinite drift", patched(6, inf), R.NOT_FINITE, "drift east inf"),
    Row("a radius of 1e30 m", patched(5, 1e30), R.OUT_OF_BOUNDS, "radius 1e+30"),
    Row("a lap of 0 s", patched(4, 0.0), R.OUT_OF_BOUNDS, "lap_period 0"),
    Row("a drift covariance that is none", patched(9, 5.0), R.OUT_OF_BOUNDS, "drift covariance 5"),
    Row("a certainty of 0 rad", patched(3, 0.0), R.OUT_OF_BOUNDS, "phase_sigma 0"),
    Row("a state that does not exist", patched(0, 7.5), R.OUT_OF_BOUNDS, "state 7.5"),
    Row("a sense that does not exist", patched(1, 0.0), R.OUT_OF_BOUNDS, "sense 0"),
    Row("id 0", sends_report(0), R.OUT_OF_BOUNDS, "id 0"),
    Row("a stamp ahead", sends_report(9, late=1.2), R.CLOCKS_DISAGREE, "id 9 is 1.2 s ahead"),
    Row("a stamp behind", sends_report(9, late=-30.0), R.CLOCKS_DISAGREE, "id 9 is 30.0 s behind"),
    Row(
        "a jump of another's phase, its address forged",
        sends_report(2, phase=0.1, late=0.07),
        R.PHASE_JUMP,
        "id 2",
        None,
        HONEST,
    ),
    Row("a phase that jumps to and fro", wandering, R.PHASE_JUMP, "by 1", WITH_KEY, ghosts=1),
    Row("20 reports a second", hasty, R.TOO_OFTEN, "id 9", WITH_KEY, ghosts=1),
    Row("a new member at every step", ghosts, R.TABLE_FULL, "32 members", ghosts=MOST_MEMBERS - 1),
    Row("a flood of noise", flood, R.FLOOD, "flood", share=0.4, beside=frozenset({R.MALFORMED})),
]


class _Port:
    """The victim's socket: returns the datagrams of the test."""

    problems = ()

    def __init__(self) -> None:
        self.queue = []
        self.sent = []

    def send(self, data: bytes, now: float) -> bool:
        self.sent.append(data)
        return True

    def receive(self, now: float) -> list:
        taken = self.queue
        self.queue = []
        return taken

    def close(self) -> None: ...


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_attack_is_rejected_with_alarm(row):
    port = _Port()
    victim = FleetLink(port, 1, row.key)
    honest = FleetLink(honest_port := _Port(), 2, row.key)
    air = Air(key=row.key, captured=honest_port.sent, victim=port.sent)
    received: list[MemberReport] = []
    alarms: set[str] = set()
    for step in range(round(LASTS / STEP)):
        air.now = now = NOON + step * STEP
        before = len(air.captured)
        victim.send(report(1, now))
        honest.send(report(2, now))
        fresh = [(one, HONEST) for one in air.captured[before:]]
        attack = [(one, row.address) for one in row.attack(air)]
        port.queue = attack + fresh if step % 2 else fresh + attack
        received += victim.received(now)
        alarms |= set(victim.alarms(now))

    of_honest = [one for one in received if one.member == 2]
    assert len(air.captured) == 50 and len(of_honest) >= row.share * 50
    for one in of_honest:
        assert abs(one.phase - report(2, one.stamp).phase) < 1e-5
    assert len({one.member for one in received} - {2}) == row.ghosts
    counts = victim.acceptance.rejected
    assert set(counts) - {row.reason} == row.beside
    assert row.reason is None or counts[row.reason] >= 3
    assert any(row.alarm in one for one in alarms) if row.alarm else not alarms
    assert victim.alarms(now + 10) == []
    assert (
        len(victim.acceptance.members) <= MOST_MEMBERS
        and len(victim.take_frames()) == len(received) + 50
    )


@given(
    system=st.integers(0, 255),
    stamp=st.one_of(st.integers(0, 2**64 - 1), st.just(round(NOON * 1e6))),
    name=st.one_of(st.binary(min_size=10, max_size=10), st.just(b"circfleet1")),
    array=st.integers(0, 2**16 - 1),
    numbers=st.lists(st.floats(width=32), min_size=12, max_size=12),
    cut=st.integers(0, 100),
)
def test_random_frame_is_rejected_or_has_values_within_bounds(
    system, stamp, name, array, numbers, cut
):
    victim = FleetLink(port := _Port(), 1)
    message = mavlink.MAVLink_debug_float_array_message(stamp, name, array, [*numbers, *[0.0] * 46])
    port.queue = [
        (Encoder(system, COMPONENT).encode(message)[: cut if cut < 80 else None], STRANGER)
    ]
    for one in victim.received(NOON):
        check_numbers(one)
    assert victim.acceptance.accepted + sum(victim.acceptance.rejected.values()) == 1


def test_phase_jump_is_accepted_after_two_seconds_of_reports():
    """The member's estimate jumps, and its reports continue from the new phase. Until they are
    accepted, the victim extrapolates the last accepted report."""
    victim = FleetLink(port := _Port(), 1)
    accepted = []
    for step in range(60):
        now = NOON + 0.2 * step
        one = (
            report(2, now)
            if step < 20
            else replace(report(2, now), phase=(report(2, now).phase + pi) % (2 * pi))
        )
        port.queue = [(frame(one), HONEST)]
        accepted += [step for _ in victim.received(now)]
    assert accepted == [*range(20), *range(30, 60)]
    assert victim.acceptance.rejected[R.PHASE_JUMP] == 10


def test_phase_jump_after_search_is_accepted_at_once():
    victim = FleetLink(port := _Port(), 1)
    states = [State.ON_CIRCLE, State.SEARCH, State.ON_CIRCLE]
    for step, (state, phase) in enumerate(zip(states, (0.0, 0.0, 3.0), strict=True)):
        port.queue = [(frame(report(2, NOON + step, state=state, phase=phase)), HONEST)]
        assert victim.received(NOON + step)
    assert not victim.acceptance.rejected


def test_member_may_change_address_after_silence():
    victim = FleetLink(port := _Port(), 1)
    for after, address, members in ((0.0, HONEST, 1), (2.0, STRANGER, 1), (70.0, HONEST, 1)):
        port.queue = [(frame(report(2 if after < 60 else 5, NOON + after)), address)]
        assert len(victim.received(NOON + after)) == 1 and len(victim.acceptance.members) == members
    assert not victim.acceptance.rejected


@pytest.mark.parametrize("wrong_by", [3600.0, 30.0])
def test_member_is_accepted_after_its_clock_is_corrected(wrong_by):
    """Tested in both directions. An attacker repeats the frames with future timestamps when these
    times are reached. The victim rejects them."""
    wrong, right = (FleetLink(_Port(), member, bytes(range(32))) for member in (1, 2))
    ports = wrong._transport, right._transport
    captured = []
    accepted = {1: [], 2: []}
    for step in range(100):
        now = NOON + 0.2 * step
        error = wrong_by if step < 50 else 0.0
        wrong.send(report(1, now + error))
        right.send(report(2, now))
        captured += [(one, HONEST) for one in ports[0].sent if error]
        ports[0].queue = [(one, STRANGER) for one in ports[1].sent]
        ports[1].queue = [(one, HONEST) for one in ports[0].sent]
        accepted[1] += [step for _ in wrong.received(now + error)]
        accepted[2] += [step for _ in right.received(now)]
        for port in ports:
            port.sent.clear()
    assert accepted == {1: [*range(50, 100)], 2: [*range(50, 100)]}
    for step, datagram in enumerate(captured):
        ports[1].queue = [datagram]
        assert not right.received(NOON + wrong_by + 0.2 * step)
    assert len(captured) == right.acceptance.rejected[R.REPLAYED] == 50


def test_member_is_accepted_after_restart_with_corrected_clock():
    victim = FleetLink(port := _Port(), 1, KEY)
    for stamp, accepted in ((NOON + 30.0, 0), (NOON + 1.0, 1)):
        member = FleetLink(sender := _Port(), 2, KEY)
        member.send(report(2, stamp))
        port.queue = [(sender.sent[0], HONEST)]
        assert len(victim.received(NOON + 1.0)) == accepted


def test_other_members_are_accepted_after_own_clock_is_corrected():
    victim = FleetLink(port := _Port(), 1, KEY)
    for stamp in (NOON + 20.0, NOON, NOON + 0.2):
        port.queue = [(frame(report(2, stamp), KEY), HONEST)]
        assert victim.received(stamp)
