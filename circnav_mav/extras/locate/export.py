"""Export of the place as MAVLink messages, GeoJSON (RFC 7946) and KML 2.2.

Map coordinates are exported without height: GeoJSON counts heights from the ellipsoid, a vehicle
counts them from sea level.
"""

import json
import re
from collections.abc import Iterable
from math import cos, isfinite, pi, radians, sin
from typing import Any
from xml.etree import ElementTree as Xml

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.place import Place
from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message

NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML does not allow: control characters and surrogates."""


def named_values(place: Place, now: float) -> list[Message]:
    """Return NAMED_VALUE_FLOAT messages for ground station graphs.

    They hold the target's position east and north of the first vehicle position (m), its standard
    deviation (m) and the speed of the target (m/s).
    """
    values = {
        "CN_TEAST": place.east,
        "CN_TNORTH": place.north,
        "CN_TSIG": place.sigma,
        "CN_TSPD": place.speed,
    }
    if place.up_known:
        values["CN_TALT"] = place.up
    stamp = our_boot_ms(now)
    return [
        dialect.MAVLink_named_value_float_message(stamp, name.encode(), value)
        for name, value in values.items()
        if isfinite(value)
    ]


def orbit_status(place: Place, orbit: Orbit, now: float) -> Message:
    """Return ORBIT_EXECUTION_STATUS, from which QGroundControl draws the circle. Positive radius:
    clockwise. z: target altitude above sea level, m, or 0 if unknown."""
    x = round(place.latitude * 1e7)
    y = round(place.longitude * 1e7)
    radius = orbit.radius if orbit.direction is Direction.CLOCKWISE else -orbit.radius
    z = place.up if place.up_known else 0.0
    return dialect.MAVLink_orbit_execution_status_message(
        round(now * 1e6), radius, dialect.MAV_FRAME_GLOBAL, x, y, z
    )


CORNERS = 72
"""Number of corners of the drawn ellipse, one every 5 deg. The chords deviate from the ellipse by
at most 0.1 % of the radius."""


def ring(place: Place) -> list[list[float]]:
    """Return the 95 % ellipse as a closed ring of longitude and latitude, counter-clockwise."""
    ellipse = place.ellipse
    azimuth = radians(place.ellipse.azimuth)
    points = []
    for corner in range(CORNERS + 1):
        angle = 2 * pi * (corner % CORNERS) / CORNERS
        along = ellipse.major * cos(angle)
        across = ellipse.minor * sin(angle)
        east = place.east + along * sin(azimuth) - across * cos(azimuth)
        north = place.north + along * cos(azimuth) + across * sin(azimuth)
        latitude, longitude = place.plane.to_degrees(east, north)
        points.append([round(longitude, 8), round(latitude, 8)])
    return points


def geojson(places: dict[str, Place], *tracks: Iterable[tuple[float, float]]) -> str:
    """Return a FeatureCollection: point and ellipse of each target, and vehicle tracks (latitude,
    longitude)."""
    shapes: list[tuple[str, Any, dict[str, Any]]] = []
    for name, place in places.items():
        point = [round(place.longitude, 8), round(place.latitude, 8)]
        shapes.append(("Point", point, {"name": name, **place.plain()}))
        shapes.append(("Polygon", [ring(place)], {"name": f"{name}, 95 %"}))
    for track in tracks:
        way = [[round(longitude, 7), round(latitude, 7)] for latitude, longitude in track]
        if len(way) > 1:
            shapes.append(("LineString", way, {"name": "vehicle"}))
    features = [
        {
            "type": "Feature",
            "geometry": {"type": kind, "coordinates": coordinates},
            "properties": properties,
        }
        for kind, coordinates, properties in shapes
    ]
    return json.dumps(
        {"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False
    )


def kml(places: dict[str, Place]) -> str:
    """Return placemarks with their ellipses, as KML."""
    root = Xml.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = Xml.SubElement(root, "Document")
    for given, place in places.items():
        name = NOT_IN_XML.sub("?", given)
        mark = Xml.SubElement(document, "Placemark")
        Xml.SubElement(mark, "name").text = name
        Xml.SubElement(mark, "description").text = place.words()
        point = Xml.SubElement(mark, "Point")
        Xml.SubElement(point, "coordinates").text = f"{place.longitude:.8f},{place.latitude:.8f}"
        area = Xml.SubElement(document, "Placemark")
        Xml.SubElement(area, "name").text = f"{name}, 95 %"
        boundary = Xml.SubElement(Xml.SubElement(area, "Polygon"), "outerBoundaryIs")
        corners = " ".join(f"{longitude:.8f},{latitude:.8f}" for longitude, latitude in ring(place))
        Xml.SubElement(Xml.SubElement(boundary, "LinearRing"), "coordinates").text = corners
    Xml.indent(root)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"
    )
