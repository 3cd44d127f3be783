"""`circnav plan`: reads the options, prints the table, writes picture and mission."""

import os
from collections.abc import Iterator
from math import degrees, floor, inf, isfinite
from pathlib import Path

from circnav_mav.cli.bundled import bundled
from circnav_mav.cli.check import read_mission
from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.cli.init import write_mission
from circnav_mav.cli.progress import each, progress
from circnav_mav.extras.plan.candidates import (
    Candidate,
    Site,
    candidate,
    fails,
    holds_ground_speed,
    radii,
    recommended,
    smallest_radius,
)
from circnav_mav.guidance.maths import radius_sensitivity
from circnav_mav.mission.checks import fastest_turn
from circnav_mav.mission.load import load_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.runlog.atomic_write import write_text


def print_plan(
    path: str,
    speeds: tuple[float, ...],
    largest: float | None,
    smallest: float | None,
    height: float | None,
    wind: float,
    gusts: float | None,
    sigma: float | None,
    rate: float | None,
    laps: float,
    picture: str | None,
    mission: str | None,
) -> int:
    """Print a table for each speed and write the files. Raises Refused."""
    if mission is not None and os.path.lexists(mission):
        raise Refused(f"--write {mission}: is there already, name another file")
    changes = list(_changes(height, sigma, rate))
    # 0.15: default gusts as a share of the wind. MIL-F-8785C gives 0.14 at a height of 100 m.
    site = Site(
        smallest or 1.0, largest or inf, wind, 0.15 * wind if gusts is None else gusts, laps
    )
    speeds = speeds or (read_mission(path, tuple(changes)).orbit.speed,)
    found = list(_candidates(path, changes, speeds, site))
    best, reason = recommended(found)
    changes += at_speed(path, best.speed)
    start = _with_radius(path, changes, best.radius)
    if (words := next(fails(start), None)) is not None:
        raise Refused(f"plan {path}: no circle can be flown: {words}")
    for line in (*table(start, site, found, best), *_recommendation(start, best, reason)):
        say(line)
    if picture is not None:
        with refusing(picture), progress(f"drawing {picture}"):
            from circnav_mav.extras.plan.picture import plot_plan

            plot_plan(Path(picture), found, best, site, f"{start.file.name}: wind {wind:g} m/s")
        say(f"{picture}: the circles as a picture")
    if mission is not None:
        _write(path, [*changes, f"orbit.radius_m={best.radius!r}"], start, site, mission)
    return Exit.DONE


def _changes(height: float | None, sigma: float | None, rate: float | None) -> Iterator[str]:
    """Yield the options as overrides of the mission."""
    keys = {
        "orbit.height_above_target_m": height,
        "ranging.sigma_m": sigma,
        "ranging.rate_hz": rate,
    }
    yield from (f"{key}={float(value)!r}" for key, value in keys.items() if value is not None)


def at_speed(path: str, speed: float) -> Iterator[str]:
    """Yield overrides of the mission: the speed, and a lower turn rate if the acceleration limit
    requires it."""
    flown = f"vehicle.speed_mps={speed!r}"
    yield flown
    mission = read_mission(path, (flown,))
    if (most := fastest_turn(mission)) < mission.orbit.max_turn_rate:
        yield f"vehicle.max_turn_rate_deg_s={floor(degrees(most))!r}"


def _limited(mission: Mission) -> bool:
    """True if the vehicle's acceleration limits its turn rate."""
    most = fastest_turn(mission)
    return isfinite(most) and degrees(mission.orbit.max_turn_rate) > floor(degrees(most)) - 1e-6


def _with_radius(path: str, changes: list[str], radius: float) -> Mission:
    return read_mission(path, (*changes, f"orbit.radius_m={radius!r}"))


def _candidates(
    path: str, changes: list[str], speeds: tuple[float, ...], site: Site
) -> Iterator[Candidate]:
    """Yield the circles of each speed. Raises Refused."""
    for speed in speeds:
        changed = [*changes, *at_speed(path, speed)]
        sizes = _radii(read_mission(path, tuple(changed)), site)
        for radius in each(f"computing circles at {speed:g} m/s", sizes, len(sizes)):
            yield candidate(_with_radius(path, changed, radius), site)


