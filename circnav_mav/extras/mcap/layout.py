"""Layout for Foxglove that shows one exported file: scene, map, events and plots of each vehicle.

Import the layout in Foxglove by Layouts, Import from file.
"""

from collections.abc import Sequence
from typing import Any

PLOTS = {
    "range, m": ("r", "measured", "desired"),
    "turn rate, rad/s, left positive": ("demanded", "turn_rate"),
    "drift, m/s": ("drift_x", "drift_y"),
    "ages, s": ("range_age", "link_age"),
}
"""Columns of the ticks by the title of their plot."""
SHOWN = ("/scene", "/truth/pose", "/estimate/pose")
"""Topics in the 3D panel."""


def frame(prefix: str, name: str) -> str:
    """Return the name of a frame of one vehicle. prefix: prefix of the vehicle's topics."""
    return f"{prefix}/{name}".lstrip("/")


def foxglove_layout(prefixes: Sequence[str]) -> dict[str, Any]:
    """Return the layout. prefixes: prefixes of the topics of each vehicle."""
    first = prefixes[0]
    topics = (prefix + topic for prefix in prefixes for topic in SHOWN)
    left: dict[str, Any] = {
        "3D!scene": {
            "followMode": "follow-none",
            "followTf": frame(first, "beacon"),
            "cameraState": {"distance": 350, "perspective": False, "phi": 0, "far": 5000},
            "topics": {topic: {"visible": True} for topic in topics},
        },
        "map!place": {"disabledTopics": [], "layer": "map", "followTopic": f"{first}/fix"},
    }
    for prefix in prefixes:
        left[f"RosOut!events{prefix.replace('/', '-')}"] = {
            "searchTerms": [],
            "minLogLevel": 1,
            "topicToRender": f"{prefix}/events",
        }
    right: dict[str, Any] = {
        f"Plot!{title.partition(',')[0]}": {
            "title": title,
            "paths": [_path(prefix, column) for prefix in prefixes for column in columns],
            "xAxisVal": "timestamp",
            "showLegend": True,
            "legendDisplay": "floating",
            "isSynced": True,
        }
        for title, columns in PLOTS.items()
    }
    return {
        "configById": left | right,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": _column([*left]), "second": _column([*right])},
    }


def _path(prefix: str, column: str) -> dict[str, Any]:
    return {
        "value": f"{prefix}/ticks.{column}",
        "enabled": True,
        "timestampMethod": "receiveTime",
        "label": f"{prefix.lstrip('/')} {column}".lstrip(),
    }


def _column(panels: Sequence[str]) -> Any:
    """Return panels below each other, of equal height, as Foxglove's tree of pairs."""
    if len(panels) == 1:
        return panels[0]
    return {
        "direction": "column",
        "splitPercentage": 100 / len(panels),
        "first": panels[0],
        "second": _column(panels[1:]),
    }
