"""Phase of this member, from the relative motion that the pilot estimates."""

from math import nan, pi

from circnav_mav.extras.fleet.law import OwnState
from circnav_mav.extras.fleet.phase import LAP, Drift, PhaseMap, circle_angle
from circnav_mav.guidance.types import RelativeMotion
from circnav_mav.pilot import Pilot

UNKNOWN = Drift((0.0, 0.0), (1e4, 0.0, 1e4))
"""Drift in the reports of this member while its drift is unknown: a very large covariance."""


class OwnPhase:
    """Low-pass of this member's drift and airspeed, and its temporal phase on the circle.

    drift: mean after the low-pass, and the covariance of the newest estimate.
    map: map from the member's angle on the circle to its temporal phase. None before the relative
        motion is known, and after a reversal of the circle.
    """

    def __init__(self, pilot: Pilot) -> None:
        self.drift = UNKNOWN
        self.map: PhaseMap | None = None
        self._pilot = pilot
        self._airspeed = pilot.orbit.speed
        self._mapped_at = 0.0

    @property
    def sense(self) -> int:
        """Sense of rotation of the current circle."""
        return self._pilot.orbit.direction.turn_sign

    @property
    def lap_period(self) -> float:
        """Duration of a lap, s."""
        orbit = self._pilot.orbit
        return (LAP / orbit.speed if self.map is None else self.map.lap_time) * orbit.radius

    def update(self, now: float, dt: float, *, leaving: bool, shares_layer: bool) -> OwnState:
        """Return the state of this member. dt: time since the last update, s."""
        estimate = self._pilot.estimate if self._pilot.mission.steering else None
        relative = None if estimate is None else estimate.relative
        if estimate is None or relative is None or not relative.trusted:
            return OwnState(None, pi, nan, leaving, shares_layer)
        self._smooth(relative, dt)
        # 1.0: time between two updates of the phase map, s.
        if self.map is None or now - self._mapped_at >= 1.0:
            self.map = PhaseMap.of(self._airspeed, self.drift.mean, self.sense)
            self._mapped_at = now
        phase, rate = self.map.at(circle_angle(relative.x, relative.y, self.sense))
        # The estimate is for the time of the pilot's last step. Extrapolate the phase to the
        # present time.
        phase += LAP * (now - estimate.time) / self.lap_period
        sigma = relative.sigma / max(estimate.r, 1.0) * rate
        return OwnState(phase % LAP, sigma, estimate.r, leaving, shares_layer)

    def _smooth(self, relative: RelativeMotion, dt: float) -> None:
        """Filter drift and airspeed."""
        # 10.0: time constant, s. The filter removes gusts, which do not change the lap.
        share = dt / (10.0 + dt)
        east, north = relative.drift_x, relative.drift_y
        if self.drift is not UNKNOWN:
            before_east, before_north = self.drift.mean
            east = before_east + share * (east - before_east)
            north = before_north + share * (north - before_north)
        ee, en, nn = relative.drift_covariance or UNKNOWN.covariance
        self.drift = Drift((east, north), (max(ee, 1e-6), en, max(nn, 1e-6)))
        self._airspeed += share * (relative.airspeed - self._airspeed)
