"""python -m tests.faults.matrix [--quick] [--profile P] [--fault F] [--level TEXT] [--seed N]: the fault matrix.

Every fault at every level over the emulated vehicles, in lockstep; prints one line a cell and writes the table as
Markdown. The seed of a cell is printed: a cell flown alone with it flies the same flight.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from tests.faults.cell import LAW, Scenario, Verdict, fly
from tests.faults.scenarios.attacks import ATTACKS
from tests.faults.scenarios.line import LINE
from tests.faults.scenarios.pauses import STANDSTILLS
from tests.faults.scenarios.peers import PEERS
from tests.faults.scenarios.ranging import RANGING
from tests.faults.scenarios.signing import SIGNING

EVERY = (*LINE, *RANGING, *PEERS, *SIGNING, *ATTACKS, *STANDSTILLS)
SCENARIOS = tuple(sorted(EVERY, key=lambda one: int(one.fault[1:])))
PROFILES = ("arducopter", "arduplane", "ardurover", "px4_copter", "px4_plane", "px4_plane_attitude")
FIRST = PROFILES[:2]
HEAD = (
    "| fault | level | vehicle | seed | result | RMS % | worst age s | to safe s | recovery s | rejects |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def cells(*, quick: bool, profile: str | None, fault: str | None, level: str | None) -> Iterator[tuple[Scenario, str]]:
    """What is to be flown."""
    for scenario in SCENARIOS:
        if (quick and not scenario.quick) or fault not in (None, scenario.fault) or (level or "") not in scenario.level:
            continue
        for name in (profile,) if profile else FIRST if quick else PROFILES:
            if not scenario.profiles or name in scenario.profiles:
                yield scenario, name


def row(verdict: Verdict) -> str:
    """A cell as a line of the table."""
    rejects = ", ".join(f"{count} {name}" for name, count in sorted(verdict.rejects.items())) or "none"
    result = "pass" if verdict.passed else f"**FAIL** {'; '.join(verdict.faults)}"
    return (
        f"| {verdict.scenario.fault} | {verdict.scenario.level} | {verdict.profile} | {verdict.seed} | {result} "
        f"| {100 * verdict.rms:.1f} | {verdict.worst_age:.2f} | {_number(verdict.to_safe)} "
        f"| {_number(verdict.recovery)} | {rejects} |"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    started = time.monotonic()
    chosen = list(cells(quick=options.quick, profile=options.profile, fault=options.fault, level=options.level))
    rows, failed = [], 0
    print(HEAD)
    for scenario, profile in chosen:
        verdict = fly(scenario, profile, options.seed, options.law)
        rows.append(row(verdict))
        failed += not verdict.passed
        print(rows[-1], flush=True)
    summary = (
        f"{len(chosen)} cells, {len(chosen) - failed} passed, {failed} failed, law {options.law}, seed {options.seed}, "
        f"{time.monotonic() - started:.0f} s"
    )
    print(summary)
    if options.out:
        options.out.write_text(f"{summary}\n\n{HEAD}\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.matrix", description="Flies the fault matrix.")
    parser.add_argument("--quick", action="store_true", help="one or two levels of each fault, two vehicles")
    parser.add_argument("--profile", choices=PROFILES)
    parser.add_argument("--fault", help="F1 .. F24")
    parser.add_argument("--level", help="part of the level's name")
    parser.add_argument("--law", default=LAW, help="guidance.law of the missions")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, metavar="TABLE.md", help="write the table as Markdown")
    return parser


if __name__ == "__main__":
    sys.exit(main())
