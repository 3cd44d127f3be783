"""A lockstep flight that leaves a run folder behind, as the runner does; its clock shows whole microseconds."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from circnav_mav.mav.framing import split_frames
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING, VEHICLE, OutputMode, Pilot
from circnav_mav.runtime.manifest import Manifest
from circnav_mav.runtime.recorder import LoopStep, Recorder
from sim.config import parse_vehicle
from sim.vehicle import Vehicle
from tests.flight.lockstep import CONFIG, LINKS, Flight

EPOCH_US = 1_790_000_000_000_000


@dataclass
class RecordedFlight(Flight):
    """A flight whose turns and ticks go to a recorder. `interrupt_at`: when somebody presses Ctrl-C. `slow_at`: when a
    turn takes so long that nothing is said in it."""

    recorder: Recorder | None = None
    interrupt_at: float = math.inf
    slow_at: float = math.inf
    noise: list[bytes] = field(default_factory=list)

    def _step(self, due: float) -> None:
        pilot, vehicle, recorder = self.pilot, self.vehicle, self.recorder
        assert recorder is not None
        moment = math.ceil(due * 1e6)
        self.now = max(moment / 1e6 if moment / 1e6 >= due else (moment + 1) / 1e6, self.now)
        vehicle.advance(self.now)
        step = LoopStep(self.now)
        links = LINKS if pilot.settings.ranging_apart else {"main": VEHICLE}
        for sim_link, link in links.items():
            for frame in vehicle.outgoing(sim_link):
                if self.hears(frame, self.now):
                    self._hear(frame, link, "sim", step)
        for frame in self.noise:
            self._hear(frame, VEHICLE, "somebody else", step)
        if self.now >= self.interrupt_at and pilot.outcome is None:
            step.interrupt = "SIGINT"
            pilot.interrupt(self.now, "SIGINT")
        out = pilot.step(self.now)
        if out and self.now >= self.slow_at:
            out, step.held_back, self.slow_at = b"", True, math.inf
            pilot.hold_back()
        vehicle.receive(out)
        step.said = split_frames(out)
        step.hello = split_frames(pilot.hello(self.now)) if RANGING in links.values() else []
        recorder.step(step)
        recorder.ticks(pilot.take_records())

    def _hear(self, frame: bytes, link: str, source: str, step: LoopStep) -> None:
        self.pilot.receive(frame, self.now, source, link)
        step.heard.append((link, source, self.pilot.take_frames()))


def recorded_flight(folder: Path, mission: str, *overrides: str, output: OutputMode = OutputMode.FLY) -> RecordedFlight:
    """A flight of a file in config/, ready to go, that records into a folder; close its recorder at the end."""
    loaded = load_mission(CONFIG / f"{mission}.toml", overrides)
    assert loaded.file.sim is not None
    recorder = Recorder(folder, loaded.text)
    Manifest(folder, mission=mission, voice=output.value, epoch_us=EPOCH_US, seeds={})
    recorder.start(EPOCH_US)
    vehicle = Vehicle(parse_vehicle(loaded.file.sim, mission))
    return RecordedFlight(Pilot(loaded.pilot_settings(output)), vehicle, recorder=recorder)
