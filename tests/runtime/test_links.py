"""UDP, TCP and serial links over what the kernel really has: loopback sockets and a pseudo terminal."""

import os
import pty
import select
import socket
import termios
from contextlib import closing

import pytest

from circnav_mav.runtime.endpoint import MOST_BYTES, LinkError
from circnav_mav.runtime.links import open_link
from circnav_mav.runtime.udp_link import LONGEST, MOST_DATAGRAMS
from tests.process import PATIENCE

UDP = (socket.AF_INET, socket.SOCK_DGRAM)


def receive(link, now=0.0, patience=PATIENCE):
    """What comes in once the link's descriptor has something."""
    select.select([link.fileno()], [], [], patience)
    return link.receive(now)


@pytest.fixture
def udp():
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(PATIENCE)
        yield peer


@pytest.fixture
def server(port):
    """On a port that nobody else takes when it has gone."""
    with closing(socket.create_server(("127.0.0.1", port))) as listening:
        listening.settimeout(PATIENCE)
        yield listening


def address(server):
    return f"tcp:127.0.0.1:{server.getsockname()[1]}"


# --- UDP ---


def test_udpin_hears_everybody_and_answers_whom_it_is_told(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        udp.sendto(b"one", ("127.0.0.1", link.port))
        ((data, source),) = receive(link)
        assert (data, source) == (b"one", udp.getsockname())
        link.send(b"answer", source)
        assert udp.recv(100) == b"answer"


def test_udpin_says_nothing_before_it_knows_to_whom(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        link.send(b"nobody", None)
        assert link.troubles.total() == 0


def test_datagrams_stay_apart_and_in_order(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        for i in range(10):
            udp.sendto(bytes([i]) * (i + 1), ("127.0.0.1", link.port))
        assert [data for data, _ in receive(link)] == [bytes([i]) * (i + 1) for i in range(10)]
        assert link.receive(0.0) == []


def test_a_flood_is_taken_in_portions(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        for _ in range(MOST_DATAGRAMS + 100):
            udp.sendto(b"x", ("127.0.0.1", link.port))
        assert len(receive(link)) == MOST_DATAGRAMS
        assert len(link.receive(0.0)) == 100


def test_a_flood_of_long_datagrams_is_taken_in_portions_and_none_is_lost(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        sent = [bytes([i]) * 1400 for i in range(100)]
        for data in sent:
            udp.sendto(data, ("127.0.0.1", link.port))
        portions = []
        while portion := link.receive(0.0):
            portions.append([data for data, _ in portion])
        assert [data for portion in portions for data in portion] == sent
        assert max(sum(map(len, portion)) for portion in portions) < MOST_BYTES + 1400
        assert len(portions) == 5


@pytest.mark.parametrize(
    ("host", "peers", "heard"),
    [
        ("127.0.0.1", ["127.0.0.1"], True),
        ("127.0.0.1", ["10.0.0.5", "127.0.0.0/8"], True),
        ("127.0.0.1", ["10.0.0.5", "127.0.0.2", "fe80::/10"], False),
        ("[::1]", ["::1"], True),
        ("[::1]", ["::2", "127.0.0.1"], False),
        ("[::]", ["127.0.0.1"], True),  # IPv4 on a socket of both
    ],
)
def test_udpin_hears_the_addresses_that_the_mission_names_and_no_other(host, peers, heard):
    family, to = (socket.AF_INET6, "::1") if host == "[::1]" else (socket.AF_INET, "127.0.0.1")
    with closing(open_link(f"udpin:{host}:0", peers)) as link, closing(socket.socket(family, UDP[1])) as other:
        other.sendto(b"hello", (to, link.port))
        assert [data for data, _ in receive(link)] == [b"hello"] * heard
        assert [words for words in link.troubles if words.startswith("ignored: sent by")] == (
            [] if heard else [f"ignored: sent by {host}:{other.getsockname()[1]}"]
        )


def test_a_datagram_that_no_router_sends_is_not_read(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        for size in (LONGEST + 1, 65_000, LONGEST):
            udp.sendto(bytes(size), ("127.0.0.1", link.port))
        assert [len(data) for data, _ in receive(link)] == [LONGEST]
        assert link.troubles.total() == 2


def test_ipv6_carries_bytes_both_ways():
    with closing(open_link("udpin:[::1]:0")) as link, closing(open_link(f"udpout:[::1]:{link.port}")) as there:
        there.send(b"one", None)
        ((data, source),) = receive(link)
        link.send(b"answer", source)
        assert (data, [back for back, _ in receive(there)]) == (b"one", [b"answer"])
    with (
        closing(socket.create_server(("::1", 0), family=socket.AF_INET6)) as server,
        closing(open_link(f"tcp:[::1]:{server.getsockname()[1]}")) as link,
        closing(server.accept()[0]) as there,
    ):
        there.sendall(b"hello")
        assert [data for data, _ in receive(link)] == [b"hello"]


def test_what_waits_in_a_flooded_socket_is_not_old(udp):
    """A longer queue loses nothing less: it only makes everything in it late, a takeover too."""
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        for _ in range(3000):
            udp.sendto(bytes(1400), ("127.0.0.1", link.port))
        waiting = 0
        while portion := link.receive(0.0):
            waiting += sum(len(data) for data, _ in portion)
        assert waiting < 400_000, "0.4 s at 1 MB/s"


def test_udpout_speaks_first_and_to_its_own_address_only(udp):
    with closing(open_link(f"udpout:127.0.0.1:{udp.getsockname()[1]}")) as link:
        link.send(b"hello", None)
        data, ours = udp.recvfrom(100)
        assert data == b"hello"
        udp.sendto(b"answer", ours)
        assert [data for data, _ in receive(link)] == [b"answer"]
        link.send(b"again", ("127.0.0.1", 9))
        assert udp.recv(100) == b"again"


def test_udpout_hears_nobody_but_whom_it_speaks_to(udp):
    """As a vehicle that still speaks to our fixed port, when we have gone on to another: else the one would be heard
    and the other commanded."""
    with closing(open_link(f"udpout:127.0.0.1:{udp.getsockname()[1]}")) as link, closing(socket.socket(*UDP)) as other:
        for _ in range(MOST_DATAGRAMS):
            other.sendto(b"stranger", ("127.0.0.1", link.port))
        udp.sendto(b"ours", ("127.0.0.1", link.port))
        assert receive(link) == []
        assert link.receive(0.0) == [(b"ours", udp.getsockname())]
        assert link.troubles == {f"ignored: sent by 127.0.0.1:{other.getsockname()[1]}": MOST_DATAGRAMS}


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.1.1", "localhost"])
def test_udpout_hears_this_computer_by_whatever_name(host):
    """It answers as 127.0.0.1."""
    with closing(socket.socket(*UDP)) as vehicle:
        vehicle.bind(("0.0.0.0", 0))
        vehicle.settimeout(10.0)
        with closing(open_link(f"udpout:{host}:{vehicle.getsockname()[1]}")) as link:
            link.send(b"hello", None)
            vehicle.sendto(b"answer", vehicle.recvfrom(100)[1])
            assert [data for data, _ in receive(link)] == [b"answer"]


def test_a_crowd_of_strangers_is_told_in_few_words(udp):
    with closing(open_link(f"udpout:127.0.0.1:{udp.getsockname()[1]}")) as link:
        for _ in range(20):
            with closing(socket.socket(*UDP)) as other:
                other.sendto(b"stranger", ("127.0.0.1", link.port))
        while link.troubles.total() < 20:
            assert receive(link) == []
        assert len(link.troubles) <= 5


def test_two_udpout_links_can_be_open_at_once(udp):
    """The second cannot have the fixed local port and takes another."""
    port = udp.getsockname()[1]
    with closing(open_link(f"udpout:127.0.0.1:{port}")) as one, closing(open_link(f"udpout:127.0.0.1:{port}")) as two:
        assert one.port != two.port


def test_a_port_in_use_is_refused_in_one_line_with_what_to_do(udp):
    port = udp.getsockname()[1]
    with pytest.raises(LinkError) as caught:
        open_link(f"udpin:127.0.0.1:{port}")
    assert str(caught.value) == (
        f"endpoint udpin:127.0.0.1:{port}: port is in use by another program: close it, or choose another port"
    )
    assert not caught.value.nobody


def test_an_address_that_is_not_ours_is_refused_in_one_line():
    with pytest.raises(LinkError, match=r"^endpoint udpin:192\.0\.2\.1:14550: cannot assign requested address$"):
        open_link("udpin:192.0.2.1:14550")


def test_a_peer_that_refuses_is_silence_and_counted_and_may_come_back(port):
    """ICMP "port unreachable" shows as an error on the socket."""
    with closing(open_link(f"udpout:127.0.0.1:{port}")) as link:
        for _ in range(3):
            link.send(b"anybody?", None)
            assert link.receive(0.0) == []
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as back:
            back.bind(("127.0.0.1", port))
            back.settimeout(PATIENCE)
            link.send(b"there", None)
            assert back.recv(100) == b"there"


def test_a_network_that_is_unreachable_is_counted_and_not_raised(udp):
    with closing(open_link("udpin:127.0.0.1:0")) as link:
        link.send(b"x", ("240.0.0.1", 1))
        link.send(b"x" * 70_000, udp.getsockname())
        assert link.troubles.total() >= 1


# --- TCP ---


def test_tcp_carries_bytes_both_ways(server):
    with closing(open_link(address(server))) as link, closing(server.accept()[0]) as there:
        there.sendall(b"hello")
        ((data, source),) = receive(link)
        assert (data, source) == (b"hello", server.getsockname())
        link.send(b"answer", source)
        assert there.recv(100) == b"answer"
        assert link.receive(0.0) == []


def test_a_tcp_server_that_is_not_there_is_refused_as_nobody():
    with closing(socket.socket()) as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        with pytest.raises(LinkError) as caught:
            open_link(f"tcp:127.0.0.1:{port}")
    assert str(caught.value) == f"endpoint tcp:127.0.0.1:{port}: nobody listens there (connection refused)"
    assert caught.value.nobody


def test_after_the_end_of_file_tcp_connects_again_a_second_later(server):
    with closing(open_link(address(server))) as link:
        server.accept()[0].close()
        assert receive(link, now=10.0) == []
        assert link.fileno() is None
        assert link.troubles.total() == 1
        assert link.receive(10.9) == []
        assert link.fileno() is None, "too early"
        link.receive(11.0)
        there = server.accept()[0]
        with closing(there):
            there.sendall(b"back")
            assert [data for data, _ in receive(link, now=11.1)] == [b"back"]
            link.send(b"again", None)
            assert there.recv(100) == b"again"


def test_a_dead_tcp_server_does_not_make_the_loop_spin(server):
    """A thousand calls between two retries make one attempt; there is nothing to select on meanwhile."""
    with closing(open_link(address(server))) as link:
        server.accept()[0].close()
        receive(link, now=0.0)
        server.close()
        attempts = 0
        for i in range(1000):
            link.receive(i / 100)
            attempts += link.fileno() is not None
            if link.fileno() is not None:
                assert receive(link, now=i / 100) == []
        assert 8 <= attempts <= 10
        assert link.troubles.total() == attempts + 1


def test_between_connections_what_is_sent_is_lost_without_a_word(server):
    with closing(open_link(address(server))) as link:
        server.accept()[0].close()
        receive(link)
        link.send(b"lost", None)


def test_a_reset_connection_is_an_end_and_no_error(server):
    with closing(open_link(address(server))) as link:
        there = server.accept()[0]
        there.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        there.close()
        assert receive(link) == []
        assert link.fileno() is None


def test_a_peer_that_does_not_read_delays_nothing(server):
    """A full buffer loses bytes instead."""
    with closing(open_link(address(server))) as link, closing(server.accept()[0]):
        for _ in range(200):
            link.send(b"x" * 65536, None)
        assert link.troubles["TX buffer full: lower stream rates or raise the baud rate"] > 0


def test_a_hundred_flaps_of_a_tcp_server_leak_nothing_and_the_link_is_back_each_time_within_two_seconds(server):
    with closing(open_link(address(server))) as link:
        there, now = server.accept()[0], 0.0
        before = len(os.listdir("/proc/self/fd"))
        for flap in range(100):
            there.close()
            assert receive(link, now) == []
            now += 1.0
            link.receive(now)
            there = server.accept()[0]
            there.sendall(b"%d" % flap)
            assert [data for data, _ in receive(link, now)] == [b"%d" % flap]
            link.send(b"answer", None)
            assert there.recv(100) == b"answer"
        assert len(os.listdir("/proc/self/fd")) == before
        assert link.troubles.total() == 100
        there.close()


def test_a_server_that_vanishes_without_a_word_is_given_up_by_the_kernel(server):
    """Half-open: nothing can be read and nothing is acknowledged. Linux ends such a connection when it is told to."""
    with closing(open_link(address(server))) as link, socket.socket(fileno=os.dup(link.fileno())) as twin:
        assert twin.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 3000


def test_closing_twice_is_no_mistake(server):
    link = open_link(address(server))
    link.close()
    link.close()


# --- serial ---


@pytest.fixture
def line():
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    yield master, os.ttyname(slave)
    os.close(slave)
    os.close(master)


def test_a_serial_line_carries_bytes_both_ways(line):
    master, name = line
    with closing(open_link(f"serial:{name}:57600")) as link:
        os.write(master, b"\xfd\x00hello")
        ((data, source),) = receive(link)
        assert (data, source) == (b"\xfd\x00hello", name)
        link.send(b"\x00answer\n", source)
        assert os.read(master, 100) == b"\x00answer\n"
        assert link.receive(0.0) == []


def test_a_serial_device_that_vanishes_is_silence_until_it_is_back(tmp_path):
    """Under a name of its own: its number goes to the next who asks for a terminal, another test for one."""
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    name = tmp_path / "tty"
    name.symlink_to(os.ttyname(slave))
    with closing(open_link(f"serial:{name}:57600")) as link:
        name.unlink()
        os.close(slave)
        os.close(master)
        for i in range(30):
            assert link.receive(i / 10) == []
            link.send(b"lost", None)
        assert link.troubles.total() > 0


def test_a_serial_device_that_is_plugged_in_again_and_again_is_back_each_time_within_two_seconds(tmp_path):
    """A new device under the old name, as udev makes it."""
    pytest.importorskip("serial")
    name = tmp_path / "tty"

    def plug():
        master, slave = pty.openpty()
        name.symlink_to(os.ttyname(slave))
        return master, slave

    master, slave = plug()
    with closing(open_link(f"serial:{name}:57600")) as link:
        before, now = len(os.listdir("/proc/self/fd")), 0.0
        for flap in range(50):
            os.close(slave)
            os.close(master)
            name.unlink()
            assert receive(link, now) == []
            assert link.fileno() is None
            link.receive(now + 0.5)
            link.send(b"lost", None)
            now += 1.0
            link.receive(now)
            assert link.fileno() is None, "there is no device"
            master, slave = plug()
            now += 1.0
            link.receive(now)
            os.write(master, b"%d" % flap)
            assert [data for data, _ in receive(link, now)] == [b"%d" % flap]
            link.send(b"answer", None)
            assert os.read(master, 100) == b"answer"
        assert len(os.listdir("/proc/self/fd")) == before
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize(
    "error", [termios.error(5, "Input/output error"), ValueError("not a baud rate"), OSError(5, "")]
)
def test_a_serial_device_that_vanishes_while_it_is_opened_again_is_tried_on(line, monkeypatch, error):
    """The last that pyserial does with a device that it opens is to flush it, and what that raises it passes on."""
    master, name = line
    with closing(open_link(f"serial:{name}:57600")) as link:
        link._port.close()
        assert link.receive(0.0) == []
        with monkeypatch.context() as vanishing:
            vanishing.setattr(termios, "tcflush", raising(error))
            for now in (1.0, 2.0, 3.0):
                assert link.receive(now) == []
                assert link.fileno() is None
                link.send(b"lost", None)
        link.receive(4.0)
        os.write(master, b"back")
        assert [data for data, _ in receive(link, 4.0)] == [b"back"]


def test_a_serial_device_that_vanishes_while_it_is_first_opened_is_refused_in_one_line(line, monkeypatch):
    monkeypatch.setattr(termios, "tcflush", raising(termios.error(5, "Input/output error")))
    with pytest.raises(LinkError, match=rf"^endpoint serial:{line[1]}:57600: input/output error$"):
        open_link(f"serial:{line[1]}:57600")


@pytest.mark.parametrize("error", [termios.error(5, "Input/output error"), OSError(5, ""), ValueError("no descriptor")])
def test_a_serial_device_may_fail_in_every_way_while_it_is_read_written_and_closed(line, monkeypatch, error):
    _, name = line
    with closing(open_link(f"serial:{name}:57600")) as link:
        with monkeypatch.context() as failing:
            for action in ("read", "close", "fileno"):
                failing.setattr(link._port, action, raising(error))
            link.send(b"lost", None)
            assert link.receive(0.0) == []
        assert link.troubles.total() == 2
        assert link.fileno() is None


def raising(error):
    """A function that fails."""

    def fail(*arguments):
        raise error

    return fail
