"""Whether the bank of filters knows how wrong it is, and what it costs, beside the version before. Prints; asserts
nothing.

    git worktree add ../before COMMIT                # a folder with a version of before
    python -m tests.bench.bench_bank --before ../before

A row is a situation of the benchmark: share of the time in which the NEES of (r, theta) lies in its 95 % band over the
last 100 s, and the processor's time of the bank's steps, one flight at a time as in the air.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from circnav_mav.experiments.batch.flight import fly_situation, policy
from circnav_mav.experiments.batch.situations import SITUATIONS
from circnav_mav.experiments.bench import judged
from circnav_mav.guidance.estimators.multiple_model import DriftBank

ROOT = Path(__file__).parents[2]
SHOWN = (
    "calm", "wind .33 V", "wind .53 V", "target stops and goes", "wind .33 V turns 90 deg in 10 s",
    "gusts 1.5, wind .33 V", "the same with accelerations", "uwb, wind .2 V", "lora, wind .2 V",
)  # fmt: skip
ALONE = 60.0
"""Time, s, of the flight whose steps are timed."""


def measured(situation: str, flights: int, seed: int) -> tuple[float, float]:
    """Share of the time in the band, and processor's time of a step, us."""
    flown = SITUATIONS[situation]
    cell = judged(flown, "auto", fly_situation(flown, policy("auto"), flights, seed), 0.0)
    spent, steps, step = 0.0, 0, DriftBank.step

    def timed(*args: object) -> None:
        nonlocal spent, steps
        began = time.process_time()
        step(*args)  # type: ignore[arg-type]
        spent, steps = spent + time.process_time() - began, steps + 1

    DriftBank.step = timed  # type: ignore[method-assign, assignment]
    fly_situation(replace(flown, duration=ALONE), policy("auto"), 1, seed)
    DriftBank.step = step  # type: ignore[method-assign]
    return cell.nees_in_band, 1e6 * spent / steps


def of_version(root: Path, situation: str, flights: int, seed: int) -> tuple[float, float]:
    """The same of the version in a folder, in a process of its own."""
    asked = [sys.executable, __file__, "--one", situation, "--flights", str(flights), "--seed", str(seed)]
    said = subprocess.run(
        asked, env={**os.environ, "PYTHONPATH": str(root)}, capture_output=True, check=True, text=True
    )
    in_band, cost = json.loads(said.stdout)
    return float(in_band), float(cost)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--before", type=Path, help="folder with another version; without it only this one is measured")
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--seed", type=int, default=2027)
    parser.add_argument("--situations", nargs="+", default=SHOWN, choices=SITUATIONS, metavar="SITUATION")
    parser.add_argument("--one", choices=SITUATIONS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one is not None:
        print(json.dumps(measured(args.one, args.flights, args.seed)))
        return
    roots = [ROOT] if args.before is None else [args.before.resolve(), ROOT]
    print("| situation |" + " NEES in its 95 % band | a step, us |" * len(roots) + " times as long |")
    print("|---|" + "---|---|" * len(roots) + "---|")
    for situation in args.situations:
        found = [of_version(root, situation, args.flights, args.seed) for root in roots]
        told = "".join(f" {100 * in_band:.0f} % | {cost:.0f} |" for in_band, cost in found)
        print(f"| {situation} |{told} {found[-1][1] / found[0][1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
