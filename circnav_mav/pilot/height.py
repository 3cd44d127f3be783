"""The height above the target, by which slant ranges become horizontal.

Read are VFR_HUD.alt and, of HOME_POSITION, the altitude alone: its latitude, longitude and local position never are.
"""

from circnav_mav.mav.codec import Message
from circnav_mav.mav.own_motion import AIR_MAX_AGE, MOST_ALTITUDE
from circnav_mav.pilot.settings import HeightSettings

MOST_CLIMB = 20.0
"""Climb or sink rate, m/s, that none of our vehicles has: a quicker change is an altitude estimate that was reset."""
BUNCHED = 0.25
"""Least time, s, by which two altitudes count as apart: a link may deliver several at once."""
RETURNS = 3.0
"""Time, s, within which an altitude that jumped may come back little by little, as ArduPlane's does in turbulence."""

HEARD = frozenset({"VFR_HUD", "HOME_POSITION"})
"""Types of the messages that tell of the height."""


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
        self._doubt: tuple[float, float, float] | None = None
        """When the altitude jumped lately, from where and how far."""

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
        if before is None or abs(change) <= MOST_CLIMB * waited:
            self._forgive(altitude, now)
            return False
        # the vehicle did not move, its zero did: a glitch that comes and goes leaves nothing behind
        began, origin, so_far = self._doubt or (now, before, 0.0)
        self._doubt = began, origin, so_far + change
        self._zero += change
        self.jumped += change
        return True

    def _forgive(self, altitude: float, now: float) -> None:
        """After an altitude that has come back little by little, the zero of before its jump."""
        if self._doubt is None or now - self._doubt[0] < RETURNS:
            return
        (_, origin, jump), self._doubt = self._doubt, None
        if self._zero is not None and abs(altitude - origin) <= MOST_CLIMB * BUNCHED:
            self._zero -= jump
            self.jumped -= jump

    def at(self, now: float) -> float | None:
        """The height now, m; None where it is not known, or the mission says nothing of it."""
        live = self._engaged or now - self._heard_at <= AIR_MAX_AGE
        if self._zero is None or self._altitude is None or not live:
            return self._settings.above_target
        return self._base + (self._altitude - self._zero)

    @property
    def newest(self) -> float | None:
        """The height by the newest altitude, m, whatever its age; None if unknown."""
        return self.at(self._heard_at)

    def set(self, height: float, now: float) -> str:
        """Use another height above the target from now on, m. Return why this is not possible, empty otherwise."""
        if self._altitude is None or now - self._heard_at > AIR_MAX_AGE:
            return "no altitude (VFR_HUD.alt)"
        self._settings = HeightSettings(above_target=height)
        self._base, self._zero, self._doubt = height, self._altitude, None
        return ""

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

    def held(self, now: float) -> float | None:
        """Return the height in flight if no altitude is received and it is held; else None."""
        return self.at(now) if self._engaged and now - self._heard_at > AIR_MAX_AGE else None

    @property
    def jump(self) -> float:
        """Jump of the altitude in flight that does not count as height, m; 0 for none that matters."""
        return self.jumped if abs(self.jumped) > MOST_CLIMB * BUNCHED else 0.0
