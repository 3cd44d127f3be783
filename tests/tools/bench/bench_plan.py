"""Figures of `circnav plan`, compared with flights of random missions in lockstep on the bundled
vehicles.

    python -m tests.tools.bench.bench_plan --fly flown.jsonl --seconds 240
    python -m tests.tools.bench.bench_plan --compare flown.jsonl

The first command flies missions for a given time. The second compares the plan with all flights.

The number of a mission determines vehicle, speed, radius, wind, gusts, and noise and rate of the
radio, drawn at random. A mission that does not pass `circnav check` is drawn again. A flight
appends one line to the file, so that an interrupted run resumes.

Radius RMS: RMS error of the true radius over the last WINDOW seconds. Survey: standard deviation of
the place that `circnav locate` states for these seconds, and the error of the place.
"""

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import hypot, inf
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.extras.locate.forecast import position_sigma
from circnav_mav.extras.locate.place import Place
from circnav_mav.extras.plan.command import at_speed
from circnav_mav.extras.plan.radius_error import radius_rms
from circnav_mav.mav.check_result import PASS
from circnav_mav.mission.checks import check_mission, drift_allowed
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import Mission
from tests.extras.locate.flown import LocatingFlight, locating_flight
from tests.flight.lockstep import CONFIG

WINDOW = 240.0
SETTLING = 60.0
"""Evaluated time (WINDOW), and time before it to reach the circle (SETTLING), s."""
STRICT = ("turn rate", "drift", "margin", "rate error", "sampling", "gain")
"""Lines of `circnav check` that a drawn mission must pass."""
WITHIN = 0.3
"""Largest error of a planned figure, as a share of the flown figure."""
SPEEDS = {"arduplane": (15.0, 27.0), "arducopter": (3.0, 8.0), "ardurover": (1.5, 5.0)}
SHARES = {"arduplane": 0.45, "arducopter": 0.4, "ardurover": 0.15}
MOST_TRIED = 200
"""Draws of a mission before the program gives up."""


@dataclass(frozen=True)
class Drawn:
    """A drawn mission. radius: m. speed, wind, gust: m/s. sigma: noise of the ranges, m. rate:
    ranges per second, Hz."""

    number: int
    vehicle: str
    speed: float
    radius: float
    wind: float
    gust: float
    sigma: float
    rate: float

    @property
    def overrides(self) -> tuple[str, ...]:
        """Return the mission as changes of the bundled one."""
        cruise = (
            (f"sim.vehicle.cruise_speed_mps={self.speed}",) if self.vehicle == "arduplane" else ()
        )
        return (
            *cruise,
            *at_speed(str(CONFIG / f"{self.vehicle}.toml"), self.speed),
            f"orbit.radius_m={self.radius}",
            f"ranging.sigma_m={self.sigma}",
            f"ranging.rate_hz={self.rate}",
            f"sim.ranging.rate_hz={self.rate}",
            f"sim.ranging.noise_m={self.sigma}",
            f"sim.wind.speed_mps={self.wind}",
            f"sim.wind.gust_rms_mps={self.gust}",
            f"sim.seed={self.number + 1}",
            f"sim.start.random.range_m=[{1.1 * self.radius}, {1.6 * self.radius}]",
            "sim.sensors.gps_error_m=1.5",
            "sim.start.random.bearing_deg=[0, 360]",
            "limits.duration_s=2000",
        )

    def mission(self) -> Mission:
        """Return the mission. Raises MissionError."""
        return load_mission(CONFIG / f"{self.vehicle}.toml", self.overrides)


def draw(number: int) -> Drawn:
    """Return mission `number`."""
    rng = np.random.default_rng([47, number])
    for _ in range(MOST_TRIED):
        vehicle = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        speed = rng.uniform(*SPEEDS[vehicle])
        seconds = rng.uniform(2.0, 12.0)  # radius divided by speed, s
        wind = 0.0 if vehicle == "ardurover" else rng.uniform(0.0, 0.35) * speed
        gust = 0.0 if vehicle == "ardurover" else rng.uniform(0.0, 0.3) * wind
        sigma = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
        rate = float(rng.choice([4.0, 5.0, 10.0, 20.0]))
        values = (round(float(one), 2) for one in (speed, speed * seconds, wind, gust, sigma))
        drawn = Drawn(number, vehicle, *values, rate)
        try:
            mission = drawn.mission()
        except MissionError:
            continue
        sound = all(line.grade is PASS for line in check_mission(mission) if line.subject in STRICT)
        if sound and drift_allowed(mission) >= drawn.wind + 2 * drawn.gust:
            return drawn
    raise SystemExit(f"mission {number}: no draw of {MOST_TRIED} passes its checks")


