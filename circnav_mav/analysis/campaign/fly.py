"""The one function that every way of running a campaign runs: run numbers in, rows out."""

import traceback
from collections.abc import Iterable, Iterator
from typing import Any

from circnav_mav.analysis.campaign.batchable import group, obstacle
from circnav_mav.analysis.campaign.figures import failed_row, row
from circnav_mav.analysis.campaign.flights import fly_batch
from circnav_mav.analysis.campaign.lockstep import fly_lockstep
from circnav_mav.analysis.campaign.plan import Campaign, Run, prepare
from circnav_mav.mission.load import MissionError
from sim.config import ConfigError

Row = dict[str, Any]
BATCH_STEPS = 8_000_000
"""Steps times flights of a chunk: what is kept of a step and flight takes 8 bytes."""
MOST_IN_CHUNK = 1000
"""Flights in a chunk: with more, numpy's own cost of a step does not matter any more."""
LEAST_CHUNKS = 4
"""A small campaign is still cut into so many chunks, for that many processes."""


class NotBatchableError(Exception):
    """A mission that no batch flies, where the campaign wants a batch."""


def chunks(campaign: Campaign) -> list[range]:
    """The runs, cut up in a way that depends on the campaign alone: a row never depends on who flies it with whom."""
    try:
        run = prepare(campaign, 0)
        limits, rate = run.mission.file.limits, run.vehicle.ranging.rate_hz
        steps = int(limits.duration_s * max(limits.tick_hz, rate)) + 1
        batch = campaign.engine != "lockstep" and obstacle(run) is None
    except (MissionError, ConfigError):
        steps, batch = 1, False
    size = min(MOST_IN_CHUNK, max(1, BATCH_STEPS // steps)) if batch else 1
    size = max(1, min(size, -(-campaign.runs // LEAST_CHUNKS)))
    return [range(first, min(first + size, campaign.runs)) for first in range(0, campaign.runs, size)]


def fly_chunk(campaign: Campaign, numbers: Iterable[int]) -> list[Row]:
    """Fly some runs and return their rows in order. Nothing that a run does keeps the others from being flown."""
    rows: dict[int, Row] = {}
    alone: list[Run] = []
    together: dict[tuple[tuple[str, str], ...], list[Run]] = {}
    for number in numbers:
        try:
            run = prepare(campaign, number)
            reason = "the campaign wants lockstep" if campaign.engine == "lockstep" else obstacle(run)
            if reason is not None and campaign.engine == "batch":
                raise NotBatchableError(f"no batch flies this mission: {reason}")
        except (MissionError, ConfigError, NotBatchableError) as error:
            rows[number] = failed_row(number, campaign.values(number), str(error))
            continue
        if reason is None:
            together.setdefault(group(run), []).append(run)
        else:
            alone.append(run)
    for runs in together.values():
        for number, done in _fly_together(runs, alone):
            rows[number] = done
    for run in alone:
        rows[run.number] = _fly_alone(run)
    return [rows[number] for number in sorted(rows)]


def _fly_together(runs: list[Run], alone: list[Run]) -> Iterator[tuple[int, Row]]:
    """The rows of a batch; flights that it cannot fly are handed on to be flown alone."""
    try:
        tracks = fly_batch(runs)
    except Exception:  # one of them broke the arithmetic of all: each for itself
        tracks = None
    if tracks is None:
        alone += runs
        return
    for run, track in zip(runs, tracks, strict=True):
        if track is None:
            alone.append(run)
        else:
            yield run.number, row(run, track)


def _fly_alone(run: Run) -> Row:
    try:
        return row(run, fly_lockstep(run))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"internal error: {type(error).__name__}: {error} ({where.name})"
        return failed_row(run.number, run.values, " ".join(text.split()))
