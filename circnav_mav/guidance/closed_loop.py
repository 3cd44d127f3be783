"""Control loop of one vehicle, from an estimate to a commanded turn rate. Used by the pilot and by
`circnav_mav.Guidance`.

The law computes the turn rate. While ranges are missing, the steady turn of the circle replaces the
law. The turn rate is corrected for the pending turn and for the turn gain. `VehicleModel` learns
the response of the vehicle and monitors it.
"""

from math import pi

from circnav_mav.guidance.step import LawChoice, Steering, coasting, compensate_turn_gain
from circnav_mav.guidance.types import Orbit, OwnLaw, RangeEstimate, TurnCommand
from circnav_mav.guidance.vehicle_model import VehicleModel


class ClosedLoop:
    """Control loop. orbit: current circle. vehicle: model of the vehicle, learned in flight."""

    def __init__(
        self,
        orbit: Orbit,
        law: LawChoice | OwnLaw,
        vehicle: VehicleModel,
    ) -> None:
        """law: a choice from `LAWS`, or a user-defined law. Raises ValueError as `Steering`."""
        self.orbit = orbit
        self.vehicle = vehicle
        self._steer = Steering(orbit, law)

    def change(self, orbit: Orbit, law: LawChoice) -> None:
        """Fly another circle from now on. Raises ValueError as `__init__`, and then keeps the
        circle."""
        self._steer.change(orbit, law)
        self.orbit = orbit

    def command(self, estimate: RangeEstimate, now: float) -> TurnCommand:
        """Return the turn that the law demands, with all corrections."""
        turning = estimate.relative.turn_rate if estimate.relative is not None else 0.0
        pending = self.vehicle.pending(now, turning)
        command = self._steer(estimate, pending, self.vehicle.limit_cycle.share)
        # Without the target's position the law repeats slow turns on purpose (excitation,
        # successive hypotheses). So the monitor looks for slow limit cycles only while the law
        # flies on the estimated position.
        self.vehicle.limit_cycle.lap = (
            2 * pi / abs(self.orbit.steady_turn_rate) if command.flies == "drift" else 0.0
        )
        return self._compensated(command)

    def hold(self, estimate: RangeEstimate | None, now: float) -> TurnCommand:
        """Return the steady turn of the circle, with all corrections."""
        motion = estimate.relative if estimate is not None else None
        pending = self.vehicle.pending(now, 0.0 if motion is None else motion.turn_rate)
        return self._compensated(coasting(self.orbit, motion, pending))

    def reset(self) -> None:
        """Forget the commands. Call when another controller, or no controller, steers the
        vehicle."""
        self.vehicle.reset()

    def _compensated(self, command: TurnCommand) -> TurnCommand:
        return compensate_turn_gain(command, self.orbit.max_turn_rate, self.vehicle.gain)