def fly(drawn: Drawn) -> dict[str, object]:
    """Fly a mission. Return what was flown."""
    flown = locating_flight(drawn.vehicle, *drawn.overrides, law="auto")
    flown.solve_from = 1e9
    while flown.pilot.mission.engaged_at is None and flown.now < 60.0:
        flown.fly(flown.now + 1.0)
    flown.fly(flown.now + SETTLING)
    while flown.now < 400.0 and not _on_circle(flown, drawn.radius):
        flown.fly(flown.now + 5.0)
    begun = flown.now
    flown.fly(begun + WINDOW)
    late = [one for one in flown.truths if one.time >= begun]
    off = (
        np.array([hypot(one.north - one.target_north, one.east - one.target_east) for one in late])
        - drawn.radius
    )
    assert flown.locator is not None
    for received in (flown.locator._track, flown.locator._ranges):
        while received and received[0][0] < begun:
            received.popleft()
    place = flown.solve()
    found = (
        {"sigma": place.sigma, "error": hypot(*flown.error(place))}
        if isinstance(place, Place)
        else {}
    )
    return {
        "drawn": asdict(drawn),
        "ended": str(flown.pilot.mission.outcome) if flown.pilot.done else "",
        "begun": begun,
        "seconds": flown.now - begun,
        "rms": float(np.sqrt(np.mean(off**2))),
        "mean": float(off.mean()),
        "locate": found,
    }


def _on_circle(flown: LocatingFlight, radius: float) -> bool:
    """Return True if the radius error was below a tenth of the radius for the last 20 s."""
    late = [one for one in flown.truths if one.time >= flown.now - 20.0]
    return all(
        abs(hypot(t.north - t.target_north, t.east - t.target_east) / radius - 1) < 0.1
        for t in late
    )


def lines_of(path: Path) -> list[dict[str, Any]]:
    """Return the flights in a file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def fly_all(path: Path, numbers: Iterator[int], seconds: float) -> None:
    """Fly missions that are not in the file, until the given time has passed."""
    until = time.monotonic() + seconds
    done = {line["drawn"]["number"] for line in lines_of(path)}
    for number in numbers:
        if number in done:
            continue
        if time.monotonic() > until:
            return
        line = json.dumps(fly(draw(number)))
        with path.open("a") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())
        print(line, flush=True)


def planned(drawn: Drawn) -> tuple[float, float | None]:
    """Return the planned radius RMS and standard deviation of the place, m."""
    mission = drawn.mission()
    return radius_rms(mission, drawn.gust), position_sigma(mission, WINDOW)


def compare(path: Path) -> None:
    """Print a line per flight, and the share of flights for which the error of the plan is below
    WITHIN."""
    rms = []
    survey = []
    errors = []
    print(
        "number vehicle    V m/s  radius  wind  gust sigma  rate | RMS planned flown ratio | place"
        " planned stated error"
    )
    for line in lines_of(path):
        drawn = Drawn(**line["drawn"])
        if line["ended"]:
            print(f"{drawn.number:6} {drawn.vehicle}: ended: {line['ended']}")
            rms.append(float("inf"))
            continue
        expected, sigma = planned(drawn)
        found: dict[str, float] = line["locate"]
        rms.append(float(line["rms"]) / expected)
        survey.append(found["sigma"] / sigma if sigma and found else float("inf"))
        errors.append(found["error"] / sigma if sigma and found else float("inf"))
        conditions = (
            f"{drawn.speed:5.1f} {drawn.radius:7.1f} {drawn.wind:5.1f} {drawn.gust:5.2f}"
            f" {drawn.sigma:5.2f}"
        )
        radius = f"{expected:11.3f} {line['rms']:5.3f} {rms[-1]:5.2f}"
        place = f"{sigma or 0:13.2f} {found.get('sigma', 0):6.2f} {found.get('error', 0):5.2f}"
        print(
            f"{drawn.number:6} {drawn.vehicle:10} {conditions} {drawn.rate:5.0f} | {radius} |"
            f" {place}"
        )
    for name, ratios in (("radius RMS", rms), ("stated sigma of the place", survey)):
        inside = sum(1 - WITHIN <= one <= 1 + WITHIN for one in ratios)
        print(
            f"{name}: {inside} of {len(ratios)} within {100 * WITHIN:.0f} % of the plan, median"
            f" {np.median(ratios):.2f}"
        )
    print(
        f"error of the place over the planned sigma: RMS {np.sqrt(np.mean(np.square(errors))):.2f}"
        " (1.41 expected)"
    )


def main() -> None:
    """Fly or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fly", type=Path, metavar="FILE")
    parser.add_argument("--compare", type=Path, metavar="FILE")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--missions", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=inf)
    options = parser.parse_args()
    if options.fly:
        fly_all(
            options.fly,
            iter(range(options.first, options.first + options.missions)),
            options.seconds,
        )
    if options.compare:
        compare(options.compare)


if __name__ == "__main__":
    main()
