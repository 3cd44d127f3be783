"""Flights of a campaign: run numbers in, rows of the table out.

Similar flights are computed together, as a batch of arrays. Every other flight runs the real pilot against the emulated
vehicle, step by step (lockstep).
"""

import traceback
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from typing import Any

from circnav_sim.config import ConfigError

from circnav_mav.extras.campaign.figures import failed_row, row
from circnav_mav.extras.campaign.flights import fly_batch, time_step, white_noise
from circnav_mav.extras.campaign.lockstep import fly_lockstep
from circnav_mav.extras.campaign.plan import Campaign, Run, flat, prepare
from circnav_mav.mission.load import MissionError

OWN = frozenset({
    "name", "vehicle.max_turn_rate_deg_s", "vehicle.max_bank_deg", "orbit.radius_m", "orbit.direction",
    "orbit.height_above_target_m", "guidance.gain", "guidance.correct_radius",
    "ranging.sigma_m", "sim.seed", "sim.start.north_m",
    "sim.start.east_m", "sim.start.altitude_m", "sim.start.heading_deg", "sim.vehicle.max_turn_rate_deg_s",
    "sim.ranging.preset", "sim.ranging.noise_m", "sim.ranging.bias_m",
    "sim.ranging.outlier_fraction", "sim.ranging.outlier_m", "sim.ranging.dropout_fraction",
    "sim.ranging.clock_offset_s", "sim.ranging.max_range_m", "sim.ranging.report_accuracy", "sim.truth.rate_hz",
})  # fmt: skip
OWN_OF_KALMAN = OWN | {"vehicle.speed_mps", "vehicle.turn_lag_s", "sim.vehicle.turn_lag_s"}
OWN_TABLES = ("sim.start.random.", "sim.target.", "sim.wind.")
"""Keys and tables that may differ between the flights of a batch. All other keys have the same value in a batch."""
MOST_SCATTER = 1.5
"""Largest ratio of simulated range noise to `ranging.sigma_m` in a batch. The pilot may detect a larger difference."""
MOST_OUTLIERS = 0.13
"""Largest fraction of outliers for a batch. The pilot may treat a larger fraction as noise."""


def group(run: Run) -> tuple[tuple[str, str], ...]:
    """Return the values that must be the same in all flights of a batch."""
    own = OWN_OF_KALMAN if run.mission.estimator == "kalman" else OWN
    values = dict(flat(run.mission.file.model_dump(exclude={"sim"}) | {"sim": run.vehicle.model_dump()}))
    shared = (key for key in values if key not in own and not key.startswith(OWN_TABLES))
    return tuple((key, repr(values[key])) for key in sorted(shared))


def lockstep_reason(run: Run) -> str | None:
    """Return the first reason why a flight needs lockstep, or None if a batch can fly it.

    A batch models only the ideal copter, the emulator's radios and the pilot's steering.
    """
    file, sim = run.mission.file, run.vehicle
    airframe, start, ranging = sim.vehicle, sim.start, sim.ranging
    ideal = airframe.profile == "arducopter" and airframe.dynamics != "realistic" and airframe.speed_lag_s == 0
    hovers = start.armed and start.altitude_m != 0 and not start.speed_mps
    wild = ranging.outlier_fraction > MOST_OUTLIERS and ranging.outlier_m > 2 * file.ranging.sigma_m
    reasons = {
        "[vehicle] is not the plain ArduPilot copter": run.mission.vehicle_key != ("ardupilot", "copter"),
        "sim.vehicle is not the ideal copter (profile arducopter, dynamics unicycle or airborne)": not ideal,
        "sim.start is not a hover in the air": not hovers,
        "the mission has [[sim.events]]": bool(sim.events),
        "the height comes from the altitude": run.mission.height.needs_altitude,
        "sim.ranging.rate_hz is 0": ranging.rate_hz <= 0,
        "sim.ranging.latency_s is not 0": ranging.latency_s > 0,
        'sim.ranging.via = "autopilot" repeats ranges': ranging.via == "autopilot",
        "the range noise is larger than ranging.sigma_m": white_noise(ranging) > MOST_SCATTER * file.ranging.sigma_m,
        "sim.ranging.outlier_fraction is so large that the pilot treats outliers as noise": wild,
        "ranging.stamp is not the default": file.ranging.stamp == "arrival",
        "ranging.rate_name: a measured range rate": file.ranging.rate_name is not None,
        "guidance.radius_trim_per_s is not 0": file.guidance.radius_trim_per_s > 0,
        "[bounds] is set": file.bounds != type(file.bounds)(),
        "engage.on_takeover is not the default": file.engage.on_takeover != "end",
    }
    return next((reason for reason, found in reasons.items() if found), None)


