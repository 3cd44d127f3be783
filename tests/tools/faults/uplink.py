"""python -m tests.tools.faults.uplink [--seeds N] [--first N] [--profile P]: one minute without
uplink, for several seeds.

Telemetry and ranges arrive, but the vehicle receives no commands. Prints for each seed the time to
regain the circle after the outage, and the largest radius error after the circle was regained. The
fault matrix flies one seed.
"""

import argparse
import sys
from math import inf
from typing import NamedTuple

from tests.tools.fault_link import Impairment
from tests.tools.faults.course import BAND, Course

OUTAGE = 60.0
AFTER = 50.0
WITHIN = 25.0
MOST_SWING = 0.1
"""Bounds: time to regain the circle, s, and radius error after the circle was regained, share of
the radius."""


class Regained(NamedTuple):
    """within: time to regain the circle, s; None: never regained. swing: largest radius error
    afterwards, share of the radius. broken: broken rules for setpoints."""

    within: float | None
    swing: float
    broken: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return (
            self.within is not None
            and self.within <= WITHIN
            and self.swing < MOST_SWING
            and not self.broken
        )


def fly(profile: str, seed: int) -> Regained:
    """Fly one seed of a vehicle with law `auto` until its circle is steady, then cut the uplink."""
    course = Course(profile, ('guidance.law="auto"', f"sim.seed={seed}")).fly(110.0)
    start = course.now
    course.link.impair(up=Impairment(loss=1.0))
    course.fly(start + OUTAGE)
    course.link.impair()
    course.fly(course.now + AFTER)
    errors = course.errors(start + OUTAGE, inf)
    outside = [time for time, error in errors if abs(error) > BAND]
    reached = next((time for time, error in errors if abs(error) < BAND), inf)
    swing = max((abs(error) for time, error in errors if time > reached), default=inf)
    done = course.pilot.mission.outcome is not None or not outside or outside[-1] > course.now - 5.0
    within = None if done else outside[-1] - start - OUTAGE
    return Regained(within, swing, tuple(course.broken))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.faults.uplink", description="Flies uplink outages."
    )
    parser.add_argument("--profile", default="arducopter")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=100)
    options = parser.parse_args(arguments)
    failed = 0
    for seed in range(options.first, options.first + options.seeds):
        one = fly(options.profile, seed)
        failed += not one.passed
        took = "not regained" if one.within is None else f"{one.within:.1f} s"
        print(
            f"seed {seed}: {took}, swing {100 * one.swing:.1f} %{'' if one.passed else ', FAIL'}",
            flush=True,
        )
    print(f"{options.seeds} seeds, {failed} failed, {options.profile}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
