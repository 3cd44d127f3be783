"""python -m tests.tools.firmware.fly VEHICLE [options]:

one flight of the installed circnav on real firmware in simulation.

Prints one line with figures of the simulator's true track, and leaves a run folder: result.json,
truth.csv, setpoints.csv, mission.toml, circnav/ (its own run folder), circnav.log, firmware.log.
This tool shares no code and no sign convention with circnav. Exit code 0: flown and evaluated, even
if the circle was not kept. Exit code 3: the vehicle did not start to fly, or circnav did not
engage.
"""

import argparse
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, astuple, fields
from datetime import datetime
from functools import partial
from math import cos, degrees, hypot, inf, radians, sin, tan
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from pymavlink.dialects.v20 import all as mavlink

from tests.process import reserved_port
from tests.tools.firmware import px4, sitl
from tests.tools.firmware.bench import Bench, Firmware, NoFlightError, Truth, note
from tests.tools.firmware.flight import (
    BEHIND_ARDUPILOT,
    BEHIND_PX4,
    ROOT,
    Flight,
    add_options,
    flight,
)
from tests.tools.firmware.radio import UP, Radio
from tests.tools.firmware.score import Array, Target, columns, from_target, score
from tests.tools.firmware.wire import LOOPBACK, G
from tests.tools.straight_way import straight_way

OWN = (
    "outcome",
    "reason",
    "settled_s",
    "radius_mean_m",
    "radius_rms_error_m",
    "turn_std_deg_s",
    "turn_at_limit",
    "samples_accepted",
    "samples_rejected",
    "law_changes",
    "version",
    "firmware",
)
"""Entries of circnav's summary that are part of a result."""
SHOWN = (
    "kept",
    "direction",
    "rms",
    "mean",
    "sd",
    "settled",
    "closest",
    "turn_sd",
    "turn_at_limit",
    "total_variation",
    "roll",
    "own",
    "own_position",
    "homing",
    "takeover",
    "real_speedup",
)
"""Entries of a result that are printed."""
ENGAGE_PATIENCE = 90.0
"""Time limit for circnav to engage, s."""
LEAVE_PATIENCE = 30.0
HOME = 150.0
"""Distance from the beacon at which the vehicle has arrived, m."""
SLOWEST = 2.0
"""Largest ratio of real to simulated time. A slower flight is ended."""


def missing(flown: Flight) -> str:
    """Return the reason why the flight cannot run here; empty if it can."""
    if not flown.baseline and not Path(flown.circnav).is_file():
        return f"no circnav at {flown.circnav}: install the package, or name one with --circnav"
    if flown.what.firmware == BEHIND_ARDUPILOT:
        return sitl.missing(flown.what.kind)
    return px4.missing()


