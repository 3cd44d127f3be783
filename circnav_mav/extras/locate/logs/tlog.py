"""MAVLink telemetry logs: positions of every vehicle, each with the ranges of its own radios."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from math import nan
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.logs.interface import (
    FIX_3D,
    Format,
    ReadOptions,
    by_boot,
    first_track,
)
from circnav_mav.extras.locate.range_log import Position, RangeLog
from circnav_mav.mav.codec import Ids, Message, ids
from circnav_mav.mav.ranging.interface import Reading, Reject
from circnav_mav.mav.ranging.named_value_float import NAMED_VALUE_FLOAT
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.pilot.method import RECEIVERS
from circnav_mav.runlog.run_folder import RunError
from circnav_mav.runlog.tlog import read_messages

OURS = "CN_TEAST"
"""Name of the NAMED_VALUE_FLOAT by which the locator of circnav is recognized. Values of the
locator are not ranges."""
NOT_VEHICLES = {
    dialect.MAV_TYPE_ANTENNA_TRACKER,
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ADSB,
    dialect.MAV_TYPE_CAMERA,
    dialect.MAV_TYPE_CHARGING_STATION,
    dialect.MAV_TYPE_FLARM,
    dialect.MAV_TYPE_SERVO,
    dialect.MAV_TYPE_ODID,
    dialect.MAV_TYPE_BATTERY,
    dialect.MAV_TYPE_PARACHUTE,
    dialect.MAV_TYPE_LOG,
    dialect.MAV_TYPE_OSD,
    dialect.MAV_TYPE_IMU,
    dialect.MAV_TYPE_GPS,
    dialect.MAV_TYPE_WINCH,
}
"""Types of senders that may report a position but have no ranging radio."""
NAMED = ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT")
KINDS = {kind.id: kind for kind in RANGING_MESSAGES.values()}
KINDS[dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT] = NAMED_VALUE_FLOAT  # the same fields
FILTERED = "GLOBAL_POSITION_INT"
"""Message with the position of the autopilot's filter."""
WANTED = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT, dialect.MAVLINK_MSG_ID_GPS2_RAW,
    *KINDS,
}  # fmt: skip


@dataclass(slots=True)
class _Sender:
    """One MAVLink sender.

    vehicle: True for a vehicle, None before the first HEARTBEAT.
    fixes: True for each receiver with a fix, empty before the first report.
    tracks: positions by message, each with the fix at its time.
    log: its ranges and names of values.
    """

    vehicle: bool | None = None
    fixes: dict[str, bool] = field(default_factory=dict)
    tracks: dict[str, list[tuple[Position, bool | None]]] = field(default_factory=dict)
    log: RangeLog = field(default_factory=RangeLog)

    def moved(self, time: float, message: Message) -> None:
        """Add a position: of a receiver with its own fix, of the filter with that of any
        receiver."""
        kind = message.get_type()
        if kind in RECEIVERS:
            self.fixes[kind] = message.fix_type >= FIX_3D
        elif kind != FILTERED:
            return
        any_fix = any(self.fixes.values()) if self.fixes else None
        position = time, message.lat / 1e7, message.lon / 1e7, message.alt / 1000
        rows = self.tracks.setdefault(kind, [])
        rows.append((position, self.fixes.get(kind, any_fix)))


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    named, _, _ = options.range_name.partition(".")
    wanted = WANTED | {kind.id for kind in dialect.mavlink_map.values() if kind.msgname == named}
    rows = ((stamp / 1e6, (stamp, message)) for stamp, message in read_messages(path, wanted))
    return by_boot(rows, lambda part: _collect(part, options))


def _collect(messages: Iterable[tuple[int, Message]], options: ReadOptions) -> list[RangeLog]:
    """Return the vehicles found in a log. messages: time (us since 1970) and message."""
    senders = dict[Ids, _Sender]()
    newest = dict[str, tuple[float | None, float]]()
    began: int | None = None
    for stamp, message in messages:
        began = stamp if began is None else began
        time = (stamp - began) / 1e6
        sender = senders.setdefault(ids(message), _Sender())
        kind = message.get_type()
        if kind == "HEARTBEAT":
            sender.vehicle = message.type not in NOT_VEHICLES
        elif kind in NAMED:
            sender.log.names.add(message.name)
        sender.moved(time, message)
        tag, reading = _range(message, options.range_name, time)
        if not isinstance(reading, Reading):
            continue
        one = reading.stamp, reading.slant
        if newest.get(tag) != one:  # autopilots repeat the newest range
            newest[tag] = one
            options.add(sender.log, tag, time, reading.slant, reading.sigma or nan)
    return _by_vehicle(senders, options)


