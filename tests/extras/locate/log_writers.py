"""Writers of log files, written from the specifications of the formats, independently of the
product's readers."""

import struct
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

STRUCTS = dict(zip("QBbIHfCcLe", "QBbIHfHhii", strict=True)) | {"n": "4s", "N": "16s", "Z": "64s"}
"""Format characters of ArduPilot's LogStructure.h."""
LOGGED = {
    "GPS": ("QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "POS": ("QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "RFND": ("QBCBBb", "TimeUS,Instance,Dist,Stat,Orient,Quality"),
    "BCN": ("QBBfffffff", "TimeUS,Health,Cnt,D0,D1,D2,D3,PosX,PosY,PosZ"),
    "ORGN": ("QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
    "XKF1": ("QBfff", "TimeUS,C,PN,PE,PD"),
    "UWB": ("Qf", "TimeUS,Dist"),
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "NVF": ("QNf", "TimeUS,Name,Value"),
}
TOPICS = {
    "vehicle_global_position": (
        "QQddff??2x",
        "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;"
        "float alt;float eph;bool lat_lon_valid;bool alt_valid;uint8_t[2] _padding0;",
    ),
    "vehicle_gps_position": (
        "QQdddB7x",
        "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;"
        "double longitude_deg;double altitude_msl_m;uint8_t fix_type;uint8_t[7] _padding0;",
    ),
    "distance_sensor": (
        "QfffffbB2x",
        "uint64_t timestamp;float min_distance;float max_distance;"
        "float current_distance;float variance;float h_fov;int8_t signal_quality;"
        "uint8_t orientation;"
        "uint8_t[2] _padding0;",
    ),
    "ranging_beacon": (
        "QfffB3x",
        "uint64_t timestamp;float range;float range_accuracy;float alt;uint8_t beacon_id;"
        "uint8_t[3] _padding0;",
    ),
    "debug_key_value": (
        "Qf10s2x",
        "uint64_t timestamp;float value;char[10] key;uint8_t[2] _padding0;",
    ),
}


def write_dataflash(file: Path, rows: list[tuple[str, tuple]]) -> Path:
    """Write a dataflash log of (message, values): the table of formats, then the messages."""
    kinds = list(dict.fromkeys(name for name, _ in rows))
    table = [("FMT", 128, "BBnNZ", "Type,Length,Name,Format,Columns")]
    table += [(name, 129 + number, *LOGGED[name]) for number, name in enumerate(kinds)]
    packers = {
        name: (number, struct.Struct("<" + "".join(map(STRUCTS.get, kind))))
        for name, number, kind, _ in table
    }
    with file.open("wb") as log:
        for name, number, kind, columns in table:
            size = 3 + packers[name][1].size
            log.write(
                b"\xa3\x95\x80"
                + packers["FMT"][1].pack(
                    128 if name == "FMT" else number,
                    size,
                    name.encode(),
                    kind.encode(),
                    columns.encode(),
                )
            )
        for name, values in rows:
            number, packer = packers[name]
            log.write(b"\xa3\x95" + bytes([number]) + packer.pack(*values))
    return file


def write_ulog(file: Path, rows: list[tuple[str, int, tuple]]) -> Path:
    """Write a ULog file of (topic, instance, values): magic, flag bits, formats, subscriptions,
    data."""
    series = list(dict.fromkeys((name, instance) for name, instance, _ in rows))
    with file.open("wb") as log:

        def put(kind: bytes, body: bytes) -> None:
            log.write(struct.pack("<Hc", len(body), kind) + body)

        log.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
        put(b"B", bytes(40))
        for name in dict.fromkeys(name for name, _ in series):
            put(b"F", f"{name}:{TOPICS[name][1]}".encode())
        for number, (name, instance) in enumerate(series):
            put(b"A", struct.pack("<BH", instance, number) + name.encode())
        for name, instance, values in rows:
            # a ULog message omits the padding at the end of its last field
            layout = TOPICS[name][0][:-2]
            put(
                b"D",
                struct.pack("<H", series.index((name, instance)))
                + struct.pack("<" + layout, *values),
            )
    return file


def write_tlog(
    file: Path, records: list[tuple[float, int, int, object]], zero: float = 1.75e9
) -> Path:
    """Write a tlog of (time, system, component, message)."""
    with file.open("wb") as log:
        for time, system, component, message in sorted(records, key=lambda record: record[0]):
            sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            frame = message.pack(sender)  # type: ignore[attr-defined]
            log.write(round((zero + time) * 1e6).to_bytes(8, "big") + frame)
    return file