def fly(flown: Flight, folder: Path) -> dict[str, Any]:
    """Fly, and return the result, which is also written to result.json in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with reserved_port() as app_port, reserved_port() as other_port:
        ardupilot = flown.what.firmware == BEHIND_ARDUPILOT
        firmware: Firmware = sitl.ArduPilot(flown, other_port) if ardupilot else px4.Px4(flown)
        bench = Bench(flown, firmware, folder, app_port)
        try:
            result = _flown(flown, bench, folder)
        except NoFlightError as problem:
            modes = [(round(at, 1), mode) for at, mode in bench.modes]
            texts = [(round(at, 1), text) for at, text in bench.texts][-30:]
            result = {"failed": str(problem), "modes": modes, "texts": texts}
            result["setpoints"] = len(bench.setpoints)
        finally:
            bench.close()
            shutil.rmtree(folder / "firmware", ignore_errors=True)
    result = {"title": flown.title, "flight": asdict(flown), **result}
    (folder / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    return result


def _flown(flown: Flight, bench: Bench, folder: Path) -> dict[str, Any]:
    bench.firmware.bring_up(bench)
    home = bench.track[0].altitude
    radio = Radio(bench, home)
    note(f"  up: {flown.title}, height {bench.truth.altitude - home:.1f} m")
    bench.longest_pause = 0.0
    if flown.baseline:
        radio.stand(*bench.firmware.circle(bench, *radio.target(bench.now)))
        limit = 0.0
    else:
        silent = bench.now + flown.radio_at
        bench.on_truth = lambda truth: radio.tick(truth) if truth.time >= silent else None
        limit = _start_circnav(flown, bench, folder, home)
    began = bench.now
    wall = time.monotonic()
    _loop(flown, bench, began, home)
    spent = time.monotonic() - wall
    engaged, ended = _circled(flown, bench, began)
    figures = score(
        flown,
        bench.track,
        bench.setpoints,
        radio.target,
        engaged=engaged,
        ended=ended,
        turn_limit=limit,
        home=home,
    )
    _write(folder, bench, radio, engaged)
    bench.close()
    return {
        **figures,
        **({"from_ground": _lowest(bench, began, home)} if flown.from_ground else {}),
        "own": {} if flown.baseline else own_verdict(folder / "circnav"),
        "own_position": own_position(flown, bench, began, ended),
        "homing": homing(flown, bench.track, radio.target, engaged, ended),
        "takeover": _after_takeover(flown, bench, began),
        "modes": [(round(at - engaged, 1), mode) for at, mode in bench.modes if at > began - 5],
        "texts": [(round(at - engaged, 1), text) for at, text in bench.texts if at > began - 5][
            :30
        ],
        "ranges": {"sent": radio.sent, "lost": radio.lost},
        "from_app": dict(bench.from_app),
        "hidden": bench.hidden,
        "exit_code": bench.app.returncode if bench.app else None,
        "real_speedup": round((bench.now - began) / spent, 3),
        "longest_pause": round(bench.longest_pause, 2),
    }


def _lowest(bench: Bench, began: float, home: float) -> dict[str, float]:
    """Return figures of a flight that began on the ground: time and height of the first setpoint
    after the lift-off, lowest height afterwards, and largest bank below 5 m, m and deg."""
    first = bench.setpoints[0].time if bench.setpoints else bench.now
    lifted = next((one.time for one in bench.track if one.altitude > home + 0.3), began)
    steered = [one for one in bench.track if first <= one.time <= bench.setpoints[-1].time]
    low = [abs(degrees(one.roll)) for one in steered if one.altitude < home + 5.0]
    return {
        "first_setpoint_after_lift_off_s": round(first - lifted, 1),
        "height_at_first_setpoint_m": round(steered[0].altitude - home, 1),
        "lowest_while_steered_m": round(min(one.altitude for one in steered) - home, 1),
        "bank_below_5_m_deg": round(max(low, default=0.0), 1),
    }


def _start_circnav(flown: Flight, bench: Bench, folder: Path, home: float) -> float:
    """Start circnav on a mission for this flight. Return the mission's turn limit, rad/s."""
    mission = write_mission(
        flown, folder / "mission.toml", bench.app_port, home + flown.target_height
    )
    command = [flown.circnav, "fly", str(folder / "mission.toml"), "--out", str(folder / "circnav"),
               *[word for one in flown.set for word in ("--set", one)]]  # fmt: skip
    log = (folder / "circnav.log").open("wb")
    bench.relaying = True
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    bench.app = subprocess.Popen(
        command,
        stdout=log,
        stderr=subprocess.STDOUT,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )
    if "max_turn_rate_deg_s" in mission["vehicle"]:
        return radians(mission["vehicle"]["max_turn_rate_deg_s"])
    return G * tan(radians(mission["vehicle"]["max_bank_deg"])) / flown.speed


