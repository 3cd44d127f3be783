"""python -m tests.faults.attacks [--profile P] [--seed N]: what attackers on the link can do, a row each.

What the setpoints did, and what the operator was shown meanwhile. docs/safety.md has the trust model.
"""

import argparse
import sys

from tests.faults.cell import Verdict, fly
from tests.faults.scenarios.attacks import ATTACKS

HEAD = "| attack | setpoints | shown to the operator | result |\n|---|---|---|---|"


def row(verdict: Verdict) -> str:
    """An attack as a line of the table."""
    scenario = verdict.scenario
    if verdict.outcome:
        did = f"end: {verdict.outcome}"
    elif not verdict.engaged:
        did = "none: not engaged"
    elif scenario.fresh:
        did = "none before it was over, then engaged"
    else:
        did = f"hold the circle, RMS {100 * verdict.rms:.1f} %"
    shown = next((line for line in verdict.reported if scenario.reported in line), "-") if scenario.reported else "-"
    result = "safe, reported" if verdict.passed else f"**FAIL** {'; '.join(verdict.faults)}"
    return f"| {scenario.level} | {did} | {shown} | {result} |"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.attacks", description="Flies the attack table.")
    parser.add_argument("--profile", choices=("arducopter", "arduplane"), default="arducopter")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    print(HEAD)
    failed = 0
    for scenario in ATTACKS:
        verdict = fly(scenario, options.profile, options.seed)
        print(row(verdict), flush=True)
        failed += not verdict.passed
    print(f"{len(ATTACKS)} attacks, {failed} failed, {options.profile}, seed {options.seed}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
