"""What leaves the survey, read by others: pymavlink, an XML parser, the definitions of GeoJSON and Cursor on Target."""

import json
from datetime import datetime
from math import hypot
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from lxml import etree
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.locate.export import cursor_on_target, geojson, kml, ring
from circnav_mav.locate.geodesy import Plane
from circnav_mav.locate.messages import orbit_status, own_beacon
from circnav_mav.locate.place import Place
from sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, to_degrees

PLACE = Place(
    time=12.0, plane=Plane(-35.0, 149.0), east=30.0, north=40.0, up=584.0, covariance=np.diag([9.0, 1.0]),
    up_sigma=0.5, up_known=True, bias=0.0, bias_sigma=1.0, delay=0.0, delay_sigma=0.1, noise=0.5, used=100, outliers=2,
    velocity=(1.0, -1.0), velocity_sigma=0.2,
)  # fmt: skip

# MITRE's Event.xsd, as far as our events use it
COT_SCHEMA = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"><xs:element name="event"><xs:complexType><xs:all>
<xs:element name="detail" minOccurs="0"><xs:complexType><xs:sequence>
<xs:any processContents="skip" minOccurs="0" maxOccurs="unbounded"/></xs:sequence></xs:complexType></xs:element>
<xs:element name="point"><xs:complexType>
<xs:attribute name="lat" use="required"><xs:simpleType><xs:restriction base="xs:decimal">
<xs:minInclusive value="-90"/><xs:maxInclusive value="90"/></xs:restriction></xs:simpleType></xs:attribute>
<xs:attribute name="lon" use="required"><xs:simpleType><xs:restriction base="xs:decimal">
<xs:minInclusive value="-180"/><xs:maxInclusive value="180"/></xs:restriction></xs:simpleType></xs:attribute>
<xs:attribute name="hae" type="xs:decimal" use="required"/><xs:attribute name="ce" type="xs:decimal" use="required"/>
<xs:attribute name="le" type="xs:decimal" use="required"/></xs:complexType></xs:element></xs:all>
<xs:attribute name="version" use="required"><xs:simpleType><xs:restriction base="xs:decimal">
<xs:minInclusive value="2"/></xs:restriction></xs:simpleType></xs:attribute>
<xs:attribute name="type" use="required"><xs:simpleType><xs:restriction base="xs:string">
<xs:pattern value="\\w+(-\\w+)*(;[^;]*)?"/></xs:restriction></xs:simpleType></xs:attribute>
<xs:attribute name="uid" type="xs:string" use="required"/><xs:attribute name="time" type="xs:dateTime" use="required"/>
<xs:attribute name="start" type="xs:dateTime" use="required"/>
<xs:attribute name="stale" type="xs:dateTime" use="required"/>
<xs:attribute name="how" use="required"><xs:simpleType><xs:restriction base="xs:string">
<xs:pattern value="\\w(-\\w+)*"/></xs:restriction></xs:simpleType></xs:attribute>
</xs:complexType></xs:element></xs:schema>"""


def test_the_plane_agrees_with_the_emulators_own_geodesy_within_centimetres() -> None:
    plane = Plane(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
    for north, east in ((0.0, 3000.0), (-3000.0, 0.0), (2000.0, -2000.0)):
        assert plane.to_metres(*to_degrees(north, east)) == pytest.approx((east, north), abs=0.05)
        assert plane.to_metres(*plane.to_degrees(east, north)) == pytest.approx((east, north), abs=1e-6)


def test_a_plane_beside_the_date_line_goes_on_across_it() -> None:
    plane = Plane(0.0, 179.9999)
    _, longitude = plane.to_degrees(100.0, 0.0)
    assert longitude == pytest.approx(-179.9992, abs=1e-4)
    assert plane.to_metres(0.0, longitude)[0] == pytest.approx(100.0)


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)])
def test_the_circle_is_as_qgroundcontrol_reads_it(direction: Direction, sign: int) -> None:
    """Its Vehicle.cc: centre x, y degrees times 1e7, clockwise where the radius is positive."""
    orbit = Orbit(100.0, direction, 15.0, 0.35)
    packed = orbit_status(PLACE, orbit, 12.0).pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=194))
    (message,) = mavlink.MAVLink(None).parse_buffer(packed)
    assert message.get_type() == "ORBIT_EXECUTION_STATUS" and message.radius == sign * 100.0
    assert (message.x / 1e7, message.y / 1e7) == pytest.approx((PLACE.latitude, PLACE.longitude), abs=1e-7)
    assert message.frame == mavlink.MAV_FRAME_GLOBAL and message.z == 584.0


def test_ranging_beacon_carries_range_place_and_their_accuracy_in_millimetres() -> None:
    packed = own_beacon(PLACE, 107.7, 0.5, (1, 1), 12.0).pack(mavlink.MAVLink(None))
    (message,) = mavlink.MAVLink(None).parse_buffer(packed)
    assert (message.range, message.range_accuracy, message.hacc_est) == (107700, 500, 3000)
    assert message.lat == round(PLACE.latitude * 1e7)


def test_the_ellipse_has_its_long_axis_along_the_larger_error() -> None:
    """Covariance diag(9, 1) of east and north: 2.4477 times 3 and 1 m, the long axis due east."""
    ellipse = PLACE.ellipse
    assert (ellipse.major, ellipse.minor, ellipse.azimuth) == pytest.approx((7.343, 2.448, 90.0), abs=1e-3)
    corners = np.array([PLACE.plane.to_metres(lat, lon) for lon, lat in ring(PLACE)]) - [30.0, 40.0]
    assert np.abs(corners).max(axis=0) == pytest.approx([7.343, 2.448], abs=0.01)


def test_geojson_is_a_feature_collection_with_longitude_first_and_a_closed_ring_that_runs_left_round() -> None:
    """RFC 7946, sections 3.1.1, 3.1.6."""
    table = json.loads(geojson({"target": PLACE}, [(-35.0, 149.0), (-35.001, 149.001)]))
    point, area, track = (feature["geometry"] for feature in table["features"])
    assert table["type"] == "FeatureCollection" and all(one["type"] == "Feature" for one in table["features"])
    assert point["coordinates"] == pytest.approx([PLACE.longitude, PLACE.latitude])
    (outer,) = area["coordinates"]
    x, y = np.array(outer).T
    assert outer[0] == outer[-1] and np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0
    assert track == {"type": "LineString", "coordinates": [[149.0, -35.0], [149.001, -35.001]]}


def test_kml_is_xml_with_longitude_first() -> None:
    names = {"k": "http://www.opengis.net/kml/2.2"}
    text = Xml.fromstring(kml({"a <b>": PLACE})).find(".//k:Point/k:coordinates", names).text  # type: ignore[union-attr]
    assert [float(part) for part in (text or "").split(",")] == pytest.approx([PLACE.longitude, PLACE.latitude])


def test_cursor_on_target_fits_its_schema_and_tells_one_sigma_and_the_motion() -> None:
    data = cursor_on_target(PLACE, 'tag "<1>', 1_750_000_000_000_000, 12.0)
    etree.XMLSchema(etree.fromstring(COT_SCHEMA)).assertValid(etree.fromstring(data))
    event = Xml.fromstring(data)
    assert event.find("point").get("ce") == "3.0"  # type: ignore[union-attr]
    track = event.find("detail/track")
    assert track is not None and float(track.get("course", "")) == 135.0
    assert float(track.get("speed", "")) == pytest.approx(hypot(1, 1), abs=0.01)
    stale = datetime.fromisoformat(event.get("stale", "")) - datetime.fromisoformat(event.get("time", ""))
    assert stale.total_seconds() == 30.0
