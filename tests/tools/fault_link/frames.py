"""MAVLink frames for the faults: split from data on the link, or packed for any sender with a valid
CRC."""

from collections.abc import Iterator

from pymavlink.dialects.v20 import all as mavlink

V2 = 0xFD
V2_HEADER = 10
CRC = 2


def message_id(frame: bytes) -> int:
    """Return the id of a MAVLink 2 frame, or -1 for other data."""
    return (
        int.from_bytes(frame[7:10], "little")
        if len(frame) >= V2_HEADER + CRC and frame[0] == V2
        else -1
    )


def frames(data: bytes, at: int = 0, apart: int = 0) -> Iterator[bytes]:
    """Yield the successive MAVLink 2 frames from offset `at`, with `apart` bytes between them."""
    while at + V2_HEADER + CRC <= len(data) and data[at] == V2:
        end = at + data[at + 1] + V2_HEADER + CRC + (13 if data[at + 2] & 1 else 0)
        yield data[at:end]
        at = end + apart


def write(
    message: mavlink.MAVLink_message, system: int, component: int, sequence: int = 0
) -> bytes:
    """Pack a frame of any sender. Floats may have any value; integers must fit their fields."""
    engine = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    engine.seq = sequence
    return bytes(message.pack(engine))


def raw_frame(number: int, payload: bytes, system: int, component: int, sequence: int = 0) -> bytes:
    """Pack a frame of any id with any payload. The CRC is valid if the id is in the dialect."""
    kind = mavlink.mavlink_map.get(number)
    head = bytes((len(payload), 0, 0, sequence & 255, system, component)) + number.to_bytes(
        3, "little"
    )
    crc: int = mavlink.x25crc(head + payload + bytes((kind.crc_extra if kind else 0,))).crc
    return bytes((V2,)) + head + payload + crc.to_bytes(2, "little")
