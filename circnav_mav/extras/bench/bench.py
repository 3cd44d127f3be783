"""The benchmark: every law and estimator in every situation, as a table, a CSV file and a picture.

    circnav bench --flights 1000 --out bench

A flight is kept if the RMS radius error of its last 100 s is below 10 m and it went round the right way. The random
numbers of a cell depend only on --seed and its situation, so its results are the same alone and in the whole table.
"""

import time
import zlib
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from circnav_mav.extras.batch import metrics
from circnav_mav.extras.batch.flight import LAST, ORBIT, SITUATIONS, Situation, Tracks, fly_situation, policy
from circnav_mav.extras.batch.worker_pool import workers
from circnav_mav.extras.bench.table import Cell, draw, line, markdown, write_csv
from circnav_mav.guidance.maths import Batch
from circnav_mav.runlog.atomic_write import write_text
from circnav_mav.runlog.metrics import turn_figures

KEPT_BELOW = 10.0
"""RMS radius error, m, of a flight that is kept: a tenth of the benchmark's radius; chosen."""


def run(
    cells: Sequence[tuple[str, str]], flights: int, seed: int = 1, out: Path | None = None, *,
    report: Callable[[str], None] = lambda line: None, cores: int = 1,
) -> list[Cell]:  # fmt: skip
    """Fly cells (names of situation and policy). Write table.csv, table.md and table.png into the folder `out`.

    report: called with a line for each cell. Raises WorkerDiedError.
    """
    done: list[Cell] = []
    with workers(cores) if min(cores, len(cells)) > 1 else nullcontext() as submit:
        jobs = [submit(fly_cell, *cell, flights, seed) for cell in cells] if submit else []
        for at, cell in enumerate(cells):
            done.append(jobs[at].result() if jobs else fly_cell(*cell, flights, seed))
            report(line(done[-1]))
            if out is not None:
                write_csv(done, out / "table.csv")
                write_text(out / "table.md", markdown(done))
    if out is not None:
        draw(done, out / "table.png")
    return done


def fly_cell(situation: str, law: str, flights: int, seed: int) -> Cell:
    """Fly one cell. Its worlds depend on seed and situation only, so that they are the same for all policies."""
    flown = SITUATIONS[situation]
    began = time.perf_counter()
    # The figures of BENCHMARK.md were flown when the names of situations were written without leading zeros ("wind
    # .33 V"). The seed is computed from that spelling, so that the same worlds are drawn.
    world = seed + zlib.crc32(situation.replace("0.", ".").encode()) % 1_000_000
    tracks = fly_situation(flown, policy(law), flights, world)
    return evaluate(flown, law, tracks, time.perf_counter() - began)


def evaluate(situation: Situation, policy: str, tracks: Tracks, seconds: float) -> Cell:
    start, r_d, late = tracks.start, ORBIT.radius, tracks.time >= tracks.time[-1] - LAST

    def end(values: Batch) -> Batch:
        return np.asarray(values[late], float)

    error = end(tracks.r) - r_d
    rms = metrics.rms(error)
    right_way = metrics.right_way(end(tracks.angle), tracks.sense)
    outside = tracks.r[0] > 1.3 * r_d
    ideal = metrics.tangent_time(
        start.p[:, outside], start.psi[outside], tracks.sense[outside],
        V=ORBIT.speed, r_d=r_d, max_turn_rate=ORBIT.max_turn_rate,
    )  # fmt: skip
    ten, two = (metrics.last_exit(tracks.time, tracks.r[:, outside], r_d, band * r_d) / ideal for band in (0.1, 0.02))
    commands = (turn_figures(end(tracks.time), command, ORBIT) for command in end(tracks.command).T)
    turns = [turn for turn in commands if turn]
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
        peak_median=float(np.median(np.abs(error).max(axis=0))),
        mean_error=float(error.mean(axis=0).mean()),
        settled10_median=_percentile(ten, 50),
        settled10_p95=_percentile(ten, 95),
        settled2_median=_percentile(two, 50),
        settled2_p95=_percentile(two, 95),
        closest_outside=_percentile(tracks.r[:, outside].min(axis=0), 1),
        overshoot_inside=_percentile(metrics.overshoot(tracks.r, r_d)[tracks.r[0] < r_d], 50),
        wrong_way=int((~right_way & metrics.went_round(end(tracks.angle))).sum()),
        turn_std_deg_s=float(np.median([turn.turn_std_deg_s for turn in turns])),
        turn_at_limit=float(np.median([turn.turn_at_limit for turn in turns])),
        turn_variation_rad_s2=float(np.median([turn.turn_variation_rad_s2 for turn in turns])),
        limit_cycles=sum(turn.turn_limit_cycle for turn in turns),
        range_rmse=float(np.median(metrics.rms(end(tracks.r_hat) - end(tracks.r)))),
        rate_rmse=float(np.sqrt((rate_error**2).mean())),
        rate_p99=_percentile(np.abs(rate_error).ravel(), 99),
        nees_mean=float(nees[known].mean()) if known.any() else float("nan"),
        nees_in_band=float(in_band[known].mean()) if known.any() else float("nan"),
        seconds=seconds,
    )


def _percentile(values: Batch, q: float) -> float:
    """Return a percentile. It is an element of the values, because a number and infinity have no mean."""
    return float(np.percentile(values, q, method="higher")) if len(values) else float("nan")
