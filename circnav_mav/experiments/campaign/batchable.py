"""Which flights may be flown in a batch, and which of them together. Whatever else is varied flies in lockstep."""

from collections.abc import Iterator

from circnav_mav.experiments.campaign.emulated import white_noise
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.experiments.campaign.spec import flat

OWN = frozenset({
    "name", "vehicle.max_turn_rate_deg_s", "vehicle.max_bank_deg", "orbit.radius_m", "orbit.direction",
    "orbit.height_above_target_m", "guidance.gain", "guidance.correct_radius", "guidance.min_samples",
    "ranging.sigma_m", "ranging.min_range_m", "ranging.max_range_m", "link.sim_speed", "sim.seed", "sim.start.north_m",
    "sim.start.east_m", "sim.start.altitude_m", "sim.start.heading_deg", "sim.vehicle.max_turn_rate_deg_s",
    "sim.ranging.preset", "sim.ranging.noise_m", "sim.ranging.bias_m",
    "sim.ranging.outlier_fraction", "sim.ranging.outlier_m", "sim.ranging.dropout_fraction",
    "sim.ranging.clock_offset_s", "sim.ranging.max_range_m", "sim.ranging.report_accuracy", "sim.truth.rate_hz",
})  # fmt: skip
OWN_OF_KALMAN = OWN | {"vehicle.speed_mps", "vehicle.turn_lag_s", "guidance.gate_sigma", "sim.vehicle.turn_lag_s"}
OWN_TABLES = ("sim.start.random.", "sim.target.", "sim.wind.")
"""What each flight of a batch has of its own; flights of one batch share everything else."""
MOST_SCATTER = 1.5
"""Scatter of the ranges over what the mission says of it, from which on the pilot may find it out."""
MOST_OUTLIERS = 0.13
"""Share of outliers from which on the pilot may take them for noise."""


def obstacle(run: Run) -> str | None:
    """Why this flight needs lockstep; None if a batch flies it."""
    return next((reason for found, reason in _obstacles(run) if found), None)


def group(run: Run) -> tuple[tuple[str, str], ...]:
    """What must be the same in all flights of a batch."""
    own = OWN_OF_KALMAN if run.mission.estimator == "kalman" else OWN
    values = dict(flat(run.mission.file.model_dump(exclude={"sim"}) | {"sim": run.vehicle.model_dump()}))
    shared = (key for key in values if key not in own and not key.startswith(OWN_TABLES))
    return tuple((key, repr(values[key])) for key in sorted(shared))


def _obstacles(run: Run) -> Iterator[tuple[bool, str]]:
    """What a batch does not model: other vehicles, what the pilot does beside steering, radios that are not alike."""
    file, sim = run.mission.file, run.vehicle
    airframe, start, ranging = sim.vehicle, sim.start, sim.ranging
    ideal = airframe.profile == "arducopter" and airframe.dynamics != "realistic" and airframe.speed_lag_s == 0
    yield run.mission.vehicle_key != ("ardupilot", "copter"), "[vehicle] is not the plain ArduPilot copter"
    yield not ideal, "sim.vehicle is not the ideal copter (profile arducopter, dynamics unicycle or airborne)"
    yield not start.armed or start.altitude_m == 0 or bool(start.speed_mps), "sim.start is not a hover in the air"
    yield bool(sim.events), "[[sim.events]] happen"
    yield run.mission.height.needs_altitude, "the height comes from the altitude"
    yield ranging.rate_hz <= 0, "sim.ranging.rate_hz is 0"
    yield ranging.latency_s > 0, "sim.ranging.latency_s is not 0"
    yield ranging.via == "autopilot", 'sim.ranging.via = "autopilot" repeats ranges'
    yield white_noise(ranging) > MOST_SCATTER * file.ranging.sigma_m, "ranges scatter more than ranging.sigma_m says"
    wild = ranging.outlier_fraction > MOST_OUTLIERS and ranging.outlier_m > 2 * file.ranging.sigma_m
    yield wild, "sim.ranging.outlier_fraction is so large that the pilot takes outliers for noise"
    yield file.ranging.resent or file.ranging.stamp == "arrival", "[ranging] resent or stamp is not the default"
    yield file.ranging.rate_name is not None, "ranging.rate_name: a measured range rate"
    yield file.vehicle.max_turn_acceleration_deg_s2 is not None, "vehicle.max_turn_acceleration_deg_s2 is set"
    yield file.guidance.radius_trim_per_s > 0, "guidance.radius_trim_per_s is not 0"
    yield file.bounds != type(file.bounds)(), "[bounds] are set"
    yield file.engage.on_takeover != "end", "engage.on_takeover is not the default"
