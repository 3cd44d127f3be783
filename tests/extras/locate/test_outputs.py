"""Output of the locator, read by independent readers: the wire layout of MAVLink by hand,
pymavlink, the package `geojson`, an XML parser."""

import struct
from xml.etree import ElementTree as Xml

import geojson
import numpy as np
import pytest
from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, to_degrees
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.locate import export
from circnav_mav.extras.locate.export import orbit_status
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import Direction, Orbit
from tests.rig import x25

PLACE = Place(
    time=12.0,
    plane=Plane(-35.0, 149.0),
    east=30.0,
    north=40.0,
    up=584.0,
    covariance=np.diag([9.0, 1.0]),
    up_sigma=0.5,
    up_known=True,
    velocity=(1.0, -1.0),
    velocity_sigma=0.2,
)
HERE = pytest.approx((-35 + 40 / 110_941, 149 + 30 / 91_288), abs=5e-7)
"""Latitude and longitude of PLACE, deg. At this latitude one degree of latitude is 110,941 m and
one degree of longitude 91,288 m."""
ORBIT_STATUS = 360
CRC_EXTRA = 11
LAYOUT = "<QfiifB"
"""Message id of ORBIT_EXECUTION_STATUS, its CRC_EXTRA, and its fields in wire order: time_usec,
radius, x, y, z, frame."""


def test_local_plane_agrees_with_geodesy_of_emulator():
    plane = Plane(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
    for north, east in ((0.0, 3000.0), (-3000.0, 0.0), (2000.0, -2000.0)):
        assert plane.to_metres(*to_degrees(north, east)) == pytest.approx((east, north), abs=0.05)
        assert plane.to_metres(*plane.to_degrees(east, north)) == pytest.approx(
            (east, north), abs=1e-6
        )


def test_local_plane_continues_across_date_line():
    plane = Plane(0.0, 179.9999)
    _, longitude = plane.to_degrees(100.0, 0.0)
    assert longitude == pytest.approx(-179.9992, abs=1e-4)
    assert plane.to_metres(0.0, longitude)[0] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)]
)
def test_orbit_status_matches_its_wire_layout(direction, sign):
    """As QGroundControl's Vehicle.cc decodes it: radius positive clockwise; x, y in degrees * 1e7
    as int32; z in meters; frame MAV_FRAME_GLOBAL (0). MAVLink 2 omits the zero byte of the frame at
    the end of the payload."""
    orbit = Orbit(60.0, direction, 15.0, 0.35)
    frame = orbit_status(PLACE, orbit, 12.0).pack(
        mavlink.MAVLink(None, srcSystem=1, srcComponent=194)
    )
    end = 10 + frame[1]
    assert (frame[0], *frame[5:7]) == (0xFD, 1, 194) and int.from_bytes(
        frame[7:10], "little"
    ) == ORBIT_STATUS
    assert x25(frame[1:end] + bytes([CRC_EXTRA])) == int.from_bytes(frame[end : end + 2], "little")
    time, radius, x, y, z, what = struct.unpack(
        LAYOUT, frame[10:end].ljust(struct.calcsize(LAYOUT), b"\0")
    )
    assert (time, radius, z, what) == (12_000_000, sign * 60.0, 584.0, 0)
    assert (x / 1e7, y / 1e7) == HERE


def test_error_ellipse_follows_covariance():
    """For a covariance diag(9, 1) m^2 of east and north, the semi-axes of the 95 % ellipse are
    2.4477 times 3 m (east) and 1 m."""
    ellipse = PLACE.ellipse
    assert (ellipse.major, ellipse.minor, ellipse.azimuth) == pytest.approx(
        (7.343, 2.448, 90.0), abs=1e-3
    )
    corners = np.array([PLACE.plane.to_metres(lat, lon) for lon, lat in export.ring(PLACE)]) - [
        30.0,
        40.0,
    ]
    assert np.abs(corners).max(axis=0) == pytest.approx([7.343, 2.448], abs=0.01)


def test_geojson_is_valid():
    """Positions and rings follow RFC 7946, sections 3.1.1 and 3.1.6."""
    table = geojson.loads(export.geojson({"target": PLACE}, [(-35.0, 149.0), (-35.001, 149.001)]))
    assert isinstance(table, geojson.FeatureCollection) and table.is_valid, table.errors()
    point, area, track = (feature.geometry for feature in table.features)
    assert tuple(point.coordinates[::-1]) == HERE
    x, y = np.array(area.coordinates[0]).T
    assert (x[0], y[0]) == (x[-1], y[-1]) and np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0
    assert track == {"type": "LineString", "coordinates": [[149.0, -35.0], [149.001, -35.001]]}


def test_kml_is_valid():
    names = {"k": "http://www.opengis.net/kml/2.2"}
    text = Xml.fromstring(export.kml({"a <b> \x1b\x00": PLACE})).findtext(
        ".//k:Point/k:coordinates", "", names
    )
    assert tuple(float(part) for part in text.split(","))[::-1] == HERE
