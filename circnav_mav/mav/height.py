"""How high the vehicle flies above the target, by its own altitude: slant ranges become horizontal with it.

Read are VFR_HUD.alt and, of HOME_POSITION, the altitude alone: its latitude, longitude and local position never are.
"""

from dataclasses import dataclass

from circnav_mav.mav.codec import Message
from circnav_mav.mav.own_motion import AIR_MAX_AGE, MOST_ALTITUDE

MOST_CLIMB = 20.0
"""Climb or sink rate, m/s, that none of our vehicles has: a quicker change is an altitude estimate that was reset."""
BUNCHED = 0.25
"""Least time, s, by which two altitudes count as apart: a link may deliver several at once."""

HEARD = frozenset({"VFR_HUD", "HOME_POSITION"})
"""Types of the messages that tell of the height."""


@dataclass(frozen=True, slots=True)
class HeightSettings:
    """What the mission says of the height, at most one of them, m. above_target: of the vehicle above the target when
    guidance engages. target_altitude: of the target above sea level. target_above_home: of the target above home."""

    above_target: float | None = None
    target_altitude: float | None = None
    target_above_home: float | None = None

    @property
    def needs_altitude(self) -> bool:
        """Whether nothing is known of the height before the vehicle reports its altitude."""
        return self.target_altitude is not None or self.target_above_home is not None


class Height:
    """The height above the target. Before the engagement it is what the mission and the newest altitude say; from then
    on it changes with the altitude alone, and the last one holds when no altitude comes."""

    def __init__(self, settings: HeightSettings) -> None:
        self._settings = settings
        self._base = settings.above_target or 0.0
        self._zero = settings.target_altitude
        """The altitude at which the height is `_base`, None while it is not known."""
        self._altitude: float | None = None
        self._heard_at = float("-inf")
        self._engaged = False
        self.jumped = 0.0
        """The sum of the jumps of the altitude since the engagement, m, which do not count as height."""

    def engage(self) -> None:
        """Guidance has the vehicle: home and height are now those of the flight."""
        self._engaged = True

    def hear(self, message: Message, altitude: float | None, now: float) -> bool:
        """Take in one message of the vehicle. altitude: what is believed of VFR_HUD, None: nothing. Tells whether the
        altitude has jumped."""
        above_home = self._settings.target_above_home
        if message.get_type() == "HOME_POSITION" and above_home is not None and not self._engaged:
            home = message.altitude / 1000
            self._zero = home + above_home if abs(home) <= MOST_ALTITUDE else self._zero
        if message.get_type() != "VFR_HUD" or altitude is None:
            return False
        before, waited = self._altitude, max(now - self._heard_at, BUNCHED)
        self._altitude, self._heard_at = altitude, now
        if not self._engaged:  # a home that is set late moves the altitude by hundreds of metres, and rightly so
            return False
        if self._zero is None:
            self._zero = altitude if self._settings.above_target is not None else None
            return False
        change = 0.0 if before is None else altitude - before
        if abs(change) <= MOST_CLIMB * waited:
            return False
        # the vehicle did not move, its zero did: a glitch that comes and goes leaves nothing behind
        self._zero += change
        self.jumped += change
        return True

    def at(self, now: float) -> float | None:
        """The height now, m; None where it is not known, or the mission says nothing of it."""
        live = self._engaged or now - self._heard_at <= AIR_MAX_AGE
        if self._zero is None or self._altitude is None or not live:
            return self._settings.above_target
        return self._base + (self._altitude - self._zero)

    def why_unknown(self, now: float) -> str:
        """Why there is no height although the mission wants one, for people; empty where there is."""
        if not self._settings.needs_altitude or self.at(now) is not None:
            return ""
        if self._zero is None:
            return (
                "no home altitude (HOME_POSITION), from which orbit.target_above_home_m counts: set home, or give "
                "orbit.target_altitude_m or orbit.height_above_target_m instead"
            )
        return "no altitude (VFR_HUD.alt), without which the height above the target is not known"

    def trouble(self, now: float) -> str:
        """What is wrong with the height of the flight, for people; empty where nothing is."""
        height = self.at(now)
        if not self._engaged or height is None:
            return ""
        if now - self._heard_at > AIR_MAX_AGE:
            return f"ALTITUDE NOT HEARD: height above the target held at {height:.1f} m"
        if abs(self.jumped) > MOST_CLIMB * BUNCHED:
            return f"ALTITUDE JUMPED by {self.jumped:+.1f} m, not counted as height: compare the radius with the map"
        return ""
