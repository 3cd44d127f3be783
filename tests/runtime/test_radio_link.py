"""A radio behind its driver: what becomes of its bytes on the way to the pilot."""

import math
from collections import Counter
from collections.abc import Hashable

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.radios.interface import RadioReading
from circnav_mav.radios.lines import Lines
from circnav_mav.radios.linktrack import LinkTrack
from circnav_mav.runtime.links import LinkError
from circnav_mav.runtime.radio_link import RadioLink, open_radio, radio_port
from tests.radios.recorded import NODE_FRAME_2


class Wire:
    """A port that hears what is put into it."""

    def __init__(self) -> None:
        self.troubles: Counter[str] = Counter()
        self.waiting: list[tuple[bytes, Hashable]] = []
        self.sent: list[bytes] = []

    def fileno(self) -> int | None:
        return None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        heard, self.waiting = self.waiting, []
        return heard

    def send(self, data: bytes, to: Hashable) -> None:
        self.sent.append(data)

    def close(self) -> None:
        pass


def decoded(frames) -> list:
    reader = mavlink.MAVLink(None)
    return [(reader.decode(bytearray(frame)), source) for frame, source in frames]


def test_a_reading_is_a_ranging_beacon_of_its_own_source():
    wire = Wire()
    wire.waiting = [(NODE_FRAME_2, "/dev/ttyUSB0")]
    (first, source), *others = decoded(RadioLink("linktrack", LinkTrack(), wire, datagrams=False).receive(0.0))
    assert first.to_dict() | {"lat": 0, "lon": 0, "alt": 0} == {
        "mavpackettype": "RANGING_BEACON", "time_usec": 1926822000, "target_system": 0, "target_component": 0,
        "beacon_id": 0, "range": 3179, "lat": 0, "lon": 0, "alt": 0, "alt_type": 0, "hacc_est": 2**32 - 1,
        "vacc_est": 2**32 - 1, "carrier_freq": 0, "range_accuracy": 2**32 - 1, "sequence": 1, "status": 0,
    }  # fmt: skip
    assert (first.get_srcSystem(), first.get_srcComponent(), source) == (1, 192, "/dev/ttyUSB0 beacon 0")
    assert [(message.beacon_id, message.range, at) for message, at in others] == [
        (1, 5548, "/dev/ttyUSB0 beacon 1"), (2, 6728, "/dev/ttyUSB0 beacon 2"), (3, 4651, "/dev/ttyUSB0 beacon 3")
    ]  # fmt: skip


NONE = 2**32 - 1


@pytest.mark.parametrize(
    ("line", "millimetres", "sigma", "stamp"),
    [
        ("12.3456", 12346, NONE, 0),
        ("2.5,7,12.3,0.05", 12300, 50, 2_500_000),
        ("nan,7,nan,nan", NONE, NONE, 0),
        ("-1e300,7,-5,-1", NONE, NONE, 0),
        ("1e300,7,1e300,1e300", NONE - 1, NONE - 1, 0),
        ("inf,7,inf,inf", NONE, NONE, 0),
        ("0,7,0,0", NONE, NONE, 0),
    ],
)
def test_only_numbers_that_are_ranges_pass_as_such(line, millimetres, sigma, stamp):
    wire, driver = Wire(), Lines()
    link = RadioLink("lines", driver, wire, datagrams=True)
    wire.waiting = [(line.encode(), "x")]  # over UDP a line need not end
    ((message, _),) = decoded(link.receive(0.0))
    assert (message.range, message.range_accuracy, message.time_usec) == (millimetres, sigma, stamp)
    assert math.isnan(message.alt)


def test_a_wrong_baud_rate_is_said_in_one_line_and_heals():
    wire = Wire()
    link = RadioLink("linktrack", LinkTrack(), wire, datagrams=False)
    for step in range(100):
        wire.waiting = [(bytes(range(40)), "x")]
        assert link.receive(0.1 * step) == []
    assert list(link.troubles) == [
        "bytes come in that are none of linktrack: another baud rate, driver or output of the radio?"
    ]
    before = link.troubles.total()
    assert before == 4
    for step in range(100, 200):
        wire.waiting = [(NODE_FRAME_2 + bytes(40), "x")]
        assert len(link.receive(0.1 * step)) == 4
    assert link.troubles.total() == before


def test_a_radio_that_sees_no_beacon_is_no_trouble():
    wire = Wire()
    link = RadioLink("lines", Lines(), wire, datagrams=False)
    for step in range(100):
        assert link.receive(0.1 * step) == []
    assert not link.troubles


def test_a_driver_that_fails_costs_its_bytes_and_no_flight():
    class Broken(Lines):
        def read_line(self, line):
            return [RadioReading(5.0, beacon=70_000)] if line == "bad" else super().read_line(line)

    wire = Wire()
    link = RadioLink("broken", Broken(), wire, datagrams=True)
    wire.waiting = [(b"", "x"), (b"bad", "x")]
    assert link.receive(0.0) == []
    wire.waiting = [(b"5.0", "x")]
    assert len(link.receive(0.1)) == 1
    assert list(link.troubles) == ["driver broken failed: ValueError('beacon id 70000 is not 0 to 65535')"]


@pytest.mark.parametrize(
    ("endpoint", "port"),
    [
        ("linktrack:/dev/ttyUSB0", "serial:/dev/ttyUSB0:921600"),
        ("dwm1001:/dev/ttyACM0", "serial:/dev/ttyACM0:115200"),
        ("linktrack:/dev/ttyUSB0:460800", "serial:/dev/ttyUSB0:460800"),
        ("linktrack:serial:/dev/ttyUSB0:460800", "serial:/dev/ttyUSB0:460800"),
        ("lines:udpin:0.0.0.0:5005", "udpin:0.0.0.0:5005"),
        ("dwm1001:/dev/serial/by-id/usb-SEGGER:1-port0", "serial:/dev/serial/by-id/usb-SEGGER:1-port0:115200"),
    ],
)
def test_a_device_is_a_serial_line_at_the_speed_of_its_radio(endpoint, port):
    assert radio_port(endpoint)[2] == port


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        ("linktrak:/dev/ttyUSB0", "no driver 'linktrak'; there are dwm1001, lines, linktrack"),
        ("linktrack:/dev/ttyUSB77", "no such device"),
        ("linktrack:ttyUSB0", "write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD"),
        ("lines:udpin:0.0.0.0", "port is missing"),
    ],
)
def test_a_radio_that_cannot_be_opened_is_one_line(endpoint, said):
    with pytest.raises(LinkError) as refused:
        open_radio(endpoint)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
