"""python -m tests.tools.faults.matrix [--quick] [--profile P] [--fault F] [--level TEXT] [--seed
N]: the fault matrix.

Flies every fault at every level on the emulated vehicles, in lockstep. Prints a line for each cell
and then the table of docs/measured.md, a line for each fault (--out: into a file). A single cell
with the same seed repeats the same flight.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.tools.faults.attacks import ATTACKS
from tests.tools.faults.cell import LAW, Scenario, Verdict, Want, fly
from tests.tools.faults.scenarios.line import LINE
from tests.tools.faults.scenarios.pauses import STANDSTILLS
from tests.tools.faults.scenarios.peers import PEERS
from tests.tools.faults.scenarios.ranging import RANGING
from tests.tools.faults.scenarios.reports import REPORTS
from tests.tools.faults.scenarios.signing import SIGNING

EVERY = (*LINE, *RANGING, *PEERS, *SIGNING, *ATTACKS, *STANDSTILLS, *REPORTS)
SCENARIOS = tuple(sorted(EVERY, key=lambda one: int(one.fault[1:])))
PROFILES = ("arducopter", "arduplane", "ardurover", "px4_copter", "px4_plane")
FIRST = PROFILES[:2]
HEAD = (
    "| fault | level | vehicle | seed | result | RMS % | worst age s | to safe s | recovery s |"
    " rejects |\n|---|---|---|---|---|---|---|---|---|---|"
)
FAULTS = {
    "F1": "frames are lost",
    "F2": "the link is down, one way or both",
    "F3": "frames arrive late",
    "F4": "frames arrive with varying delay (jitter)",
    "F5": "frames arrive in another order",
    "F6": "frames arrive twice",
    "F7": "bytes are damaged, cut off, split, joined",
    "F9": "frames of unknown senders flood the link",
    "F10": "invalid range values",
    "F11": "outliers, noise, offsets, coarse steps",
    "F12": "ranges stop, freeze, arrive seldom or in bursts",
    "F13": "time stamps of the sensor are wrong",
    "F14": "the clock of circnav's computer is wrong",
    "F15": "the autopilot reboots",
    "F16": "the operator takes over, or disarms",
    "F17": "the vehicle sends from another address",
    "F18": "another vehicle, radio or companion sends",
    "F19": "commands are refused, ignored or answered late",
    "F20": "circnav's process is paused",
    "F22": "MAVLink 1, old frames sent again, signed links",
    "F23": "attackers on the link",
    "F24": "the autopilot, the radio or the whole computer is paused",
    "F25": "several range sensors, and ranges faster than ticks",
    "F29": "attitude and airspeed are missing, not finite, or jump",
}
BY_FAULT = (
    "| | fault | levels | circnav | held to, RMS % of the radius | back within, s | silent or safe"
    " within, s | passed on |\n|---|---|---|---|---|---|---|---|"
)


def cells(
    *, quick: bool, profile: str | None, fault: str | None, level: str | None
) -> Iterator[tuple[Scenario, str]]:
    """Return the cells to fly."""
    for scenario in SCENARIOS:
        if (
            (quick and not scenario.quick)
            or fault not in (None, scenario.fault)
            or (level or "") not in scenario.level
        ):
            continue
        for name in (profile,) if profile else FIRST if quick else PROFILES:
            if not scenario.profiles or name in scenario.profiles:
                yield scenario, name


def row(verdict: Verdict) -> str:
    """Return the line of the table for a cell."""
    rejects = (
        ", ".join(f"{count} {name}" for name, count in sorted(verdict.rejects.items())) or "none"
    )
    result = "pass" if verdict.passed else f"**FAIL** {'; '.join(verdict.faults)}"
    return (
        f"| {verdict.scenario.fault} | {verdict.scenario.level} | {verdict.profile} |"
        f" {verdict.seed} | {result} | {100 * verdict.rms:.1f} | {verdict.worst_age:.2f} |"
        f" {_number(verdict.to_safe)} | {_number(verdict.recovery)} | {rejects} |"
    )


def by_fault(verdicts: Iterable[Verdict]) -> str:
    """Return a line for each fault: the reactions of the vehicles, the worst figures of all cells
    of the fault, and the vehicles that passed."""
    flown: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        flown.setdefault(verdict.scenario.fault, []).append(verdict)
    return "\n".join([BY_FAULT, *(_fault_row(fault, found) for fault, found in flown.items())])


def _fault_row(fault: str, found: list[Verdict]) -> str:
    def wanted(verdict: Verdict) -> Want:
        return verdict.scenario.on.get(verdict.profile, verdict.scenario.want)

    def worst(values: Iterable[float | None]) -> str:
        return _number(max((value for value in values if value is not None), default=None))

    answers = Counter(
        wanted(verdict).value for verdict in found if wanted(verdict) is not Want.SAFE
    )
    held = worst(100 * one.rms for one in found if wanted(one) is Want.HOLD and not one.outcome)
    back = worst(
        one.recovery for one in found if wanted(one) in (Want.HOLD, Want.REGAIN) and not one.outcome
    )
    safe = worst(one.to_safe for one in found if one.outcome)
    flew = dict.fromkeys(one.profile for one in found)
    failing = {one.profile for one in found if not one.passed}
    passed = ", ".join(name for name in flew if name not in failing) or "none"
    levels = len({one.scenario.level for one in found})
    answer = "; ".join(answers) or "breaks no rule"
    everyone = f"all {len(flew)}" if not failing and len(flew) == len(PROFILES) else passed
    return (
        f"| {fault} | {FAULTS[fault]} | {levels} | {answer} | {held} | {back} | {safe} |"
        f" {everyone} |"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    started = time.monotonic()
    chosen = list(
        cells(
            quick=options.quick, profile=options.profile, fault=options.fault, level=options.level
        )
    )
    flown: list[Verdict] = []
    print(HEAD)
    for scenario, profile in chosen:
        flown.append(fly(scenario, profile, options.seed, options.law))
        print(row(flown[-1]), flush=True)
    failed = sum(not verdict.passed for verdict in flown)
    summary = (
        f"{len(chosen)} cells, {len(chosen) - failed} passed, {failed} failed, law {options.law},"
        f" seed {options.seed}, {time.monotonic() - started:.0f} s"
    )
    table = by_fault(flown)
    print(f"{summary}\n\n{table}")
    if options.out:
        options.out.write_text(f"{summary}\n\n{table}\n", encoding="utf-8")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.faults.matrix", description="Flies the fault matrix."
    )
    parser.add_argument(
        "--quick", action="store_true", help="some levels of each fault, two vehicles"
    )
    parser.add_argument("--profile", choices=PROFILES)
    parser.add_argument("--fault", help="F1 to F25, F29")
    parser.add_argument("--level", help="part of the level's name")
    parser.add_argument("--law", default=LAW, help="guidance.law of the missions")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, metavar="TABLE.md", help="file for the table by fault")
    return parser


if __name__ == "__main__":
    sys.exit(main())
