"""A plain map grid, north up: targets with their 95 % ellipses, and the vehicle's track; drawn from GeoJSON."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from circnav_mav.locate.geodesy import Plane
from circnav_mav.report.pictures import STYLE, literal, save

TRACK, TARGET = "#0063a6", "#d55e00"


def plot_map(path: Path, table: str, title: str) -> None:
    """Draw the features of a GeoJSON of ours: once with the track, once as near as the ellipses are. Raises OSError."""
    features = json.loads(table)["features"]
    points = [feature for feature in features if feature["geometry"]["type"] == "Point"]
    longitude, latitude = points[0]["geometry"]["coordinates"]
    plane = Plane(latitude, longitude)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 5.5), layout="constrained")
        figure.suptitle(literal(title))
        wide, near = figure.subplots(1, 2)
        for axis in (wide, near):
            for feature in features:
                _draw(axis, feature, plane)
            axis.set_aspect("equal", adjustable="datalim")
            axis.set_xlabel(f"east of {latitude:.6f} {longitude:.6f}, m")
            axis.set_ylabel("north, m")
        half = max(2.0, 1.5 * max(point["properties"]["ellipse_95"]["semi_major_m"] for point in points[:1]))
        near.set_aspect("equal", adjustable="box")
        near.set_xlim(-half, half)
        near.set_ylim(-half, half)
        wide.legend(loc="upper right", fontsize=8)
        save(figure, path)


def _draw(axis: Any, feature: dict[str, Any], plane: Plane) -> None:
    geometry, name = feature["geometry"], literal(str(feature["properties"]["name"]))
    longitude, latitude = np.reshape(np.array(geometry["coordinates"], float), (-1, 2)).T
    east, north = plane.to_metres(latitude, longitude)
    match geometry["type"]:
        case "Point":
            axis.plot(east, north, "+", color=TARGET, ms=10, mew=2, label=name)
        case "Polygon":
            axis.fill(east, north, color=TARGET, alpha=0.15, lw=0)
            axis.plot(east, north, color=TARGET, lw=0.8)
        case _:
            axis.plot(east, north, color=TRACK, lw=0.8, label=name)
