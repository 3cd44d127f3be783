"""UDP, TCP and serial links over real kernel objects: loopback sockets and a pseudo terminal."""

import os
import pty
import select
import socket
import subprocess
import termios
from contextlib import closing
from unittest.mock import Mock

import pytest

from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.links import LONGEST, MOST_BYTES, MOST_DATAGRAMS, open_link, user_of
from tests.process import PATIENCE

UDP = (socket.AF_INET, socket.SOCK_DGRAM)


def received(link, now=0.0):
    """Wait until the link's descriptor is readable. Return the received data with their source."""
    select.select([link.fileno()], [], [], PATIENCE)
    return link.receive(now)


def receive(link, now=0.0):
    return [data for data, _ in received(link, now)]


def portions(link):
    """Return the data waiting at a link, one list for each call of `receive`."""
    found = []
    while portion := link.receive(0.0):
        found.append([data for data, _ in portion])
    return found


def opened(request, text):
    """Open a link that is closed after the test."""
    link = open_link(text)
    request.addfinalizer(link.close)
    return link


@pytest.fixture
def udp():
    with closing(socket.socket(*UDP)) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(PATIENCE)
        yield peer


@pytest.fixture
def udpin(request, udp):
    """A link on a local port, with `udp` connected to it."""
    link = opened(request, "udpin:127.0.0.1:0")
    udp.connect(("127.0.0.1", link.port))
    return link


@pytest.fixture
def udpout(request, udp):
    return opened(request, f"udpout:127.0.0.1:{udp.getsockname()[1]}")


@pytest.fixture
def server(port):
    """A server on a port that stays reserved after the server has closed."""
    with closing(socket.create_server(("127.0.0.1", port))) as listening:
        listening.settimeout(PATIENCE)
        yield listening


@pytest.fixture
def tcp(request, server):
    return opened(request, f"tcp:localhost:{server.getsockname()[1]}")


# --- UDP


BOTH_VERSIONS = pytest.mark.parametrize("host", ["127.0.0.1", "[::1]"])


@BOTH_VERSIONS
def test_udp_link_transfers_bytes_in_both_directions(request, host):
    link = opened(request, f"udpin:{host}:0")
    there = opened(request, f"udpout:{host}:{link.port}")
    link.send(b"lost", None)
    there.send(b"one", None)
    ((data, source),) = received(link)
    link.send(b"answer", source)
    assert (data, source[1]) == (b"one", there.port)
    assert receive(there) == [b"answer"]
    assert link.troubles.total() == 0


def test_udp_flood_is_read_in_portions_without_loss(udp, udpin):
    for _ in range(MOST_DATAGRAMS + 100):
        udp.send(b"x")
    assert [len(portion) for portion in portions(udpin)] == [MOST_DATAGRAMS, 100]
    sent = [bytes([i]) * 1400 for i in range(100)]
    for data in sent:
        udp.send(data)
    taken = portions(udpin)
    assert [data for portion in taken for data in portion] == sent
    assert max(sum(map(len, portion)) for portion in taken) < MOST_BYTES + 1400
    assert len(taken) == 5


def test_flooded_udp_socket_keeps_short_queue(udp, udpin):
    """In a flood frames are lost with any queue length. A long queue would also delay every frame,
    including a takeover."""
    for _ in range(3000):
        udp.send(bytes(1400))
    assert sum(len(data) for portion in portions(udpin) for data in portion) < 400_000


