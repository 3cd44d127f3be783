"""`circnav bench`, `circnav campaign`, `circnav paper`: many flights, and their tables and pictures."""

import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from circnav_sim.config import ConfigError
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extras.campaign.execute import cores, on_cores, on_scheduler
from circnav_mav.extras.campaign.figures import SUMMARY, summarise
from circnav_mav.extras.campaign.fly import Row, chunks, obstacle
from circnav_mav.extras.campaign.plan import Campaign, CampaignError, hopeless, load_campaign, prepare
from circnav_mav.extras.campaign.plots import plot_campaign
from circnav_mav.extras.campaign.store import TABLE, Store
from circnav_mav.foreign import printable
from circnav_mav.mission.load import MissionError
from circnav_mav.runlog.atomic_write import write_json
from circnav_mav.runtime.clock import local_time_name

SHOWN = 2
"""The start that the paper's figures show, where there are as many."""
MOST_JUDGED = 200
"""Flights of which it is found out beforehand which engine they need."""
SETTLED = ("settled_median", "settled_p95")
TELL_EVERY = 10.0
"""Time, s, between two lines of progress where there is no terminal."""


def fly_campaign(
    file: str, *, runs: int | None, out: str | None, resume: bool, scheduler: str | None, processes: int | None
) -> int:
    """Fly what is missing, tell what came of it, and return the exit code. Raises Refused."""
    with refusing(file, CampaignError):
        campaign = load_campaign(file, runs)
        if reason := hopeless(campaign):
            raise Refused(reason)
        if resume and out is None:
            raise Refused("--resume: name the folder to go on with: --out DIR")
        name = Path(file).stem
        folder = Path(out) if out else Path("campaigns") / f"{local_time_name()}-{name}"
        engines = _engines(campaign)
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what was flown is kept, and said
        with closing(Store(folder, campaign, resume=resume)) as store:
            say(engines)
            interrupted = _fly(campaign, store, scheduler, processes)
            return _finish(campaign, store, printable(name), interrupted)


def _engines(campaign: Campaign) -> str:
    """Which engine flies how many of the flights, judged by the first of them, in words. Raises Refused."""
    if campaign.engine == "lockstep":
        return f"{campaign.where}: {campaign.runs} flights in lockstep"
    judged = min(campaign.runs, MOST_JUDGED)
    reasons: Counter[str] = Counter()
    for number in range(judged):
        with suppress(MissionError, ConfigError):  # a flight that cannot be prepared says so in its row
            reasons.update(filter(None, [obstacle(prepare(campaign, number))]))
    if reasons and campaign.engine == "batch":
        raise Refused(f'{campaign.where}: engine: "batch" cannot fly this: {next(iter(reasons))}')
    slow = sum(reasons.values())
    counted = f"{judged - slow} in batches, {slow} in lockstep"
    flights = f"{campaign.runs} flights" + (f", of the first {judged}" if judged < campaign.runs else "")
    each = [f"  in lockstep, one by one: {count} where {reason}" for reason, count in reasons.items()]
    return "\n".join([f"{campaign.where}: {flights}: {counted}", *each])


def _fly(campaign: Campaign, store: Store, scheduler: str | None, processes: int | None) -> bool:
    """Fly the missing runs; tells whether somebody interrupted. Raises CampaignError."""
    torn = [chunk for chunk in chunks(campaign) if not store.done.issuperset(chunk)]
    if not torn:
        return False
    done = frozenset(store.done)
    if scheduler is None:
        results = on_cores(campaign, torn, processes or cores(), done)
    else:
        results = on_scheduler(campaign, torn, scheduler, done)
    try:
        with _progress(len(store.done), campaign.runs) as show, closing(results):
            for rows in results:
                store.add(rows)
                show(len(store.done), rows)
    except KeyboardInterrupt:
        return True
    return False


@contextmanager
def _progress(done: int, total: int) -> Iterator[Callable[[int, list[Row]], None]]:
    """A bar with the time left on a terminal, else a line from time to time."""
    console = Console()
    if not console.is_terminal:
        yield _lines(done, total)
        return
    looks = (TextColumn("flights"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[lost]}"),
             TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())  # fmt: skip
    with Progress(*looks, console=console) as bar:
        task = bar.add_task("", total=total, completed=done, lost="")
        lost = 0

        def show(done: int, rows: list[Row]) -> None:
            nonlocal lost
            lost += sum(not row["kept"] for row in rows)
            bar.update(task, completed=done, lost=f"{lost} not kept")

        yield show


def _lines(before: int, total: int) -> Callable[[int, list[Row]], None]:
    began = told = time.monotonic()

    def show(done: int, rows: list[Row]) -> None:
        nonlocal told
        now = time.monotonic()
        if now - told >= TELL_EVERY:
            told, rate = now, max(done - before, 1) / (now - began)
            say(f"  {done} of {total} flights, {(total - done) / rate:.0f} s left")

    return show


def _finish(campaign: Campaign, store: Store, name: str, interrupted: bool) -> int:
    """Sort the table, write and print the summary, draw. Raises CampaignError, Refused."""
    store.sort()
    rows = store.read()
    summary = summarise(rows, campaign.swept)
    try:
        write_json(store.folder / SUMMARY, summary)
    except OSError as error:
        raise Refused(f"{store.folder}: cannot be written: {error.strerror or error}; {TABLE} is complete") from None
    pictures, problems = plot_campaign(store.folder, rows, list(campaign.specs), list(campaign.swept), name)
    _say("all flights", summary["all"])
    for key, values in summary["by"].items():
        for value, figures in values.items():
            _say(f"{key} = {value}", figures)
    for said in dict.fromkeys(row["error"] for row in rows if row["error"]):
        say(f"  ERROR      {said}")
    for problem in problems:
        say(f"  WARNING    {problem}")
    written = [TABLE, SUMMARY, *(path.name for path in pictures)]
    say(f"  written    {store.folder}/: {', '.join(written)}")
    if interrupted:
        say(f"  stopped after {len(rows)} of {campaign.runs} flights; go on with --out {store.folder} --resume")
        return Exit.INTERRUPTED
    return Exit.DONE


def _say(what: str, figures: dict[str, Any]) -> None:
    """One line of the summary."""
    low, high = figures["kept_interval"]
    share = "" if low is None else f" ({100 * figures['kept_share']:.1f} %, {100 * low:.1f} .. {100 * high:.1f})"
    line = f"  {what:<34} kept {figures['kept']} of {figures['flights']}{share}"
    if figures["rms_median"] is not None:
        low, high = figures["rms_interval"]
        sure = "" if low is None else f" ({low:.3g} .. {high:.3g})"
        line += f"  RMS {figures['rms_median']:.3g} m{sure}, p95 {figures['rms_p95']:.3g} m"
        median, late = ("never" if time is None else f"{time:.0f} s" for time in map(figures.get, SETTLED))
        line += f"  settled {median}, p95 {late}"
    if figures["turn_std_deg_s"] is not None:
        line += f"  turn sd {figures['turn_std_deg_s']:.1f} deg/s, at the limit {100 * figures['turn_at_limit']:.0f} %"
    for name in ("limit_cycles", "wrong_way", "not_engaged", "failed"):
        line += f"  {name.replace('_', ' ')}: {figures[name]}" if figures[name] else ""
    say(line)
