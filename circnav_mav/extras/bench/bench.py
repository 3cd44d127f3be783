"""The benchmark: every law and estimator in every situation, as a table, a CSV file and a picture.

    circnav bench --flights 20 --out bench

A flight is kept if the RMS radius error of its last 100 s is below 10 m and it went round the right
way. The random numbers of a cell depend only on --seed and its situation, so its results are the
same alone and in the whole table. The laws of a situation fly in the same worlds: compare them by
their paired differences.
"""

import time
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.extras.bench.flight import Track, fly
from circnav_mav.extras.bench.situations import LAST, ORBIT, SITUATIONS, Situation
from circnav_mav.extras.bench.table import Cell, draw, line, markdown, write_csv
from circnav_mav.runlog import many_flights
from circnav_mav.runlog.atomic_write import write_text
from circnav_mav.runlog.metrics import turn_figures
from circnav_mav.runtime.worker_pool import workers

Flown = tuple[Track, float]
"""A flight and its processor time, s."""


def run(
    cells: Sequence[tuple[str, str]], flights: int, seed: int = 1, out: Path | None = None, *,
    report: Callable[[str], None] = lambda line: None, cores: int = 1, form: str = "png",
) -> list[Cell]:  # fmt: skip
    """Fly cells (names of situation and policy). Write table.csv, table.md and the figure into the
    folder `out`.

    report: called with a line for each cell. Raises WorkerDiedError.
    """
    done: list[Cell] = []
    first: dict[str, NDArray[Any]] = {}
    with workers(cores) if min(cores, len(cells) * flights) > 1 else nullcontext() as submit:
        jobs: list[list[Future[Flown]]] = []
        if submit is not None:
            jobs = [
                [submit(fly_one, *cell, seed, number) for number in range(flights)]
                for cell in cells
            ]
        for at, cell in enumerate(cells):
            if jobs:
                flown = [job.result() for job in jobs[at]]
                jobs[at] = []  # free the memory of the tracks
            else:
                flown = [fly_one(*cell, seed, number) for number in range(flights)]
            seconds = sum(one for _, one in flown)
            tracks = [track for track, _ in flown]
            beside = first.setdefault(cell[0], rms_errors(tracks))
            done.append(evaluate(SITUATIONS[cell[0]], cell[1], tracks, seconds, beside))
            report(line(done[-1]))
            if out is not None:
                write_csv(done, out / "table.csv")
                write_text(out / "table.md", markdown(done))
    if out is not None:
        draw(done, out / f"table.{form}")
    return done


def fly_one(situation: str, law: str, seed: int, number: int) -> Flown:
    """Fly one flight. Its world depends on seed, situation and number only, so that it is the same
    for all policies."""
    began = time.process_time()
    world = seed + zlib.crc32(situation.encode()) % 1_000_000
    track = fly(SITUATIONS[situation], law, world, number)
    return track, time.process_time() - began


def rms_errors(flown: Sequence[Track]) -> NDArray[Any]:
    """Return the RMS radius error of the evaluated part of each flight, m."""
    late = flown[0].time >= flown[0].time[-1] - LAST
    return many_flights.rms(np.array([track.rows["r"][late] for track in flown]).T - ORBIT.radius)


def evaluate(
    situation: Situation,
    policy: str,
    flown: Sequence[Track],
    seconds: float,
    beside: NDArray[Any],
) -> Cell:
    """Return the figures of a cell. seconds: processor time of its flights. beside: `rms_errors` of
    the situation's first policy."""
    r_d = ORBIT.radius
    time = flown[0].time
    late = time >= time[-1] - LAST
    rows = {
        name: np.array([track.rows[name] for track in flown], float).T for name in flown[0].rows
    }
    sense = np.array([track.sense for track in flown])
    start = np.array([track.start for track in flown]).T
    heading = np.array([track.heading for track in flown])

    def end(name: str) -> NDArray[Any]:
        return np.asarray(rows[name][late])

    error = end("r") - r_d
    rms = rms_errors(flown)
    differences = np.sort(rms - beside)
    low, high = many_flights.median_interval(differences, len(differences))
    right_way = many_flights.right_way(end("angle"), sense)
    outside = rows["r"][0] > 1.3 * r_d
    ideal = many_flights.tangent_time(
        start[:, outside], heading[outside], sense[outside],
        V=ORBIT.speed, r_d=r_d, max_turn_rate=ORBIT.max_turn_rate,
    )  # fmt: skip
    ten, two = (
        many_flights.last_exit(time, rows["r"][:, outside], r_d, band * r_d) / ideal
        for band in (0.1, 0.02)
    )
    commands = (turn_figures(time[late], command, ORBIT) for command in end("command").T)
    turns = [turn for turn in commands if turn]
    range_error = end("r_hat") - end("r")
    rate_error = end("r_dot_hat") - end("r_dot")
    rate_error = rate_error[np.isfinite(rate_error)]
    nees = end("nees")
    known = np.isfinite(nees)
    in_band = (nees >= 0.0506) & (nees <= 7.378)
    # 10.0: largest RMS radius error of a kept flight, m. Chosen: a tenth of the benchmark's radius.
    return Cell(
        situation=situation.name,
        policy=policy,
        flights=rms.size,
        kept=int(((rms < 10.0) & right_way).sum()),
        rms_median=float(np.median(rms)),
        rms_p95=_percentile(rms, 95),
        rms_max=float(rms.max()),
        peak_median=float(np.median(np.abs(error).max(axis=0))),
        mean_error=float(error.mean(axis=0).mean()),
        settled10_median=_percentile(ten, 50),
        settled10_p95=_percentile(ten, 95),
        settled2_median=_percentile(two, 50),
        settled2_p95=_percentile(two, 95),
        closest_outside=_percentile(rows["r"][:, outside].min(axis=0), 1),
        overshoot_inside=_percentile(
            many_flights.overshoot(rows["r"], r_d)[rows["r"][0] < r_d], 50
        ),
        wrong_way=int((~right_way & many_flights.went_round(end("angle"))).sum()),
        turn_std_deg_s=float(np.median([turn.turn_std_deg_s for turn in turns])),
        turn_at_limit=float(np.median([turn.turn_at_limit for turn in turns])),
        turn_variation_rad_s2=float(np.median([turn.turn_variation_rad_s2 for turn in turns])),
        limit_cycles=sum(turn.turn_limit_cycle for turn in turns),
        range_rmse=float(np.median(np.sqrt(np.nanmean(range_error**2, axis=0)))),
        rate_rmse=float(np.sqrt((rate_error**2).mean())),
        rate_p99=_percentile(np.abs(rate_error), 99),
        nees_mean=float(nees[known].mean()) if known.any() else float("nan"),
        nees_in_band=float(in_band[known].mean()) if known.any() else float("nan"),
        difference_median=_percentile(differences, 50),
        difference_low=float("nan") if low is None else low,
        difference_high=float("nan") if high is None else high,
        seconds=seconds,
    )


def _percentile(values: NDArray[Any], q: float) -> float:
    """Return a percentile that is one of the values. An interpolation between a number and infinity
    (never settled) would be infinite."""
    return float(np.percentile(values, q, method="higher")) if len(values) else float("nan")
