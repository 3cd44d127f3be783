"""A radio behind its driver: from received bytes to messages for the pilot."""

import math
import sys
from collections import Counter
from importlib.metadata import EntryPoint

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.radios.lines import DECIMAL_COMMA, Lines
from circnav_mav.extras.radios.linktrack import LinkTrack
from circnav_mav.mav.ranging.driver import RadioReading
from circnav_mav.mav.ranging.line_driver import LineDriver
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.radio_link import BATCH, RadioLink, open_radio, radio_port
from tests.extras.radios.recorded import NODE_FRAME_2

NONE = 2**32 - 1


class Wire:
    """A port that receives the data put into it."""

    def __init__(self):
        self.troubles = Counter()
        self.waiting = []

    def receive(self, now):
        received = self.waiting
        self.waiting = []
        return received


class Radio:
    """A radio at the end of a wire."""

    def __init__(self, name, driver):
        self.wire = Wire()
        self.link = RadioLink(name, driver, self.wire)
        if isinstance(driver, LineDriver):
            self.readings(b"\n")  # the end of the first line, which may be incomplete

    def readings(self, *data, now=0.0):
        """Receive bytes; return a message and its source for each reading."""
        self.wire.waiting = [(one, "/dev/ttyUSB0") for one in data]
        reader = mavlink.MAVLink(None)
        return [
            (reader.decode(bytearray(frame)), source) for frame, source in self.link.receive(now)
        ]


def test_driver_reading_becomes_ranging_beacon_message():
    radio = Radio("linktrack", LinkTrack())
    (first, source), *others = radio.readings(NODE_FRAME_2)
    assert (first.get_type(), first.time_usec, first.beacon_id) == ("RANGING_BEACON", 1926822000, 0)
    assert (first.range, first.range_accuracy, first.sequence, first.status) == (3179, NONE, 1, 0)
    assert (first.target_system, first.target_component, first.hacc_est) == (0, 0, NONE)
    assert (first.get_srcSystem(), first.get_srcComponent(), source) == (
        1,
        192,
        "/dev/ttyUSB0",
    )
    assert [(message.beacon_id, message.range, at) for message, at in others] == [
        (1, 5548, "/dev/ttyUSB0"),
        (2, 6728, "/dev/ttyUSB0"),
        (3, 4651, "/dev/ttyUSB0"),
    ]


@pytest.mark.parametrize(
    ("line", "millimetres", "sigma", "stamp"),
    [
        ("12.3456", 12346, NONE, 0),
        ("2.5,7,12.3,0.05", 12300, 50, 2_500_000),
        ("nan,7,nan,nan", NONE, NONE, 0),
        ("-1e300,7,-5,-1", NONE, NONE, 0),
        ("1e300,7,1e306,1e306", NONE - 1, NONE - 1, 0),
        ("inf,7,inf,inf", NONE, NONE, 0),
        ("0,7,0,0", NONE, NONE, 0),
    ],
)
def test_only_valid_readings_become_ranges(line, millimetres, sigma, stamp):
    ((message, _),) = Radio("lines", Lines()).readings(line.encode() + b"\n")
    assert (message.range, message.range_accuracy, message.time_usec) == (millimetres, sigma, stamp)
    assert math.isnan(message.alt)


def test_radio_link_reports_wrong_baud_rate_until_corrected():
    radio = Radio("linktrack", LinkTrack())
    wrong = (
        f"received bytes are no linktrack data: {bytes(range(24))!r}: wrong baud rate, driver or"
        " output of the radio?"
    )

    def ten_seconds(began, *data):
        """Return the number of readings in each step of 10 s, and the reported faults."""
        readings = {len(radio.readings(*data, now=began + 0.1 * step)) for step in range(100)}
        return readings, dict(radio.link.troubles)

    assert ten_seconds(0.0) == ({0}, {})
    assert ten_seconds(10.0, bytes(range(40))) == ({0}, {wrong: 4})
    assert ten_seconds(20.0, NODE_FRAME_2 + bytes(40)) == ({4}, {wrong: 4})


def test_line_split_over_datagrams_is_assembled():
    """A serial bridge once split the line "123.4" into two datagrams, which were read as ranges of
    12 m and 3.4 m."""
    radio = Radio("lines", Lines())
    ranges = [
        message.range / 1000
        for data in (b"12", b"3.4\n124.0", b"\n", b"125.0\n1")
        for message, _ in radio.readings(data)
    ]
    assert ranges == [123.4, 124.0, 125.0]


@pytest.mark.parametrize(
    ("sent", "shown"),
    [
        (b"dist: 12.3 m\r\n", "'dist: 12.3 m'"),
        (b"12.3", f"'{21 * '12.3'}' (without a line end)"),
    ],
)
def test_radio_link_shows_text_that_contains_no_range(sent, shown):
    radio = Radio("lines", Lines())
    for step in range(26):
        assert radio.readings(sent, now=0.1 * step) == []
    assert list(radio.link.troubles) == [f"received text is no lines data: {shown}"]


