"""The benchmark: every law and estimator in every situation, as tables and pictures.

    circnav bench --flights 20 --out bench

A flight is kept if the RMS radius error of its last 100 s is below 10 m and it went round the right
way. The random numbers of a flight depend only on --seed, its situation and its number, so its row
is the same alone and in the whole table. The laws of a situation fly in the same worlds: compare
them by their paired differences.
"""

import csv
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from math import nan
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.cli.progress import flights as progress
from circnav_mav.extras.bench import pictures
from circnav_mav.extras.bench.flight import Track, fly
from circnav_mav.extras.bench.situations import LAST, ORBIT, Situation
from circnav_mav.extras.bench.table import Cell, line, markdown, write_csv
from circnav_mav.foreign import read_lines
from circnav_mav.runlog import many_flights
from circnav_mav.runlog.atomic_write import atomic_write, write_text
from circnav_mav.runlog.many_flights import quantile
from circnav_mav.runlog.metrics import TurnFigures, turn_figures
from circnav_mav.runtime import jobs

Row = dict[str, Any]
"""Figures of one flight. Its keys are NAMES."""
FLIGHTS = "flights.csv"
"""Table of the flights, appended flight by flight, so that an interrupted benchmark continues."""
NAMES = (
    "situation", "policy", "seed", "flight", "kept", "wrong_way", "rms", "peak",
    "mean_error", "settled10", "settled2", "closest", "overshoot", "turn_std_deg_s",
    "turn_at_limit", "turn_variation_rad_s2", "turn_limit_cycle", "range_rmse", "rate_rmse",
    "rate_p99", "nees_mean", "nees_in_band", "nees_last", "nis_last", "seconds",
)  # fmt: skip
WORDS = ("situation", "policy")


class BenchError(Exception):
    """Folder of another benchmark; the message is one line with the remedy."""


def run(
    cells: Sequence[tuple[Situation, str]],
    flights: int,
    seed: int = 1,
    out: Path | None = None,
    *,
    report: Callable[[str], None] = lambda line: None,
    processes: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    form: str = "png",
) -> list[Row]:
    """Fly cells (situation and name of the policy). Return the rows of all finished flights, sorted
    by cell and number. Ctrl-C ends the flights, and the finished ones are returned.

    out: folder for the tables and pictures. resume: True to fly only the flights that are missing
    in its FLIGHTS. report: called with a line for each finished cell. Raises BenchError, JobsError.
    """
    done = {} if out is None else _reopen(out, seed, resume)
    wanted = {
        (situation.name, law, number): (situation, law, seed, number)
        for situation, law in cells
        for number in range(flights)
    }
    missing = {key: job for key, job in wanted.items() if key not in done}
    reported = 0

    def report_finished() -> None:
        nonlocal reported
        while reported < len(cells):
            keys = list(wanted)[: flights * (reported + 1)]
            if not all(key in done for key in keys[-flights:]):
                return
            report(line(table([done[key] for key in keys])[-1]))
            reported += 1

    with progress(len(wanted) - len(missing), len(wanted)) as show:
        report_finished()
        results = jobs.fly(fly_one, missing.values(), min(processes, len(missing) or 1), scheduler)
        try:
            with closing(results):
                for row in results:
                    done[_key(row)] = row
                    if out is not None:
                        _append(out / FLIGHTS, row.values())
                    show(row["kept"])
                    report_finished()
        except KeyboardInterrupt:
            pass
    rows = [done[key] for key in wanted if key in done]
    if out is not None and rows:
        write(rows, out, form)
    return rows


def _reopen(out: Path, seed: int, resume: bool) -> dict[tuple[str, str, int], Row]:
    """Return the finished flights of a folder. Their table is written again, because its last line
    may be incomplete. Raises BenchError."""
    done = {_key(row): row for row in read(out / FLIGHTS, seed)}
    if done and not resume:
        raise BenchError(f"{out}: holds flights already: --resume them, or name another --out")
    with atomic_write(out / FLIGHTS) as fresh:
        _append(fresh, NAMES, *(row.values() for row in done.values()))
    return done


