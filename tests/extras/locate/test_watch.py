"""The GPS watch: detection of the faulty one among GPS, beacon and compass, and its delay."""

from cmath import rect
from math import atan2, cos, hypot, pi, sin

import pytest

from circnav_mav.extras.locate.watch import FaultSource, GpsWatch, Observation
from tests.extras.locate.flown import surveyed

V, R = 15.0, 100.0
FROM = 60.0


def looks(fault, *, noise=1.0):
    """Yield four observations a second on a circle around (0, 0) in wind of 4 m/s to the east. The fault begins at
    FROM."""
    for tick in range(480):
        t = tick / 4
        angle = V / R * t
        east, north = R * cos(angle), R * sin(angle)
        wrong = max(0.0, t - FROM)
        # the nose points along air velocity = ground velocity - wind
        air = -V * sin(angle) - 4.0, V * cos(angle)
        told = (east, north + (min(50.0 * wrong, 500.0) if fault == "spoof" else 0.0))
        measured = hypot(east - (5.0 * wrong if fault == "beacon" else 0.0), north)
        turned = 0.6 if fault == "compass" and wrong else 0.0
        wobble = noise * sin(12.9898 * tick)
        # the bearing by ranges and heading turns with the compass, and the one by position follows a spoofed position
        by_position = atan2(-told[1], -told[0])
        bearing = (angle + pi + turned - by_position + pi) % (2 * pi) - pi
        air = rect(hypot(*air), atan2(air[1], air[0]) + turned)
        yield Observation(t, *told, air, (measured - hypot(*told) + wobble, 2.0), (bearing, 0.06))


@pytest.mark.parametrize(
    ("fault", "culprit"), [("spoof", FaultSource.GPS), ("beacon", FaultSource.BEACON), ("compass", FaultSource.COMPASS)]
)
def test_what_fails_together_names_the_culprit_within_ten_seconds(fault, culprit):
    watch = GpsWatch()
    found = [(look.time, watch.fault) for look in looks(fault) if watch.see(look) or watch.fault]
    assert FROM < found[0][0] <= FROM + 10.0
    assert {named for _, named in found} == {culprit}, "it is not another one a minute later"
    assert len(watch.reported) == 1 and f"most likely wrong: {culprit.value}" in watch.reported[0][1]


def test_an_honest_flight_in_wind_raises_no_alarm():
    watch = GpsWatch()
    for look in looks("none"):
        watch.see(look)
    assert watch.reported == []


def test_a_spoof_of_the_emulated_vehicle_is_told_within_ten_seconds_and_leaves_the_place_alone():
    """The spoof moves by 500 m within 10 s from t = 75 s on. Positions change no byte of the
    flight: test_never_steers.py."""
    changes = ('sim.events=[{at_s=75.0, action="gps_spoof", value=50.0}]', "sim.sensors.gps_error_m=0.5",
               "limits.duration_s=90", "sim.start.north_m=150", "sim.start.east_m=0")  # fmt: skip
    flown = surveyed("quickstart", *changes, law="smooth")
    flown.solve_from, flown.solve_every = 55.0, 5.0
    flown.fly(86.0)
    watch = flown.locator.watch
    assert watch.reported and 75.0 < watch.reported[0][0] <= 85.0 and "most likely wrong: GPS" in watch.reported[0][1]
    texts = [message.text for _, message in flown.messages if message.get_type() == "STATUSTEXT"]
    assert "circnav: GPS WATCH: most likely wrong: GPS" in texts
    place = flown.locator.place
    assert hypot(*flown.error(place)) < 5.0
