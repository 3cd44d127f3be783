"""The circle flown with a radio behind a driver: the emulator's ranges as lines of text, beside another beacon's."""

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import RANGING, Pilot
from circnav_mav.radios.lines import Lines
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from circnav_mav.runtime.radio_link import RadioLink
from tests.flight.recorded import RecordedFlight, recorded_flight
from tests.runtime.test_radio_link import Wire

OVERRIDES = (
    'ranging.message="ranging_beacon"', 'ranging.endpoint="lines:udpin:127.0.0.1:5005"', 'guidance.law="smooth"',
    'sim.ranging.message="ranging_beacon"', 'sim.ranging.via="direct"', "limits.duration_s=45",
)  # fmt: skip
SILENT = (15.0, 17.0)


class RadioFlight(RecordedFlight):
    """Each range of the emulator's radio comes as a line, after one of a beacon that is nearer."""

    def _hear(self, frame, link, source, step):
        if link != RANGING:
            super()._hear(frame, link, source, step)
            return
        beacon = mavlink.MAVLink(None).decode(bytearray(frame))
        stamp = beacon.time_usec / 1e6
        text = f"{stamp},4,33.3\n{stamp},3,{beacon.range / 1000}\nno range\n"
        self.wire.waiting = [] if SILENT[0] < self.now < SILENT[1] else [(text.encode(), ("10.0.0.9", 4000))]
        for reading, at in self.radio.receive(self.now):
            super()._hear(reading, link, at, step)


def radio_flight(folder, *overrides) -> RadioFlight:
    plain = recorded_flight(folder, "quickstart", *OVERRIDES, *overrides)
    flight = RadioFlight(plain.pilot, plain.vehicle, recorder=plain.recorder)
    flight.wire = Wire()
    flight.radio = RadioLink("lines", Lines(), flight.wire, datagrams=True)
    flight.fly(100).recorder.close()
    return flight


def test_the_named_beacon_is_circled_through_an_outage_and_replayed_exactly(tmp_path):
    flight = radio_flight(tmp_path, "ranging.beacon_id=3")
    assert flight.pilot.outcome.ending.value == "completed"
    run = open_run(tmp_path)
    flown = run.truth.time > 40
    assert abs(run.truth.radius[flown] - 100).max() < 5
    held = [time for time, phase in zip(run.ticks.time, run.ticks.words["phase"], strict=True) if phase == "holding"]
    assert SILENT[0] < min(held) < max(held) < SILENT[1] + 1
    settings = parse_mission(run.mission_text, "mission.toml").pilot_settings()
    done = replay(Pilot(settings), recorded_steps(tmp_path))
    assert done.identical


def test_without_a_name_the_first_beacon_heard_is_the_one(tmp_path):
    pilot = radio_flight(tmp_path, "limits.duration_s=5").pilot
    assert pilot.tracker.ranging.trusted == (1, 192, "10.0.0.9:4000 beacon 4")
    assert pilot.tracker.ranging.rejected["wrong_source"] > 30
