"""Airborne state of an aircraft: established flight before the engagement, height above the ground
after it.

Guidance must not take an aircraft out of its take-off: near the ground, every turn is a crash. So
neither a mode request nor a setpoint is sent before the flight is established. Rovers and boats are
exempt (`Autopilot.flies`).
"""

from typing import NamedTuple

from circnav_mav.mav.session import Session
from circnav_mav.mission.mission import Mission
from circnav_mav.timers import Hysteresis

LEAST_AIRSPEED = 0.7
"""Least airspeed of a plane at the engagement, as a share of the mission's speed."""
ESTABLISHED = 5.0
"""Time in the air without interruption after which a flight is established, s. ArduCopter reports
IN_AIR 0.1 s after lift-off."""


class Obstacle(NamedTuple):
    """Condition that must be met before an aircraft is steered.

    short: the required condition, for a STATUSTEXT, at most 32 characters.
    long: human-readable text with the present value.
    """

    short: str
    long: str


class Airborne:
    """Airborne state of the pinned vehicle."""

    def __init__(self, settings: Mission, session: Session) -> None:
        self._settings = settings
        self._session = session
        self.in_air = Hysteresis(raise_after=ESTABLISHED)
        self._stood = False
        """True after the vehicle was seen on the ground, until its flight is established."""
        self._ground: float | None = None
        """Altitude of the place of arming, m, None while unknown. A move of home in flight does not
        change it."""

    @property
    def floor(self) -> float:
        """Least height above the place of arming at which a flight begins, m."""
        given = self._settings.file.engage.min_height_m
        return self._session.adapter.min_height if given is None else given

    def step(self, now: float) -> bool:
        """Process the newest reports. Return True in the step in which a flight that began on the
        ground is established."""
        vehicle = self._session.vehicle
        motion = self._session.motion.at(now)
        in_air = self.in_air.update(vehicle.armed and not vehicle.on_ground(now), now)
        disarmed = vehicle.mode is not None and not vehicle.armed
        stands = vehicle.stands(now)
        self._stood |= disarmed or stands
        # ON_GROUND is reported once a second, so it may be old when an armed vehicle climbs.
        if disarmed or (stands and self._ground is None):
            self._ground = motion.altitude
        elif self._ground is None:
            self._ground = motion.home_altitude
        flies = in_air and not self._too_low(now) and not self._too_slow(now)
        begins = flies and self._stood
        self._stood &= not flies
        return begins

    def height(self, now: float) -> float | None:
        """Return the height above the place of arming, m, or None if it is unknown."""
        motion = self._session.motion.at(now)
        if motion.altitude is None or self._ground is None:
            return motion.above_home
        return motion.altitude - self._ground

    def obstacle(self, now: float) -> Obstacle | None:
        """Return the condition that must be met before the vehicle is steered, or None."""
        checks = self._CHECKS if self._session.adapter.flies else (Airborne._kept_mode,)
        return next(filter(None, (check(self, now) for check in checks)), None)

    def _grounded(self, now: float) -> Obstacle | None:
        vehicle = self._session.vehicle
        if vehicle.on_ground(now):
            return Obstacle("on the ground", "the vehicle is on the ground, takes off or lands")
        return None if vehicle.armed else Obstacle("not armed", "the vehicle is not armed")

    def _kept_mode(self, now: float) -> Obstacle | None:
        vehicle = self._session.vehicle
        if vehicle.mode not in self._session.adapter.kept_modes:
            return None
        mode = f"mode {vehicle.mode_name}"
        return Obstacle(mode, f"circnav does not end the {mode}: enter another mode")

    def _not_established(self, now: float) -> Obstacle | None:
        if self.in_air.on:
            return None
        flown = 0.0 if self.in_air.since is None else now - self.in_air.since
        on_ground = self._session.vehicle.on_ground(now)
        state = "armed (no landed state)" if on_ground is None else "in the air"
        needed = f"{ESTABLISHED:g} s {state}"
        return Obstacle(needed, f"{needed}: {flown:.0f} s so far")

    def _hovers(self, now: float) -> Obstacle | None:
        if not self._session.adapter.fixed_wing or not self._session.vehicle.hovers:
            return None
        return Obstacle("flight on the wing", "the quadplane hovers or is in a transition")

    def _too_low(self, now: float) -> Obstacle | None:
        floor = self.floor
        height = self.height(now)
        if floor == 0:
            if self._session.vehicle.on_ground(now) is not None:
                return None
            return Obstacle(
                "a landed state",
                "no landed state (EXTENDED_SYS_STATE) and engage.min_height_m = 0: nothing shows"
                " that the vehicle flies",
            )
        if height is None:
            return Obstacle(
                "height unknown",
                "the height above the place of arming is unknown: start circnav before the"
                " take-off, or set engage.min_height_m = 0",
            )
        needed = f"{floor:g} m of height"
        if height >= floor:
            return None
        return Obstacle(
            needed,
            f"{needed} above the place of arming (engage.min_height_m): {height:.1f} m now",
        )

    def _too_slow(self, now: float) -> Obstacle | None:
        airspeed = self._session.motion.at(now).airspeed
        least = LEAST_AIRSPEED * self._settings.facts.speed
        if not self._session.adapter.fixed_wing or airspeed is None or airspeed >= least:
            return None
        needed = f"{least:.1f} m/s of airspeed"
        return Obstacle(needed, f"{needed}: {airspeed:.1f} m/s now")

    _CHECKS = (_grounded, _kept_mode, _not_established, _hovers, _too_low, _too_slow)
    """Checks of an aircraft, in the order in which their conditions are shown."""

    def grounded(self, now: float) -> str:
        """Return the reason why a steered aircraft must not be steered any longer, or an empty
        string."""
        vehicle = self._session.vehicle
        if not self._session.adapter.flies:
            return ""
        # After a takeover by LAND, the landed state may be received before the mode. A mode report
        # that follows it decides.
        if vehicle.on_ground(now) and vehicle.received_at > vehicle.landed.changed:
            return "the vehicle reports that it is on the ground or lands"
        height = self.height(now)
        if height is not None and height < self.floor / 2 and self.floor > 0:
            return f"height {height:.1f} m, below half of engage.min_height_m ({self.floor:g} m)"
        return ""

    def resumes(self, now: float) -> str:
        """Return the reason why an aircraft in the guided mode must not be steered again after a
        lost link, or an empty string. It may have landed meanwhile."""
        floor = self.floor
        if self._session.adapter.flies and floor > 0 and self.height(now) is None:
            return "the height above the place of arming is unknown"
        return self.grounded(now)