@pytest.mark.parametrize(
    ("host", "peers", "received"),
    [
        ("127.0.0.1", ["127.0.0.1"], True),
        ("127.0.0.1", ["10.0.0.5", "127.0.0.0/8"], True),
        ("127.0.0.1", ["10.0.0.5", "127.0.0.2", "fe80::/10"], False),
        ("[::1]", ["::1"], True),
        ("[::1]", ["::2", "127.0.0.1"], False),
        ("[::]", ["127.0.0.1"], True),  # an IPv4 peer on a socket for IPv4 and IPv6
    ],
)
def test_udpin_accepts_only_addresses_of_the_mission(host, peers, received):
    family, to = (socket.AF_INET6, "::1") if host == "[::1]" else (socket.AF_INET, "127.0.0.1")
    with (
        closing(open_link(f"udpin:{host}:0", peers)) as link,
        closing(socket.socket(family, UDP[1])) as other,
    ):
        other.sendto(b"hello", (to, link.port))
        assert receive(link) == [b"hello"] * received
        assert list(link.troubles) == (
            [] if received else [f"ignored: from {host}:{other.getsockname()[1]}"]
        )


def test_udpout_receives_only_from_its_address(udp, udpout):
    """Another vehicle may still send to the fixed local port of the link. If its frames were
    accepted, one vehicle would be received and another one commanded. A second link uses another
    local port, because the fixed port is taken."""
    udpout.send(b"again", ("127.0.0.1", 9))
    assert udp.recv(100) == b"again"
    with closing(open_link(f"udpout:127.0.0.1:{udp.getsockname()[1]}")) as second:
        assert second.port != udpout.port
    with closing(socket.socket(*UDP)) as other:
        for _ in range(MOST_DATAGRAMS):
            other.sendto(b"stranger", ("127.0.0.1", udpout.port))
        udp.sendto(b"ours", ("127.0.0.1", udpout.port))
        assert receive(udpout) == []
        assert udpout.receive(0.0) == [(b"ours", udp.getsockname())]
        assert udpout.troubles == {
            f"ignored: from 127.0.0.1:{other.getsockname()[1]}": MOST_DATAGRAMS
        }


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.1.1", "localhost"])
def test_udpout_accepts_replies_from_any_local_address(host):
    """The vehicle's answers have the source 127.0.0.1, for each of these host names."""
    with closing(socket.socket(*UDP)) as vehicle:
        vehicle.bind(("0.0.0.0", 0))
        vehicle.settimeout(PATIENCE)
        with closing(open_link(f"udpout:{host}:{vehicle.getsockname()[1]}")) as link:
            link.send(b"hello", None)
            vehicle.sendto(b"answer", vehicle.recvfrom(100)[1])
            assert receive(link) == [b"answer"]


def test_many_unknown_udp_senders_are_summarized(udpout):
    for _ in range(20):
        with closing(socket.socket(*UDP)) as other:
            other.sendto(b"stranger", ("127.0.0.1", udpout.port))
    while udpout.troubles.total() < 20:
        assert receive(udpout) == []
    assert len(udpout.troubles) <= 5


def test_udp_link_continues_when_peer_returns_after_refusal(request, port):
    """After ICMP "port unreachable" the socket raises an error, which must not end the link."""
    link = opened(request, f"udpout:127.0.0.1:{port}")
    for _ in range(3):
        link.send(b"hello?", None)
        assert link.receive(0.0) == []
    with closing(socket.socket(*UDP)) as back:
        back.bind(("127.0.0.1", port))
        back.settimeout(PATIENCE)
        link.send(b"there", None)
        assert back.recv(100) == b"there"


def test_oversized_datagrams_and_unreachable_networks_are_counted(udp, udpin):
    for size in (LONGEST + 1, 65_000, LONGEST):
        udp.send(bytes(size))
    assert list(map(len, receive(udpin))) == [LONGEST]
    assert udpin.troubles.total() == 2
    udpin.send(b"x", ("240.0.0.1", 1))
    udpin.send(b"x" * 70_000, udp.getsockname())
    assert udpin.troubles.total() >= 3


# --- TCP


