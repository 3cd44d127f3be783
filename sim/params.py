"""The few parameters that a companion computer uses, under their real names, and the protocol that
reads and sets them."""

import math
import struct
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as mavlink

from .links import Message

INT8 = 2
INT16 = 4
INT32 = 6
REAL32 = 9
NOT_IN_LIST = 65535
LARGEST = 1e6  # largest value of a parameter; NaN is rejected as well
RANGES = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}


@dataclass(frozen=True)
class Parameter:
    name: str
    default: float
    kind: int = REAL32


class Parameters(dict[str, float]):
    """Parameter values by name. ArduPilot casts integers to float on the wire, PX4 copies their
    bytes."""

    def __init__(self, table: tuple[Parameter, ...], bytewise: bool) -> None:
        super().__init__((p.name, p.default) for p in table)
        self._table = table
        self._bytewise = bytewise

    def microseconds(self, name: str) -> int:
        """Return a parameter in seconds as microseconds."""
        return round(self[name] * 1e6)

    def all_values(self) -> list[Message]:
        return [self._message(p, i) for i, p in enumerate(self._table)]

    def read(self, name: str, index: int) -> Message | None:
        """Return the value by index, or by name if the index is negative; None if there is no such
        parameter."""
        if index >= 0:
            return self._message(self._table[index], index) if index < len(self._table) else None
        found = self._find(name)
        return self._message(found, NOT_IN_LIST) if found else None

    def write(self, name: str, wire_value: float) -> Message | None:
        """Set a parameter from its wire value. Return the message with the new value. None if the
        name is unknown."""
        found = self._find(name)
        if found is None:
            return None
        value = self._from_wire(found.kind, wire_value)
        if value is not None and abs(value) <= LARGEST:
            self[name] = value
        return self._message(found, NOT_IN_LIST)

    def _find(self, name: str) -> Parameter | None:
        return next((p for p in self._table if p.name == name), None)

    def _message(self, parameter: Parameter, index: int) -> Message:
        value = self._to_wire(parameter.kind, self[parameter.name])
        name = parameter.name.encode()
        return mavlink.MAVLink_param_value_message(
            name, value, parameter.kind, len(self._table), index
        )

    def _to_wire(self, kind: int, value: float) -> float:
        if self._bytewise and kind != REAL32:
            return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
        return value

    def _from_wire(self, kind: int, value: float) -> float | None:
        if kind == REAL32:
            return value
        if self._bytewise:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        low, high = RANGES[kind]
        return float(min(high, max(low, round(value)))) if math.isfinite(value) else None
