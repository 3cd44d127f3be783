"""The link over real sockets on the loopback interface, the format of its frames, and their
place in a recording."""

import socket
import struct
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from math import isnan, nan, nextafter, pi, tau
from operator import attrgetter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.fleet.acceptance import BOUNDS, Rejection, check_numbers
from circnav_mav.extras.fleet.frames import MESSAGE, from_message, to_message
from circnav_mav.extras.fleet.link import (
    MOST_DATAGRAMS,
    MULTICAST,
    FleetLink,
    LocalNetwork,
    MulticastLink,
    Transport,
)
from circnav_mav.extras.fleet.report import State
from circnav_mav.mav.codec import Encoder
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Pilot
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.record import COLUMNS
from circnav_mav.runlog.loop_steps import recorded_steps, tlog_steps
from circnav_mav.runlog.replay import replay, without_timeouts
from circnav_mav.runlog.tlog import read_messages, read_tlog
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.recorder import Recorder
from tests.extras.fleet.reports import KEY, NOON, frame, report

LOOPBACK = "127.0.0.1"
IP_AND_UDP = 28


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def decoded(data: bytes):
    return mavlink.MAVLink(None).decode(bytearray(data))


# --- the format


@pytest.mark.parametrize(("key", "size"), [(None, 80), (KEY, 93)])
def test_fleet_report_is_one_debug_float_array(key, size):
    sent = frame(report(2, NOON), key)
    message = decoded(sent)
    assert len(sent) == size and message.get_type() == "DEBUG_FLOAT_ARRAY"
    assert (
        message.name,
        message.array_id,
        message.get_srcSystem(),
        message.get_srcComponent(),
    ) == ("circfleet1", 0, 2, 191)
    assert 5 * (size + IP_AND_UDP) * 10 < 6100


def _between(name: str) -> st.SearchStrategy:
    return st.floats(*BOUNDS[name], allow_nan=False)


@given(
    stamp=st.floats(0.0, 4e9),
    state=st.sampled_from(State),
    sense=st.sampled_from([1, -1]),
    phase=st.floats(0.0, nextafter(tau, 0.0)),
    numbers=st.tuples(
        *map(
            _between, ("phase_sigma", "lap_period", "radius", "height", "drift east", "drift north")
        )
    ),
    variances=st.tuples(_between("drift variance east"), _between("drift variance north")),
    correlation=st.floats(-1.0, 1.0),
)
def test_report_fields_are_preserved_in_frame(
    stamp, state, sense, phase, numbers, variances, correlation
):
    """Encoding keeps stamps to 1 us, phases to 1 urad and other values to 7 digits. A phase stays
    below a full circle, and other values stay within their bounds."""
    sigma, lap, radius, height, east, north = numbers
    ee, nn = variances
    one = report(
        7,
        stamp,
        state=state,
        sense=sense,
        phase=phase,
        phase_sigma=sigma,
        lap_period=lap,
        radius=radius,
        height=height,
        drift=(east, north),
        drift_covariance=(ee, correlation * (ee * nn) ** 0.5, nn),
    )
    back = from_message(decoded(Encoder(7, 191).encode(to_message(one))))
    assert (back.member, back.state, back.sense) == (7, state, sense)
    assert back.stamp == pytest.approx(stamp, abs=1e-6)
    assert 0 <= back.phase < tau and abs((back.phase - phase + pi) % tau - pi) < 1e-6
    for was, now in zip(
        numbers,
        (back.phase_sigma, back.lap_period, back.radius, back.height, *back.drift),
        strict=True,
    ):
        assert now == pytest.approx(was, rel=1e-7, abs=1e-30)
    assert back.drift_covariance == pytest.approx(one.drift_covariance, rel=1e-7, abs=1e-30)
    check_numbers(back)


def test_unknown_height_in_report_stays_unknown():
    assert isnan(from_message(decoded(frame(report(2, NOON, height=nan)))).height)


# --- sockets