@BOTH_VERSIONS
def test_tcp_link_transfers_bytes_in_both_directions(request, host):
    family = socket.AF_INET6 if host == "[::1]" else socket.AF_INET
    with closing(socket.create_server((host.strip("[]"), 0), family=family)) as server:
        link = opened(request, f"tcp:{host}:{server.getsockname()[1]}")
        with closing(server.accept()[0]) as there:
            there.sendall(b"hello")
            assert received(link) == [(b"hello", server.getsockname())]
            link.send(b"answer", server.getsockname())
            assert there.recv(100) == b"answer"
            assert link.receive(0.0) == []
        link.close()


LINGER = {"its end": bytes(8), "a reset": b"\x01" + bytes(7)}


@pytest.mark.parametrize("end", LINGER)
def test_tcp_link_reconnects_after_one_second(server, tcp, monkeypatch, end):
    """The host name is not resolved again, because a failed name server would delay the loop."""
    monkeypatch.delattr(socket, "getaddrinfo")
    there = server.accept()[0]
    now = 10.0
    before = len(os.listdir("/proc/self/fd"))
    for flap in range(20):
        there.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER[end])
        there.close()
        assert receive(tcp, now) == []
        assert (tcp.fileno(), tcp.troubles.total()) == (None, flap + 1)
        tcp.send(b"lost", None)
        assert tcp.receive(now + 0.9) == []
        assert tcp.fileno() is None
        now += 1.0
        tcp.receive(now)
        with socket.socket(fileno=os.dup(tcp.fileno())) as twin:
            assert twin.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        there = server.accept()[0]
        there.sendall(b"%d" % flap)
        assert receive(tcp, now) == [b"%d" % flap]
        tcp.send(b"answer", None)
        assert there.recv(100) == b"answer"
    assert len(os.listdir("/proc/self/fd")) == before
    there.close()


def test_unreachable_tcp_server_does_not_block_loop(server, tcp):
    """A thousand calls of `receive` between two retries make one attempt to connect. Meanwhile the
    link has no descriptor for `select`."""
    server.accept()[0].close()
    assert receive(tcp) == []
    server.close()
    attempts = 0
    for i in range(1000):
        tcp.receive(i / 100)
        attempts += tcp.fileno() is not None
        if tcp.fileno() is not None:
            assert receive(tcp, i / 100) == []
    assert 8 <= attempts <= 10
    assert tcp.troubles.total() == attempts + 1


def test_blocked_tcp_peer_does_not_delay_loop(server, tcp):
    """If the send buffer is full, bytes are dropped. If the peer acknowledges nothing, Linux ends
    the connection after the timeout of the socket."""
    with socket.socket(fileno=os.dup(tcp.fileno())) as twin:
        assert twin.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 3000
    with closing(server.accept()[0]):
        for _ in range(200):
            tcp.send(b"x" * 65536, None)
        assert tcp.troubles["TX buffer full: lower stream rates or raise the baud rate"] > 0


# --- serial


class Line:
    """A pseudo terminal as serial device that can be disconnected. It has a fixed name, as from
    udev, because its pty number may be reused by another terminal."""

    def __init__(self, name):
        pytest.importorskip("serial")
        self.name = name
        self.plug()

    def plug(self):
        self.master, self._slave = pty.openpty()
        self.name.symlink_to(os.ttyname(self._slave))

    def unplug(self):
        os.close(self._slave)
        os.close(self.master)
        self.name.unlink()


@pytest.fixture
def line(tmp_path):
    made = Line(tmp_path / "tty")
    yield made
    made.unplug()


@pytest.fixture
def serial(request, line):
    return opened(request, f"serial:{line.name}:57600")


def test_serial_link_transfers_bytes_in_both_directions(line, serial):
    os.write(line.master, b"\xfd\x00hello")
    assert received(serial) == [(b"\xfd\x00hello", str(line.name))]
    serial.send(b"\x00answer\n", None)
    assert os.read(line.master, 100) == b"\x00answer\n"
    assert serial.receive(0.0) == []


