"""The fault matrix.

    python -m tests.tools.faults.matrix [--quick] [--profile P] [--fault F] [--level TEXT]

Flies every fault at every level on the emulated vehicles, in lockstep. Prints a line for each cell
and then the table of docs/measured.md, a line for each fault (--out: into a file). A single cell
with the same seed repeats the same flight.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from tests.tools import cells
from tests.tools.cells import Result
from tests.tools.faults.cell import LAW, Want, fly
from tests.tools.faults.scenarios.attacks import ATTACKS
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
CELLS = {
    f"{scenario.fault}, {scenario.level}, {profile}": (scenario, profile)
    for scenario in SCENARIOS
    for profile in scenario.profiles or PROFILES
}
HEAD = (
    "fault, level, vehicle | seed | result | RMS % | worst age s | to safe s | recovery s | swing %"
    " | rejects | shown to the operator"
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
    "fault | meaning | levels | circnav | held to, RMS % of the radius | back within, s"
    " | silent or safe within, s | passed on"
)


def chosen(
    *, quick: bool = False, profile: str | None = None, fault: str | None = None, level: str = ""
) -> Iterator[str]:
    """Return the names of the cells to fly."""
    for name, (scenario, flown) in CELLS.items():
        profiles = (profile,) if profile else FIRST if quick else PROFILES
        if (
            flown in profiles
            and scenario.quick >= quick
            and fault in (None, scenario.fault)
            and level in scenario.level
        ):
            yield name


def cell(name: str, seed: int, law: str) -> Result:
    """Fly a cell."""
    return asdict(fly(*CELLS[name], seed, law))


def row(one: Result) -> list[object]:
    """Return the line of the table for a cell."""
    rejects = ", ".join(f"{count} {name}" for name, count in sorted(one["rejects"].items()))
    result = f"**FAIL** {'; '.join(one['faults'])}" if one["faults"] else "pass"
    wanted = CELLS[one["row"]][0].reported
    shown = next((text for text in one["reported"] if wanted and wanted in text), "-")
    figures = (100 * one["rms"], one["worst_age"], one["to_safe"], one["recovery"])
    swing = 100 * one["swing"]
    return [one["row"], one["seed"], result, *figures, swing, rejects or "none", shown]


def by_fault(flown: Mapping[str, Sequence[Result]]) -> str:
    """Return a table with a line for each fault: the reactions of the vehicles, the worst figures
    of all cells of the fault, and the vehicles that passed."""
    faults: dict[str, list[Result]] = {}
    for name, flights in flown.items():
        faults.setdefault(CELLS[name][0].fault, []).extend(flights)
    return cells.table(BY_FAULT, (_fault_row(fault, found) for fault, found in faults.items()))


def _wanted(one: Result) -> Want:
    scenario, profile = CELLS[one["row"]]
    return scenario.on.get(profile, scenario.want)


def _passed(flights: Sequence[Result]) -> str:
    """Return the vehicles that passed all cells."""
    flew = dict.fromkeys(CELLS[one["row"]][1] for one in flights)
    failing = {CELLS[one["row"]][1] for one in flights if one["faults"]}
    passed = [name for name in flew if name not in failing]
    return f"all {len(passed)}" if len(passed) == len(PROFILES) else ", ".join(passed) or "none"


def _fault_row(fault: str, flights: Sequence[Result]) -> list[object]:
    answers = dict.fromkeys(want.value for want in map(_wanted, flights) if want is not Want.SAFE)
    held = [one for one in flights if _wanted(one) is Want.HOLD]
    back = [one for one in flights if _wanted(one) is Want.REGAIN] + held
    return [
        fault,
        FAULTS[fault],
        len({CELLS[one["row"]][0].level for one in flights}),
        "; ".join(answers) or "breaks no rule",
        _worst("rms", held, 100.0, ended=False),
        _worst("recovery", back, ended=False),
        _worst("to_safe", flights, ended=True),
        _passed(flights),
    ]


def _worst(
    figure: str, flights: Iterable[Result], unit: float = 1.0, *, ended: bool
) -> float | None:
    """Return the largest known figure of the flights that have ended their mission, or not."""
    known = [one[figure] for one in flights if bool(one["outcome"]) is ended]
    return max((unit * value for value in known if value is not None), default=None)


def main() -> int:
    parser = cells.parser(__doc__, CELLS, (1, 1))
    parser.add_argument("--quick", action="store_true", help="some levels, two vehicles")
    parser.add_argument("--profile", choices=PROFILES)
    parser.add_argument("--fault", help="F1 to F25, F29")
    parser.add_argument("--level", default="", help="part of the level's name")
    parser.add_argument("--law", default=LAW, help="guidance.law of the missions")
    parser.add_argument("--out", type=Path, metavar="TABLE.md", help="file for the table by fault")
    given = parser.parse_args()
    names = chosen(quick=given.quick, profile=given.profile, fault=given.fault, level=given.level)
    given.rows = [name for name in names if name in given.rows]
    flown = cells.flown(partial(cell, law=given.law), given)
    flights = [one for found in flown.values() for one in found]
    print(cells.table(HEAD, map(row, flights)))
    failed = sum(bool(one["faults"]) for one in flights)
    summary = f"{len(flights)} flights, {failed} failed, law {given.law}\n\n{by_fault(flown)}\n"
    print(summary)
    if given.out:
        given.out.write_text(summary, encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
