"""Many flights of a campaign at once: ideal copters and radios of the emulator with the batch guidance, no messages.

Angles of the emulator and of mission files (clockwise from north) are converted into the paper's frame by `mav.frames`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from math import atan2, ceil, hypot, pi, radians
from typing import Any

import numpy as np
from circnav_sim.config import RandomStart
from circnav_sim.config import Ranging as RangingConfig
from circnav_sim.sensor import CHARACTERS
from circnav_sim.starting import starting_body

from circnav_mav.extras.batch.guidance import Authority, Guidance, estimator, fly
from circnav_mav.extras.batch.sensors import NO_NOISE, MotionSensors, Radio, Ranging, Reading
from circnav_mav.extras.batch.world import Airframe, Surroundings, Truth, World
from circnav_mav.extras.campaign.lockstep import COMPLETED, Flight, FlightResult
from circnav_mav.extras.campaign.plan import Run
from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.step import StepSettings
from circnav_mav.guidance.types import SAME_TIME
from circnav_mav.mav.frames import YawRate, heading_enu_from_yaw_ned, turn_rate_from_yaw_rate

REPORTABLE_SIGMA = {
    "distance_sensor": (0.01, 0.1594),
    "ranging_beacon": (1e-3, np.inf),
    "named_value_float": (0.0, -np.inf),
}
"""Least and largest standard deviation that a message can carry, m; NAMED_VALUE_FLOAT carries none. Smaller ones are
sent as the least. In place of larger ones, the standard deviation of the mission is used."""


def emulated_world(runs: Sequence[Run]) -> World:
    """Return vehicles, winds and targets. The wind carries vehicles with the dynamics "airborne". Vehicles with the
    dynamics "unicycle" hold their speed over the ground and do not drift."""
    bodies = [starting_body(run.vehicle, (0.0, 0.0)) for run in runs]
    winds, targets = [run.vehicle.wind for run in runs], [run.vehicle.target for run in runs]
    towards = _array(heading_enu_from_yaw_ned(radians(wind.from_deg) + pi) for wind in winds)
    courses = (heading_enu_from_yaw_ned(atan2(t.velocity_east_mps, t.velocity_north_mps)) for t in targets)
    turns = (turn_rate_from_yaw_rate(YawRate(radians(t.turn_rate_deg_s))) for t in targets)
    around = Surroundings(
        wind=_array(wind.speed_mps for wind in winds) * np.stack([np.cos(towards), np.sin(towards)]),
        gust=_array(wind.gust_rms_mps for wind in winds),
        gust_time=_array(wind.gust_time_s for wind in winds),
        target_speed=_array(hypot(t.velocity_east_mps, t.velocity_north_mps) for t in targets),
        target_course=_array(courses),
        target_turn=_array(turns),
        target_push=_array(t.acceleration_mps2 for t in targets),
    )
    airframe = Airframe(
        speed=_array(run.mission.orbit.speed for run in runs),
        limit=np.radians(_array(run.vehicle.vehicle.max_turn_rate_deg_s for run in runs)),
        lag=_array(run.vehicle.vehicle.turn_lag_s for run in runs),
    )
    places = zip(bodies, targets, strict=True)
    p = np.array([(body.east - target.east_m, body.north - target.north_m) for body, target in places]).T
    carried = _array(run.vehicle.vehicle.dynamics == "airborne" for run in runs)
    psi = _array(heading_enu_from_yaw_ned(body.heading) for body in bodies)
    return World(around, airframe, p, psi, _seeds(runs), carried)


def emulated_radio(runs: Sequence[Run], every: int) -> Radio:
    """Return the radios, with a sample per `every` steps, and the pilot's processing of their ranges."""
    configs = [run.vehicle.ranging for run in runs]
    kinds = [CHARACTERS[config.preset] for config in configs]
    ranging = Ranging(
        white=_array(map(white_noise, configs)),
        drifting=_array(k.drift for k in kinds),
        drift_time=_array(k.drift_time for k in kinds),
        bias=_array(c.bias_m for c in configs),
        loss=_array(1 - (1 - c.dropout_fraction) * (1 - k.loss) for c, k in zip(configs, kinds, strict=True)),
        outlier_share=_array(c.outlier_fraction for c in configs),
        outlier=_array(c.outlier_m for c in configs),
        near_bias=_array(k.near_bias for k in kinds),
        near=_array(k.near for k in kinds),
        farthest=_array(c.max_range_m for c in configs),
        gap_rate=_array(k.gap_rate for k in kinds),
        gap=_array(k.gap for k in kinds),
        every=every,
    )
    sigmas = []  # standard deviation of a range: as reported by its message, else as in the mission
    for run in runs:
        (least, most), noise = REPORTABLE_SIGMA[run.mission.file.ranging.message], run.vehicle.ranging.noise_m
        reported = run.vehicle.ranging.report_accuracy and noise <= most
        sigmas.append(max(noise, least) if reported else run.mission.file.ranging.sigma_m)
    heights = (-starting_body(run.vehicle, (0.0, 0.0)).down - run.vehicle.target.altitude_m for run in runs)
    reading = Reading(
        sigma=_array(sigmas),
        most=_array(run.mission.max_range for run in runs),
        height=_array(run.mission.file.orbit.height_above_target_m or 0.0 for run in runs),
    )
    return Radio(ranging, reading, _seeds(runs), _array(heights))


