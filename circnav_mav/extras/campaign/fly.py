"""Flights of a campaign: they convert run numbers to rows of the table. Each flight is the real
pilot against the emulated vehicle, step by step (lockstep)."""

import traceback
from typing import Any

from circnav_sim.config import ConfigError

from circnav_mav.extras.campaign.figures import failed_row, row
from circnav_mav.extras.campaign.lockstep import fly_lockstep
from circnav_mav.extras.campaign.plan import Campaign, prepare
from circnav_mav.mission.load import MissionError

Row = dict[str, Any]


def fly_run(campaign: Campaign, number: int) -> Row:
    """Fly a run and return its row. A run that cannot be flown has a row with its error."""
    try:
        run = prepare(campaign, number)
    except (MissionError, ConfigError) as error:
        return failed_row(number, campaign.values(number), str(error))
    try:
        return row(run, fly_lockstep(run))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1].name
        text = " ".join(f"internal error: {type(error).__name__}: {error} ({where})".split())
        return failed_row(number, run.values, text)
