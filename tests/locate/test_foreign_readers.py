"""What leaves the survey, read by decoders that share nothing with what wrote it: the wire layout of MAVLink by hand,
the package `geojson`, a TAK library."""

import struct

import geojson
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.locate import export
from circnav_mav.locate.messages import orbit_status
from tests.locate.test_outputs import PLACE

ORBIT_STATUS, CRC_EXTRA, LAYOUT = 360, 11, "<QfiifB"
"""Its id, the byte that seeds its checksum, and its fields by size: time_usec, radius, x, y, z, frame."""


def x25(data: bytes) -> int:
    """The checksum of MAVLink: CRC-16/MCRF4XX, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def test_the_orbit_status_is_what_a_c_decoder_reads_from_the_wire() -> None:
    """As QGroundControl does: radius positive clockwise, x, y degrees * 1e7 as int32, z metres, frame MAV_FRAME_GLOBAL
    (0), whose byte MAVLink 2 leaves out at the end of a payload."""
    orbit = Orbit(60.0, Direction.COUNTERCLOCKWISE, 15.0, 0.35)
    frame = orbit_status(PLACE, orbit, 12.0).pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=194))
    length, payload = frame[1], frame[10 : 10 + frame[1]]
    assert (frame[0], *frame[5:7]) == (0xFD, 1, 194) and int.from_bytes(frame[7:10], "little") == ORBIT_STATUS
    assert x25(frame[1 : 10 + length] + bytes([CRC_EXTRA])) == int.from_bytes(
        frame[10 + length : 12 + length], "little"
    )
    time, radius, x, y, z, what = struct.unpack(LAYOUT, payload.ljust(struct.calcsize(LAYOUT), b"\0"))
    assert (time, radius, z, what) == (12_000_000, -60.0, 584.0, 0)
    # 40 m north and 30 m east of 35 S 149 E: a degree is 110 941 m of the meridian, 91 288 m of the parallel there
    assert (x / 1e7, y / 1e7) == pytest.approx((-35 + 40 / 110_941, 149 + 30 / 91_288), abs=2e-7)


def test_the_package_geojson_finds_nothing_wrong() -> None:
    table = geojson.loads(export.geojson({"target": PLACE}, [(-35.0, 149.0), (-35.001, 149.001)]))
    assert isinstance(table, geojson.FeatureCollection) and table.is_valid, table.errors()
    assert [feature.geometry.type for feature in table.features] == ["Point", "Polygon", "LineString"]
    assert all(feature.is_valid for feature in table.features)


def test_a_tak_library_reads_place_error_and_motion() -> None:
    """takproto turns the XML into TAK's own protocol buffers, and refuses what it cannot."""
    takproto = pytest.importorskip("takproto")
    data = export.cursor_on_target(PLACE, "tag 17", 1_750_000_000_000_000, 12.0)
    event = takproto.parse_proto(takproto.xml2proto(data.decode())).cotEvent
    assert (event.lat, event.lon) == pytest.approx((PLACE.latitude, PLACE.longitude), abs=1e-7)
    assert (event.type, event.how, event.ce, event.le) == ("a-u-G", "m-f", 3.0, 9999999.0)
    assert (event.detail.track.course, event.detail.contact.callsign) == (135.0, "tag 17")
    assert event.staleTime - event.sendTime == 30_000
    assert event.sendTime == 1_750_000_012_000
