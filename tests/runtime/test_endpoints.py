"""Endpoints: both spellings, and one line for each mistake."""

import socket
import sys

import pytest

from circnav_mav.runtime.endpoint import Endpoint, LinkError, parse_endpoint
from circnav_mav.runtime.links import open_link


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("udpin:0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udpin://0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", Endpoint("udpin", "127.0.0.1", 14550)),
        ("udpout:10.0.0.1:14540", Endpoint("udpout", "10.0.0.1", 14540)),
        ("udpout://10.0.0.1:14540", Endpoint("udpout", "10.0.0.1", 14540)),
        ("tcp:localhost:5760", Endpoint("tcp", "localhost", 5760)),
        ("tcp://localhost:5760", Endpoint("tcp", "localhost", 5760)),
        ("tcpout://localhost:5760", Endpoint("tcp", "localhost", 5760)),
        ("serial:/dev/ttyUSB0:57600", Endpoint("serial", "/dev/ttyUSB0", 57600)),
        ("serial:///dev/ttyUSB0:57600", Endpoint("serial", "/dev/ttyUSB0", 57600)),
        ("serial:/dev/ttyUSB0,921600", Endpoint("serial", "/dev/ttyUSB0", 921600)),
        ("udpin:0.0.0.0:0", Endpoint("udpin", "0.0.0.0", 0)),
        ("udpin:[::1]:14550", Endpoint("udpin", "::1", 14550)),
        ("tcp://[fe80::1%eth0]:5760", Endpoint("tcp", "fe80::1%eth0", 5760)),
    ],
)
def test_both_spellings_name_the_same_endpoint(text, endpoint):
    assert parse_endpoint(text) == endpoint


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD"),
        ("14550", "write udpin:HOST:PORT"),
        ("127.0.0.1:14550", "write udpin:HOST:PORT"),
        ("http://127.0.0.1:14550", "write udpin:HOST:PORT"),
        ("udpin:127.0.0.1", "port is missing or not a number, write udpin:HOST:PORT"),
        ("udpin:14550", "host is missing, write udpin:HOST:PORT"),
        ("udpin:127.0.0.1:", "port is missing or not a number"),
        ("udpin:127.0.0.1:many", "port is missing or not a number"),
        ("udpin:127.0.0.1:-1", "port is missing or not a number"),
        ("udpin:127.0.0.1:65536", "65535"),
        ("tcp:127.0.0.1:99999", "65535"),
        pytest.param("udpin:127.0.0.1:" + 5000 * "1", "port is missing or not a number", id="thousands of digits"),
        ("udpin:127.0\0.0.1:14550", "holds a character that no address has"),
        ("udpin:::1:14550", "write an IPv6 address in brackets, as in udpin:[::1]:14550"),
        ("udpout:[::1:14550", "write an IPv6 address in brackets"),
        ("tcp:[1.2::z]:5760", "write an IPv6 address in brackets"),
        ("serial:/dev/ttyUSB0", "baud rate is missing or not a number"),
        ("serial:/dev/ttyUSB0:fast", "baud rate is missing or not a number"),
    ],
)
def test_an_endpoint_that_is_none_is_refused_in_one_line_that_repeats_it(text, problem):
    with pytest.raises(LinkError) as caught:
        parse_endpoint(text)
    assert str(caught.value).startswith(f"endpoint {text!r}: ")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not caught.value.nobody


def test_a_serial_device_that_is_not_there_is_refused_in_one_line():
    pytest.importorskip("serial")
    with pytest.raises(LinkError, match=r"^endpoint serial:/dev/nothing-here:57600: no such device$"):
        open_link("serial:/dev/nothing-here:57600")


def test_a_serial_endpoint_without_the_package_for_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"needs the package pyserial: pip install pyserial$"):
        open_link("serial:/dev/ttyUSB0:57600")


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp"])
def test_a_host_that_nobody_knows_is_refused_in_one_line(kind, monkeypatch):
    """Without asking a name server: the resolver's own error."""

    def unknown(*_arguments, **_keywords):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "gethostbyname", unknown)
    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(LinkError, match=r"^endpoint .*: host name is not known$"):
        open_link(f"{kind}:no.such.host.invalid:14550")


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp"])
@pytest.mark.parametrize("host", ["192.168..1", ".localhost", 70 * "a"])
def test_a_host_that_can_be_no_name_is_refused_in_one_line(kind, host):
    """An empty label, or one beyond 63 letters: the resolver is not even asked."""
    with pytest.raises(LinkError, match=r"^endpoint .*: host name is not known$") as caught:
        open_link(f"{kind}:{host}:14550")
    assert not caught.value.nobody  # to wait for it does not help
