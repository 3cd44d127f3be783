"""When a vehicle becomes ours: asked of one real flight, for a batch has no modes and no heartbeats."""

from dataclasses import dataclass, replace

from circnav_mav.experiments.campaign.lockstep import Lockstep
from circnav_mav.experiments.campaign.plan import Run
from sim.config import RandomStart


@dataclass(frozen=True, slots=True)
class Opening:
    """heard: time, s, of the first range that reaches the pilot. steered: of the first setpoint."""

    heard: float
    steered: float


def opening(run: Run) -> Opening | None:
    """The opening of a flight like this one, beside its target in perfect weather with a perfect radio; None if it
    would never be engaged."""
    vehicle, target = run.vehicle, run.vehicle.target
    clean = replace(
        vehicle,
        start=replace(
            vehicle.start, random=RandomStart(), north_m=target.north_m + run.mission.orbit.radius, east_m=target.east_m
        ),
        target=replace(target, velocity_north_mps=0.0, velocity_east_mps=0.0, acceleration_mps2=0.0),
        ranging=replace(vehicle.ranging, preset="gaussian", noise_m=0.0, outlier_fraction=0.0, dropout_fraction=0.0),
    )
    flight = Lockstep(replace(run, vehicle=clean))
    patience = 2 * run.mission.file.link.wait_s
    heard = None
    while flight.pilot.engaged_at is None and not flight.pilot.done and flight.now < patience:
        flight.step(patience)
        if heard is None and flight.pilot.tracker.accepted:
            heard = flight.now
    steered = flight.pilot.engaged_at
    return None if heard is None or steered is None else Opening(heard, steered)
