"""A lockstep flight that writes a run folder."""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle

from circnav_mav.cli.closing import write_manifest
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import OutputMode, Pilot
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.recorder import Recorder
from tests.flight.lockstep import CONFIG, Flight

EPOCH_US = 1_790_000_000_000_000


@dataclass
class RecordedFlight(Flight):
    """A flight with a recorder. `interrupt_at`: time of the operator's Ctrl-C, s. `slow_at`: time,
    s, from which every step is too slow. The slow steps end when one of them has withheld a
    setpoint."""

    recorder: Recorder | None = None
    interrupt_at: float = math.inf
    slow_at: float = math.inf

    def _step(self, moment: float) -> None:
        slow = self.now >= self.slow_at
        passes = 1.0 if slow else 0.0
        self.clock.real = itertools.count(0.0, passes).__next__  # type: ignore[method-assign]
        super()._step(moment)

    def _signal(self) -> str | None:
        return "SIGINT" if self.now >= self.interrupt_at else None

    def _keep(self, step: LoopStep) -> None:
        assert self.recorder is not None
        self.recorder.step(step)
        records = self.pilot.take_records()
        self.recorder.ticks(records)
        if step.held_back and records:
            self.slow_at = math.inf


def recorded_flight(
    folder: Path, mission: str, *overrides: str, output: OutputMode = OutputMode.FLY
) -> RecordedFlight:
    """Return a flight of a file in config/, ready to start, that records into a folder. Close its
    recorder at the end."""
    loaded = load_mission(CONFIG / f"{mission}.toml", overrides)
    assert loaded.file.sim is not None
    recorder = Recorder(folder, loaded.text)
    pilot = Pilot(loaded, output_mode=output)
    write_manifest(folder, loaded, pilot, EPOCH_US)
    recorder.start(EPOCH_US)
    vehicle = Vehicle(parse_vehicle(loaded.file.sim, mission))
    return RecordedFlight(pilot, vehicle, recorder=recorder)
