"""The benchmark: every law and estimator through every situation, a table, a CSV and a picture.

    circnav bench --flights 1000 --out bench

A flight is kept when the RMS radius error of its last 100 s is below 10 m and it went round the right way. Every cell
has its own seed, so a cell prints the same numbers alone and in the whole table.
"""

import csv
import time
import zlib
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.experiments.batch import metrics
from circnav_mav.experiments.batch.flight import Situation, Tracks, fly_situation, policy
from circnav_mav.experiments.batch.guidance import POLICIES
from circnav_mav.experiments.batch.situations import LAST, SITUATIONS
from circnav_mav.experiments.bench_table import markdown
from circnav_mav.experiments.worker_pool import workers
from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.runlog.atomic_write import atomic_write, write_text
from circnav_mav.runlog.turn_command import turn_figures

Array = Any
KEPT_BELOW = 10.0


@dataclass(frozen=True, slots=True)
class Cell:
    """One law in one situation. Lengths in m, times in s; p95: 95th percentile over the flights.

    rms: of the radius error over the last 100 s, peak: its largest. settled10, settled2: last exit from +-10 % and
    +-2 % over the Dubins time to the tangent point, for starts outside 1.3 r_d. closest: 1st percentile of the closest
    approach, for starts outside. wrong_way: flights that went round in the wrong sense, a quarter turn in the
    last 100 s at least. turn_*:
    of the command over the last 100 s, medians; limit_cycles: flights in which it was in one (see `turn_command`).
    range_rmse, rate_rmse: of the estimates, m and m/s, over the last 100 s. nees_in_band: share of steps with the NEES
    of (r, theta) in its 95 % band.
    """

    situation: str
    policy: str
    flights: int
    kept: int
    rms_median: float
    rms_p95: float
    rms_max: float
    peak_median: float
    mean_error: float
    settled10_median: float
    settled10_p95: float
    settled2_median: float
    settled2_p95: float
    closest_outside: float
    overshoot_inside: float
    wrong_way: int
    turn_std_deg_s: float
    turn_at_limit: float
    turn_variation_rad_s2: float
    limit_cycles: int
    range_rmse: float
    rate_rmse: float
    rate_p99: float
    nees_mean: float
    nees_in_band: float
    seconds: float


def run(
    cells: Iterable[tuple[str, str]] | None = None,
    flights: int = 1000,
    seed: int = 1,
    out: Path | None = None,
    *,
    tell: Callable[[str], None] | None = None,
    cores: int = 1,
) -> list[Cell]:
    """Fly cells, (situation, policy) by name, all of them by default; write table.csv, .md and .png into `out`."""
    done: list[Cell] = []
    with closing(_flown(list(cells or product(SITUATIONS, POLICIES)), flights, seed, cores)) as flown:
        for cell in flown:
            done.append(cell)
            if tell is not None:
                tell(line(cell))
            if out is not None:
                write_csv(done, out / "table.csv")
                write_text(out / "table.md", markdown(done))
    if out is not None:
        from circnav_mav.experiments.bench_picture import draw

        draw(done, out / "table.png")
    return done


def _flown(cells: list[tuple[str, str]], flights: int, seed: int, cores: int) -> Generator[Cell, None, None]:
    """The cells in their order, as soon as those before them are flown. Raises WorkerDiedError."""
    if min(cores, len(cells)) == 1:
        yield from (fly_cell(*cell, flights, seed) for cell in cells)
        return
    with workers(cores) as submit:
        flown = [submit(fly_cell, *cell, flights, seed) for cell in cells]
        yield from (cell.result() for cell in flown)


def fly_cell(situation: str, law: str, flights: int, seed: int) -> Cell:
    """Fly one cell. Its worlds depend on seed and situation only: all policies meet the same."""
    flown = SITUATIONS[situation]
    began = time.perf_counter()
    world = seed + zlib.crc32(situation.encode()) % 1_000_000
    tracks = fly_situation(flown, policy(law), flights, world)
    return judged(flown, law, tracks, time.perf_counter() - began)


