"""What every way of running a campaign runs: run numbers in, rows out."""

import traceback
from collections.abc import Collection, Iterable, Sequence
from typing import Any

from circnav_mav.emulator.config import ConfigError
from circnav_mav.experiments.campaign.batchable import group, obstacle
from circnav_mav.experiments.campaign.figures import failed_row, row
from circnav_mav.experiments.campaign.flights import fly_batch, time_step
from circnav_mav.experiments.campaign.lockstep import fly_lockstep
from circnav_mav.experiments.campaign.plan import Campaign, Run, prepare
from circnav_mav.mission.load import MissionError

Row = dict[str, Any]
BATCH_STEPS = 8_000_000
"""Steps times flights of a chunk: what is kept of a step and flight takes 13 bytes."""
MOST_IN_CHUNK = 1000
"""Flights in a chunk: with more, numpy's own cost of a step does not matter any more."""
MOST_LOOKED_AT = 64
"""Flights among which one is looked for that a batch flies."""
LEAST_CHUNKS = 4
"""A small campaign is still cut into so many chunks, for that many processes."""


def chunks(campaign: Campaign) -> list[range]:
    """The runs, cut up in a way that depends on the campaign alone: a row never depends on who flies it with whom."""
    size = max(1, min(_most_together(campaign), -(-campaign.runs // LEAST_CHUNKS)))
    return [range(first, min(first + size, campaign.runs)) for first in range(0, campaign.runs, size)]


def _most_together(campaign: Campaign) -> int:
    """How many flights make a chunk: as many as memory holds of the first that a batch flies, one where none does."""
    for number in range(min(campaign.runs, MOST_LOOKED_AT) if campaign.engine != "lockstep" else 0):
        try:
            run = prepare(campaign, number)
        except (MissionError, ConfigError):
            continue
        if obstacle(run) is None:
            steps = int(run.mission.file.limits.duration_s / time_step(run)) + 1
            return min(MOST_IN_CHUNK, max(1, BATCH_STEPS // steps))
    return 1


def fly_chunk(campaign: Campaign, numbers: Iterable[int]) -> list[Row]:
    """Fly some runs to their ends and return their rows in order."""
    rows, alone = _fly_batches(campaign, numbers)
    return sorted(rows + [_fly_alone(run) for run in alone], key=lambda done: int(done["run"]))


def fly_part(campaign: Campaign, chunk: Sequence[int], wanted: Collection[int]) -> tuple[list[Row], list[int]]:
    """The rows of those wanted runs of a chunk that fly together, and the numbers of those that take a flight each:
    their rows need not wait for one another. A single run is always flown.

    The whole batch is flown: how numpy sums up depends on how many fly together, and a row must not depend on where a
    campaign was interrupted.
    """
    if len(chunk) == 1:
        return fly_chunk(campaign, chunk), []
    rows, alone = _fly_batches(campaign, chunk)
    return [row for row in rows if row["run"] in wanted], [run.number for run in alone if run.number in wanted]


def _fly_batches(campaign: Campaign, numbers: Iterable[int]) -> tuple[list[Row], list[Run]]:
    """The rows of all but the runs that must be flown alone, and these. Nothing that a run does keeps the others from
    being flown."""
    rows: list[Row] = []
    alone: list[Run] = []
    together: dict[tuple[tuple[str, str], ...], list[Run]] = {}
    for number in numbers:
        try:
            run = prepare(campaign, number)
        except (MissionError, ConfigError) as error:
            rows.append(failed_row(number, campaign.values(number), str(error)))
            continue
        reason = "the campaign wants lockstep" if campaign.engine == "lockstep" else obstacle(run)
        if reason is None:
            together.setdefault(group(run), []).append(run)
        elif campaign.engine == "batch":
            rows.append(failed_row(number, run.values, f"no batch flies this mission: {reason}"))
        else:
            alone.append(run)
    for runs in together.values():
        try:
            tracks = fly_batch(runs)
        except Exception:  # one of them broke the arithmetic of all: each for itself
            tracks = None
        if tracks is None:
            alone += runs
        else:
            rows += [row(run, track) for run, track in zip(runs, tracks, strict=True)]
    return rows, alone


def _fly_alone(run: Run) -> Row:
    try:
        return row(run, fly_lockstep(run))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"internal error: {type(error).__name__}: {error} ({where.name})"
        return failed_row(run.number, run.values, " ".join(text.split()))
