"""How one value of a mission varies from run to run: a list makes a grid, a table names a distribution."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np


class SpecError(Exception):
    """A spec that says nothing; the message names the remedy."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Every value in its turn."""

    values: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A distribution and its numbers, or the values of a choice."""

    kind: str
    numbers: tuple[Any, ...]

    def draw(self, rng: np.random.Generator) -> Any:
        """One value."""
        return DRAWS[self.kind](rng, *self.numbers)


Spec = Grid | Drawn
DRAWS: dict[str, Callable[..., Any]] = {
    "uniform": lambda rng, low, high: float(rng.uniform(low, high)),
    "normal": lambda rng, mean, sigma: float(rng.normal(mean, sigma)),
    "log_uniform": lambda rng, low, high: float(np.exp(rng.uniform(np.log(low), np.log(high)))),
    "choice": lambda rng, *values: values[rng.integers(len(values))],
}
MOST = 1e300
"""Largest bound of a draw: sums of two such numbers are numbers still."""
FORMS = "a list, {uniform=[low, high]}, {log_uniform=[low, high]}, {normal=[mean, sigma]} or {choice=[...]}"


def read_spec(value: Any) -> Spec:
    """The spec of one key of [vary]. Raises SpecError."""
    if isinstance(value, list):
        if not value:
            raise SpecError("is an empty list, name at least one value")
        return Grid(tuple(value))
    if not isinstance(value, dict) or len(value) != 1:
        raise SpecError(f"write {FORMS}, not {value!r}")
    ((kind, numbers),) = value.items()
    if kind not in DRAWS:
        near = get_close_matches(kind, DRAWS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(DRAWS)}"
        raise SpecError(f"{kind}: unknown key, {hint}")
    if not isinstance(numbers, list) or not numbers:
        raise SpecError(f"{kind}: must be a list, not {numbers!r}")
    if kind != "choice":
        _check_numbers(kind, numbers)
    return Drawn(kind, tuple(numbers))


def _is_plain(number: Any) -> bool:
    return isinstance(number, int | float) and not isinstance(number, bool) and abs(number) <= MOST


def _check_numbers(kind: str, numbers: list[Any]) -> None:
    if len(numbers) != 2 or not all(map(_is_plain, numbers)):
        raise SpecError(f"{kind}: must be two numbers, neither of them above {MOST:g}, not {numbers!r:.80}")
    first, second = numbers
    if kind == "normal" and second < 0:
        raise SpecError(f"normal: the standard deviation must be at least 0, not {second:g}")
    if kind != "normal" and first > second:
        raise SpecError(f"{kind}: [{first:g}, {second:g}] is empty, write the lower bound first")
    if kind == "log_uniform" and first <= 0:
        raise SpecError(f"log_uniform: must be above 0, not {first:g}")


def flat(
    table: Mapping[str, Any], before: str = "", whole: Callable[[Mapping[str, Any]], bool] = lambda table: False
) -> Iterator[tuple[str, Any]]:
    """(dotted key, value) pairs of nested tables; `whole` tells which tables are values themselves."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value and not whole(value):
            yield from flat(value, f"{before}{key}.", whole)
        else:
            yield before + key, value
