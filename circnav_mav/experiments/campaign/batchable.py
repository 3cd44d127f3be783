"""Which flights may be flown in a batch, and which of them together. Whatever else is varied flies in lockstep."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import inf
from statistics import NormalDist
from typing import Any

from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.experiments.campaign.surroundings import GUST_EVERY
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.range_noise import QUARTILE_OF_NORMAL, TOO_MUCH
from sim.config import Ranging
from sim.sensor import CHARACTERS

OWN = frozenset({
    "name", "vehicle.speed_mps", "vehicle.max_turn_rate_deg_s", "vehicle.max_bank_deg", "vehicle.turn_lag_s",
    "orbit.radius_m", "orbit.direction", "orbit.height_above_target_m", "guidance.law", "guidance.gain",
    "guidance.correct_radius", "guidance.gate_sigma", "guidance.min_samples", "ranging.sigma_m",
    "ranging.min_range_m", "ranging.max_range_m", "link.sim_speed", "sim.seed", "sim.start.north_m",
    "sim.start.east_m", "sim.start.altitude_m", "sim.start.heading_deg", "sim.vehicle.max_turn_rate_deg_s",
    "sim.vehicle.turn_lag_s", "sim.ranging.preset", "sim.ranging.noise_m", "sim.ranging.bias_m",
    "sim.ranging.outlier_fraction", "sim.ranging.outlier_m", "sim.ranging.dropout_fraction",
    "sim.ranging.clock_offset_s", "sim.ranging.max_range_m", "sim.ranging.report_accuracy", "sim.truth.rate_hz",
})  # fmt: skip
OWN_TABLES = ("sim.start.random.", "sim.target.", "sim.wind.")
"""What each flight of a batch has of its own; flights of one batch share everything else."""


SOON_FOUND_OUT = TOO_MUCH / 2
"""Scatter over what is said of it from which on the pilot may notice; batches do not look."""


def obstacle(run: Run) -> str | None:
    """Why this flight needs lockstep; None if a batch flies it."""
    return next((reason for found, reason in _obstacles(run) if found), None)


def group(run: Run) -> tuple[tuple[str, str], ...]:
    """What must be the same in all flights of a batch."""
    values = _flat(run.mission.file.model_dump(exclude={"sim"})) | _flat(asdict(run.vehicle), "sim.")
    shared = (key for key in values if key not in OWN and not key.startswith(OWN_TABLES))
    return tuple((key, repr(values[key])) for key in sorted(shared))


def _obstacles(run: Run) -> Iterator[tuple[bool, str]]:
    file, sim = run.mission.file, run.vehicle
    airframe, start, ranging, limits = sim.vehicle, sim.start, sim.ranging, file.limits
    law = LAWS[file.guidance.law]
    yield run.mission.height.needs_altitude, "the height comes from the altitude"
    yield law.switches, f'guidance.law = "{law.name}" switches: the last digit of a message decides which way'
    yield law.flies_relative_motion, f'guidance.law = "{law.name}" learns how its vehicle answers'
    yield run.mission.estimator != "kalman", f'guidance.estimator = "{run.mission.estimator}"'
    yield run.mission.vehicle_key != ("ardupilot", "copter"), "[vehicle] is not the plain ArduPilot copter"
    ideal = airframe.profile == "arducopter" and airframe.dynamics != "realistic"
    yield not ideal, "sim.vehicle is not the ideal copter (profile arducopter, dynamics unicycle or airborne)"
    yield airframe.speed_lag_s > 0, "sim.vehicle.speed_lag_s is not 0"
    yield not start.armed or start.altitude_m == 0 or bool(start.speed_mps), "sim.start is not a hover in the air"
    yield bool(sim.events), "[[sim.events]] happen"
    yield (
        ranging.rate_hz <= 0 or not _on_grid(ranging.rate_hz, limits.tick_hz),
        ("sim.ranging.rate_hz and limits.tick_hz are not multiples of each other in whole microseconds"),
    )
    gusts = airframe.dynamics == "airborne" and sim.wind.gust_rms_mps > 0
    yield gusts and not _whole(GUST_EVERY * max(limits.tick_hz, ranging.rate_hz)), "gusts come every 0.1 s, ticks not"
    yield ranging.latency_s > 0, "sim.ranging.latency_s is not 0"
    yield ranging.via == "autopilot", 'sim.ranging.via = "autopilot" repeats ranges'
    yield ranging.message != file.ranging.message, "sim.ranging.message is not the mission's"
    white, most = _scatter(ranging), SOON_FOUND_OUT * file.ranging.sigma_m
    yield white > most, "ranges scatter more than ranging.sigma_m says"
    yield (
        white * _made_of_noise(ranging) > most,
        "sim.ranging.outlier_fraction is so large that the pilot takes outliers for noise",
    )
    yield file.ranging.resent or file.ranging.stamp == "arrival", "[ranging] resent or stamp is not the default"
    yield file.vehicle.max_turn_acceleration_deg_s2 is not None, "vehicle.max_turn_acceleration_deg_s2 is set"
    yield file.guidance.radius_trim_per_s > 0, "guidance.radius_trim_per_s is not 0"
    yield file.bounds != type(file.bounds)(), "[bounds] are set"
    yield file.engage.on_takeover != "end", "engage.on_takeover is not the default"


def _scatter(ranging: Ranging) -> float:
    """Standard deviation of the white noise of the emulator's ranges, m."""
    white = CHARACTERS[ranging.preset].white
    return ranging.noise_m if white is None else white


def _made_of_noise(ranging: Ranging) -> float:
    """How many times the white noise the pilot's check of it measures, between outliers that are far off: each spoils
    three bends, so that the lower quartile of all lies higher among the good ones. Some 1.4 at 10 % of outliers, 2 at
    20 %, without end where they leave less than a quarter of the bends good."""
    if ranging.outlier_m <= _scatter(ranging):
        return 1.0
    good = (1 - ranging.outlier_fraction) ** 3
    return NormalDist().inv_cdf((1 + 0.25 / good) / 2) / QUARTILE_OF_NORMAL if good > 0.25 else inf


def _on_grid(rate: float, ticks: float) -> bool:
    """Whether ranges and ticks fall together, and the emulator's clock of microseconds can keep both."""
    more, less = max(rate, ticks), min(rate, ticks)
    return _whole(more / less) and _whole(1e6 / more)


def _whole(number: float) -> bool:
    return number > 0.5 and abs(number - round(number)) < 1e-9


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{before}{key}.")
        else:
            flat[before + key] = value
    return flat
