"""The loop of one vehicle, from an estimate to the turn rate to command: for the pilot and for `circnav_mav.Guidance`.

The law, or the circle's own turn while ranges are missing, is corrected by the radius trim, by what is commanded but
not turned yet, and by the turn gain. `TurnAnswer` learns and monitors how the vehicle follows.
"""

from collections.abc import Callable

from circnav_mav.guidance.step import Flies, LawChoice, Steering, compensate_turn_gain, holding
from circnav_mav.guidance.turn_answer import TurnAnswer
from circnav_mav.guidance.types import Orbit, OwnMotion, RangeEstimate, TurnCommand
from circnav_mav.guidance.watches import next_trim

DRIFT = Flies.DRIFT.name.lower()
LONGEST_TRIM_STEP = 0.2
"""Longest time, s, that the radius integral counts between two steps: a gap is not an error that lasted."""


class ClosedLoop:
    """orbit: the circle that is flown now. answer: the vehicle's response to turn commands, learned in flight."""

    def __init__(
        self, orbit: Orbit, law: LawChoice | Callable[..., TurnCommand], answer: TurnAnswer, radius_trim: float = 0.0
    ) -> None:
        """law: one of ours, or a function with the arguments of a `Steering`. radius_trim: rate of the slow integral
        that holds the mean radius, 1/s. Raises ValueError if the radius correction does not exist for the gain."""
        self.orbit, self.answer = orbit, answer
        self._steer = Steering(orbit, law) if isinstance(law, LawChoice) else law
        self._rate, self._trim = radius_trim, 0.0
        self._steered: tuple[float, float] | None = None
        """Time, s, and range, m, of the last steered step."""

    def change(self, orbit: Orbit, law: LawChoice, *, keeps_trim: bool) -> None:
        """Fly another circle from now on. Raises ValueError as above; then the circle stays as it was."""
        assert isinstance(self._steer, Steering)
        self._steer.change(orbit, law)
        self.orbit, self._trim = orbit, self._trim if keeps_trim else 0.0

    def feel(self, own: OwnMotion, nose: OwnMotion) -> bool:
        """Learn from own motion; return True if the vehicle was commanded. nose: motion as it was reported."""
        commanded = self.answer.feel(own)
        if commanded:
            self.answer.watch(nose)
        return commanded

    def command(self, estimate: RangeEstimate, now: float) -> TurnCommand:
        """Return the turn that the law asks for."""
        turning = estimate.relative.turn_rate if estimate.relative is not None else 0.0
        pending = self.answer.pending(now, turning)
        command = self._steer(estimate, self._trim, pending, self.answer.monitor.share)
        self._trim_radius(estimate, command)
        return self._compensated(command)

    def hold(self, estimate: RangeEstimate | None, now: float) -> TurnCommand:
        """Return the circle's own turn."""
        motion = estimate.relative if estimate is not None else None
        pending = self.answer.pending(now, 0.0 if motion is None else motion.turn_rate)
        return self._compensated(holding(self.orbit, motion, pending))

    def reset(self) -> None:
        """Forget the commands: another has the vehicle, or nothing steers it."""
        self.answer.reset()
        self._steered = None

    def _compensated(self, command: TurnCommand) -> TurnCommand:
        return compensate_turn_gain(command, self.orbit.max_turn_rate, self.answer.gain)

    def _trim_radius(self, estimate: RangeEstimate, command: TurnCommand) -> None:
        """Let the slow integral run over the time since the last steered step, while the vehicle follows."""
        before, self._steered = self._steered, (estimate.time, estimate.r)
        # An approach that does not know where the target is closes slowly. Counted as a lasting error, it would be
        # held on the other side of the circle for half a minute afterwards.
        approaches = command.flies not in ("", DRIFT)
        if before is not None and self._rate > 0 and self.answer.by_command.followed and not approaches:
            step = estimate.time - before[0]
            self._trim = next_trim(
                self._trim,
                rate=self._rate,
                r=estimate.r,
                change=estimate.r - before[1] if step <= LONGEST_TRIM_STEP else 0.0,
                r_d=self.orbit.radius + command.offset,
                V=self.orbit.speed,
                step=min(step, LONGEST_TRIM_STEP),
                saturated=command.saturated or self.answer.bank_limit.short,
            )
