"""Parameters by name: encoding of numbers, repeated requests, and unknown names."""

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.params import ParameterReader, parameter_value

INT8 = 2
UINT8 = 1
INT16 = 4
INT32 = 6
REAL32 = 9
VEHICLE = (7, 1)
ANSWER_TIMEOUT = 0.7
AT_ONCE = 5
TRIES = 3
"""Period of a repeated request, s; largest number of pending requests, because ArduPilot queues 5
answers; number of requests before a name is regarded as unknown, because an unknown name is not
answered."""


def frame(name: bytes, raw: bytes, kind: int) -> Any:
    """Return a PARAM_VALUE that was built by hand (value bytes, count, index, name, type) and
    decoded by a receiver."""
    payload = raw + struct.pack("<HH16sB", 900, 65535, name, kind)
    head = bytes((len(payload), 0, 0, 0, 7, 1)) + (22).to_bytes(3, "little")
    crc = mavlink.x25crc(head + payload + bytes((220,))).crc  # 220: CRC_EXTRA of PARAM_VALUE
    return mavlink.MAVLink(None).decode(
        bytearray(b"\xfd" + head + payload + struct.pack("<H", crc))
    )


def cast(name: str, value: float, kind: int = REAL32) -> Any:
    return frame(name.encode(), struct.pack("<f", value), kind)


def requested_names(messages: list[Any]) -> list[str]:
    return [message.param_id.rstrip("\0") for message in messages]


@pytest.mark.parametrize("value", [0, 1, 255, -1, 16_777_216])
def test_ardupilot_parameter_values_are_cast_to_float(value: int) -> None:
    assert parameter_value(cast("FS_GCS_ENABLE", value, INT32), bytewise=False) == value


# As floats 0xFF800001 and 0x7F800001 are signaling NaNs. Reading them as floats changes a bit.
@pytest.mark.parametrize(
    ("kind", "raw", "value"),
    [
        *(
            (INT32, struct.pack("<i", n), n)
            for n in (0, 1, -1, 4001, -8_388_607, 0x7F800001, 2**31 - 1, -(2**31))
        ),
        (INT8, b"\xfe\x55\x55\x55", -2),
        (UINT8, b"\xfe\x55\x55\x55", 254),
        (INT16, b"\xfe\xff\x55\x55", -2),
        (REAL32, struct.pack("<f", 1.5), 1.5),
    ],
)
def test_px4_integer_parameters_are_read_from_bytes_of_float(
    kind: int, raw: bytes, value: float
) -> None:
    assert parameter_value(frame(b"COM_OBL_RC_ACT", raw, kind), bytewise=True) == value


def test_five_parameter_requests_are_pending_and_lost_ones_repeated() -> None:
    """A ground station downloads all parameters on the same link: values that circnav did not
    request are ignored."""
    names = [f"P{i}" for i in range(AT_ONCE + 3)]
    reader = ParameterReader(names, bytewise=False)
    assert requested_names(reader.poll(VEHICLE, 0.0)) == names[:AT_ONCE]
    assert reader.poll(VEHICLE, 0.1) == []
    for name in ("P1", "NOT_OURS"):
        reader.receive(cast(name, 4.0))
    assert requested_names(reader.poll(VEHICLE, 0.2)) == [names[AT_ONCE]]
    assert requested_names(reader.poll(VEHICLE, ANSWER_TIMEOUT)) == ["P0", "P2", "P3", "P4"]
    for name in names:
        assert not reader.done
        reader.receive(cast(name, 2.0))
    assert reader.done
    assert reader.values == {**dict.fromkeys(names, 2.0), "P1": 4.0}


def test_unknown_parameter_is_given_up_after_three_requests() -> None:
    reader = ParameterReader(["SLOW"], bytewise=False)
    asked = [requested_names(reader.poll(VEHICLE, i * ANSWER_TIMEOUT)) for i in range(10)]
    assert asked == [["SLOW"]] * TRIES + [[]] * (10 - TRIES)
    assert reader.done
    reader.receive(cast("SLOW", 1.0))
    assert reader.values == {"SLOW": 1.0}


def test_parameter_name_of_sixteen_characters_is_read_whole() -> None:
    name = "A234567890123456"
    reader = ParameterReader([name, name], bytewise=False)
    (request,) = reader.poll(VEHICLE, 0.0)
    assert (request.target_system, request.target_component, request.param_index) == (7, 1, -1)
    assert len(bytes(request.pack(mavlink.MAVLink(None, 1, 191)))) == 12 + 20
    reader.receive(cast(name, 1.0))
    assert reader.values == {name: 1.0}