Row = dict[str, Any]
BATCH_STEPS = 8_000_000
"""Largest number of steps times flights in a chunk. Each step of a flight takes 13 bytes of memory."""
MOST_IN_CHUNK = 1000
"""Largest number of flights in a chunk: with more, numpy's overhead per step is negligible already."""
MOST_TRIED = 64
"""Largest number of flights that are tried to find one that a batch can fly."""
LEAST_CHUNKS = 4
"""Least number of chunks, so that a small campaign uses several processes."""


def chunks(campaign: Campaign) -> list[range]:
    """Return the runs in chunks that depend on the campaign only: rows are the same for any number of processes."""
    size = max(1, min(_most_together(campaign), -(-campaign.runs // LEAST_CHUNKS)))
    return [range(first, min(first + size, campaign.runs)) for first in range(0, campaign.runs, size)]


def _most_together(campaign: Campaign) -> int:
    """Return the number of flights per chunk, which the memory limits; 1 if no batch can fly them."""
    for number in range(min(campaign.runs, MOST_TRIED) if campaign.engine != "lockstep" else 0):
        try:
            run = prepare(campaign, number)
        except (MissionError, ConfigError):
            continue
        if lockstep_reason(run) is None:
            steps = int(run.mission.file.limits.duration_s / time_step(run)) + 1
            return min(MOST_IN_CHUNK, max(1, BATCH_STEPS // steps))
    return 1


def fly_chunk(campaign: Campaign, numbers: Iterable[int]) -> list[Row]:
    """Fly some runs and return their rows in order."""
    rows, alone = _fly_batches(campaign, numbers)
    for run in alone:
        try:
            rows.append(row(run, fly_lockstep(run)))
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1].name
            text = " ".join(f"internal error: {type(error).__name__}: {error} ({where})".split())
            rows.append(failed_row(run.number, run.values, text))
    return sorted(rows, key=lambda done: int(done["run"]))


def fly_part(campaign: Campaign, chunk: Sequence[int], wanted: Collection[int]) -> tuple[list[Row], list[int]]:
    """Fly the batches of a chunk. Return the rows of wanted runs, and the numbers of runs that must fly alone.

    A single run is always flown. Otherwise all runs of the batch are flown, not only wanted runs: numpy's rounding
    depends on the size of the batch, and a row must not depend on where a campaign was interrupted.
    """
    if len(chunk) == 1:
        return fly_chunk(campaign, chunk), []
    rows, alone = _fly_batches(campaign, chunk)
    return [row for row in rows if row["run"] in wanted], [run.number for run in alone if run.number in wanted]


def _fly_batches(campaign: Campaign, numbers: Iterable[int]) -> tuple[list[Row], list[Run]]:
    """Return the rows of the batches, and the runs that must fly alone. Errors of a run do not affect the others."""
    rows: list[Row] = []
    alone: list[Run] = []
    together: dict[tuple[tuple[str, str], ...], list[Run]] = {}
    for number in numbers:
        try:
            run = prepare(campaign, number)
        except (MissionError, ConfigError) as error:
            rows.append(failed_row(number, campaign.values(number), str(error)))
            continue
        reason = "the campaign requires lockstep" if campaign.engine == "lockstep" else lockstep_reason(run)
        if reason is None:
            together.setdefault(group(run), []).append(run)
        elif campaign.engine == "batch":
            rows.append(failed_row(number, run.values, f"a batch cannot fly this mission: {reason}"))
        else:
            alone.append(run)
    for runs in together.values():
        results = None
        with suppress(Exception):  # one run made the arithmetic of all fail: fly each alone
            results = fly_batch(runs)
        if results is None:
            alone += runs
        else:
            rows += [row(run, result) for run, result in zip(runs, results, strict=True)]
    return rows, alone
