"""The command `circnav campaign`: many flights, their table and pictures."""

import signal
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from circnav_sim.config import ConfigError

from circnav_mav.cli.exits import Exit, Refused, refusing, say, warn
from circnav_mav.cli.progress import flights, progress
from circnav_mav.extras.campaign.figures import SUMMARY, summarize
from circnav_mav.extras.campaign.fly import fly_run
from circnav_mav.extras.campaign.plan import (
    Campaign,
    CampaignError,
    load_campaign,
    unflyable_value,
    without_effect,
)
from circnav_mav.extras.campaign.plots import plot_campaign
from circnav_mav.extras.campaign.store import TABLE, Store
from circnav_mav.foreign import printable
from circnav_mav.mission.load import MissionError
from circnav_mav.runlog.atomic_write import write_json
from circnav_mav.runtime.clock import local_time_name
from circnav_mav.runtime.jobs import JobsError, cores, fly

SETTLED = ("settled_median", "settled_p95")


def fly_campaign(
    file: str,
    *,
    runs: int | None,
    out: str | None,
    resume: bool,
    scheduler: str | None,
    processes: int | None,
    form: str,
) -> int:
    """Fly the missing runs, print the results, and return the exit code. Raises Refused."""
    with refusing(file, CampaignError, JobsError):
        campaign = load_campaign(file, runs)
        if reason := unflyable_value(campaign):
            raise Refused(reason)
        if resume and out is None:
            raise Refused("--resume: name the folder of the campaign to continue: --out DIR")
        name = Path(file).stem
        folder = Path(out) if out else Path("campaigns") / f"{local_time_name()}-{name}"
        # Let SIGTERM act as Ctrl-C: the results are kept and printed.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with closing(Store(folder, campaign, resume=resume)) as store:
            say(f"{campaign.where}: {campaign.runs} flights")
            with suppress(MissionError, ConfigError):  # a run that cannot be flown has its own row
                warn(without_effect(campaign))
            interrupted = _fly(campaign, store, scheduler, processes)
            return _finish(campaign, store, printable(name), interrupted, form)


def _fly(campaign: Campaign, store: Store, scheduler: str | None, processes: int | None) -> bool:
    """Fly the missing runs. Return True if interrupted. Raises CampaignError, JobsError."""
    missing = [number for number in range(campaign.runs) if number not in store.done]
    if not missing:
        return False
    jobs = ((campaign, number) for number in missing)
    results = fly(fly_run, jobs, processes or cores(), scheduler)
    try:
        with flights(len(store.done), campaign.runs) as show, closing(results):
            for row in results:
                store.add([row])
                show(row["kept"])
    except KeyboardInterrupt:
        return True
    return False


def _finish(campaign: Campaign, store: Store, name: str, interrupted: bool, form: str) -> int:
    """Sort the table, write and print the summary, draw the pictures. Raises CampaignError,
    Refused."""
    store.sort()
    rows = store.read()
    summary = summarize(rows, campaign.swept)
    try:
        write_json(store.folder / SUMMARY, summary)
    except OSError as error:
        raise Refused(
            f"{store.folder}: cannot be written: {error.strerror or error}; {TABLE} is complete"
        ) from None
    with progress("drawing the pictures"):
        pictures, problems = plot_campaign(
            store.folder, rows, list(campaign.specs), list(campaign.swept), name, form
        )
    _print_figures("all flights", summary["all"])
    for key, values in summary["by"].items():
        for value, figures in values.items():
            _print_figures(f"{key} = {value}", figures)
        for value, figures in list(values.items())[1:]:
            _print_difference(f"{value} minus {next(iter(values))}", figures)
    for failure in dict.fromkeys(row["error"] for row in rows if row["error"]):
        say(f"  ERROR      {failure}")
    warn(*problems)
    written = [TABLE, SUMMARY, *(path.name for path in pictures)]
    say(f"  written    {store.folder}/: {', '.join(written)}")
    if interrupted:
        say(
            f"  stopped after {len(rows)} of {campaign.runs} flights; continue with --out"
            f" {store.folder} --resume"
        )
        return Exit.INTERRUPTED
    return Exit.DONE


def _print_difference(what: str, figures: dict[str, Any]) -> None:
    """Print the paired difference of two values of a key."""
    if figures["difference_median"] is None:
        return
    low, high = figures["difference_interval"]
    interval = "" if low is None else f" ({low:+.3g} to {high:+.3g})"
    pairs = f"{figures['pairs']} pairs with the same draws"
    say(f"  {what:<34} RMS {figures['difference_median']:+.3g} m{interval}, {pairs}")


def _print_figures(what: str, figures: dict[str, Any]) -> None:
    """Print one line of the summary."""
    low, high = figures["kept_interval"]
    share = (
        ""
        if low is None
        else f" ({100 * figures['kept_share']:.1f} %, {100 * low:.1f} to {100 * high:.1f})"
    )
    line = f"  {what:<34} kept {figures['kept']} of {figures['flights']}{share}"
    if figures["rms_median"] is not None:
        low, high = figures["rms_interval"]
        interval = "" if low is None else f" ({low:.3g} to {high:.3g})"
        line += f"  RMS {figures['rms_median']:.3g} m{interval}, p95 {figures['rms_p95']:.3g} m"
        median, late = (
            "never" if time is None else f"{time:.0f} s" for time in map(figures.get, SETTLED)
        )
        line += f"  settled {median}, p95 {late}"
    if figures["turn_std_deg_s"] is not None:
        line += (
            f"  turn sd {figures['turn_std_deg_s']:.1f} deg/s, at the limit"
            f" {100 * figures['turn_at_limit']:.0f} %"
        )
    for name in ("limit_cycles", "wrong_way", "not_engaged", "failed"):
        line += f"  {name.replace('_', ' ')}: {figures[name]}" if figures[name] else ""
    say(line)