@pytest.mark.parametrize("key", [None, KEY], ids=["unsigned", "signed"])
@pytest.mark.parametrize("way", ["multicast", "peers"])
def test_members_receive_reports_of_others_but_not_own(way, key):
    ports = [free_port() for _ in range(3)]
    if way == "multicast":
        sockets = [Transport(ports[0], LOOPBACK) for _ in ports]
    else:
        peers = [tuple(f"{LOOPBACK}:{port}" for port in ports if port != own) for own in ports]
        sockets = [Transport(own, peers=others) for own, others in zip(ports, peers, strict=True)]
    members = [FleetLink(opened, ident, key) for ident, opened in enumerate(sockets, 1)]
    received = []
    for ident, member in enumerate(members, 1):
        member.send(report(ident, NOON))
    for member in members:
        received.append([one.member for one in member.received(NOON)])
    assert received == [[2, 3], [1, 3], [1, 2]]
    for member in members:
        assert (
            not member.alarms(NOON)
            and not member.summary()["rejected"]
            and len(member.take_frames()) == 3
        )
        member.close()
        member.send(report(1, NOON + 1))
        assert member.received(NOON + 1) == []


def test_multicast_stays_in_local_network():
    member = FleetLink(Transport(free_port(), LOOPBACK), 1)
    opened = member._transport._link._socket
    assert opened.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 1
    member.close()


@pytest.mark.parametrize("start", [0.0, NOON])
def test_link_sends_reports_at_5_hz(start):
    network = LocalNetwork()
    sender, receiver = (FleetLink(network.port(one), one, KEY) for one in (1, 2))
    stamps = []
    for step in range(200):  # 10 s of a loop at 20 Hz
        sender.send(report(1, start + 0.05 * step))
        stamps += [one.stamp for one in receiver.received(start + 0.05 * step)]
    assert (
        stamps == pytest.approx([start + 0.2 * n for n in range(50)])
        and not receiver.acceptance.rejected
    )


def test_link_sends_only_valid_own_reports():
    network = LocalNetwork()
    sender, receiver = (FleetLink(network.port(one), one) for one in (1, 2))
    for wrong in (
        {"phase": nan},
        {"radius": 1e9},
        {"drift": (nan, 0.0)},
    ):
        sender.send(replace(report(1, NOON + 20), **wrong))
        assert (
            receiver.received(NOON + 20) == []
            and "reports are not sent" in sender.alarms(NOON + 20)[0]
        )
    sender.send(report(1, NOON - 3600))
    sender.send(report(1, NOON - 7200))
    assert sender.sent == 2


@pytest.mark.parametrize("interface", ["absent0", "10.99.99.99"])
def test_fleet_link_works_after_missing_network_appears(interface, monkeypatch):
    """A network radio is connected after the start. The link then sends and receives reports
    without a restart."""
    port = free_port()
    member = FleetLink(Transport(port, interface), 1)
    for step in range(20):
        member.send(report(1, NOON + 0.2 * step))
        assert member.received(NOON + 0.2 * step) == []
    (alarm,) = member.alarms(NOON + 4)
    assert interface in alarm and member.sent == 0
    member._transport._open = partial(
        MulticastLink, port, LOOPBACK
    )  # the network interface appears
    other = FleetLink(Transport(port, LOOPBACK), 2)
    for step in range(40, 60):
        member.send(report(1, NOON + 0.2 * step))
        other.received(NOON + 0.2 * step)
    assert other.acceptance.accepted >= 9 and not member.alarms(NOON + 20)
    member.close()
    other.close()


@pytest.fixture
def members():
    """Two members on one multicast port."""
    port = free_port()
    with ExitStack() as opened:
        yield [
            opened.enter_context(closing(FleetLink(Transport(port, LOOPBACK), one)))
            for one in (1, 2)
        ]


def accepted_steps(members):
    """Let the members exchange reports for 10 s. Return the steps in which the first member
    received a report."""
    accepted = []
    for step in range(50):
        now = NOON + 0.2 * step
        for ident, member in enumerate(members, 1):
            member.send(report(ident, now))
        accepted += [step for _ in members[0].received(now)]
        members[1].received(now)
    return accepted


def test_link_reopens_failed_socket(members):
    members[0]._transport._link._socket.close()  # every later call on this socket raises an error
    accepted = accepted_steps(members)
    assert members[0].sent >= 35 and len(accepted) >= 35 and not members[0].alarms(NOON + 10)


def test_lost_multicast_membership_is_renewed(members):
    """A network radio was disconnected and connected again. Without a renewal, the socket sends but
    receives nothing."""
    membership = socket.inet_aton(MULTICAST) + socket.inet_aton(LOOPBACK)
    members[0]._transport._link._socket.setsockopt(
        socket.IPPROTO_IP, socket.IP_DROP_MEMBERSHIP, membership
    )
    accepted = accepted_steps(members)
    assert 25 <= accepted[0] <= 30 and accepted[-1] == 49


