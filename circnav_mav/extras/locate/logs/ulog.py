"""PX4's ULog files (.ulg), read by pyulog."""

import io
from contextlib import redirect_stdout
from importlib.util import find_spec
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.extras.locate.logs.interface import FIX_3D, Format, ReadOptions, with_fix
from circnav_mav.extras.locate.place import Array
from circnav_mav.extras.locate.range_log import Position, RangeLog
from circnav_mav.mav.ranging.distance_sensor import DOWNWARD
from circnav_mav.runlog.run_folder import RunError

MAGIC = b"ULog\x01\x12\x35"
INSTALL = "pyulog is not installed: pip install 'circnav-mav[ulog]', or convert it with ulog2csv"
TOPICS = [
    "vehicle_global_position",
    "vehicle_gps_position",
    "sensor_gps",
    "distance_sensor",
    "ranging_beacon",
    "debug_key_value",
]


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    if find_spec("pyulog") is None:
        raise RunError(INSTALL)
    named, _, _ = options.range_name.partition(".")
    try:
        with redirect_stdout(io.StringIO()):  # pyulog prints warnings
            parsed = _bounded_parser()(str(path), [*TOPICS, named], True)
    except RunError:
        raise
    except Exception as error:  # pyulog raises exceptions of any kind on damaged files
        raise RunError(f"cannot be read as a ULog file: {error!r}") from None
    data = parsed.data_list
    log = RangeLog()
    if parsed.file_corruption:
        log.note("damaged: parts of the log are left out")
    try:
        _collect(log, data, options)
    except KeyError as error:
        raise RunError(f"cannot be read as a ULog file: no field {error.args[0]}") from None
    return [log]


def _bounded_parser() -> Any:
    """Return pyulog's parser with a limit of memory for the fields of the topics."""
    from pyulog.core import ULog

    size = 0

    class Parser(ULog):  # type: ignore[misc]
        class _MessageAddLogged(ULog._MessageAddLogged):  # type: ignore[misc]
            def _parse_nested_type(self, prefix: str, kind: str, formats: Any) -> None:
                # pyulog stores a name for each field and each element of an array, before it has
                # read any data. Nested arrays multiply: 200 bytes needed 1.6 GB.
                nonlocal size
                for _, count, name in formats[kind].fields:
                    size += max(count, 1) * (len(prefix) + len(name) + 10)
                # Largest length of all names, characters. Logs of PX4 have less than a million.
                if size > 10_000_000:
                    raise RunError("cannot be read as a ULog file: its topics have too many fields")
                super()._parse_nested_type(prefix, kind, formats)

    return Parser


def _collect(log: RangeLog, data: list[Any], options: ReadOptions) -> None:
    """Add the positions and ranges of the topics. Raises KeyError for a missing field."""
    named, _, part = options.range_name.partition(".")
    for topic in data:
        try:
            _ranges(log, topic, options)
        except KeyError as error:
            log.note(f"{topic.name} has no field {error.args[0]} and is left out")
        if topic.name == named and part in topic.data:
            for time, slant in zip(_time(topic.data), topic.data[part], strict=True):
                options.add(log, options.range_name, float(time), float(slant))
    gps = next((topic.data for name in ("vehicle_gps_position", "sensor_gps") for topic in data
                if topic.name == name and topic.multi_id == 0), None)  # fmt: skip
    fused = next((topic.data for topic in data if topic.name == "vehicle_global_position"), None)
    log.positions = _positions(fused, gps)
    log.names = {
        name for topic in data if topic.name == "debug_key_value" for name in _keys(topic.data)
    }


def _time(data: dict[str, Array]) -> Array:
    """Return the seconds since boot: the sensor's timestamp if set, else the time of
    publication."""
    stamp = data["timestamp"]
    sample = data.get("timestamp_sample", stamp)
    return np.asarray(np.where(sample > 0, sample, stamp) / 1e6, float)


def _positions(fused: dict[str, Array] | None, gps: dict[str, Array] | None) -> list[Position]:
    """Return the positions of the filter, or of the GPS receiver if the filter has none."""
    if gps is not None:
        time = _time(gps)
        fix = gps["fix_type"] >= FIX_3D
    if fused is not None and len(fused["timestamp"]) > 1:
        valid = fused.get("lat_lon_valid", np.ones(len(fused["lat"]))).astype(bool)
        rows = list(zip(_time(fused), fused["lat"], fused["lon"], fused["alt"], strict=True))
        state: list[bool | None] = [None] * len(rows)
        if gps is not None:
            at = np.searchsorted(time, [row[0] for row in rows], side="right") - 1
            state = [bool(fix[index]) if index >= 0 else None for index in at]
        return with_fix(
            [(_floats(row), one) for row, one, good in zip(rows, state, valid, strict=True) if good]
        )
    if gps is None:
        return []
    if "latitude_deg" in gps:
        latitude = gps["latitude_deg"]
        longitude = gps["longitude_deg"]
        altitude = gps["altitude_msl_m"]
    else:  # PX4 before 1.14 logs degrees times ten million, and mm
        latitude = gps["lat"] / 1e7
        longitude = gps["lon"] / 1e7
        altitude = gps["alt"] / 1e3
    rows = list(zip(time, latitude, longitude, altitude, strict=True))
    return with_fix([(_floats(row), bool(one)) for row, one in zip(rows, fix, strict=True)])


def _floats(row: tuple[Any, ...]) -> Position:
    time, latitude, longitude, altitude = map(float, row)
    return time, latitude, longitude, altitude


def _ranges(log: RangeLog, topic: Any, options: ReadOptions) -> None:
    data = topic.data
    match topic.name:
        case "distance_sensor":
            good = (data["orientation"] != DOWNWARD) & (
                data.get("signal_quality", np.array(-1)) != 0
            )
            slant = data["current_distance"]
            variance = data["variance"]
            far = data["max_distance"]
            good &= (far <= 0) | (slant < far)
            tags = [f"distance sensor {topic.multi_id}"] * len(slant)
            sigma = np.where(variance > 0, np.sqrt(np.maximum(variance, 0)), nan)
        case "ranging_beacon":
            slant = data["range"]
            good = np.ones(len(data["range"]), bool)
            tags = [f"beacon {number}" for number in data["beacon_id"]]
            sigma = np.where(data["range_accuracy"] > 0, data["range_accuracy"], nan)
        case "debug_key_value":
            slant = data["value"]
            sigma = np.full(len(data["value"]), nan)
            tags = _keys(data)
            good = np.array([name == options.range_name for name in tags])
        case _:
            return
    for time, one, spread, tag, usable in zip(_time(data), slant, sigma, tags, good, strict=True):
        if usable:
            options.add(log, tag, float(time), float(one), float(spread))


def _keys(data: dict[str, Array]) -> list[str]:
    """Return the keys of debug_key_value, which pyulog stores as one column per letter."""
    columns = [data[f"key[{index}]"] for index in range(10) if f"key[{index}]" in data]
    letters = np.array(columns).T.astype(np.uint8)
    return [bytes(row).split(b"\0")[0].decode("ascii", "replace") for row in letters]


ULOG = Format(
    name="a PX4 log (ULog)",
    matches=lambda head: head.startswith(MAGIC),
    read=_read,
    ranges="distance_sensor that does not look down, ranging_beacon",
    positions="vehicle_global_position or vehicle_gps_position with a 3D fix",
)