def _append(path: Path, *rows: Iterable[Any]) -> None:
    with path.open("a", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def write(rows: Sequence[Row], out: Path, form: str = "png") -> None:
    """Write the tables and pictures of the rows into a folder."""
    cells = table(rows)
    write_csv(cells, out / "table.csv")
    write_text(out / "table.md", markdown(cells))
    pictures.draw(cells, out / f"table.{form}")
    if any(cell.consistency_flights for cell in cells):
        pictures.draw_consistency(cells, out / f"consistency.{form}")


def table(rows: Sequence[Row]) -> list[Cell]:
    """Return the cells of the rows."""
    by: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        by.setdefault((row["situation"], row["policy"]), []).append(row)
    first: dict[str, list[Row]] = {}
    for (situation, _), some in by.items():
        first.setdefault(situation, some)
    return [cell_of(some, first[situation]) for (situation, _), some in by.items()]


def read(path: Path, seed: int) -> Iterator[Row]:
    """Yield the rows of a table of flights. An incomplete last line is dropped. Raises
    BenchError."""
    for texts in csv.DictReader(read_lines(path) if path.is_file() else ()):
        if None in texts.values():
            return
        try:
            row: Row = {
                name: texts[name] if name in WORDS else _value(texts[name]) for name in NAMES
            }
        except (KeyError, ValueError) as error:
            raise BenchError(
                f"{path}: cannot resume: {error}: damaged, or of another version: name another"
                " --out"
            ) from None
        if row["seed"] != seed:
            raise BenchError(
                f"{path}: cannot resume: its flights have seed {row['seed']}: give this --seed, or"
                " name another --out"
            )
        yield row


def _value(text: str) -> float | int | bool:
    if text in ("True", "False"):
        return text == "True"
    return int(text) if text.isdecimal() else float(text)


def _key(row: Row) -> tuple[str, str, int]:
    return row["situation"], row["policy"], row["flight"]


def cell_of(rows: Sequence[Row], first: Sequence[Row]) -> Cell:
    """Return the figures of a cell. first: flights of the situation's first policy, in the same
    worlds."""
    n = len(rows)
    beside = {row["flight"]: row["rms"] for row in first}
    differences = np.sort(
        [row["rms"] - beside[row["flight"]] for row in rows if row["flight"] in beside]
    )

    def known(name: str) -> NDArray[Any]:
        values = np.array([row[name] for row in rows], float)
        return np.sort(values[~np.isnan(values)])

    def at(name: str, share: float) -> float:
        return quantile(known(name), share)

    def mean(name: str) -> float:
        return _known(np.mean, known(name))

    rms = known("rms")
    low, high = _median_interval(rms, n)
    less, more = _median_interval(differences, len(differences))
    return Cell(
        situation=rows[0]["situation"],
        policy=rows[0]["policy"],
        flights=n,
        kept=sum(row["kept"] for row in rows),
        rms_median=quantile(rms, 0.5),
        rms_low=low,
        rms_high=high,
        rms_p95=quantile(rms, 0.95),
        rms_max=float(rms[-1]),
        peak_median=at("peak", 0.5),
        mean_error=mean("mean_error"),
        settled10_median=at("settled10", 0.5),
        settled10_p95=at("settled10", 0.95),
        settled2_median=at("settled2", 0.5),
        settled2_p95=at("settled2", 0.95),
        closest_outside=at("closest", 0.01),
        overshoot_inside=at("overshoot", 0.5),
        wrong_way=sum(row["wrong_way"] for row in rows),
        turn_std_deg_s=at("turn_std_deg_s", 0.5),
        turn_at_limit=at("turn_at_limit", 0.5),
        turn_variation_rad_s2=at("turn_variation_rad_s2", 0.5),
        limit_cycles=sum(row["turn_limit_cycle"] for row in rows),
        range_rmse=at("range_rmse", 0.5),
        rate_rmse=_known(many_flights.rms, known("rate_rmse")),
        rate_p99=at("rate_p99", 0.5),
        nees_mean=mean("nees_mean"),
        nees_in_band=mean("nees_in_band"),
        nees_last=mean("nees_last"),
        nis_last=mean("nis_last"),
        consistency_flights=max(len(known("nees_last")), len(known("nis_last"))),
        difference_median=quantile(differences, 0.5),
        difference_low=less,
        difference_high=more,
        seconds=sum(row["seconds"] for row in rows),
    )


def _median_interval(ordered: NDArray[Any], worlds: int) -> list[float]:
    """Return the 95 % interval of the median, NaN for None."""
    ends: list[float] = np.array(many_flights.median_interval(ordered, worlds), float).tolist()
    return ends


def fly_one(situation: Situation, law: str, seed: int, number: int) -> Row:
    """Fly one flight and return its row. Its world depends on seed, situation and number only, so
    that it is the same for all policies."""
    began = time.process_time()
    world = seed + zlib.crc32(situation.name.encode()) % 1_000_000
    track = fly(situation, law, world, number)
    names = {"situation": situation.name, "policy": law, "seed": seed, "flight": number}
    return names | figures(track) | {"seconds": time.process_time() - began}


def figures(track: Track) -> Row:
    """Return the figures of a flight. See `Cell` for their meanings."""
    r_d = ORBIT.radius
    late = track.time >= track.time[-1] - LAST
    r = np.asarray(track.rows["r"], float)[:, None]
    end = {name: np.asarray(values[late], float) for name, values in track.rows.items()}
    error = end["r"] - r_d
    rms = float(many_flights.rms(error))
    angle = end["angle"][:, None]
    right_way = bool(many_flights.right_way(angle, np.array([track.sense]))[0])
    outside = bool(r[0, 0] > 1.3 * r_d)
    ideal = np.array([nan])
    if outside:
        ideal = many_flights.tangent_time(
            np.array([track.start]).T, np.array([track.heading]), np.array([track.sense]),
            V=ORBIT.speed, r_d=r_d, max_turn_rate=ORBIT.max_turn_rate,
        )  # fmt: skip
    ten, two = (
        float((many_flights.last_exit(track.time, r, r_d, band * r_d) / ideal)[0])
        for band in (0.1, 0.02)
    )
    no_turn = TurnFigures(nan, nan, nan, turn_limit_cycle=False)
    turn = turn_figures(track.time[late], end["command"], ORBIT) or no_turn
    range_error = _finite(end["r_hat"] - end["r"])
    rate_error = _finite(end["r_dot_hat"] - end["r_dot"])
    nees = _finite(end["nees"])
    return {
        # 10.0: largest RMS radius error of a kept flight, m. Chosen: a tenth of the radius.
        "kept": rms < 10.0 and right_way,
        "wrong_way": not right_way and bool(many_flights.went_round(angle)[0]),
        "rms": rms,
        "peak": float(np.abs(error).max()),
        "mean_error": float(error.mean()),
        "settled10": ten,
        "settled2": two,
        "closest": float(r.min()) if outside else nan,
        "overshoot": nan if r[0, 0] >= r_d else float(many_flights.overshoot(r, r_d)[0]),
        **asdict(turn),
        "range_rmse": _known(many_flights.rms, range_error),
        "rate_rmse": _known(many_flights.rms, rate_error),
        "rate_p99": quantile(np.abs(rate_error), 0.99),
        "nees_mean": _known(np.mean, nees),
        # 0.0506, 7.378: band of 95 % of chi-squared with two degrees of freedom
        "nees_in_band": _known(np.mean, (nees >= 0.0506) & (nees <= 7.378)),
        "nees_last": _known(itemgetter(-1), nees),
        "nis_last": _known(itemgetter(-1), _finite(end["nis"])),
    }


def _known(figure: Callable[[NDArray[Any]], Any], values: NDArray[Any]) -> float:
    """Return a figure of the values, or NaN without values."""
    return float(figure(values)) if len(values) else nan


def _finite(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(values[np.isfinite(values)])
