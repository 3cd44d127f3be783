"""The benchmark as a function."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from circnav_mav.extras.bench.bench import run, table
from circnav_mav.extras.bench.flight import check_policy
from circnav_mav.extras.bench.situations import SITUATIONS, Situation
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.laws import LAWS


def bench(
    laws: Iterable[Any],
    situations: Iterable[str | Situation] = ("calm",),
    *,
    flights: int = 4,
    seed: int = 1,
    processes: int = 1,
    scheduler: str | None = None,
    each: bool = False,
) -> list[dict[str, Any]]:
    """Fly every law in every situation, and return a row per situation and law, as in table.csv of
    `circnav bench`. Fields: `circnav_mav.extras.bench.table.Cell`. All rows together are a table:
    `pandas.DataFrame(rows)`. Ctrl-C ends the flights, and the finished ones are returned.

    laws: names of laws, your law, or a pair (law, estimator) of names or of your objects. Your law
        and your estimator have the form of docs/api.md.
    situations: names, or situations of your own.
    processes: number of processes. Other processes must be able to import your law and estimator,
        so those of a notebook fly in one process.
    scheduler: address of a Dask scheduler.
    each: True for a row per flight instead.

    Raises ValueError.
    """
    policies = [policy(law) for law in laws]
    for name in policies:
        check_policy(name)
    places = [_situation(one) for one in situations]
    cells = [(place, name) for place in places for name in policies]
    rows = run(cells, flights, seed, processes=processes, scheduler=scheduler)
    return rows if each else [asdict(cell) for cell in table(rows)]


def policy(law: Any) -> str:
    """Return the name of a law, or of a pair (law, estimator). Raises ValueError."""
    if not isinstance(law, tuple):
        return law if isinstance(law, str) else LAWS.add(law)
    law, estimator = law
    return f"{policy(law)}+{estimator if isinstance(estimator, str) else ESTIMATORS.add(estimator)}"


def _situation(one: str | Situation) -> Situation:
    if isinstance(one, Situation):
        return one
    if one not in SITUATIONS:
        raise ValueError(f'situation "{one}" is not one of: {"; ".join(SITUATIONS)}')
    return SITUATIONS[one]
