"""Lockstep flights of a signing pilot and a signing vehicle, with one common wall clock, as from
GPS."""

from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.signing import Signing
from circnav_mav.pilot import Pilot
from tests.flight.lockstep import Flight, flight
from tests.rig import flown_for_long

KEY = bytes(range(32))
OTHER = bytes(range(1, 33))


def voice(
    key: bytes | None, timestamp: int = 0, system: int = 1, component: int = 1, link_id: int = 0
) -> mavlink.MAVLink:
    """Return a sender with any key and clock."""
    engine = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    engine.signing.secret_key = key
    engine.signing.sign_outgoing = key is not None
    engine.signing.timestamp = timestamp
    engine.signing.link_id = link_id
    return engine


def key_file(folder: Path, key: bytes, name: str = "drone.key") -> Path:
    """Write a key file that only its owner can read."""
    path = folder / name
    path.touch(0o600)
    path.write_text(f"{key.hex()}\n")
    return path


def signed_flight(
    mission: str,
    folder: Path,
    *overrides: str,
    ours: bytes | None = KEY,
    theirs: bytes | None = KEY,
    vehicle_clock: float | None = 0.0,
) -> Flight:
    """Return a flight of a file in config/, ready to start. ours: key of the pilot. theirs: key of
    vehicle and radio. None: no key."""
    if theirs is not None:
        overrides = (*overrides, f"sim.signing.key_file={key_file(folder, theirs, 'vehicle.key')}")
    made = flight(mission, *overrides)
    signing = Signing(ours) if ours is not None else None
    return Flight(
        flown_for_long(Pilot(made.pilot.settings, signing)),
        made.vehicle,
        signing=signing,
        vehicle_clock=vehicle_clock,
    )