def white_noise(config: RangingConfig) -> float:
    """Return the standard deviation of the white noise of the emulator's ranges, m."""
    white = CHARACTERS[config.preset].white
    return config.noise_m if white is None else white


def guidance_of(runs: Sequence[Run]) -> Guidance:
    """Return the guidance of the missions: one law and one estimator, with the numbers of each flight."""
    missions = [run.mission for run in runs]
    each = [StepSettings.of(mission.orbit, mission.law) for mission in missions]
    numbers = {f.name: _array(getattr(one, f.name) for one in each) for f in fields(StepSettings) if f.name != "law"}
    settings = StepSettings(law=each[0].law, **numbers)
    estimation = replace(missions[0].estimation, speed=numbers["V"], max_turn_rate=numbers["limit"])
    gains = [mission.file.vehicle.turn_gain for mission in missions]
    return Guidance(
        settings,
        estimator(missions[0].estimator, estimation, len(runs)),
        len(runs),
        lag=_array(mission.file.vehicle.turn_lag_s for mission in missions),
        stale=missions[0].stale,
        true_lag=runs[0].vehicle.vehicle.turn_lag_s,
        turn_gain=_array(1.0 if gain == "learn" else gain for gain in gains),
        learns=np.array([gain == "learn" for gain in gains]),
    )


def _seeds(runs: Sequence[Run]) -> list[tuple[int]]:
    return [(run.vehicle.seed,) for run in runs]


def _array(values: Iterable[Any]) -> Array:
    return np.array(list(values), float)


NEVER = 1 << 40
"""Number of a step that no flight reaches: 1,700 years of steps of 0.05 s."""


def engagement_times(run: Run) -> tuple[float, float] | None:
    """Return the times of the first range at the pilot and of the first setpoint, s; None if the flight never engages.

    A batch has no modes and no heartbeats. The times are therefore taken from one lockstep flight that starts on the
    circle, with ideal conditions and an ideal radio.
    """
    vehicle, target = run.vehicle, run.vehicle.target
    beside = target.north_m + run.mission.orbit.radius
    clean = vehicle.changed(
        start=vehicle.start.changed(random=RandomStart(), north_m=beside, east_m=target.east_m),
        target=target.changed(velocity_north_mps=0.0, velocity_east_mps=0.0, acceleration_mps2=0.0),
        ranging=vehicle.ranging.changed(preset="gaussian", noise_m=0.0, outlier_fraction=0.0, dropout_fraction=0.0),
    )
    flight = Flight(replace(run, vehicle=clean))
    patience = 2 * run.mission.file.link.wait_s
    received = None
    while flight.pilot.mission.engaged_at is None and not flight.pilot.done and flight.now < patience:
        flight.step(patience)
        if received is None and flight.pilot.tracker.accepted:
            received = flight.now
    steered = flight.pilot.mission.engaged_at
    return None if received is None or steered is None else (received, steered)


