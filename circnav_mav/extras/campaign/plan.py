"""Campaign files (mission, number of runs, varied values) and their runs.

The values and the seed of a run follow from the campaign's seed and the run's number. An error in a
file is one line.
"""

import copy
import tomllib
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import prod
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from circnav_sim.config import ConfigError, VehicleConfig, parse_vehicle
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from circnav_mav.cli.check import NO_WIND, drifts_with_wind
from circnav_mav.guidance.own_code import OwnCodeError
from circnav_mav.mission.load import (
    MissionError,
    load_mission,
    mission_of,
    put,
    read_text,
    read_toml,
)
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.problems import in_words


@dataclass(frozen=True, slots=True)
class Distribution:
    """A distribution and its numbers, or the values of a choice."""

    kind: str
    numbers: tuple[Any, ...]

    def draw(self, rng: np.random.Generator) -> Any:
        return DRAWS[self.kind](rng, *self.numbers)


Spec = tuple[Any, ...] | Distribution
"""The values of a grid, or a distribution."""
DRAWS: dict[str, Callable[..., Any]] = {
    "uniform": lambda rng, low, high: float(rng.uniform(low, high)),
    "normal": lambda rng, mean, sigma: float(rng.normal(mean, sigma)),
    "log_uniform": lambda rng, low, high: float(np.exp(rng.uniform(np.log(low), np.log(high)))),
    "choice": lambda rng, *values: values[rng.integers(len(values))],
}
MOST = 1e300
"""Largest bound of a random value. It is chosen so that the sum of two such numbers is finite."""
FORMS = (
    "a list, {uniform=[low, high]}, {log_uniform=[low, high]}, {normal=[mean, sigma]} or"
    " {choice=[...]}"
)


def read_spec(value: Any) -> Spec:
    """Return the grid or the distribution that a value in [vary] describes. Raises ValueError with
    the remedy."""
    if isinstance(value, list):
        if not value:
            raise ValueError("is an empty list, name at least one value")
        return tuple(value)
    if not isinstance(value, dict) or len(value) != 1:
        raise ValueError(f"write {FORMS}, not {value!r}")
    ((kind, numbers),) = value.items()
    if kind not in DRAWS:
        near = get_close_matches(kind, DRAWS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(DRAWS)}"
        raise ValueError(f"{kind}: unknown key, {hint}")
    if not isinstance(numbers, list) or not numbers:
        raise ValueError(f"{kind}: must be a list, not {numbers!r}")
    if kind != "choice":
        _check_numbers(kind, numbers)
    return Distribution(kind, tuple(numbers))


def _check_numbers(kind: str, numbers: list[Any]) -> None:
    if len(numbers) != 2 or not all(
        type(number) in (int, float) and abs(number) <= MOST for number in numbers
    ):
        raise ValueError(
            f"{kind}: must be two numbers, neither of them above {MOST:g}, not {numbers!r:.80}"
        )
    first, second = numbers
    if kind == "normal" and second < 0:
        raise ValueError(f"normal: the standard deviation must be at least 0, not {second:g}")
    if kind != "normal" and first > second:
        raise ValueError(f"{kind}: [{first:g}, {second:g}] is empty, write the lower bound first")
    if kind == "log_uniform" and first <= 0:
        raise ValueError(f"log_uniform: must be above 0, not {first:g}")


