"""The drivers, with bytes that the manufacturers published."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circnav_mav.extras.radios.dwm1001 import Dwm1001
from circnav_mav.extras.radios.lines import Lines
from circnav_mav.extras.radios.linktrack import LinkTrack
from circnav_mav.mav.ranging.driver import DriverError, make_driver, split_driver
from tests.extras.radios.recorded import (
    AOA_NODE_FRAME_0,
    DWM1001,
    LEC,
    LEC_OVERRUN,
    LES,
    LINKTRACK,
    NODE_FRAME_2,
    NODE_FRAME_3,
)


def ranges(readings) -> dict[int, float]:
    return {one.beacon: one.range for one in readings}


@pytest.mark.parametrize("frame", LINKTRACK, ids=["node 2", "node 3", "aoa 0"])
def test_linktrack_matches_the_manufacturers_parser(frame):
    expected, stamp = LINKTRACK[frame]
    readings = LinkTrack().receive(frame, 0.0)
    assert ranges(readings) == pytest.approx(expected)
    assert {one.stamp for one in readings} == {stamp}
    assert {one.sigma for one in readings} == {None}


def test_dwm1001_driver_reads_only_complete_lines():
    driver = Dwm1001()
    driver.receive(b"dwm> \r\n", 0.0)
    for line, expected in DWM1001.items():
        assert ranges(driver.receive(line, 0.1)) == expected
    assert driver.unread == 0
    assert ranges(driver.receive(LEC_OVERRUN, 0.1)) == {
        0x0090: 3.25,
        0xD91E: 3.33,
        0x0487: 0.18,
        0x15BA: 0.0,
    }
    cut = LEC[: LEC.index(b"AN2,111C,5.00")] + b"AN2,111C,5.\r\n"
    assert ranges(driver.receive(cut, 0.2)) == {0x1151: 6.44, 0x0CA8: 6.5}
    for run_together in (
        b"DIST,1,AN0,1151,5.00,8.00,2.25,6.446.50\r\n",
        b"1151[5.00,8.00,2.25]=6.486.51\r\n",
    ):
        assert driver.receive(run_together, 0.3) == []


def test_dwm1001_driver_sends_start_command_once():
    asked = []
    driver = Dwm1001()
    for step in range(200):
        words = driver.ask(0.05 * step)
        asked += [words] if words else []
        driver.receive(
            {b"\r\r": b"\r\n\r\ndwm> ", b"lec\r": b"lec\r\n"}.get(words, b""), 0.05 * step
        )
    assert asked == [b"\r\r", b"lec\r"]
    speaks = Dwm1001()  # the radio was already running, so the first line is complete
    speaks.receive(b"\n" + LES, 0.5)
    assert not any(speaks.ask(0.05 * step) for step in range(200))


LINES = {
    b"123.4\n": (123.4, 0, None, None),
    b"3,123.4\n": (123.4, 3, None, None),
    b"17.25, 3, 123.4\r\n": (123.4, 3, None, 17.25),
    b"0003,123.4\n": (123.4, 3, None, None),
    b"17.25 0x1A2B 123.4 0.1\n": (123.4, 0x1A2B, 0.1, 17.25),
    b'{"range": 123.4}\n': (123.4, 0, None, None),
    b'{"time": 17.25, "id": 3, "sigma": 0.1, "range": 123.4, "rssi": -80}\n': (
        123.4,
        3,
        0.1,
        17.25,
    ),
}


@pytest.mark.parametrize("line", LINES)
def test_lines_driver_reads_printed_ranges(line):
    driver = Lines()
    driver.receive(b"time,id,range\n", 0.0)
    (one,) = driver.receive(line, 0.1)
    assert (one.range, one.beacon, one.sigma, one.stamp) == LINES[line]


@pytest.mark.parametrize(
    "line",
    [
        b"time,id,range",
        b"range: 12",
        b"1,2,3,4,5",
        b'{"distance": 3}',
        b'{"range": null}',
        b'{"range": true}',
        b'{"range": 3',
        b"70000,12.3",
        b"-1,12.3",
        b'{"range": 1e999999999999}',
        b"[" * 900,
        b'{"a":' * 6000,
        b"\xff\xfe\x00",
    ],
)
def test_lines_driver_counts_lines_without_range(line):
    driver = Lines()
    driver.receive(b"\n", 0.0)
    found = driver.receive(line + b"\n5.0\n", 0.1)
    assert [one.range for one in found if one.range < 1e9] == [5.0]
    assert driver.unread == (0 if len(found) > 1 else len(line))


def test_lines_driver_rejects_line_with_lost_beginning():
    driver = Lines()
    assert driver.receive(b"3.4\n123.5\n12", 0.0) == Lines().receive(b"\n123.5\n", 0.0)
    # 5 s later: the cable was disconnected, so the next line has lost its beginning
    assert driver.receive(b"3.4\n123.6\n", 5.0) == Lines().receive(b"\n123.6\n", 0.0)


STREAMS = {
    LinkTrack: b"".join(LINKTRACK) + b"\x55\x04" + NODE_FRAME_3,
    Dwm1001: b"\r\n" + LES + b"dwm> lec\r\n" + LEC + LEC_OVERRUN,
    Lines: b"\n" + b"".join(LINES),
}


@pytest.mark.parametrize("make", STREAMS)
@given(cuts=st.lists(st.integers(0, 700), max_size=12))
@settings(max_examples=30, deadline=None)
def test_driver_readings_are_independent_of_chunks(make, cuts):
    stream = STREAMS[make]
    places = [0, *sorted(cuts), len(stream)]
    whole = make()
    pieces = make()
    expected = whole.receive(stream, 0.0)
    found = [one for a, b in pairwise(places) for one in pieces.receive(stream[a:b], 0.0)]
    assert found == expected
    assert len(expected) >= 6
    assert pieces.unread == whole.unread


@given(noise=st.binary(max_size=300), at=st.integers(0, 400))
@settings(max_examples=100, deadline=None)
def test_damaged_linktrack_frame_is_rejected(noise, at):
    damaged = bytearray(NODE_FRAME_3)
    damaged[at % len(damaged)] ^= 0x41
    driver = LinkTrack()
    readings = driver.receive(noise + damaged + NODE_FRAME_2 * 30, 0.0)
    good = set(LINKTRACK[NODE_FRAME_2][0].values())
    assert [one.range for one in readings][-40:] == [*LINKTRACK[NODE_FRAME_2][0].values()] * 10
    assert {one.range for one in readings} <= good
    assert driver.unread >= len(NODE_FRAME_3)
    unread = driver.unread
    for _ in range(10):
        driver.receive(b"\x55\x04\xff\xff" * 100, 0.0)
    assert driver.unread - unread > 3_000
    assert len(driver.receive(AOA_NODE_FRAME_0 * 5, 0.0)) >= 16


def test_driver_name_precedes_endpoint():
    assert split_driver("linktrack:/dev/ttyUSB0") == ("linktrack", "/dev/ttyUSB0")
    assert split_driver("lines:udpin:0.0.0.0:5005") == ("lines", "udpin:0.0.0.0:5005")
    assert split_driver("udpin:0.0.0.0:5005") == (None, "udpin:0.0.0.0:5005")
    with pytest.raises(
        DriverError, match="no driver 'linktrak'; there are dwm1001, lines, linktrack"
    ):
        make_driver("linktrak")


def test_ranging_watch_refuses_time_that_is_no_number(circnav):
    assert circnav("ranging", "watch", "lines:udpin:127.0.0.1:0", "--seconds", "nan").code == 2