class Engagement(Authority):
    """Flights under control: from the first good estimate after `begins` (`engagement_times`) to the mission's end.

    A flight also ends after too long a time without a good estimate. engaged, ended (B,): numbers of the steps.
    stopped (B,): True if the flight ended because ranges were missing.
    """

    def __init__(self, runs: Sequence[Run], begins: tuple[float, float], dt: float) -> None:
        limits = runs[0].mission.file.limits
        self._first_range, self._first_setpoint = (round(time / dt) for time in begins)
        self._length, self._patience = round(limits.duration_s / dt), round(runs[0].mission.file.link.wait_s / dt)
        self._hold = (limits.hold_s + SAME_TIME) / dt
        self.engaged, self.ended = np.full(len(runs), NEVER), np.full(len(runs), NEVER)
        self._good_at = np.full(len(runs), NEVER)
        self.stopped = np.zeros(len(runs), bool)

    def receives(self, step: int) -> Array:
        return (step >= self._first_range) & (step < self.ended)

    def flies(self, step: int, good: Array) -> Array:
        waits = self.engaged == NEVER
        self.engaged = np.where(
            waits & good & (step >= self._first_setpoint) & (self.ended == NEVER), step, self.engaged
        )
        ours = (self.engaged <= step) & (step < self.ended)
        self._good_at = np.where(good, step, self._good_at)
        lost = ours & (step - self._good_at > self._hold)
        over = ours & (step - self.engaged >= self._length)
        given_up = (self.engaged == NEVER) & (self.ended == NEVER) & (step >= self._patience)
        self.stopped |= lost & ~over
        self.ended = np.where(lost | over | given_up, step, self.ended)
        return ours & (step < self.ended)

    def over(self, step: int) -> bool:
        return not (self.ended > step).any()


def time_step(run: Run) -> float:
    """Return the time step of a run's batch, s: a fraction of the range interval, at most the pilot's tick."""
    period = 1 / run.vehicle.ranging.rate_hz
    return period / ceil(period * run.mission.file.limits.tick_hz - 1e-9)


def fly_batch(runs: Sequence[Run]) -> list[FlightResult] | None:
    """Fly runs of the same group. Return their results in order; None if the lockstep flight of
    `engagement_times` does not engage."""
    begins = engagement_times(runs[0])
    if begins is None:
        return None
    dt = time_step(runs[0])
    world, engagement = emulated_world(runs), Engagement(runs, begins, dt)
    radio = emulated_radio(runs, round(1 / runs[0].vehicle.ranging.rate_hz / dt))
    path, turns, cuts = [], [], []

    def record(step: int, true: Truth, command: Array, cut: Array) -> None:
        path.append(true.p.astype(np.float32))
        turns.append(command.astype(np.float32))
        cuts.append(cut)

    fly(world, radio, MotionSensors(NO_NOISE, []), guidance_of(runs), engagement, dt, record)
    kept = np.stack(path), np.stack(turns), np.stack(cuts)
    return [_result(run, flight, engagement, dt, *kept) for flight, run in enumerate(runs)]


def _result(
    run: Run, flight: int, engagement: Engagement, dt: float, path: Array, turns: Array, cuts: Array
) -> FlightResult:
    engaged, ended = int(engagement.engaged[flight]), int(engagement.ended[flight])
    outcome, ours = COMPLETED, slice(engaged, ended)
    if engaged == NEVER:
        outcome, ours = "no ranging: no usable range", slice(0, 0)
    elif engagement.stopped[flight]:
        outcome = f"no range for {run.mission.file.limits.hold_s:.1f} s"
    time = dt * np.arange(len(path[ours]), dtype=float)
    return FlightResult(
        engine="batch",
        start=(float(path[0, 0, flight]), float(path[0, 1, flight]), starting_body(run.vehicle, (0.0, 0.0)).heading),
        engaged=engaged * dt if engaged != NEVER else None,
        time=time,
        east=path[ours, 0, flight].astype(float),
        north=path[ours, 1, flight].astype(float),
        outcome=outcome,
        turn_time=time,
        turn=turns[ours, flight].astype(float),
        turn_cut=cuts[ours, flight],
    )
