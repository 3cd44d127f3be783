"""Control loop of one vehicle, from an estimate to a commanded turn rate. For the pilot and
`circnav_mav.Guidance`.

The turn rate comes from the law, or is the steady turn of the circle while ranges are missing.
Corrections: radius trim, pending turn and turn gain. `LearnedResponse` learns the response of the
vehicle and monitors it.
"""

from collections.abc import Callable
from math import pi

from circnav_mav.guidance.step import LawChoice, Steering, compensate_turn_gain, holding
from circnav_mav.guidance.turn_answer import LearnedResponse
from circnav_mav.guidance.types import Orbit, RangeEstimate, TurnCommand
from circnav_mav.guidance.watches import next_trim

LONGEST_TRIM_STEP = 0.2
"""Longest time step of the radius integral, s: an error is not integrated over a gap."""


class ClosedLoop:
    """Control loop. orbit: current circle. answer: response of the vehicle to turn commands,
    learned in flight."""

    def __init__(
        self,
        orbit: Orbit,
        law: LawChoice | Callable[..., TurnCommand],
        answer: LearnedResponse,
        radius_trim: float = 0.0,
    ) -> None:
        """law: a choice from `LAWS`, or a function with the arguments of `Steering`. radius_trim:
        rate of the slow integral on the mean radius, 1/s, for laws on range alone. Raises
        ValueError if this gain has no radius correction."""
        self.orbit = orbit
        self.answer = answer
        self._steer = Steering(orbit, law) if isinstance(law, LawChoice) else law
        self._rate = radius_trim
        self._trim = 0.0
        self._steered: tuple[float, float] | None = None
        """Time, s, and range, m, of the last steered step."""

    def change(self, orbit: Orbit, law: LawChoice, *, keeps_trim: bool) -> None:
        """Fly another circle from now on. Raises ValueError as `__init__`, and then keeps the
        circle."""
        assert isinstance(self._steer, Steering)
        self._steer.change(orbit, law)
        self.orbit = orbit
        self._trim = self._trim if keeps_trim else 0.0

    def command(self, estimate: RangeEstimate, now: float) -> TurnCommand:
        """Return the turn that the law demands, with all corrections."""
        turning = estimate.relative.turn_rate if estimate.relative is not None else 0.0
        pending = self.answer.pending(now, turning)
        command = self._steer(estimate, self._trim, pending, self.answer.monitor.share)
        # Without the target's position the law repeats slow turns on purpose (excitation,
        # successive hypotheses). So the monitor looks for slow limit cycles only while the law
        # flies on the estimated position.
        self.answer.monitor.lap = (
            2 * pi / abs(self.orbit.steady_turn_rate) if command.flies == "drift" else 0.0
        )
        self._trim_radius(estimate, command)
        return self._compensated(command)

    def hold(self, estimate: RangeEstimate | None, now: float) -> TurnCommand:
        """Return the steady turn of the circle, with all corrections."""
        motion = estimate.relative if estimate is not None else None
        pending = self.answer.pending(now, 0.0 if motion is None else motion.turn_rate)
        return self._compensated(holding(self.orbit, motion, pending))

    def reset(self) -> None:
        """Forget the commands. Call when another controller, or no controller, steers the
        vehicle."""
        self.answer.reset()
        self._steered = None

    def _compensated(self, command: TurnCommand) -> TurnCommand:
        return compensate_turn_gain(command, self.orbit.max_turn_rate, self.answer.gain)

    def _trim_radius(self, estimate: RangeEstimate, command: TurnCommand) -> None:
        """Update the radius trim over the time since the last steered step, while the vehicle
        follows."""
        before = self._steered
        self._steered = (estimate.time, estimate.r)
        # A law on range alone turns with V: a vehicle 6 % faster than V flies outside the circle.
        # Laws on relative motion estimate the speed, and a trim did not reduce their error in any
        # emulated flight.
        on_range = not command.flies
        if on_range and before is not None and self._rate > 0 and self.answer.command_gain.followed:
            step = estimate.time - before[0]
            self._trim = next_trim(
                self._trim,
                rate=self._rate,
                r=estimate.r,
                change=estimate.r - before[1] if step <= LONGEST_TRIM_STEP else 0.0,
                r_d=self.orbit.radius,
                V=self.orbit.speed,
                step=min(step, LONGEST_TRIM_STEP),
                saturated=command.saturated or self.answer.bank_limit.short,
            )
