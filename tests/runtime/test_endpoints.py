"""Endpoints: both spellings of an endpoint, and one error line for each mistake."""

import socket
import sys
from contextlib import closing
from types import ModuleType

import pytest

from circnav_mav.runtime.endpoint import Endpoint, LinkError, parse_endpoint
from circnav_mav.runtime.links import open_link


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("udpin:0.0.0.0:0", Endpoint("udpin", "0.0.0.0", 0)),
        ("udpin://0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", Endpoint("udpin", "127.0.0.1", 14550)),
        ("udpout:10.0.0.1:14540", Endpoint("udpout", "10.0.0.1", 14540)),
        ("udpout://10.0.0.1:14540", Endpoint("udpout", "10.0.0.1", 14540)),
        ("tcp:localhost:5760", Endpoint("tcp", "localhost", 5760)),
        ("tcpout://localhost:5760", Endpoint("tcp", "localhost", 5760)),
        ("serial:/dev/ttyUSB0:57600", Endpoint("serial", "/dev/ttyUSB0", 57600)),
        ("serial:///dev/ttyUSB0:57600", Endpoint("serial", "/dev/ttyUSB0", 57600)),
        ("serial:/dev/ttyUSB0,921600", Endpoint("serial", "/dev/ttyUSB0", 921600)),
        ("udpin:[::1]:14550", Endpoint("udpin", "::1", 14550)),
        ("tcp://[fe80::1%eth0]:5760", Endpoint("tcp", "fe80::1%eth0", 5760)),
    ],
)
def test_both_spellings_of_endpoint_are_equivalent(text, endpoint):
    assert parse_endpoint(text) == endpoint


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD"),
        ("14550", "write udpin:HOST:PORT"),
        ("http://127.0.0.1:14550", "write udpin:HOST:PORT"),
        ("udpin:127.0.0.1", "port is missing or not a number, write udpin:HOST:PORT"),
        ("udpin:14550", "host is missing, write udpin:HOST:PORT"),
        ("udpin:127.0.0.1:many", "port is missing or not a number"),
        ("udpin:127.0.0.1:-1", "port is missing or not a number"),
        ("udpin:127.0.0.1:65536", "port must be 0 to 65535"),
        ("udpout:127.0.0.1:0", "port must be 1 to 65535"),
        ("udpin:::1:14550", "write an IPv6 address in brackets, as in udpin:[::1]:14550"),
        ("tcp:[1.2::z]:5760", "write an IPv6 address in brackets"),
        ("serial:/dev/ttyUSB0", "baud rate is missing or not a number"),
        ("serial:/dev/ttyUSB0:fast", "baud rate is missing or not a number"),
    ],
)
def test_invalid_endpoint_is_refused_in_one_line(text, problem):
    with pytest.raises(LinkError) as caught:
        parse_endpoint(text)
    assert str(caught.value).startswith(f"endpoint {text!r}: ")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


# --- endpoints that cannot be opened: one line, and a flag if the peer may still appear


def refusal(text):
    """Return the reason of a refusal, and True if the peer is missing."""
    with pytest.raises(LinkError) as caught:
        open_link(text)
    words = str(caught.value)
    assert words.startswith(f"endpoint {text}: ")
    return words.removeprefix(f"endpoint {text}: "), caught.value.no_peer


def test_missing_serial_package_is_refused(monkeypatch):
    # no package `serial`, or another package of this name
    for module in (None, ModuleType("serial")):
        monkeypatch.setitem(sys.modules, "serial", module)
        line = "needs the package pyserial (not serial): pip install pyserial"
        assert refusal("serial:/dev/ttyUSB0:57600")[0] == line


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp"])
def test_unknown_host_is_refused(kind, monkeypatch):
    """A host name with an empty label, or with a label of more than 63 letters, is refused without
    a query. For other names the error is that of the resolver, here without a name server."""
    for host in ("192.168..1", ".localhost", 70 * "a"):
        assert refusal(f"{kind}:{host}:14550") == ("unknown host name", False)

    def unknown(*_arguments, **_keywords):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    assert refusal(f"{kind}:no.such.host.invalid:14550") == ("unknown host name", True)


def test_unavailable_port_or_address_is_refused(port):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", port))
        in_use = "port is in use by another program: close it, or choose another port"
        assert refusal(f"udpin:127.0.0.1:{port}") == (in_use, False)
    assert refusal("udpin:192.0.2.1:14550") == (
        "no interface of this computer has this address",
        True,
    )
    assert refusal(f"tcp:127.0.0.1:{port}") == (
        "connection refused: no program listens at this address",
        True,
    )