def _by_vehicle(senders: dict[Ids, _Sender], options: ReadOptions) -> list[RangeLog]:
    """Return one log per vehicle: pair the ranges of each radio with the positions of the vehicle
    on which the radio is mounted."""
    systems = sorted({system for system, _ in senders})
    tracks = {system: track for system in systems if (track := _track(senders, system))}
    logs = {
        system: RangeLog(tracks[system], vehicle=f"vehicle {system}")
        for system in _chosen(tracks, options.vehicle)
    } or {0: RangeLog()}
    left_out = _pair(senders, tracks, logs)
    used = [log for log in logs.values() if log.ranges] or list(logs.values())[:1]
    if len(used) == 1:
        used[0].vehicle = ""
    if left_out:
        used[0].note(
            f"ranges of {', '.join(left_out)} are left out: their system id is not among those of"
            f" the vehicles ({', '.join(map(str, tracks))}); give --vehicle with the system id of"
            " the vehicle that carries the radio"
        )
    used[0].names = set[str]().union(
        *(sender.log.names for sender in senders.values() if OURS not in sender.log.names)
    )
    return used


def _chosen(tracks: Mapping[int, list[Position]], vehicle: int | None) -> Collection[int]:
    """Return the system ids of the vehicles to read. Raises RunError."""
    if vehicle is None:
        return tracks.keys()
    if vehicle not in tracks:
        found = ", ".join(map(str, tracks)) or "none"
        raise RunError(
            f"--vehicle {vehicle}: it has no positions; vehicles with positions: {found}"
        )
    return (vehicle,)


def _pair(
    senders: Mapping[Ids, _Sender], tracks: Collection[int], logs: Mapping[int, RangeLog]
) -> list[str]:
    """Add the ranges of each radio to the vehicle on which the radio is mounted. Return the ids of
    the radios of an unknown vehicle.

    tracks: system ids with positions.
    logs: vehicles to read, by system id.
    """
    left_out = []
    for (system, component), sender in senders.items():
        if system in logs:
            logs[system].ranges |= sender.log.ranges
        # A radio with its own system id belongs to the only vehicle. With several vehicles, the
        # vehicle of such a radio is unknown.
        elif system not in tracks and len(logs) == 1:
            for log in logs.values():
                log.ranges |= sender.log.ranges
        elif system not in tracks and sender.log.ranges:
            left_out.append(f"{system}/{component}")
    return left_out


def _track(senders: dict[Ids, _Sender], system: int) -> list[Position]:
    """Return the positions of a system, empty if it is not a vehicle."""
    parts = {component: sender for (other, component), sender in senders.items() if other == system}
    reported = [sender.vehicle for sender in parts.values() if sender.vehicle is not None]
    if reported and not any(reported):
        return []  # for example an antenna tracker or a ground station
    # Onboard computers repeat the autopilot's position. Prefer component 1 (the autopilot), then
    # the lowest id.
    ordered = sorted(
        parts, key=lambda component: (component != dialect.MAV_COMP_ID_AUTOPILOT1, component)
    )
    # Prefer the position of the autopilot's filter to that of a receiver. An autopilot without a
    # filter sends only GPS_RAW_INT.
    return first_track(
        parts[component].tracks.get(kind, ())
        for kind in (FILTERED, *RECEIVERS)
        for component in ordered
    )


def _range(message: Message, wanted: str, time: float) -> tuple[str, Reading | Reject | None]:
    """Return the tag of a range, and its reading if the message has one.

    wanted: MESSAGE.FIELD, or the name of a named value.
    time: time of the message in the log, s, for a field without a time of its own.
    """
    kind = message.get_type()
    named, _, part = wanted.partition(".")
    of = _of(message)
    if kind == named and part in message.get_fieldnames():
        value = getattr(message, part)
        is_number = isinstance(value, int | float)
        return f"{wanted} of {of}", Reading(value, None, time) if is_number else None
    match kind:
        case "DISTANCE_SENSOR":
            tag = f"sensor {message.id} of {of}"
        case "RANGING_BEACON":
            tag = f"beacon {message.beacon_id} of {of}"
        case _ if kind in NAMED and message.name == wanted:
            tag = f"{wanted} of {of}"
        case _:
            return "", None
    return tag, KINDS[message.get_msgId()].read(message)


def _of(message: Message) -> str:
    """Return the ids of the sender as text."""
    return f"{message.get_srcSystem()}/{message.get_srcComponent()}"


TLOG = Format(
    name="a MAVLink telemetry log (tlog)",
    matches=lambda head: len(head) > 8 and head[0] == 0 and head[8] in (0xFE, 0xFD),
    read=_read,
    ranges=f"{', '.join(kind.type for kind in RANGING_MESSAGES.values())}, NAMED_VALUE_INT",
    positions="GLOBAL_POSITION_INT, else GPS_RAW_INT or GPS2_RAW, of a vehicle with a 3D fix",
)
