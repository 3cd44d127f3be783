"""Height above the target, used to convert slant ranges to horizontal ranges.

The height is computed from the altitude above sea level or, if that is unknown, above home, and
from the altitude of HOME_POSITION. Latitude, longitude and local position are never read.
"""

from math import inf

from circnav_mav.mav.codec import Message
from circnav_mav.mav.own_motion import (
    AIR_MAX_AGE,
    BUNCHED,
    MOST_ALTITUDE,
    MOST_CLIMB,
    Motion,
)
from circnav_mav.mission.schema import OrbitTable
from circnav_mav.timers import Report

READ = frozenset({"VFR_HUD", "HOME_POSITION"})
"""Types of the messages that determine the height."""


class Height:
    """Height above the target.

    Before the engagement it is computed from the mission and the newest altitude. From then on the
    height changes with the altitude alone. While no altitude is received, the last height is kept.
    """

    def __init__(self, settings: OrbitTable) -> None:
        self._settings = settings
        self._zero = settings.target_altitude_m
        """Altitude, m, at which the height above the target is `height_above_target_m`, or 0 if the
        mission has no such height. None while unknown."""
        self._altitude: Report[float] = Report()
        self._engaged = False
        self._jumped = 0.0
        """Sum of the altitude jumps since the engagement, m. Jumps do not change the height."""
        self._doubt: tuple[float, float, float] | None = None
        """Time of the first recent jump (s), the altitude before it (m), and the sum of the recent
        jumps (m)."""

    def engage(self) -> None:
        """Fix home and height for the flight: the vehicle is steered from now on."""
        self._engaged = True

    def receive(self, message: Message, motion: Motion, now: float) -> None:
        """Process a message of the vehicle. motion: newest motion of the vehicle."""
        match message.get_type():
            case "HOME_POSITION":
                self._take_home(message.altitude / 1000)
            case "VFR_HUD":
                self._take_altitude(motion, now)

    def _take_home(self, home: float) -> None:
        """Take the altitude of home, m, unless the vehicle is already steered."""
        above_home = self._settings.target_above_home_m
        if above_home is not None and not self._engaged and abs(home) <= MOST_ALTITUDE:
            self._zero = home + above_home

    def _take_altitude(self, motion: Motion, now: float) -> None:
        """Take the newest altitude. Move the zero with a jump."""
        altitude = motion.altitude
        # A height at the engagement needs only changes of the altitude.
        if altitude is None and self._settings.height_above_target_m is not None:
            altitude = motion.above_home
        if altitude is None:
            return
        before = self._altitude.value
        waited = max(self._altitude.age(now), BUNCHED)
        self._altitude.update(altitude, now)
        # A home set late changes the altitude by hundreds of meters, which is no jump.
        if not self._engaged:
            return
        if self._zero is None:
            if self._settings.height_above_target_m is not None:
                self._zero = altitude
            return
        if before is None:
            return
        change = altitude - before
        if abs(change) <= MOST_CLIMB * waited:
            self._forgive(altitude, now)
            return
        # The zero of the altitude has moved, not the vehicle: move `_zero` by the same amount. A
        # glitch that appears and disappears has no net effect.
        began, origin, so_far = self._doubt or (now, before, 0.0)
        self._doubt = began, origin, so_far + change
        self._zero += change
        self._jumped += change

    def _forgive(self, altitude: float, now: float) -> None:
        """Restore the zero if the altitude has gradually returned to its value before the jump."""
        # 3.0: time after a jump, s, in which the altitude may return gradually, as ArduPlane's
        # altitude does in turbulence.
        if self._doubt is None or now - self._doubt[0] < 3.0:
            return
        (_, origin, jump), self._doubt = self._doubt, None
        if self._zero is not None and abs(altitude - origin) <= MOST_CLIMB * BUNCHED:
            self._zero -= jump
            self._jumped -= jump

    def at(self, now: float) -> float | None:
        """Return the height, m, or None if it is unknown or the mission gives no height."""
        given = self._settings.height_above_target_m
        altitude = self._altitude.live(now, inf if self._engaged else AIR_MAX_AGE)
        if self._zero is None or altitude is None:
            return given
        return (given or 0.0) + (altitude - self._zero)

    @property
    def newest(self) -> float | None:
        """Height from the newest altitude of any age, m, or None if unknown."""
        return self.at(self._altitude.time)

    def set(self, height: float, now: float) -> str:
        """Set the present height above the target, m. Return the reason if this is impossible, else
        an empty string."""
        altitude = self._altitude.live(now, AIR_MAX_AGE)
        if altitude is None:
            return "no altitude (VFR_HUD.alt)"
        only = {"target_altitude_m": None, "target_above_home_m": None}
        self._settings = self._settings.model_copy(update={"height_above_target_m": height, **only})
        self._zero = altitude
        self._doubt = None
        return ""

    def why_unknown(self, now: float) -> str:
        """Return the reason why the height that the mission needs is unknown, human-readable, or an
        empty string."""
        if not self._settings.needs_altitude or self.at(now) is not None:
            return ""
        if self._zero is None:
            return (
                "no home altitude (HOME_POSITION), the reference of orbit.target_above_home_m: set"
                " home, or give orbit.target_altitude_m or orbit.height_above_target_m instead"
            )
        return "no altitude (VFR_HUD.alt), which the height above the target needs"

    def is_held(self, now: float) -> bool:
        """True if the last height is held because no altitude is received in flight."""
        late = self._altitude.age(now) > AIR_MAX_AGE
        return self._engaged and late and self.at(now) is not None

    @property
    def jump(self) -> float:
        """Step of the reported altitude in flight, m, that is not applied to the height above the
        target; 0 if negligible."""
        return self._jumped if abs(self._jumped) > MOST_CLIMB * BUNCHED else 0.0
