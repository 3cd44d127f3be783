"""What summary.json and manifest.json of a run may hold: whoever reads them gets what is as it should be, and what is
missing or of another kind is unknown."""

from collections.abc import Callable
from typing import Any

Table = dict[str, Any]
Shape = Callable[[Any], bool]
MOST = 1e15
"""No number of a run is as large: counts, metres, and seconds are smaller."""
YEAR_2100_US = 4_102_444_800_000_000


def known_manifest(table: Any) -> Table:
    """What a manifest.json says that can be believed."""
    return _known(table, MANIFEST)


def known_summary(table: Any) -> Table:
    """What a summary.json says that can be believed. The figures of the circle belong together: all or none."""
    circle = _known(table, CIRCLE)
    return _known(table, SUMMARY) | (circle if len(circle) == len(CIRCLE) and _consistent(circle) else {})


def _known(table: Any, shapes: dict[str, Shape]) -> Table:
    if not isinstance(table, dict):
        return {}
    return {key: table[key] for key, fits in shapes.items() if key in table and fits(table[key])}


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MOST


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _count(value: Any) -> bool:
    return isinstance(value, int) and _number(value) and value >= 0


def _length(value: Any) -> bool:
    return _number(value) and value > 0


def _counts(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_count, value.values()))


def _table(value: Any) -> bool:
    return isinstance(value, dict)


def _epoch(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 < value < YEAR_2100_US


def _or_none(fits: Shape) -> Shape:
    return lambda value: value is None or fits(value)


def _consistent(figures: Table) -> bool:
    """Mean and RMS error of the radius are known together."""
    return (figures["radius_mean_m"] is None) == (figures["radius_rms_error_m"] is None)


def _truth(value: Any) -> bool:
    return len(found := _known(value, TRUTH)) == len(TRUTH) and _consistent(found)


FIGURES: dict[str, Shape] = dict.fromkeys(("settled_s", "radius_mean_m", "radius_rms_error_m"), _or_none(_number))
TRUTH: dict[str, Shape] = FIGURES | {"direction": _or_none(_text), "closest_approach_m": _number}
CIRCLE: dict[str, Shape] = FIGURES | {
    "desired_radius_m": _length,
    "direction": _text,
    "direction_commanded": _or_none(_text),
    "engaged_s": _or_none(_number),
    "flown_s": _number,
    "truth": _or_none(_truth),
}
SUMMARY: dict[str, Shape] = {
    "mission": _text,
    "voice": _text,
    "outcome": _text,
    "reason": _text,
    "samples_accepted": _count,
    "samples_rejected": _counts,
    "frames_refused": _counts,
    "setpoints_sent": _count,
    "firmware": _or_none(_text),
    "version": _text,
    "epoch_us": _epoch,
    "steered_s": _number,
    "height_min_m": _or_none(_number),
    "height_max_m": _or_none(_number),
    "turn_std_deg_s": _or_none(_number),
    "turn_at_limit": _or_none(_number),
    "turn_variation_rad_s2": _or_none(_number),
    "turn_limit_cycle": _or_none(_flag),
    "turn_gain": _or_none(_number),
    "turn_delay_s": _or_none(_number),
    "gain_share": _or_none(_number),
    "law_changes": _count,
    "clock_speed": _or_none(_number),
    "recording_problem": _or_none(_text),
}
MANIFEST: dict[str, Shape] = {
    "mission": _text,
    "voice": _text,
    "epoch_us": _epoch,
    "seeds": _table,
    "versions": _table,
    "autopilot": _or_none(_table),
    "outcome": _or_none(_text),
    "reason": _or_none(_text),
    "exit": _or_none(_count),
}
