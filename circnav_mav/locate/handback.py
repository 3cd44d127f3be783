"""Not built yet: the position given back to an autopilot that has lost its own."""

from dataclasses import dataclass
from typing import Any

from circnav_mav.mav.codec import Message


@dataclass(frozen=True, slots=True)
class HandBackSettings:
    """every: s. place: of the target, latitude and longitude in degrees, where the mission gives it."""

    every: float = 5.0
    place: tuple[float, float] | None = None


class HandBack:
    """Does nothing yet."""

    active = False
    words = ""

    def __init__(self, settings: HandBackSettings, component: int) -> None:
        pass

    def acknowledged(self, message: Message, us: tuple[int, int], now: float) -> None:
        """An answer."""

    def reported(self, east: float, north: float, now: float) -> None:
        """A position."""

    def plain(self) -> dict[str, Any]:
        """For the summary."""
        return {}
