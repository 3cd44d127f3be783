"""From an estimate to a turn rate: the law, then the vehicle's limit."""

from collections.abc import Callable
from dataclasses import dataclass

from circnav_mav.core.laws import LAWS
from circnav_mav.core.values import Orbit, RangeEstimate, TurnCommand, TurnRate


@dataclass(frozen=True, slots=True)
class LawChoice:
    """A law by name, the magnitude of its gain, and whether its radius is corrected to the one asked for."""

    name: str
    gain: float
    correct_radius: bool = True


def steering(orbit: Orbit, choice: LawChoice) -> Callable[[RangeEstimate, float], TurnRate]:
    """The mission's guidance as one function from estimate and radius trim (m) to demanded turn rate (rad/s, not yet
    limited).

    Raises ValueError when the radius correction does not exist for this gain.
    """
    law = LAWS[choice.name]
    k = -orbit.direction.turn_sign * choice.gain  # the paper: k > 0 flies clockwise
    fed = law.fed_radius(orbit.speed, orbit.radius, choice.gain) if choice.correct_radius else orbit.radius

    def steer(estimate: RangeEstimate, trim: float = 0.0) -> TurnRate:
        return TurnRate(float(law.function(estimate.r, estimate.r_dot, V=orbit.speed, r_d=fed + trim, k=k)))

    return steer


def limit(demanded: TurnRate, max_turn_rate: float, gain: float = 1.0) -> TurnCommand:
    """What to tell a vehicle that turns at `gain` times what it is told, within +-max_turn_rate (both rad/s)."""
    told = demanded / gain
    cut = min(max(told, -max_turn_rate), max_turn_rate)
    return TurnCommand(TurnRate(cut), demanded, saturated=cut != told)
