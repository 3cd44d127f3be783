"""Default gains of all range-only laws, for the mission check, the pilot and the benchmark.

A gain depends on the circle and on one delay. The delay is the sum of two lags. The turn lag is
given in the mission. The lag of the range-rate filter follows from the radio's noise and rate. (The
heading loop of `drift` and `auto` is tuned in flight by `vector_field.drift_gains`.)
"""

from dataclasses import dataclass

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import SteadyState, steady_state
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.step import LawChoice
from circnav_mav.guidance.types import Orbit


@dataclass(frozen=True, slots=True)
class LawTuning:
    """A law and the inputs of its gain rule, for any circle.

    law: name of the law.
    estimation: settings of the range-rate filter.
    turn_lag: delay from a command to its turn, s.
    sigma, period: noise (m) and period (s) of the ranges.
    gain: gain of the mission; None if the law's rule computes it.
    rate_sigma: noise of a measured range rate that the law uses directly, m/s; None if a filter
        estimates the rate.
    """

    law: str
    estimation: EstimatorSettings
    turn_lag: float
    sigma: float
    period: float
    gain: float | None = None
    rate_sigma: float | None = None

    def steady_estimate(self, radius: float) -> SteadyState:
        """Return noise and lag of the range rate on a circle with this radius (m).

        A filter is assumed to receive ranges only, even if the radio also measures range rates. The
        gains then remain valid if these rates are rejected in flight.
        """
        if self.rate_sigma is not None:
            return SteadyState(self.rate_sigma, self.period / 2)
        return steady_state(self.estimation, r=radius, sigma=self.sigma, period=self.period)

    def loop_lag(self, radius: float) -> float:
        """Return the delay, s, from a change of the range rate to the turn, on a circle with this
        radius (m)."""
        return self.turn_lag + self.steady_estimate(radius).lag

    def default_gain(self, orbit: Orbit) -> float:
        """Return the magnitude of the gain k by the law's rule in `laws`. It is 1 for a
        user-defined law, which has no gain."""
        law = LAWS.get(self.law)  # does not import a user-defined law
        if law is None:
            return 1.0
        return float(law.default_gain(orbit.speed, orbit.radius, self.loop_lag(orbit.radius)))

    def choice(self, orbit: Orbit) -> LawChoice:
        """Return the law with its gain for a circle."""
        return LawChoice(self.law, self.gain or self.default_gain(orbit), self.turn_lag)
