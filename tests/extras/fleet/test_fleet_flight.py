"""Whole fleets on the emulator, in lockstep: spacing with estimated drift, takeovers, silence,
layers, run folders."""

import json
import re
from math import degrees

import numpy as np
import pytest

from circnav_mav.extras.fleet.evenness import rms
from circnav_mav.extras.fleet.flight import SAMPLE_EVERY
from circnav_mav.extras.fleet.listener import FleetListener
from circnav_mav.extras.fleet.metrics import figures, gap_errors
from circnav_mav.extras.fleet.report import State
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Ending, Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from tests.browser import CHROMIUM
from tests.extras.fleet.bare import bare_fleet
from tests.process import PATIENCE, ROOT, UNDRAWN, python, read_until, running
from tests.process import circnav as process_of
from tests.tools.bench.bench_fleet import RANGES

COPTER = ROOT / "config" / "arducopter.toml"
PLANE = ROOT / "config" / "arduplane.toml"
NEAR = ("sim.truth.rate_hz=0", "sim.start.north_m=45", "sim.start.east_m=-20")
TAKEN = 71.0
SILENT = 81.0
BEFORE = TAKEN - 2.0
AFTER = TAKEN + 4.0
"""Times in the flight, s: takeover of member 2, loss of all reports, and two evaluations."""


def start(north, east, heading):
    """Return the overrides of a start, m and deg."""
    return (
        f"sim.start.north_m={north}",
        f"sim.start.east_m={east}",
        f"sim.start.heading_deg={heading}",
    )


def three_copters():
    """Fly three copters. Member 3 starts farther away and joins late. At TAKEN the operator takes
    over member 2. From SILENT on no member receives reports."""
    takeover = f'sim.events=[{{at_s={TAKEN}, action="mode", mode="LOITER"}}]'
    each = {
        1: (),
        2: (takeover, *start(north=40, east=29, heading=180)),
        3: start(north=90, east=40, heading=240),
    }
    flight = bare_fleet(COPTER, 3, (*NEAR, "limits.duration_s=1000"), each.__getitem__)
    seen = {}

    def watch(flight):
        now = flight.tracks.time[-1]
        if now >= SILENT:
            flight.network.cut = {1, 2, 3}
        for at in (BEFORE, AFTER):
            if at not in seen and now >= at:
                seen[at] = [
                    (
                        m.fleet.state,
                        m.fleet.adjusted,
                        m.fleet.facts(now)["fleet"],
                        m.fleet.vehicles(now),
                    )
                    for m in flight.members
                ]

    return flight.fly(SILENT + 17.0, watch), seen


def test_three_copters_space_evenly_despite_takeover_and_lost_reports():
    flight, seen = three_copters()
    errors = np.degrees(gap_errors(flight.tracks))
    time = np.array(flight.tracks.time)
    # with estimated drift all members are evenly spaced
    assert errors[(time > BEFORE - 6.0) & (time < BEFORE)].max() < 5.0
    assert all(state is State.ON_CIRCLE for state, *_ in seen[BEFORE])
    assert max(abs(degrees(adjusted.error)) for _, adjusted, *_ in seen[BEFORE]) < 5.0
    found = figures(flight.tracks)
    assert found.smallest_vertical_m > 10.0
    assert found.too_near == 0

    # each member shows its gaps and the positions of the other members
    for *_, words, others in seen[BEFORE]:
        shown = re.search(
            r"3 of 3 members on the circle, gap (\d+) deg ahead, (\d+) deg behind", words
        )
        assert [int(gap) for gap in shown.groups()] == pytest.approx([120, 120], abs=8)
        assert len(others) == 2
    k = round(BEFORE / SAMPLE_EVERY)
    place = next(one.place for one in seen[BEFORE][0][3] if one.name == "2")
    true = flight.tracks.east[k][1], flight.tracks.north[k][1]
    assert np.hypot(place[0] - true[0], place[1] - true[1]) < 5.0

    # the takeover of member 2 moves no other member off the circle, and the others begin to space
    # again
    one, two, three_ = seen[AFTER]
    assert two[0] is State.LEAVING
    assert flight.members[1].pilot.mission.outcome.ending is Ending.TAKEN_OVER
    for other in (one, three_):
        assert other[0] is State.ON_CIRCLE
        assert len(other[1].counted) == 2
    assert np.interp(SILENT, time, errors) < np.interp(AFTER, time, errors) - 8.0
    assert [m.pilot.mission.outcome is None for m in flight.members] == [True, False, True]

    # without reports every member keeps the circle of its mission
    radius = np.hypot(flight.tracks.east, flight.tracks.north)
    silent = (time > SILENT + 12.0) & (time < SILENT + 16.0)
    assert np.abs(radius[silent][:, [0, 2]] - 30.0).max() < 1.0
    assert not any(member.listeners.problems for member in flight.members)


