"""What may happen to a link or to the process while flying."""

import os
import select
import signal
import socket
from contextlib import closing

import pytest

from circnav_mav.runtime.links import Link, LinkError, open_link
from circnav_mav.runtime.runner import StopRequest
from tests.process import PATIENCE


def dropped(server: socket.socket, host: str) -> Link:
    """A TCP link whose server has just hung up."""
    link = open_link(f"tcp:{host}:{server.getsockname()[1]}")
    server.accept()[0].close()
    select.select([link.fileno()], [], [], PATIENCE)
    link.receive(0.0)
    return link


def test_a_name_server_that_fails_in_flight_does_not_raise_out_of_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(socket.socket):
        def connect_ex(self, address: tuple[str, int]) -> int:
            if address[0] == "localhost":
                raise socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution")
            return super().connect_ex(address)

    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        link = dropped(server, "localhost")
        monkeypatch.setattr(socket, "socket", Broken)
        link.receive(2.0)
        assert link.fileno() is not None
        link.close()


def test_a_tcp_link_that_came_back_is_as_quick_as_before() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        link = dropped(server, "127.0.0.1")
        link.receive(2.0)
        with socket.socket(fileno=os.dup(link.fileno() or -1)) as twin:
            assert twin.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        link.close()


def test_many_signals_never_raise() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    stop = StopRequest()
    try:
        for _ in range(2000):
            signal.raise_signal(signal.SIGTERM)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert stop.signal_name == "SIGTERM"


def test_port_0_is_nowhere_to_send_to() -> None:
    with pytest.raises(LinkError, match="port must be 1 to 65535"):
        open_link("udpout:127.0.0.1:0")
