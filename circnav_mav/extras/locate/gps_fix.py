"""GPS fix as reported by the vehicle's receivers."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message
from circnav_mav.pilot.method import RECEIVERS

SILENT = 3.0
"""Age of a report, s, above which the report is ignored."""


class GpsFix:
    """Newest report of each receiver."""

    def __init__(self) -> None:
        self._reported: dict[str, tuple[bool, float]] = {}

    def on_message(self, message: Message, now: float) -> None:
        """Process a message of RECEIVERS."""
        self._report(message.get_type(), message.fix_type >= dialect.GPS_FIX_TYPE_3D_FIX, now)

    def has_fix(self, now: float) -> bool:
        """True if a receiver reports a 3D fix."""
        fresh = self._fresh(now)
        return any(fresh.get(kind, False) for kind in RECEIVERS)

    def _report(self, kind: str, good: bool, now: float) -> None:
        self._reported[kind] = good, now

    def _fresh(self, now: float) -> dict[str, bool]:
        return {kind: good for kind, (good, at) in self._reported.items() if now - at <= SILENT}
