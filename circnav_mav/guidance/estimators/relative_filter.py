"""Filter of the relative motion: acquisition of the target, then tracking.

If the tracker loses the target, the acquisition begins again at once, with the ranges of the last
seconds.
"""

from circnav_mav.guidance.estimators.acquisition import Acquisition, Estimate, Prior
from circnav_mav.guidance.estimators.interface import EstimatorSettings, MethodChange
from circnav_mav.guidance.estimators.relative_ekf import VelocityChange
from circnav_mav.guidance.estimators.tracker import Rate, Tracker
from circnav_mav.guidance.maths import Vector


class RelativeFilter:
    """Acquires and tracks the target. Input: `observe`, then `search`.

    acquisition: window of ranges and search.
    tracker: filters of the noise models; None before the target is located.
    """

    def __init__(self, settings: EstimatorSettings, known: Prior | None = None) -> None:
        """known: prior of drift and airspeed scale. It is discarded when a track is lost."""
        self._settings = settings
        self.acquisition = Acquisition(settings, known)
        self.tracker: Tracker | None = None
        self._since = 0.0
        """Time since the newest range, s."""

    @property
    def estimate(self) -> Estimate | None:
        """Relative motion at the newest range; None before the first range, and after a loss until
        the next range."""
        return self.acquisition.estimate if self.tracker is None else self.tracker.estimate

    @property
    def trusted(self) -> bool:
        """True if the estimate may steer."""
        return self.tracker is not None and self.tracker.estimate.trusted

    def fly_through_air(self, change: MethodChange, known: Prior) -> "RelativeFilter":
        """Return a filter that uses own motion through the air. It continues the track. Without a
        track, it acquires the target with this prior."""
        after = RelativeFilter(change.settings, known)
        if self.tracker is not None:
            after.tracker = self.tracker.through_air(change)
        return after

    def observe(
        self,
        dt: float,
        chord: Vector,
        z: float | None,
        sigma: float,
        acceleration: VelocityChange | None = None,
        rate: Rate | None = None,
    ) -> None:
        """Predict by dt (s) along a chord (m), and add the range z (m) unless it is None. sigma:
        standard deviation of ranges, m.

        acceleration: measured during dt.
        rate: range rate measured at the end of dt.
        """
        self.search()
        # Smaller and larger values than 1e-3 and 1e3 m spoil a covariance by rounding errors. The
        # motion between samples has a larger error than 1e-3 m anyway, and a range with an error of
        # 1e3 m contains no information.
        sigma = min(max(sigma, 1e-3), 1e3)
        self._since += dt
        if self.tracker is not None:
            self.tracker.observe(dt, chord, z, sigma, self._since, acceleration, rate)
            if self.tracker.lost:
                self.tracker = None
                self.acquisition.forget()
        self.acquisition.observe(dt, chord, z, sigma)
        if z is not None:
            self._since = 0.0
            if self.estimate is None:
                self.acquisition.begin(z)

    def search(self) -> None:
        """Run an iteration of the search if one is due. The next estimate uses the result."""
        sigma = self.acquisition.due
        solution = self.acquisition.search()
        if solution is not None and sigma is not None:
            self.tracker = Tracker.located(self._settings, solution, sigma)