def test_invalid_readings_are_reported_up_to_a_limit():
    class Odd(Lines):
        def read_line(self, line):
            if line.isdecimal():
                raise ValueError(1000 * line)
            odd = {"text": ("12.5",), "part": (5.0, 3.0), "far": (5.0, 70_000)}
            return [RadioReading(*odd[line]) if line in odd else (5.0, 3)]

    radio = Radio("odd", Odd())
    assert [
        radio.readings(line + b"\n") for line in (b"", b"text", b"part", b"far", b"pair")
    ] == 5 * [[]]
    assert list(radio.link.troubles)[:3] == [
        "driver odd failed: TypeError(\"'12.5' is not a number\")",
        "driver odd failed: TypeError('beacon id 3.0 is not a whole number')",
        "driver odd failed: ValueError('beacon id 70000 is not 0 to 65535')",
    ]
    for number in range(1000):
        radio.readings(b"%d\n" % number, now=float(number))
    assert radio.link.troubles["driver odd failed with other errors"] == 1000
    assert len("".join(radio.link.troubles)) < 1000


def test_failing_driver_is_called_once_a_second():
    """A driver with an error in its code was once called, and failed, 30,513 times in a flight."""

    class Unfinished(Lines):
        finished = False

        def read_line(self, line):
            return super().read_line(line) if self.finished else self.not_written_yet(line)

        def ask(self, now):
            return self.asked_at

    radio = Radio("unfinished", driver := Unfinished())
    for step in range(1000):
        assert radio.readings(b"5.0\n", now=0.1 * step) == []
    failed = "driver unfinished failed: AttributeError(\"'Unfinished' object has no attribute "
    counts = {words.removeprefix(failed): count for words, count in radio.link.troubles.items()}
    assert counts == {
        "'asked_at'\")": pytest.approx(109, abs=2),
        "'not_written_yet'\")": pytest.approx(109, abs=2),
    }
    driver.finished = True
    assert [len(radio.readings(b"5.0\n", now=102.0 + 0.1 * step)) for step in range(5)] == 5 * [1]


def test_failing_driver_does_not_end_flight():
    """Bytes that a failing driver leaves in the socket wake the loop at once. The loop once ran
    26,000 steps per second."""

    class Exiting(Lines):
        def read_line(self, line):
            return sys.exit("no radio") if line == "gone" else super().read_line(line)

        def ask(self, now):
            raise OSError("no port")

    radio = Radio("exiting", Exiting())
    assert len(radio.readings(b"5.0\n")) == 1
    assert len(radio.readings(b"gone\n", b"6.0\n")) == 1
    assert dict(radio.link.troubles) == {
        "driver exiting failed: OSError('no port')": 3,
        "driver exiting failed: SystemExit('no radio')": 1,
    }


class Bare:
    """A driver that lacks the attributes of the driver interface."""

    def receive(self, data, now):
        return []


class Exits(Bare):
    def __init__(self):
        sys.exit("no radio here")


class KeyMissing(Bare):
    def __init__(self):
        raise KeyError("port")


@pytest.mark.parametrize(
    ("driver", "error"),
    [
        ("Bare", "TypeError('its baud is missing or not int')"),
        ("Exits", "SystemExit('no radio here')"),
        ("KeyMissing", "KeyError('port')"),
        ("Absent", "has no attribute 'Absent'"),
    ],
)
def test_incomplete_driver_is_refused(monkeypatch, driver, error):
    point = EntryPoint("mine", f"{__name__}:{driver}", "circnav.ranging")
    monkeypatch.setattr("circnav_mav.installed.installed_entry_points", lambda group: [point])
    with pytest.raises(LinkError) as refused:
        open_radio("mine:udpin:127.0.0.1:0")
    assert f"driver 'mine' of {__name__}:{driver} does not load: " in str(refused.value)
    assert error in str(refused.value)


def test_serial_port_uses_default_baud_rate_of_driver():
    for endpoint, port in (
        ("linktrack:/dev/ttyUSB0", "serial:/dev/ttyUSB0:921600"),
        ("dwm1001:/dev/ttyACM0", "serial:/dev/ttyACM0:115200"),
        ("linktrack:/dev/ttyUSB0:460800", "serial:/dev/ttyUSB0:460800"),
        ("linktrack:serial:/dev/ttyUSB0:460800", "serial:/dev/ttyUSB0:460800"),
        ("lines:udpin:0.0.0.0:5005", "udpin:0.0.0.0:5005"),
        (
            "dwm1001:/dev/serial/by-id/usb-SEGGER:1-port0",
            "serial:/dev/serial/by-id/usb-SEGGER:1-port0:115200",
        ),
    ):
        assert radio_port(endpoint)[2] == port
    for endpoint, error in (
        ("linktrak:/dev/ttyUSB0", "no driver 'linktrak'; there are dwm1001, lines, linktrack"),
        (
            "linktrack:ttyUSB0",
            "write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD",
        ),
        ("lines:udpin:0.0.0.0", "port is missing"),
    ):
        with pytest.raises(LinkError) as refused:
            open_radio(endpoint)
        assert error in str(refused.value)
        assert "\n" not in str(refused.value)