def write_mission(flown: Flight, path: Path, port: int, target_altitude: float) -> dict[str, Any]:
    """Write the vehicle's mission file as an operator would do. The operator enters the altitude of
    the beacon above sea level, m, rounded to 0.1 m."""
    mission = tomlkit.parse((ROOT / "config" / f"{flown.what.mission}.toml").read_text())
    mission.pop("sim", None)
    mission["link"]["endpoint"] = f"udpin:{LOOPBACK}:{port}"
    if flown.what.firmware == BEHIND_PX4:
        # SIH runs at 95 to 99 % of real time, and old ranges would be rejected.
        mission["link"]["clock"] = "autopilot"
    mission["vehicle"]["speed_mps"] = flown.speed
    mission["orbit"]["radius_m"] = flown.radius
    mission["orbit"]["direction"] = flown.direction
    for key in ("height_above_target_m", "target_above_home_m"):
        mission["orbit"].pop(key, None)
    mission["orbit"]["target_altitude_m"] = round(target_altitude, 1)
    sigma = hypot(flown.noise, flown.drift)
    mission["ranging"] |= {
        "rate_hz": flown.rate,
        "sigma_m": sigma,
        "orientation": UP,
        "component_id": 192,
    }
    mission["limits"]["duration_s"] = flown.duration
    if flown.external_position:
        mission["locate"] = {"enabled": True}
        mission["external_position"] = {"enabled": True}
    if flown.home_s:
        mission["exit"] = {"action": "rtl"}
    path.write_text(tomlkit.dumps(mission))
    return mission.unwrap()


def _loop(flown: Flight, bench: Bench, began: float, home: float) -> None:
    """Run until circnav has ended or the time limit has passed."""
    lowered = False
    todo = sorted(_events(flown, bench), key=lambda event: event[0])
    longest = flown.duration + flown.home_s
    if not flown.baseline:
        longest += ENGAGE_PATIENCE + LEAVE_PATIENCE
    hopeless = time.monotonic() + SLOWEST * longest
    sticks = time.monotonic()
    while bench.now - began < longest and not _has_ended(flown, bench, began):
        bench.pump(0.002)
        if time.monotonic() > hopeless:
            raise NoFlightError("the simulation hardly runs")
        while todo and bench.now - began > todo[0][0]:
            todo.pop(0)[1]()
        if flown.mode_below is not None and not todo and not lowered:
            floor, mode = flown.mode_below.split("=")
            lowered = bench.truth.altitude < home + float(floor)
            if lowered:
                bench.firmware.ask_mode(bench, int(mode))
        if flown.baseline and time.monotonic() > sticks:
            sticks = time.monotonic() + 0.3
            bench.firmware.circling(bench)


def _has_ended(flown: Flight, bench: Bench, began: float) -> bool:
    """Return True if circnav has ended, and the vehicle is not on its recorded way home. Raise
    NoFlightError if circnav has not engaged in time."""
    if bench.app is None:
        return False
    since = bench.now - began
    if since > ENGAGE_PATIENCE and not _in_guided(bench, began):
        raise NoFlightError("circnav did not engage, see circnav.log")
    on_the_way = flown.home_s and since < flown.duration + flown.home_s
    return bench.app.poll() is not None and not on_the_way


def _events(flown: Flight, bench: Bench) -> Iterator[tuple[float, Callable[[], None]]]:
    """Yield the events of the flight with their times after the start of circnav, s."""
    firmware = bench.firmware
    if flown.from_ground:
        yield from firmware.take_off(bench)
    if flown.takeover is not None:
        yield flown.takeover, lambda: firmware.ask_mode(bench, firmware.holding)
    for one in flown.mode_at:
        at, mode = one.split("=")
        yield float(at), partial(firmware.ask_mode, bench, int(mode))
    if flown.home_here is not None:
        yield flown.home_here, lambda: bench.request(mavlink.MAV_CMD_DO_SET_HOME, 1)
    if flown.climb is not None:
        yield from firmware.climb(bench, *flown.climb)
    if flown.gps_off is not None:
        yield flown.gps_off, lambda: firmware.without_gps(bench)
    if flown.wind_change is not None:
        at, *wind = flown.wind_change
        yield at, lambda: firmware.wind(bench, *wind)
    if flown.param_at is not None:
        name, value = flown.param_at[1].split("=")
        yield float(flown.param_at[0]), lambda: bench.send_parameter(name, float(value))