def test_members_too_close_to_each_other_raise_alarms():
    flight = bare_fleet(
        COPTER,
        3,
        (*NEAR, *RANGES, "fleet.nearest_m=18"),
        lambda member: (
            ("sim.start.altitude_m=16", "orbit.height_above_target_m=16") if member == 2 else ()
        ),
    )
    flight.fly(12.0)
    for member in flight.members:
        alarms = member.listeners.alarms(12.0)
        assert "members 1 and 2 are 1 m apart in height" in alarms["fleet_layer"]
    for member, other in ((0, 2), (1, 1)):
        alarm = flight.members[member].listeners.alarms(12.0)["fleet_near"]
        assert re.search(rf"member {other} is \d+ m away, limit 18 m", alarm)


def test_fleet_reports_are_stamped_by_autopilot_clock():
    mission = load_mission(COPTER, ("fleet.id=1", 'link.endpoint="udpin:0.0.0.0:14550"'))
    pilot = Pilot(mission)
    one = FleetListener(mission, pilot, None)
    one.start(5_000_000)
    assert one.report(2.0).stamp == 7.0
    pilot.session.vehicle.utc.received(1.8e9, 1.0)
    assert one.report(2.0).stamp == 1.8e9 + 1.0


@pytest.mark.nightly
def test_planes_with_compass_errors_reach_even_spacing():
    """The third plane receives its first range after a minute. Compass errors of -5, 0 and 6 deg.
    tests/tools/bench/bench_fleet.py flies six planes."""
    overrides = (
        "sim.truth.rate_hz=0",
        "vehicle.speed_mps=15",
        "sim.vehicle.cruise_speed_mps=15.0",
        "sim.start.speed_mps=15.0",
        "sim.wind.speed_mps=5",
        "orbit.radius_m=100",
        "link.wait_s=200",
        "sim.start.north_m=150",
        "sim.start.east_m=-80",
    )
    late = 'sim.events=[{at_s=0.0, action="mute_ranging"}, {at_s=60.0, action="unmute_ranging"}]'

    def each(member):
        error = f"sim.sensors.heading_bias_deg={(-5.0, 0.0, 6.0)[member - 1]}"
        return (error, late) if member == 3 else (error,)

    tracks = bare_fleet(PLANE, 3, overrides, each, loss=0.3).fly(170.0).tracks
    time = np.array(tracks.time)
    joined = time[(np.array(tracks.state) == State.ON_CIRCLE).all(axis=1)][0]
    late_errors = np.degrees(gap_errors(tracks)[time > joined + 60.0])
    assert len(late_errors) > 100
    assert rms(late_errors) < 4.0
    assert figures(tracks).too_near == 0


def test_fleet_command_records_flights_that_replay(request, tmp_path):
    """The live page is checked only if a browser is installed."""
    folder = tmp_path / "fleet"
    options = ["--fleet", "2", "--fleet-loss", "0.2", "--web", "0", "--duration", "32", "--out"]
    starts = [word for key in NEAR for word in ("--set", key)]
    with running(process_of("fly", "copter", *options, str(folder), *starts)) as flown:
        if CHROMIUM is not None:
            browser = request.getfixturevalue("browser")
            browser.open(read_until(flown, "live page at ").split()[-1])
            browser.until(
                "/vehicle 2.*on circle, [23]\\d m high, \\d+ deg"
                " ahead/.test(document.body.innerText)"
            )
            browser.until(
                "[...document.querySelectorAll('#track circle.now.desired')].length === 1"
            )
            browser.until("/1 of 2|2 of 2 members on the circle/.test(document.body.innerText)")
            browser.until("!document.getElementById('outcome').hidden")
            assert not browser.complaints
        printed, problem = flown.communicate(timeout=PATIENCE)
        assert flown.returncode == 0, problem
    assert "FLEET of 2 on 30 m" in printed
    fleet = json.loads((folder / "fleet.json").read_text())
    assert [one["outcome"] for one in fleet["each"]] == ["flown to its end"] * 2
    assert (folder / "fleet.png").stat().st_size > 10_000
    assert 10_000 < (folder / "fleet.gif").stat().st_size < 1_000_000
    for member in (folder / "01", folder / "02"):
        steps = list(recorded_steps(member))
        assert any(request.offset is not None for step in steps for request in step.requests)
        assert replay(Pilot(load_mission(member / "mission.toml")), steps).identical
        assert json.loads((member / "summary.json").read_text())["desired_radius_m"] == 30.0


def test_flight_of_one_vehicle_imports_only_fleet_settings(tmp_path):
    modules = "[name for name in sys.modules if name.startswith('circnav_mav.extras.fleet.')]"
    script = f"import atexit, sys\natexit.register(lambda: print(sorted({modules})))\n{UNDRAWN}"
    flown = python(
        "-c", script, "fly", str(COPTER), "--duration", "1", "--out", str(tmp_path / "run")
    )
    printed, problem = flown.communicate(timeout=PATIENCE)
    assert (flown.returncode, problem) == (0, "")
    assert (
        printed.splitlines()[-1]
        == "['circnav_mav.extras.fleet.commands', 'circnav_mav.extras.fleet.settings']"
    )