def test_radio_link_assembles_lines_of_each_sender_separately():
    radio = Radio("lines", Lines())
    own = ("127.0.0.1", 4000)
    other = ("127.0.0.1", 4001)
    radio.wire.waiting = [
        (b"\n7,12", own), (b"\n9,9", other), (b"3.4\n", own), (b"9.9\n", other)
    ]  # fmt: skip
    found = [reading.range for reading, source in radio.link.read(0.0) if source == own]
    assert found == [123.4]


NODE = ("10.0.0.7", 4000)


def received(radio, *data, now=0.0):
    """Receive datagrams, each with its source. Return the ranges."""
    radio.wire.waiting = list(data)
    return [reading.range for reading, _ in radio.link.read(now)]


def test_new_port_for_each_datagram_loses_first_line_only():
    """An ESP8266 opens a new socket, and thus a new port, for each datagram."""
    radio = Radio("lines", Lines())
    found = [
        received(radio, (b"%d.5\n" % n, ("10.0.0.7", 4000 + n)), now=0.1 * n) for n in range(120)
    ]
    assert found == [[], *([n + 0.5] for n in range(1, 120))]
    assert len(radio.link._senders) <= 8


def test_lines_from_different_ports_are_never_joined():
    radio = Radio("lines", Lines())
    other = ("10.0.0.7", 4001)
    sent = [(b"\n", NODE), (b"9,9", other), (b"3.4\n", NODE), (b".9\n", other), (b"7,5\n", NODE)]
    assert received(radio, *sent) == [9.9, 5.0]


def test_unreadable_text_of_second_host_is_shown():
    radio = Radio("lines", Lines())
    for step in range(40):
        own = (b"12.5\n", NODE)
        other = (b"debug: %d\n" % (step % 2), ("10.0.0.9", 5000 + step))
        received(radio, own, other, now=0.1 * step)
    assert list(radio.link.troubles) == [
        "received text is no lines data: 'debug: 0', from 10.0.0.9"
    ]


def test_bytes_of_lines_that_end_with_nul_are_shown():
    radio = Radio("lines", Lines())
    for step in range(30):
        assert received(radio, (b"12.%d\0" % (step % 10), NODE), now=0.1 * step) == []
    assert list(radio.link.troubles) == [
        "received bytes are no lines data: b'12.0\\x0012.1\\x0012.2\\x0012.3\\x0012.4', from"
        " 10.0.0.7: wrong baud rate, driver or output of the radio?"
    ]


def test_radio_link_names_line_end_sent_before_its_line():
    radio = Radio("lines", Lines())
    for step in range(30):
        sent = (b"\r\n12.%d" % (step % 10), ("10.0.0.7", 4000 + step))
        assert received(radio, sent, now=0.1 * step) == []
    assert list(radio.link.troubles) == [
        "received text is no lines data: '12.9' (its line end comes first: send the line end after"
        " the line), from 10.0.0.7"
    ]


@pytest.mark.parametrize("line", ["12,%d\n", "3;12,%d\n", "7.25,3,12,%d\n"])
def test_radio_link_names_decimal_commas_as_fault(line):
    radio = Radio("lines", Lines())
    for step in range(20):
        received(radio, (line.encode() % (1 + step % 9), NODE), now=0.1 * step)
    assert list(radio.link.troubles) == [DECIMAL_COMMA]


def test_radio_link_accepts_some_ranges_without_decimals():
    radio = Radio("lines", Lines())
    for step in range(40):
        sent = b"3,12%s\n" % (b"" if step % 10 else b".5")
        received(radio, (sent, NODE), now=0.1 * step)
    assert not radio.link.troubles


def test_newest_of_several_ranges_without_time_is_used():
    radio = Radio("lines", Lines())
    received(radio, (b"\n", NODE))
    for step in range(25):
        found = received(radio, (b"3,10.0\n4,7.0\n3,11.0\n3,12.0\n", NODE), now=0.1 * step)
        assert found == [7.0, 12.0]
    assert list(radio.link.troubles) == [BATCH]
    stamped = b"1.0,3,10.0\n1.1,3,11.0\n"
    assert received(radio, (stamped, NODE), now=3.0) == [10.0, 11.0]