def _in_guided(bench: Bench, began: float) -> list[float]:
    return [at for at, mode in bench.modes if mode in bench.firmware.steered and at >= began - 1.0]


def _circled(flown: Flight, bench: Bench, began: float) -> tuple[float, float]:
    """Return the time of the first report of the guided mode, and the time of the takeover or of
    the last setpoint in the guided mode."""
    if flown.baseline:
        return began, bench.now
    entered = _in_guided(bench, began)
    if not entered or not bench.setpoints:
        raise NoFlightError("circnav never steered, see circnav.log")
    left = [
        at for at, mode in bench.modes if mode not in bench.firmware.steered and at > entered[-1]
    ]
    ends = [bench.setpoints[-1].time, *left[-1:]]
    if flown.takeover is not None:
        ends.append(began + flown.takeover)
    return entered[0], min(ends)


def _after_takeover(flown: Flight, bench: Bench, began: float) -> dict[str, Any] | None:
    """Count the setpoints between the operator's takeover and the return of the guided mode: after
    the operator's command, and after the heartbeat that reported the new mode."""
    if flown.takeover is None:
        return None
    asked = began + flown.takeover
    modes = [(at, mode in bench.firmware.steered) for at, mode in bench.shown_modes if at > asked]
    shown = next((at for at, steered in modes if not steered), None)
    again = next((at for at, steered in modes if steered and shown and at > shown), inf)
    late = [one.time for one in bench.setpoints if asked < one.time < again]
    return {
        "after_command": len(late),
        "last_after_command_s": round(max(late, default=asked) - asked, 2),
        "shown_s": None if shown is None else round(shown - asked, 2),
        "after_shown": None if shown is None else sum(at > shown for at in late),
    }


def homing(
    flown: Flight, track: list[Truth], target: Target, engaged: float, ended: float
) -> dict[str, float] | None:
    """Return figures of the mission `home`: time from the engagement to within HOME of the beacon,
    s; time of the straight path in this wind, s; and the largest distance from the beacon
    afterwards, m. If the vehicle did not arrive: its smallest distance, m."""
    if not flown.what.mission.startswith("home"):
        return None
    way = columns(track, engaged, ended)
    places = from_target(way, target)
    away = np.hypot(*places)
    near = np.flatnonzero(away <= HOME)
    if not near.size:
        return {"nearest": round(float(away.min()), 1)}
    towards = radians(flown.wind_from + 180.0)
    wind = flown.wind * cos(towards), flown.wind * sin(towards)
    airspeed = hypot(way["v_north"][0] - wind[0], way["v_east"][0] - wind[1])
    if flown.what.kind == "copter":  # a copter starts at hover, so use the speed of the mission
        airspeed = flown.speed
    north, east = -places[:, 0]
    straight = straight_way((north, east), wind, airspeed, HOME)
    took = way["time"][near[0]] - engaged
    figures = {
        "home": took,
        "straight": straight,
        "ratio": took / straight,
        "farthest": away[near[0] :].max(),
    }
    return {name: round(float(value), 2) for name, value in figures.items()}


def own_position(flown: Flight, bench: Bench, began: float, ended: float) -> dict[str, Any] | None:
    """Return figures from 10 s after the loss of GPS: the error of the autopilot's own position on
    the circle and on the way home; the vehicle's smallest distance from home, m; and the distance
    from home to the center of the last circle, m."""
    if flown.gps_off is None:
        return None
    lost = began + flown.gps_off + 10.0
    late = columns(bench.track, lost)
    if not late:
        return None
    given = Counter[str]()
    record = bench.folder / "circnav" / "external_position.csv"
    if record.is_file():
        with record.open() as file:
            given.update(f"{row['answer']}, by {row['by']}" for row in csv.DictReader(file))
    from_home = np.array([late["north"] - flown.home_away, late["east"]])
    last = columns(bench.track, bench.track[-1].time - 40.0)
    circle = np.array([last["north"] - flown.home_away, last["east"]])
    return {
        "circle": own_error(bench, lost, max(lost, ended)),
        "way_home": own_error(bench, max(lost, ended), bench.now) if flown.home_s else None,
        "nearest_home": round(float(np.hypot(*from_home).min()), 1),
        "circles_off_home": round(center(circle), 1),
        "given": dict(given),
    }


