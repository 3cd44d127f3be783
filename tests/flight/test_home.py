"""The mission `config/home.toml`: a plane flies home to one beacon. The radio has the error and the
rate of an SX1280, the wind is V/3, and GPS is lost at 2 km."""

import re
from math import hypot

import pytest
from circnav_sim.vehicle import Truth

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Ending, Phase
from tests.flight.lockstep import CONFIG, Flight, flight, true_radius
from tests.tools.bench.bench_home import HOME, came, fly, prepared
from tests.tools.straight_way import straight_way

STOPS = 'sim.events=[{{at_s=1.0, action="gps_off"}}, {{at_s={}, action="mute_ranging"}}]'.format
STALE = 3.0
"""`limits.stale_s` of the mission, s."""


def test_time_of_straight_flight_accounts_for_wind() -> None:
    assert straight_way((100.0, 0.0), (0.0, 0.0), 20.0) == pytest.approx(5.0)
    assert straight_way((100.0, 0.0), (-5.0, 0.0), 20.0, short_of=40.0) == pytest.approx(
        60.0 / 15.0
    )
    assert straight_way((0.0, -100.0), (12.0, 0.0), 20.0) == pytest.approx(100.0 / 16.0)


def test_calibration_of_home_mission_matches_emulated_radio() -> None:
    mission = load_mission(CONFIG / "home.toml", ())
    assert mission.file.sim is not None and mission.file.ranging.points_m is not None
    assert [list(point) for point in mission.file.ranging.points_m] == mission.file.sim["ranging"][
        "table_m"
    ]


def test_plane_without_gps_circles_at_home() -> None:
    """Seed 3 starts on a heading away from the beacon, with a headwind on the way."""
    flown = fly("home", 3, away=1500.0)
    assert came(flown)
    assert flown["ratio"] < 1.3
    assert flown["rms"] < 10.0


@pytest.mark.parametrize(("wind", "raised"), [(12.0, False), (16.0, True)])
def test_flight_home_raises_not_closing_alarm_in_strong_wind(wind: float, raised: bool) -> None:
    """The plane's true airspeed is 15.4 m/s, so it cannot reach home against a wind of 16 m/s."""
    flown = flight("home", f"sim.wind.speed_mps={wind}", law="auto").fly(56.0)
    alarm = flown.pilot.conditions.alarms.get("not_closing", "")
    named = re.search(rf"\(wind {wind:.0f}, airspeed 1[56] m/s\)", alarm)
    assert (named is not None) is raised
    assert len(flown.pilot.conditions.alarms) == raised


def lost(at: float, away: float, hold: float) -> list[Truth]:
    """Fly to the end; the beacon stops at the time `at`, s. Return the track between the alarm and
    the exit action."""
    flown, _ = prepared(11, (STOPS(at), f"limits.coast_s={hold}"), away=away)
    alarmed: list[float] = []

    def watch(now: Flight) -> None:
        if not alarmed and "coasting" in now.pilot.conditions.alarms:
            alarmed.append(now.now)

    flown.fly(at + STALE + hold + 30.0, watch)
    assert alarmed[0] - at < 5.0
    assert flown.outcome.ending is Ending.ABORTED
    missing = float(flown.outcome.reason.removeprefix("no range for ").removesuffix(" s"))
    assert STALE + hold <= missing < STALE + hold + 0.2
    assert flown.pilot.mission.phase is Phase.ENDED
    assert flown.vehicle.truth.mode == flown.pilot.session.adapter.exits["loiter"]
    return [truth for truth in flown.truths if alarmed[0] < truth.time < at + hold]


def test_beacon_lost_on_circle_is_circled_until_exit() -> None:
    held = lost(40.0, 250.0, hold=60.0)
    assert max(map(true_radius, held)) < HOME


def test_beacon_lost_on_approach_is_followed_by_local_circle() -> None:
    held = lost(20.0, 2000.0, hold=45.0)
    first = held[0]
    assert max(hypot(one.north - first.north, one.east - first.east) for one in held) < 3.4 * 100.0
