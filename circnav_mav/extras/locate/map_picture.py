"""Map of the located targets, as a picture."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from circnav_mav.extras.locate.place import Plane
from circnav_mav.report.plots import STYLE, literal, save

TRACK = "#0063a6"
TARGET = "#d55e00"


def plot_map(path: Path, table: str, title: str) -> None:
    """Draw the features of `export.geojson` twice: with the track, and zoomed to the ellipses.
    Raises OSError."""
    features = json.loads(table)["features"]
    points = [feature for feature in features if feature["geometry"]["type"] == "Point"]
    longitude, latitude = points[0]["geometry"]["coordinates"]
    plane = Plane(latitude, longitude)
    places = np.array(
        [plane.to_metres(*point["geometry"]["coordinates"][::-1]) for point in points]
    )
    reaches = np.array([[point["properties"]["ellipse_95"]["semi_major_m"]] for point in points])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 5.5), layout="constrained")
        figure.suptitle(literal(title))
        wide, near = figure.subplots(1, 2)
        for axis in (wide, near):
            for feature in features:
                _draw(axis, feature, plane)
            axis.set_aspect("equal", adjustable="datalim")
            axis.set(xlabel=f"east of {latitude:.6f} {longitude:.6f}, m", ylabel="north, m")
        low, high = (places - reaches).min(axis=0), (places + reaches).max(axis=0)
        middle = (low + high) / 2
        half = max(2.0, 0.75 * float((high - low).max()))
        near.set_aspect("equal", adjustable="box")
        near.set(
            xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half)
        )
        wide.legend(loc="upper right", fontsize=8)
        save(figure, path)


def _draw(axis: Any, feature: dict[str, Any], plane: Plane) -> None:
    geometry = feature["geometry"]
    name = literal(str(feature["properties"]["name"]))
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