def test_flood_of_datagrams_costs_bounded_step_time(members):
    """Each member receives 1000 random datagrams on the loopback interface, of which the socket
    buffer keeps a part."""
    port = members[0]._transport._link.port
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        attacker.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
        for n in range(1000):
            attacker.sendto(struct.pack(">I", n) * 20, (MULTICAST, port))
    steps = 0
    while (before := members[0].acceptance.rejected[Rejection.MALFORMED]) >= 0:
        members[0].received(NOON)
        taken = members[0].acceptance.rejected[Rejection.MALFORMED] - before
        assert taken <= MOST_DATAGRAMS
        steps += 1
        if not taken:
            break
    assert 2 <= steps < 20 and any("flood" in one for one in members[0].alarms(NOON))
    members[1].send(report(2, NOON))
    assert [one.member for one in members[0].received(NOON)] == [2]


@pytest.mark.parametrize(
    ("peers", "words"),
    [
        (["10.0.0.2"], "'10.0.0.2': write HOST:PORT"),
        (["[::1]:14560", "10.0.0.2:14560"], "use either IPv4 or IPv6 for all of them"),
    ],
)
def test_impossible_peers_are_refused(peers, words):
    with pytest.raises(LinkError, match=words) as refused:
        Transport(peers=peers)
    assert "\n" not in str(refused.value)


# --- the recording


def test_recorded_fleet_reports_are_read_back(tmp_path):
    """The recording contains the reports between the frames of the vehicle's link, and does not
    change these frames."""
    network = LocalNetwork()
    members = [FleetLink(network.port(one), one, KEY) for one in (1, 2)]
    recorder = Recorder(tmp_path / "run", "")
    recorder.start(round(NOON * 1e6), at_once=True)
    steps = []
    for n in range(9):
        attitude = Encoder(1, 1).encode(mavlink.MAVLink_attitude_message(n, 0, 0, 0, 0, 0, 0))
        for ident, member in enumerate(members, 1):
            member.send(report(ident, NOON + n))
        assert members[0].received(NOON + n)
        steps.append(
            LoopStep(float(n), [("vehicle", "v0", [attitude])], exchanged=members[0].take_frames())
        )
        recorder.step(steps[-1])
    recorder.close()
    assert recorder.problem is None
    back = list(recorded_steps(recorder.folder))
    assert [one.received_frames for one in back] == [one.received_frames for one in steps]
    assert [one.exchanged for one in back] == [one.exchanged for one in steps] and len(back) == 9
    read = [
        (at, from_message(one))
        for at, one in read_messages(recorder.folder / "flight.tlog", {MESSAGE})
    ]
    assert [(at / 1e6, one.member, one.stamp) for at, one in read] == [
        (NOON + n, m, NOON + n) for n in range(9) for m in (1, 2)
    ]


def test_fleet_reports_do_not_change_replay(flown, tmp_path):
    """The reports also use the ids of the vehicle and of its radio. The replayed pilot must not
    treat a report as a message of vehicle or radio."""
    plain = flown / "flight.tlog"
    mixed = tmp_path / "mixed.tlog"
    with mixed.open("wb") as out:
        for n, (stamp, one) in enumerate(read_tlog(plain)):
            out.write(struct.pack(">Q", stamp) + one)
            # A plain tlog is replayed by the stamps of received frames: add reports only there.
            if one[6] == 191 or n % 10:
                continue
            for ids in ((1, 1), (1, 192), (1, 191), (7, 191), (255, 190)):
                out.write(
                    struct.pack(">Q", stamp)
                    + Encoder(*ids).encode(to_message(report(ids[0], stamp / 1e6)))
                )
    settings = without_timeouts(load_mission(flown / "mission.toml"))
    done = [replay(Pilot(settings), tlog_steps(log, 191), ticking=True) for log in (plain, mixed)]
    assert done[1].frames > done[0].frames and done[0].setpoints
    assert done[0].sent == done[1].sent
    rows = [[attrgetter(*COLUMNS)(tick) for tick in one.ticks] for one in done]
    assert rows[0] == rows[1]
