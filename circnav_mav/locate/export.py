"""The place for maps: GeoJSON (RFC 7946), KML 2.2, Cursor on Target 2.0. Heights stay out of coordinates: these formats
mean the ellipsoid's, a vehicle counts from the sea."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from math import cos, pi, radians, sin
from typing import Any
from xml.etree import ElementTree as Xml

from circnav_mav.locate.place import Place

UNKNOWN = "9999999.0"
"""Cursor on Target's number for a height or an error that is not known."""
COT_STALE = 30.0
CORNERS = 72


def ring(place: Place) -> list[list[float]]:
    """The 95 % ellipse as longitude and latitude, counter-clockwise and closed."""
    ellipse, azimuth = place.ellipse, radians(place.ellipse.azimuth)
    points = []
    for corner in range(CORNERS + 1):
        angle = 2 * pi * (corner % CORNERS) / CORNERS
        along, across = ellipse.major * cos(angle), ellipse.minor * sin(angle)
        east = place.east + along * sin(azimuth) - across * cos(azimuth)
        north = place.north + along * cos(azimuth) + across * sin(azimuth)
        latitude, longitude = place.plane.to_degrees(east, north)
        points.append([round(longitude, 8), round(latitude, 8)])
    return points


def geojson(places: dict[str, Place], track: Iterable[tuple[float, float]] = ()) -> str:
    """A FeatureCollection: of each target the point and its ellipse, and the vehicle's track (latitude, longitude)."""
    features = []
    for name, place in places.items():
        point = {"type": "Point", "coordinates": [round(place.longitude, 8), round(place.latitude, 8)]}
        features.append(_feature(point, {"name": name, **place.plain()}))
        features.append(_feature({"type": "Polygon", "coordinates": [ring(place)]}, {"name": f"{name}, 95 %"}))
    way = [[round(longitude, 7), round(latitude, 7)] for latitude, longitude in track]
    if len(way) > 1:
        features.append(_feature({"type": "LineString", "coordinates": way}, {"name": "vehicle"}))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False)


def kml(places: dict[str, Place]) -> str:
    """Placemarks with their ellipses."""
    root = Xml.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = Xml.SubElement(root, "Document")
    for name, place in places.items():
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
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


def cursor_on_target(place: Place, name: str, epoch_us: int, now: float) -> bytes:
    """One event of an unknown thing on the ground. ce: one standard deviation, m, as the format means it."""
    time = datetime.fromtimestamp(epoch_us / 1e6, UTC) + timedelta(seconds=now)
    words: dict[str, Any] = {"version": "2.0", "uid": f"circnav.{name}", "type": "a-u-G", "how": "m-f"}
    event = Xml.Element("event", words | {"time": _zulu(time), "start": _zulu(time)})
    event.set("stale", _zulu(time + timedelta(seconds=COT_STALE)))
    where = {"lat": f"{place.latitude:.8f}", "lon": f"{place.longitude:.8f}", "hae": UNKNOWN}
    Xml.SubElement(event, "point", where | {"ce": f"{place.sigma:.1f}", "le": UNKNOWN})
    detail = Xml.SubElement(event, "detail")
    Xml.SubElement(detail, "contact", callsign=name)
    if place.moves:
        Xml.SubElement(detail, "track", course=f"{place.course:.1f}", speed=f"{place.speed:.2f}")
    Xml.SubElement(detail, "remarks").text = place.words()
    return b'<?xml version="1.0" encoding="UTF-8" standalone="yes"?>' + Xml.tostring(event)


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _zulu(time: datetime) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
