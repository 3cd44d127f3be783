"""Reads a campaign file: which mission, how often, and what varies. Whatever is wrong becomes one line."""

import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from circnav_mav.experiments.campaign.plan import DRAWS, START, Campaign, Spec, SpecError, flat, read_spec
from circnav_mav.mission.load import MissionError, in_words, load_mission, read_text, read_toml


class CampaignError(Exception):
    """A campaign that cannot be flown as written; the message is one line for the person who wrote it."""


class CampaignFile(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    mission: Annotated[str, Field(min_length=1)]
    runs: Annotated[int, Field(ge=1, le=10_000_000)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    engine: Literal["batch", "lockstep"] | None = None
    vary: dict[str, Any]


def load_campaign(path: str | Path, runs: int | None = None) -> Campaign:
    """Read and validate a campaign file; `runs` replaces its number of flights. Raises CampaignError."""
    path = Path(path)
    try:
        text = read_text(path)
        table = read_toml(text, str(path))
    except MissionError as error:
        raise CampaignError(str(error)) from None
    if "vehicle" in table and "vary" not in table:
        raise CampaignError(f"{path}: is a mission file, fly it with: circnav fly {path}")
    try:
        file = CampaignFile.model_validate(table if runs is None else table | {"runs": runs})
    except ValidationError as error:
        raise CampaignError(f"{path}: {in_words(error, CampaignFile)}") from None
    mission_path = path.parent / file.mission
    try:
        mission = load_mission(mission_path)
    except MissionError as error:
        raise CampaignError(f"{path}: mission: {error}") from None
    if mission.file.sim is None or not mission.flies_sim:
        raise CampaignError(f'{path}: mission: {file.mission}: needs a [sim] table and link.endpoint = "sim"')
    return Campaign(
        where=str(path),
        mission=tomllib.loads(mission.text),
        mission_text=mission.text,
        text=text,
        runs=file.runs,
        seed=file.seed,
        engine=file.engine,
        specs=_specs(file.vary, str(path)),
    )


def _specs(vary: Mapping[str, Any], where: str) -> dict[str, Spec]:
    """The specs by dotted key, whether the file wrote the key in quotes or as nested tables."""
    specs: dict[str, Spec] = {}

    def names_a_distribution(table: Mapping[str, Any]) -> bool:  # or nearly: what is misspelt is told as such
        return any(get_close_matches(name, DRAWS, n=1, cutoff=0.75) for name in table)

    for key, value in flat(vary, whole=names_a_distribution):
        _check_alone(key, specs, where)
        try:
            specs[key] = read_spec(value)
        except SpecError as error:
            raise CampaignError(f"{where}: vary.{key}: {error}") from None
    if not specs:
        raise CampaignError(f'{where}: vary: is empty, name what varies: "sim.wind.speed_mps" = [0.0, 5.0]')
    return specs


def _check_alone(key: str, others: Iterable[str], where: str) -> None:
    """No other key sets what this one does, or a part of it. Raises CampaignError."""
    sets = f"{START.get(key, key)}."
    for other in others:
        if other == key:
            raise CampaignError(f"{where}: vary: {key} is there twice, in two spellings: keep one")
        taken = f"{START.get(other, other)}."
        if sets.startswith(taken) or taken.startswith(sets):
            raise CampaignError(f"{where}: vary: {other} and {key} set the same key: keep one")