def _radii(start: Mission, site: Site) -> list[float]:
    """Return the radii of the candidates, m. Raises Refused if no radius fits the site."""
    wind = 0.0 if holds_ground_speed(start) else site.strongest
    V = start.orbit.speed
    least = smallest_radius(start, wind)
    if site.smallest > site.largest:
        raise Refused(
            f"plan: --smallest {site.smallest:g} m is larger than --largest {site.largest:g} m"
        )
    if wind >= V:
        raise Refused(
            f"plan: the wind with gusts, {wind:.1f} m/s, is not below the vehicle's speed of {V:g}"
            " m/s: raise --speed"
        )
    if least > site.largest:
        faster = "" if _limited(start) else ", or raise vehicle.max_bank_deg or max_turn_rate_deg_s"
        raise Refused(
            f"plan: --largest {site.largest:g} m is too small: at {V:g} m/s in {wind:.1f} m/s of"
            f" wind with gusts the smallest radius is {least:.0f} m: lower --speed{faster}"
        )
    return list(radii(least, site))


def _recommendation(start: Mission, best: Candidate, reason: str) -> Iterator[str]:
    """Yield the recommended circle and its conditions."""
    yield f"Recommended: {best.radius:g} m at {best.speed:g} m/s: {reason}."
    height = start.file.orbit.height_above_target_m or 0.0
    yield f"RMS without errors of height and radio: {radius_sensitivity(best.radius, height)}."
    if _limited(start):
        lowered = f"vehicle.max_turn_rate_deg_s = {start.file.vehicle.max_turn_rate_deg_s:g}"
        yield f"{lowered}: at this speed the autopilot's default acceleration limit allows no more."
    if holds_ground_speed(start):
        yield (
            "The autopilot holds the speed over the ground: only its lean or drive limits the wind."
        )


def table(start: Mission, site: Site, found: list[Candidate], best: Candidate) -> Iterator[str]:
    """Yield the lines of the table, at most 80 columns wide."""
    ranging = start.file.ranging
    speed = 0.0
    for one in found:
        if one.speed != speed:
            speed = one.speed
            yield (
                f"{start.file.vehicle.kind} at {speed:g} m/s, wind {site.wind:g} m/s, gusts"
                f" {site.gusts:.2g} m/s, range noise {ranging.sigma_m:g} m, {ranging.rate_hz:g} Hz"
            )
            laps = f"{site.laps:g} laps"
            yield f"used: of turn rate; place: error after {laps}; flight: approach and {laps}"
            yield "  radius   lap  bank   turn  used  wind to   RMS  place  flight  checks"
            yield "       m     s   deg  deg/s     %      m/s     m      m     min"
        yield _row(one, best)


def _row(one: Candidate, best: Candidate) -> str:
    bank = "-" if one.bank is None else f"{one.bank:.0f}"
    most = "-" if one.most_wind is None else f"{one.most_wind:.1f}"
    place = "-" if one.place is None else f"{one.place:.2f}"
    more = f" +{len(one.problems) - 1}" if len(one.problems) > 1 else ""
    checks = f"{one.problems[0]}{more}" if one.problems else "pass"
    return (
        f"{'>' if one is best else ' '} {one.radius:6g} {one.lap:5.0f} {bank:>5} {one.turn:6.1f}"
        f" {100 * one.used:5.0f} {most:>8} {one.rms:5.2f} {place:>6} {one.flight / 60:7.1f} "
        f" {checks}"
    )


def _write(path: str, changes: list[str], start: Mission, site: Site, target: str) -> None:
    """Write a mission with the recommended circle, based on the file of `circnav init` or on the
    given file."""
    if start.flies_sim and start.file.sim is not None:
        ranging = start.file.ranging
        changes += [
            f"sim.wind.speed_mps={site.wind!r}", f"sim.wind.gust_rms_mps={site.gusts!r}",
            f"sim.ranging.noise_m={ranging.sigma_m!r}", f"sim.ranging.rate_hz={ranging.rate_hz!r}",
        ]  # fmt: skip
        if any(one.fixed_wing for one in start.vehicles):
            changes.append(f"sim.vehicle.cruise_speed_mps={start.orbit.speed!r}")
    source = Path(path)
    name = Path(path).stem
    with refusing(target):
        if bundled("mission", name) == source:
            write_mission(name, target)
            source = Path(target)
        write_text(Path(target), load_mission(source, changes).text)
    say(f"  circnav check {target}")
