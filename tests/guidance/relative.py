"""Relative motions for tests: a vehicle at 15 m/s, 100 m east of its target, known and trusted but where told else."""

from functools import partial

from circnav_mav.guidance.types import RelativeMotion

known = partial(
    RelativeMotion, x=100.0, y=0.0, sigma=1.0, drift_x=0.0, drift_y=0.0, heading=0.0, turn_rate=0.0, airspeed=15.0,
    scale=1.0, trusted=True,
)  # fmt: skip
guessed = partial(known, trusted=False, trial=4)
