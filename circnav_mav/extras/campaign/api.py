"""A campaign as a function."""

import warnings
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from circnav_sim.config import ConfigError

from circnav_mav.cli.progress import flights
from circnav_mav.extras.campaign.fly import Row, fly_run
from circnav_mav.extras.campaign.plan import (
    CampaignError,
    campaign_of,
    unflyable_value,
    without_effect,
)
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.own_code import NameTable
from circnav_mav.mission.load import MissionError
from circnav_mav.runtime import jobs

OWN: dict[str, NameTable[Any]] = {"guidance.law": LAWS, "guidance.estimator": ESTIMATORS}


def campaign(
    mission: str | Path,
    vary: Mapping[str, Any],
    runs: int,
    *,
    seed: int = 0,
    processes: int = 1,
    scheduler: str | None = None,
) -> list[Row]:
    """Fly a mission file many times on the emulated vehicle with varied values, and return a row
    per flight, as in runs.csv of `circnav campaign`. Ctrl-C ends the flights, and the finished ones
    are returned.

    vary: values by key, as in [vary] of a campaign file. A warning is issued for a wind that has
        no effect on the vehicle. The lists of "guidance.law" and
        "guidance.estimator" may contain your objects, in the form of docs/api.md.
    runs: number of flights of the whole grid together.
    processes: number of processes. Other processes must be able to import your law and estimator,
        so those of a notebook fly in one process.
    scheduler: address of a Dask scheduler.

    Raises ValueError.
    """
    named = {
        key: [one if isinstance(one, str) else OWN[key].add(one) for one in value]
        if key in OWN and isinstance(value, list)
        else value
        for key, value in vary.items()
    }
    table = {"mission": str(Path(mission).absolute()), "runs": runs, "seed": seed, "vary": named}
    try:
        planned = campaign_of(table, "campaign", Path())
        if reason := unflyable_value(planned):
            raise CampaignError(reason)
        with suppress(MissionError, ConfigError):  # a run that cannot be flown has its own row
            if note := without_effect(planned):
                warnings.warn(note, stacklevel=2)
    except CampaignError as error:
        raise ValueError(str(error)) from None
    rows: list[Row] = []
    numbers = ((planned, number) for number in range(runs))
    try:
        with (
            flights(0, runs) as show,
            closing(jobs.fly(fly_run, numbers, processes, scheduler)) as results,
        ):
            for row in results:
                rows.append(row)
                show(row["kept"])
    except KeyboardInterrupt:
        pass
    return sorted(rows, key=lambda row: row["run"])
