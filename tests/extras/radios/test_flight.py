"""A flight with a radio behind the driver `lines`: the emulator's ranges as lines of text, beside
ranges of another beacon."""

from collections import Counter

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.radios.lines import Lines
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import RANGING, Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from circnav_mav.runtime import recorder
from circnav_mav.runtime.radio_link import RadioLink
from tests.flight.recorded import RecordedFlight, recorded_flight

OVERRIDES = (
    'ranging.message="ranging_beacon"',
    'ranging.endpoint="lines:udpin:127.0.0.1:5005"',
    'guidance.law="smooth"',
    'sim.ranging.message="ranging_beacon"',
    'sim.ranging.via="direct"',
    "limits.duration_s=32",
    "sim.start.north_m=120",
    "sim.start.east_m=-30",
)
SILENT = (15.0, 17.0)


class TextPort:
    """The emulator's radio as lines of text. Before each range it sends a range of a nearer beacon
    and other text."""

    def __init__(self, link, port=lambda number, now: 4000, boot=lambda now: 0.0):
        """port: port of a datagram by its number and time. boot: shift of the radio's clock at a
        time, s."""
        self._link = link
        self._port = port
        self._boot = boot
        self._sent = 0
        self.troubles = Counter()

    def receive(self, now):
        received = [
            mavlink.MAVLink(None).decode(bytearray(frame)) for frame, _ in self._link.receive(now)
        ]
        if SILENT[0] < now < SILENT[1]:
            return []
        boot = self._boot(now)
        stamped = [(one.time_usec / 1e6 + boot, one.range / 1000) for one in received]
        lines = [f"{stamp},4,33.3\n{stamp},3,{metres}\nno range\n" for stamp, metres in stamped]
        self._sent += len(lines)
        return [(line.encode(), ("10.0.0.9", self._port(self._sent, now))) for line in lines]


def radio_flight(folder, *overrides, **port) -> RecordedFlight:
    flight = recorded_flight(folder, "quickstart", *OVERRIDES, *overrides)
    flight.links[RANGING] = RadioLink("lines", Lines(), TextPort(flight.links[RANGING], **port))
    flight.fly(100).recorder.close()
    return flight


PORTS = {
    "one": {},
    "one for each datagram": {"port": lambda number, now: 4000 + number},
    "another one after restart": {
        "port": lambda number, now: 4000 + (now > SILENT[0]),
        "boot": lambda now: 5000.0 if now < SILENT[0] else 0.0,
    },
}


@pytest.mark.parametrize("port", PORTS)
def test_flight_around_selected_beacon_replays(tmp_path, monkeypatch, port):
    monkeypatch.setattr(recorder, "MOST_SOURCES", 50)
    flight = radio_flight(tmp_path, "ranging.beacon_id=3", **PORTS[port])
    assert flight.outcome.ending.value == "completed"
    run = open_run(tmp_path)
    flown = run.truth.time > 28
    assert abs(run.truth.radius[flown] - 100).max() < 5
    held = [
        time
        for time, phase in zip(run.ticks.time, run.ticks.words["phase"], strict=True)
        if phase == "coasting"
    ]
    assert SILENT[0] < min(held) < max(held) < SILENT[1] + 1
    settings = parse_mission(run.mission_text, "mission.toml")
    done = replay(Pilot(settings), recorded_steps(tmp_path))
    assert done.identical


def test_two_beacons_prevent_engagement_until_one_is_selected(tmp_path):
    pilot = radio_flight(tmp_path, "limits.duration_s=5", "link.wait_s=20").pilot
    assert pilot.mission.engaged_at is None
    reason = pilot.mission.outcome.reason
    assert reason.startswith("2 range sources: ") and "beacon_id 4 (33.3 m)" in reason
    assert reason.endswith("select yours by ranging.beacon_id")
