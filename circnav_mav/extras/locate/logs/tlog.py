"""MAVLink telemetry logs: positions of every vehicle, each with the ranges of its own radios."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import nan
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.logs.interface import (
    FAR,
    FIX_3D,
    Format,
    ReadOptions,
    by_boot,
    with_fix,
)
from circnav_mav.extras.locate.range_log import EmptyLogError, Position, RangeLog
from circnav_mav.mav.codec import Ids, Message, ids
from circnav_mav.mav.ranging.interface import Reading, boot_stamp
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
WANTED = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT, dialect.MAVLINK_MSG_ID_GPS2_RAW,
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT, *KINDS,
}  # fmt: skip


@dataclass(slots=True)
class _Sender:
    """One MAVLink sender.

    vehicle: True for a vehicle, None before the first HEARTBEAT.
    fixes: True for each receiver with a fix, empty before the first report.
    positions: positions of the autopilot's filter, each with the fix at its time.
    raw: positions of the receivers, by message.
    log: its ranges and names of values.
    """

    vehicle: bool | None = None
    fixes: dict[str, bool] = field(default_factory=dict)
    positions: list[tuple[Position, bool | None]] = field(default_factory=list)
    raw: dict[str, list[tuple[Position, bool | None]]] = field(default_factory=dict)
    log: RangeLog = field(default_factory=RangeLog)


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
    named, _, part = options.range_name.partition(".")
    for stamp, message in messages:
        began = stamp if began is None else began
        time = (stamp - began) / 1e6
        sender = senders.setdefault(ids(message), _Sender())
        match message.get_type():
            case "HEARTBEAT":
                sender.vehicle = message.type not in NOT_VEHICLES
            case "GPS_RAW_INT" | "GPS2_RAW" | "GLOBAL_POSITION_INT" as kind:
                place = message.lat / 1e7, message.lon / 1e7
                position = time, *place, message.alt / 1000
                if kind == "GLOBAL_POSITION_INT":
                    fixed = any(sender.fixes.values()) if sender.fixes else None
                    sender.positions.append((position, fixed))
                else:
                    sender.fixes[kind] = message.fix_type >= FIX_3D
                    sender.raw.setdefault(kind, []).append((position, sender.fixes[kind]))
            case kind if kind == named and part in message.get_fieldnames():
                value = getattr(message, part)
                if isinstance(value, int | float):
                    options.add(sender.log, f"{options.range_name} of {_of(message)}", time, value)
            case kind:
                if kind in NAMED:
                    sender.log.names.add(message.name)
                tag = _tag(message, options.range_name)
                reading = _reading(message)
                if tag is None or reading is None or not 0 < reading.slant <= FAR:
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
    chosen = tracks
    if options.vehicle is not None:
        if options.vehicle not in tracks:
            found = ", ".join(map(str, tracks)) or "none"
            raise RunError(
                f"--vehicle {options.vehicle}: it has no positions; vehicles with positions:"
                f" {found}"
            )
        chosen = {options.vehicle: tracks[options.vehicle]}
    logs = {
        system: RangeLog(track, vehicle=f"vehicle {system}") for system, track in chosen.items()
    } or {0: RangeLog()}
    only = next(iter(logs.values())) if len(logs) == 1 else None
    unmatched = []
    for (system, component), sender in senders.items():
        if not sender.log.ranges or (system in tracks and system not in logs):
            continue
        # A radio with its own system id belongs to the only vehicle. With several vehicles, the
        # vehicle of such a radio is unknown.
        carrier = logs.get(system, only)
        if carrier is None:
            unmatched.append(f"{system}/{component}")
        else:
            carrier.ranges |= sender.log.ranges
    used = [log for log in logs.values() if log.ranges] or list(logs.values())[:1]
    if len(used) == 1:
        used[0].vehicle = ""
    if unmatched:
        line = (
            f"ranges of {', '.join(unmatched)} are left out: their system id is not among those of"
            f" the vehicles ({', '.join(map(str, tracks))}); give --vehicle with the system id of"
            " the vehicle that carries the radio"
        )
        if not any(log.ranges for log in used):
            raise EmptyLogError(line)
        used[0].note(line)
    used[0].names = set[str]().union(
        *(sender.log.names for sender in senders.values() if OURS not in sender.log.names)
    )
    return used


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
    filtered = [parts[component].positions for component in ordered]
    raw = [parts[component].raw.get(kind, []) for component in ordered for kind in RECEIVERS]
    return next((track for rows in filtered + raw if len(track := with_fix(rows)) > 1), [])


def _reading(message: Message) -> Reading | None:
    """Return the reading of a ranging message, None if it has no range."""
    if message.get_type() == "NAMED_VALUE_INT":
        return Reading(float(message.value), None, boot_stamp(message))
    reading = KINDS[message.get_msgId()].read(message)
    return reading if isinstance(reading, Reading) else None


def _tag(message: Message, wanted: str) -> str | None:
    """Return the name of the source of a range, None for a value that is not a range."""
    match message.get_type():
        case "DISTANCE_SENSOR":
            return f"sensor {message.id} of {_of(message)}"
        case "RANGING_BEACON":
            return f"beacon {message.beacon_id} of {_of(message)}"
    return f"{wanted} of {_of(message)}" if message.name == wanted else None


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
