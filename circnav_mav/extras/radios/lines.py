"""One range per line: JSON objects or comma-separated values, in meters and seconds.

{"range": 123.4, "id": 3, "sigma": 0.1, "time": 17.25}      only the range is required
123.4            3,123.4            17.25,3,123.4            17.25,3,123.4,0.1
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from circnav_mav.mav.ranging.driver import RadioReading
from circnav_mav.mav.ranging.line_driver import LineDriver

COLUMNS = {
    1: ("range",),
    2: ("id", "range"),
    3: ("time", "id", "range"),
    4: ("time", "id", "range", "sigma"),
}
"""Columns of a line without names, by the number of values."""


DECIMAL_COMMA = (
    "received lines are an id and a whole number of meters (12,5 is id 12, 5 m): decimal commas are"
    " not read, send decimal points"
)
"""Hint to lines with decimal commas, and to whole numbers of meters, which look the same."""


class Lines(LineDriver):
    """Driver with one reading per line."""

    def __init__(self) -> None:
        super().__init__()
        self._whole_ranges = 0
        """Number of lines in a row whose range follows a comma and has no decimal point."""

    @property
    def hint(self) -> str:
        """Probable mistake of the sender, human-readable, or empty."""
        # 10: a sender that omits the decimals of a round value sends fewer in a row.
        return DECIMAL_COMMA if self._whole_ranges >= 10 else ""

    def read_line(self, line: str) -> Sequence[RadioReading] | None:
        """Return the reading of a line, None for a header or other text."""
        try:
            values = json.loads(line) if line.startswith("{") else _columns(line)
            beacon = _ident(str(values.get("id", 0)))
            sigma = values.get("sigma")
            time = values.get("time")
            if isinstance(values["range"], bool):
                return None
            whole = "," in line and str(values["range"]).isdecimal()
            self._whole_ranges = self._whole_ranges + 1 if whole and line[0] != "{" else 0
            return [RadioReading(float(values["range"]), beacon, _number(sigma), _number(time))]
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            return None


def _columns(line: str) -> Mapping[str, str]:
    values = re.split(r"\s*[,;]\s*|\s+", line)
    return dict(zip(COLUMNS[len(values)], values, strict=True))


def _ident(text: str) -> int:
    """Return an id: decimal, possibly with leading zeros, or hexadecimal with 0x."""
    return int(text, 16 if text.lower().startswith("0x") else 10)


def _number(value: Any) -> float | None:
    return None if value is None else float(value)