def judged(situation: Situation, policy: str, tracks: Tracks, seconds: float) -> Cell:
    """The numbers of a cell."""
    circle = situation.circle
    r_d = circle.radius

    def end(values: Array) -> Array:
        return np.asarray(metrics.last(tracks.time, values, LAST), float)

    rms = metrics.rms(end(tracks.r) - r_d)
    right_way = metrics.right_way(end(tracks.angle), tracks.sense)
    outside = tracks.r[0] > 1.3 * r_d
    start = tracks.start
    ideal = metrics.tangent_time(
        start.p[:, outside], start.psi[outside], tracks.sense[outside],
        V=circle.speed, r_d=r_d, max_turn_rate=circle.max_turn_rate,
    )  # fmt: skip
    ten, two = (metrics.last_exit(tracks.time, tracks.r[:, outside], r_d, band) / ideal for band in (0.1, 0.02))
    orbit = Orbit(r_d, Direction.COUNTERCLOCKWISE, circle.speed, circle.max_turn_rate)
    turns = [turn_figures(end(tracks.time), command, orbit) for command in end(tracks.command).T]
    range_error = end(tracks.r_hat) - end(tracks.r)
    rate_error = end(tracks.r_dot_hat) - end(tracks.r_dot)
    nees = end(tracks.nees)
    known = np.isfinite(nees)
    in_band = (nees >= 0.0506) & (nees <= 7.378)
    return Cell(
        situation=situation.name,
        policy=policy,
        flights=rms.size,
        kept=int(((rms < KEPT_BELOW) & right_way).sum()),
        rms_median=float(np.median(rms)),
        rms_p95=_percentile(rms, 95),
        rms_max=float(rms.max()),
        peak_median=float(np.median(np.abs(end(tracks.r) - r_d).max(axis=0))),
        mean_error=float((end(tracks.r) - r_d).mean(axis=0).mean()),
        settled10_median=_percentile(ten, 50),
        settled10_p95=_percentile(ten, 95),
        settled2_median=_percentile(two, 50),
        settled2_p95=_percentile(two, 95),
        closest_outside=_percentile(metrics.closest(tracks.r)[outside], 1),
        overshoot_inside=_percentile(metrics.overshoot(tracks.r, r_d)[tracks.r[0] < r_d], 50),
        wrong_way=int((~right_way & metrics.went_round(end(tracks.angle))).sum()),
        turn_std_deg_s=float(np.median([turn.turn_std_deg_s for turn in turns if turn])),
        turn_at_limit=float(np.median([turn.turn_at_limit for turn in turns if turn])),
        turn_variation_rad_s2=float(np.median([turn.turn_variation_rad_s2 for turn in turns if turn])),
        limit_cycles=sum(turn.turn_limit_cycle for turn in turns if turn),
        range_rmse=float(np.median(metrics.rms(range_error))),
        rate_rmse=float(np.sqrt((rate_error**2).mean())),
        rate_p99=_percentile(np.abs(rate_error).ravel(), 99),
        nees_mean=float(nees[known].mean()) if known.any() else float("nan"),
        nees_in_band=float(in_band[known].mean()) if known.any() else float("nan"),
        seconds=seconds,
    )


def line(cell: Cell) -> str:
    """A row of the printed table. Settling is told in times of the shortest way there, median and 95th percentile."""
    need = SITUATIONS[cell.situation].required
    wanted = "" if need is None or cell.policy != "auto" else f" (<= {need:.2f})"
    wrong = f"wrong way {cell.wrong_way}  " if cell.wrong_way else ""
    cycles = f", limit cycles {cell.limit_cycles}" if cell.limit_cycles else ""
    return (
        f"{cell.situation:24s} {cell.policy:22s} kept {cell.kept:4d} of {cell.flights}  {wrong}"
        f"RMS {cell.rms_median:7.3f} p95 {cell.rms_p95:8.3f}{wanted}, peak {cell.peak_median:.2f}  "
        f"settled to 10 % in {cell.settled10_median:.2f}/{cell.settled10_p95:.2f} ideal times, "
        f"to 2 % in {cell.settled2_median:.2f}  "
        f"turn sd {cell.turn_std_deg_s:.1f} deg/s, at the limit {100 * cell.turn_at_limit:.0f} %, "
        f"varies {cell.turn_variation_rad_s2:.2f} rad/s per s{cycles}  "
        f"r' {cell.rate_rmse:.3f}  {cell.seconds:.0f} s"
    )


def write_csv(cells: list[Cell], path: Path) -> None:
    """All numbers of all cells."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
        rows = [asdict(cell) for cell in cells]
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def _percentile(values: Array, q: float) -> float:
    """A percentile; the larger neighbour, because between a number and infinity there is no mean."""
    return float(np.percentile(values, q, method="higher")) if len(values) else float("nan")