def flat(
    table: Mapping[str, Any],
    before: str = "",
    whole: Callable[[Mapping[str, Any]], bool] = lambda table: False,
) -> Iterator[tuple[str, Any]]:
    """Yield (dotted key, value) of nested tables. whole(table): True if the table itself is a
    value."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value and not whole(value):
            yield from flat(value, f"{before}{key}.", whole)
        else:
            yield before + key, value


START = {
    f"start.{name}": f"sim.start.random.{name}"
    for name in ("range_m", "bearing_deg", "heading_deg")
}
"""Keys of [vary] for the start relative to the target, and the keys of the vehicle file that they
set. The vehicle file has this start only as bounds of random values."""
LEAST_TRIED = 32
"""Smallest number of runs whose missions are checked for a listed value. If all of these missions
are impossible, the campaign file is refused."""
MOST_TRIED = 256
"""Largest number of runs that are checked for a listed value. Between both bounds, one run is
checked for each grid point of the other keys."""


@dataclass(frozen=True)
class Campaign:
    """Contents of a campaign file. mission: table of the mission file. mission_text, text: the
    files as written."""

    where: str
    mission: dict[str, Any]
    mission_text: str
    text: str
    runs: int
    seed: int
    specs: dict[str, Spec]

    @property
    def swept(self) -> dict[str, tuple[Any, ...]]:
        """The keys with lists of values."""
        return {key: spec for key, spec in self.specs.items() if isinstance(spec, tuple)}

    @property
    def cells(self) -> int:
        """Number of points of the grid."""
        return prod(len(values) for values in self.swept.values())

    def values(self, run: int) -> dict[str, Any]:
        """Return the values of run number `run` by key, with the emulator's seed.

        Successive runs pass through the grid repeatedly. All points of a pass have the same draws
        and the same noise.
        """
        world, cell = divmod(run, self.cells)
        values: dict[str, Any] = {}
        for key, spec in self.specs.items():
            if isinstance(spec, Distribution):
                values[key] = spec.draw(
                    np.random.default_rng([self.seed, world, zlib.crc32(key.encode())])
                )
            else:
                cell, which = divmod(cell, len(spec))
                values[key] = spec[which]
        seed = int(np.random.SeedSequence([self.seed, world]).generate_state(1)[0])
        return {"sim.seed": seed} | values


class CampaignError(Exception):
    """Error in a campaign file, its execution or its folder; the message is one line with the
    remedy."""


class CampaignFile(BaseModel):
    """The campaign file."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    mission: Annotated[str, Field(min_length=1)]
    runs: Annotated[int, Field(ge=1, le=10_000_000)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    vary: dict[str, Any]


def load_campaign(path: str | Path, runs: int | None = None) -> Campaign:
    """Read and validate a campaign file; `runs` replaces its number of flights. Raises
    CampaignError."""
    path = Path(path)
    try:
        text = read_text(path)
        table = read_toml(text, str(path))
    except MissionError as error:
        raise CampaignError(str(error)) from None
    if "vehicle" in table and "vary" not in table:
        raise CampaignError(f"{path}: is a mission file, fly it with: circnav fly {path}")
    return campaign_of(
        table if runs is None else table | {"runs": runs}, str(path), path.parent, text
    )


def campaign_of(table: Mapping[str, Any], where: str, folder: Path, text: str = "") -> Campaign:
    """Return the campaign of a table. where: its name in messages. folder: folder of the mission.
    text: the file as written. Raises CampaignError."""
    try:
        file = CampaignFile.model_validate(table)
    except ValidationError as error:
        raise CampaignError(f"{where}: {in_words(error, CampaignFile)}") from None
    mission_path = folder / file.mission
    try:
        mission = load_mission(mission_path)
    except MissionError as error:
        raise CampaignError(f"{where}: mission: {error}") from None
    if mission.file.sim is None or not mission.flies_sim:
        raise CampaignError(
            f'{where}: mission: {file.mission}: needs a [sim] table and link.endpoint = "sim"'
        )
    return Campaign(
        where=where,
        mission=tomllib.loads(mission.text),
        mission_text=mission.text,
        text=text,
        runs=file.runs,
        seed=file.seed,
        specs=_specs(file.vary, where),
    )


def _specs(vary: Mapping[str, Any], where: str) -> dict[str, Spec]:
    """Return the specs by dotted key. The file may write keys in quotes or as nested tables."""
    specs: dict[str, Spec] = {}

    # True also for a misspelled name, so that the misspelling is reported.
    def names_a_distribution(table: Mapping[str, Any]) -> bool:
        return any(get_close_matches(name, DRAWS, n=1, cutoff=0.75) for name in table)

    for key, value in flat(vary, whole=names_a_distribution):
        _check_alone(key, specs, where)
        try:
            specs[key] = read_spec(value)
        except ValueError as error:
            raise CampaignError(f"{where}: vary.{key}: {error}") from None
    if not specs:
        raise CampaignError(
            f'{where}: vary: is empty, name what varies: "sim.wind.speed_mps" = [0.0, 5.0]'
        )
    return specs


def _check_alone(key: str, others: Iterable[str], where: str) -> None:
    """Check that no other key sets the same value or a part of it. Raises CampaignError."""
    sets = f"{START.get(key, key)}."
    for other in others:
        if other == key:
            raise CampaignError(f"{where}: vary: {key} is given twice, in two spellings: keep one")
        taken = f"{START.get(other, other)}."
        if sets.startswith(taken) or taken.startswith(sets):
            raise CampaignError(f"{where}: vary: {other} and {key} set the same key: keep one")


@dataclass(frozen=True)
class Run:
    """A run that is ready to fly: number, values, checked mission and checked vehicle."""

    number: int
    values: dict[str, Any]
    mission: Mission
    vehicle: VehicleConfig


def prepare(campaign: Campaign, number: int) -> Run:
    """Return a run, with its mission checked as any mission file. Raises MissionError,
    ConfigError."""
    values = campaign.values(number)
    table = copy.deepcopy(campaign.mission)
    where = f"{campaign.where}: vary"
    for key, value in values.items():
        path = START.get(key, key)
        given = [value, value] if key in START else value
        put(table, path.split("."), given, f"{where}: {path}")
    mission = mission_of(table, where)
    if mission.file.sim is None or not mission.flies_sim:
        raise MissionError(f'{where}: link.endpoint: must stay "sim"')
    try:
        mission.import_own_code()
    except OwnCodeError as error:
        raise MissionError(f"{where}: {error}") from None
    return Run(number, values, mission, parse_vehicle(mission.file.sim, f"{where}: sim"))


def without_effect(campaign: Campaign) -> str | None:
    """Return a note if the campaign varies the wind, and the vehicle of its first run holds its
    speed over ground. Raises MissionError, ConfigError."""
    if "sim.wind.speed_mps" not in campaign.specs:
        return None
    run = prepare(campaign, 0)
    return None if drifts_with_wind(run.mission, run.vehicle) else NO_WIND


def unflyable_value(campaign: Campaign) -> str | None:
    """Return the reason why a listed value cannot be flown with any other values, or why no run can
    be flown. None if all values can be flown."""
    stride = 1
    points = [(1, 1, 0)]
    for values in campaign.swept.values():
        points += [(stride, len(values), which) for which in range(len(values))]
        stride *= len(values)
    return next(filter(None, (_why_not(campaign, *point) for point in points)), None)


def _why_not(campaign: Campaign, stride: int, values: int, which: int) -> str | None:
    """Return the reason why no run with value number `which` of a key can be flown. None if a run
    can be flown.

    Only a sample of the runs is checked: some points of the grid, with some random draws.
    stride: step in the number of the grid point from one value of the key to the next.
    values: number of values of the key.
    """
    first = None
    others = campaign.cells // values
    rng = np.random.default_rng([campaign.seed, which])
    for world in range(min(max(others, LEAST_TRIED), MOST_TRIED)):
        other = world % others if others <= MOST_TRIED else int(rng.random() * others)
        above, below = divmod(other, stride)
        cell = (above * values + which) * stride + below
        try:
            prepare(campaign, world * campaign.cells + cell)
            return None
        except (MissionError, ConfigError) as error:
            first = first or str(error)
    return first