def test_serial_device_reconnects_within_two_seconds(line, serial):
    before = len(os.listdir("/proc/self/fd"))
    now = 0.0
    for flap in range(20):
        line.unplug()
        assert receive(serial, now) == []
        assert serial.fileno() is None
        serial.receive(now + 0.5)
        serial.send(b"lost", None)
        now += 1.0
        serial.receive(now)
        assert serial.fileno() is None
        line.plug()
        serial.receive(now + 0.9)
        assert serial.fileno() is None
        now += 1.0
        serial.receive(now)
        os.write(line.master, b"%d" % flap)
        assert receive(serial, now) == [b"%d" % flap]
        serial.send(b"answer", None)
        assert os.read(line.master, 100) == b"answer"
    assert len(os.listdir("/proc/self/fd")) == before
    assert serial.troubles.total() == 20


FAILURES = [termios.error(5, "Input/output error"), ValueError("not a baud rate"), OSError(5, "")]


@pytest.mark.parametrize("error", FAILURES)
def test_serial_link_raises_no_errors_in_flight(line, serial, monkeypatch, error):
    """pyserial flushes a device at the end of its opening, and raises an error of this flush to the
    caller."""
    close = serial._port.close

    def close_and_fail():
        close()
        raise error

    with monkeypatch.context() as failing:
        for action in ("read", "fileno"):
            failing.setattr(serial._port, action, Mock(side_effect=error))
        failing.setattr(serial._port, "close", close_and_fail)
        serial.send(b"lost", None)
        assert serial.receive(0.0) == []
    assert serial.troubles.total() == 2
    assert serial.fileno() is None
    with monkeypatch.context() as vanishing:
        vanishing.setattr(termios, "tcflush", Mock(side_effect=error))
        for now in (1.0, 2.0, 3.0):
            assert serial.receive(now) == []
            assert serial.fileno() is None
    serial.receive(4.0)
    os.write(line.master, b"back")
    assert receive(serial, 4.0) == [b"back"]


def test_serial_device_is_opened_when_it_appears(request, line):
    line.unplug()
    serial = opened(request, f"serial:{line.name}:57600")
    assert dict(serial.troubles) == {"no such device": 1}
    serial.receive(0.0)
    assert serial.fileno() is None
    line.plug()
    serial.receive(1.0)
    os.write(line.master, b"booted")
    assert receive(serial, 1.0) == [b"booted"]


def test_serial_device_that_disappears_at_opening_is_reopened(request, line, monkeypatch):
    with monkeypatch.context() as vanishing:
        vanishing.setattr(termios, "tcflush", Mock(side_effect=FAILURES[0]))
        serial = opened(request, f"serial:{line.name}:57600")
    serial.receive(0.0)
    os.write(line.master, b"back")
    assert receive(serial) == [b"back"]


def test_serial_device_without_permission_is_refused(line, monkeypatch):
    monkeypatch.setattr("os.open", Mock(side_effect=PermissionError(13, "Permission denied")))
    with pytest.raises(LinkError, match="permission denied") as refused:
        open_link(f"serial:{line.name}:57600")
    assert refused.value.no_peer, "udev may set the group of the device later"


def test_error_names_program_that_has_device_open():
    """Two programs that read one port each received a part of the bytes, without a message."""
    with open("/dev/full", "rb", buffering=0) as device:
        other = subprocess.Popen(["sleep", "60"], stdin=device)
    try:
        assert user_of("/dev/full") == f"sleep (process {other.pid})"
    finally:
        other.kill()
        other.wait(PATIENCE)
    assert user_of("/dev/full") == user_of("/dev/no-such-device") == ""


def test_serial_device_is_opened_exclusively(request, line, serial):
    second = opened(request, f"serial:{line.name}:57600")
    assert second.fileno() is None
    assert list(second.troubles) == ["device is in use by another program"]
    serial.close()
    second.receive(1.0)
    assert second.fileno() is not None
    assert not second.troubles