def own_error(bench: Bench, since: float, until: float) -> dict[str, float] | None:
    """Return the errors of the autopilot's reports against the truth at the timestamps of the
    reports: position error, m; largest step of the velocity error between two reports, m/s; mean
    and standard deviation of the heading error, degrees clockwise. Arrival times are not used: with
    them, a turn of 3 m/s^2 would look like a velocity step of 1 m/s."""
    until = min(until, bench.track[-1].time)
    reported = np.array([astuple(one) for one in bench.reported if since < one.time < until])
    if len(reported) < 2:
        return None
    true = columns(bench.track, -inf)
    true["yaw"] = np.unwrap(true["yaw"])
    names = ("north", "east", "v_north", "v_east", "yaw")
    times, *values = reported.T
    north, east, v_north, v_east, yaw = (
        value - np.interp(times, true["time"], true[name])
        for name, value in zip(names, values, strict=True)
    )
    off = np.hypot(north, east)
    turned = np.degrees(np.remainder(yaw + np.pi, 2 * np.pi) - np.pi)
    figures = {
        "median": np.median(off),
        "p95": np.percentile(off, 95),
        "largest": off.max(),
        "velocity_step": np.hypot(np.diff(v_north), np.diff(v_east)).max(),
        "heading": turned.mean(),
        "heading_sd": turned.std(),
    }
    return {name: round(float(value), 2) for name, value in figures.items()}


def center(way: Array) -> float:
    """Return the distance from the origin to the center of a circle fitted to a track, m."""
    middle = way.mean(axis=1)
    at = (way.T - middle).T
    north, east, _ = np.linalg.lstsq(
        np.c_[2 * at.T, np.ones(at.shape[1])], (at**2).sum(axis=0), rcond=None
    )[0]
    return hypot(middle[0] + north, middle[1] + east)


def own_verdict(run: Path) -> dict[str, Any]:
    """Return circnav's own figures, from its summary."""
    if not (run / "summary.json").is_file():
        return {"outcome": "no summary"}
    summary = json.loads((run / "summary.json").read_text())
    return {name: summary.get(name) for name in OWN}


def _write(folder: Path, bench: Bench, radio: Radio, engaged: float) -> None:
    with (folder / "truth.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow([*(one.name for one in fields(Truth)), "target_north", "target_east"])
        for row in bench.track:
            time_, *rest = astuple(row)
            target = radio.target(row.time)
            out.writerow([f"{time_ - engaged:.3f}", *(f"{one:.4f}" for one in (*rest, *target))])
    with (folder / "setpoints.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["time", "kind", "turn", "roll"])
        for one in bench.setpoints:
            values = ("" if value is None else f"{value:.5f}" for value in (one.turn, one.roll))
            out.writerow([f"{one.time - engaged:.3f}", one.kind, *values])


def line(result: dict[str, Any]) -> str:
    """Return a result as one line: its title, then the figures by name."""
    if "failed" in result:
        return f"{result['title']}: NOT FLOWN: {result['failed']}"
    words = [f"{name} {result[name]}" for name in SHOWN if result[name] not in (None, {})]
    return f"{result['title']}: {'; '.join(words)}"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.firmware.fly",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_options(parser)
    parser.add_argument("--out", type=Path, help="run folder [runs/firmware/TIME-VEHICLE-SEED]")
    options = parser.parse_args(arguments)
    flown = flight(options)
    if reason := missing(flown):
        parser.error(reason)
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = options.out or Path("runs") / "firmware" / f"{stamp}-{flown.vehicle}-{flown.seed}"
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    result = fly(flown, folder.resolve())
    print(f"{line(result)}; {folder}", flush=True)
    return 3 if "failed" in result else 0


if __name__ == "__main__":
    sys.exit(main())
