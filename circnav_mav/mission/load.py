"""Reads a mission file. Degrees become radians here; whatever is wrong becomes one line that names file and key."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf, radians, tan
from pathlib import Path
from typing import Any, get_args

import numpy as np
import tomlkit
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from circnav_mav.core.bounds import Bounds
from circnav_mav.core.estimators.interface import EstimatorSettings
from circnav_mav.core.estimators.steady import SteadyState, steady_state
from circnav_mav.core.guidance import LawChoice
from circnav_mav.core.laws import LAWS
from circnav_mav.core.theory import rate_gain
from circnav_mav.core.values import Direction, Orbit
from circnav_mav.mav.autopilots.interface import GRAVITY, AirLoops, VehicleFacts
from circnav_mav.mav.ranging import RANGING_MESSAGES, RangingSettings
from circnav_mav.mav.session import LinkSettings
from circnav_mav.mission.schema import MissionFile
from circnav_mav.pilot import LINKS, RANGING, VEHICLE, PilotSettings, Timing, Voice

DEFAULT_LOOP = 0.35
"""What 2 k r_d V (turn lag + filter lag) is for a default gain; from about .45 on, vehicles limit-cycle."""
LEAST_GAIN = 1.2
"""Default gains stay this many times above the paper's bound."""
MOST_PROBLEMS = 8
"""Problems of a file told in one line."""
SIM = "sim"
"""The endpoint that stands for the bundled vehicle."""


class MissionError(Exception):
    """A mission that cannot be flown as written; the message is one line for the person who wrote it."""


@dataclass(frozen=True, slots=True)
class Mission:
    """A validated mission. `file` is as the person wrote it, with units in names; `text` is the file as flown."""

    file: MissionFile
    text: str

    @property
    def orbit(self) -> Orbit:
        """The circle, in SI units and radians."""
        vehicle, orbit = self.file.vehicle, self.file.orbit
        return Orbit(orbit.radius_m, Direction(orbit.direction), vehicle.speed_mps, self._max_turn_rate())

    @property
    def law(self) -> LawChoice:
        """The law with its gain: the file's, or the law's default, lowered where the lags of turn and filter would
        make the circle oscillate."""
        guidance, orbit = self.file.guidance, self.orbit
        law = LAWS[guidance.law]
        gain = guidance.gain or law.default_gain(orbit.speed, orbit.radius)
        least = LEAST_GAIN * law.gain_bound(orbit.speed, orbit.radius)
        if guidance.gain is None and law.name == "smooth":
            gain = max(least, min(gain, DEFAULT_LOOP / (2 * orbit.radius * orbit.speed * self.loop_lag)))
        elif guidance.gain is None and law.gain_unit == "rad/m":
            gain = max(least, rate_gain(orbit.speed, orbit.radius, self.loop_lag))
        return LawChoice(guidance.law, gain, guidance.correct_radius, self.file.vehicle.turn_lag_s)

    @property
    def estimator(self) -> str:
        """The estimator: the file's, or the one that the law wants."""
        own = {"auto": "auto", "drift": "drift"}.get(self.file.guidance.law, "kalman")
        return self.file.guidance.estimator or own

    @property
    def loop_lag(self) -> float:
        """Delay from a change of range rate to the vehicle's turn, s: the filter's and the vehicle's."""
        return self.file.vehicle.turn_lag_s + self.steady_estimate.lag

    @property
    def steady_estimate(self) -> SteadyState:
        """Noise and lag of the range rate on the circle."""
        ranging = self.file.ranging
        return steady_state(self.estimation, r=self.orbit.radius, sigma=ranging.sigma_m, period=1 / ranging.rate_hz)

    @property
    def estimation(self) -> EstimatorSettings:
        """What the estimator needs to know."""
        guidance, orbit = self.file.guidance, self.orbit
        return EstimatorSettings(
            orbit.speed, orbit.max_turn_rate, gate=guidance.gate_sigma, min_samples=guidance.min_samples
        )

    @property
    def max_range(self) -> float:
        """Farthest range that counts, m: the file's limit within what the message can carry."""
        carried = RANGING_MESSAGES[self.file.ranging.message].farthest
        return min(self.file.ranging.max_range_m or carried, carried)

    @property
    def flies_sim(self) -> bool:
        """Whether the bundled vehicle is flown."""
        return self.file.link.endpoint == SIM

    @property
    def vehicle_key(self) -> tuple[str, str]:
        """The vehicle as the adapter table knows it; the stick is how a PX4 plane is steered by default."""
        vehicle = self.file.vehicle
        by_default = vehicle.method is None or (vehicle.kind == "plane" and vehicle.method == "stick")
        return vehicle.autopilot, vehicle.kind if by_default else f"{vehicle.kind} {vehicle.method}"

    def pilot_settings(self, voice: Voice = Voice.FLY) -> PilotSettings:
        """The mission as the pilot needs it. Raises ValueError for a gain without a radius correction."""
        file = self.file
        acceleration = file.vehicle.max_turn_acceleration_deg_s2
        return PilotSettings(
            orbit=self.orbit,
            law=self.law,
            estimator=self.estimator,
            estimation=self.estimation,
            ranging=self._ranging(),
            link=LinkSettings(file.vehicle.system_id, file.link.component_id),
            autopilot=self.vehicle_key[0],
            kind=self.vehicle_key[1],
            facts=self._facts(),
            bounds=self._bounds(),
            turn_gain=None if file.vehicle.turn_gain == "learn" else file.vehicle.turn_gain,
            turn_lag=file.vehicle.turn_lag_s,
            radius_trim=file.guidance.radius_trim_per_s,
            timing=Timing(
                duration=file.limits.duration_s,
                wait_link=file.link.wait_s,
                wait_ranging=file.link.wait_s,
                stale=file.limits.stale_s,
                hold=file.limits.hold_s,
                outage=file.limits.outage_s,
                round_trip=file.limits.round_trip_s,
                tick=1 / file.limits.tick_hz,
            ),
            request_mode=file.engage.request_mode,
            end_on_takeover=file.engage.on_takeover == "end",
            max_yaw_acceleration=None if acceleration is None else radians(acceleration),
            exit=file.exit.action,
            voice=voice,
            ranging_apart=file.ranging.endpoint is not None,
            stream_links=frozenset(
                link
                for link, endpoint in ((VEHICLE, file.link.endpoint), (RANGING, file.ranging.endpoint))
                if endpoint and endpoint.startswith(("tcp", "serial"))
            ),
            unsigned_links=self._unsigned_links(),
        )

    def _unsigned_links(self) -> frozenset[str]:
        accepted = self.file.signing.accept_unsigned if self.file.signing else False
        return frozenset((RANGING,) if accepted == "ranging" else LINKS if accepted else ())

    def _ranging(self) -> RangingSettings:
        table = self.file.ranging
        return RangingSettings(
            message=table.message,
            beacon_id=table.beacon_id,
            sensor_id=table.sensor_id,
            orientation=table.orientation,
            name=table.name,
            system=table.system_id,
            component=table.component_id,
            sigma=table.sigma_m,
            min_range=table.min_range_m,
            max_range=self.max_range,
            max_age=self.file.limits.stale_s,
            height=self.file.orbit.height_above_target_m,
            sensor_stamps=table.stamp == "sensor",
            rate=table.rate_hz,
            resent=table.resent,
        )

    def _max_turn_rate(self) -> float:
        """The turn rate that the vehicle may be told, rad/s: given, or that of a coordinated turn at the bank limit."""
        vehicle = self.file.vehicle
        banked = GRAVITY * tan(radians(vehicle.max_bank_deg)) / vehicle.speed_mps if vehicle.max_bank_deg else inf
        given = radians(vehicle.max_turn_rate_deg_s) if vehicle.max_turn_rate_deg_s else inf
        return min(banked, given)

    def _facts(self) -> VehicleFacts:
        vehicle = self.file.vehicle
        loops = vehicle.loops
        return VehicleFacts(
            speed=vehicle.speed_mps,
            max_bank=radians(vehicle.max_bank_deg or 0.0),
            stick_bank=radians(vehicle.full_stick_bank_deg),
            climb_gain=vehicle.climb_gain_per_s,
            max_climb=vehicle.max_climb_mps,
            loops=AirLoops(
                trim_thrust=loops.trim_thrust,
                thrust_per_speed=loops.thrust_per_mps,
                thrust_per_bank=loops.thrust_per_bank,
                pitch_per_height=radians(loops.pitch_deg_per_m),
                pitch_per_climb=radians(loops.pitch_deg_per_mps),
                max_pitch=radians(loops.max_pitch_deg),
            ),
        )

    def _bounds(self) -> Bounds:
        table = self.file.bounds
        return Bounds(
            closest=table.min_range_m,
            farthest=table.max_range_m,
            lowest=table.min_altitude_m,
            highest=table.max_altitude_m,
            battery=table.min_battery_percent,
        )


def load_mission(path: str | Path, overrides: Iterable[str] = ()) -> Mission:
    """Read and validate a mission file with `table.key=value` overrides. Raises MissionError."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise MissionError(f"{path}: is not a text file in UTF-8") from None
    return parse_mission(text, str(path), overrides, path.parent)


def parse_mission(text: str, where: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Mission:
    """Validate the text of a mission file; `where` names it in errors. folder: from where its paths are told; they
    become absolute, so that the file as flown can be flown again from its run folder. Raises MissionError."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionError(f"{where}: not valid TOML: {error}") from None
    except RecursionError:
        raise MissionError(f"{where}: not valid TOML: nested too deeply") from None
    document = tomlkit.parse(text)
    for override in overrides:
        keys, value = _override(override)
        _put(table, keys, value, override)
        _put(document, keys, value, override)
    if folder is not None:
        _make_absolute(table, folder)
        _make_absolute(document, folder)
    return mission_of(table, where, tomlkit.dumps(document))


def mission_of(table: Mapping[str, Any], where: str, text: str = "") -> Mission:
    """Validate the parsed table of a mission file; `text` is the file as flown, where anybody keeps it. Raises
    MissionError."""
    if "mission" in table and "vary" in table:
        raise MissionError(f"{where}: is a campaign file, fly it with: circnav campaign {where}")
    try:
        file = MissionFile.model_validate(table)
    except ValidationError as error:
        raise MissionError(f"{where}: {_problems(error)}") from None
    if file.link.endpoint == SIM and file.sim is None:
        raise MissionError(f'{where}: link.endpoint: is "{SIM}", which needs a [sim] table describing the vehicle')
    if file.ranging.endpoint == SIM and file.link.endpoint != SIM:
        raise MissionError(
            f'{where}: ranging.endpoint: is "{SIM}" but the vehicle is not the bundled one: --set ranging.endpoint=URL'
        )
    if file.signing and file.signing.accept_unsigned == "ranging" and file.ranging.endpoint is None:
        raise MissionError(f'{where}: signing.accept_unsigned: is "ranging", which needs a ranging.endpoint of its own')
    _check_turning(file, where)
    mission = Mission(file, text)
    _check_numbers(mission, where)
    return mission


def _check_turning(file: MissionFile, where: str) -> None:
    """A vehicle needs a limit to its turning, and a plane one to its bank. Raises MissionError."""
    vehicle = file.vehicle
    if vehicle.kind == "plane" and vehicle.max_bank_deg is None:
        raise MissionError(f"{where}: vehicle.max_bank_deg: missing, a plane turns by banking: add its limit")
    if vehicle.max_bank_deg is None and vehicle.max_turn_rate_deg_s is None:
        raise MissionError(f"{where}: vehicle.max_turn_rate_deg_s: missing, add it")


def _check_numbers(mission: Mission, where: str) -> None:
    """What follows from the file must be a number: 1e-308 m of noise leave none. Raises MissionError."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            mission.pilot_settings()
            _ = mission.loop_lag
    except ArithmeticError as error:
        reason = str(error.args[-1]) if error.args else "no number"
        raise MissionError(
            f"{where}: speed, radius, rate or noise is too small or too large to compute with ({reason.lower()})"
        ) from None


def _override(text: str) -> tuple[list[str], Any]:
    """`orbit.radius_m=80` as keys and a TOML value; what is not TOML is taken as a string."""
    key, sign, value = text.partition("=")
    if not sign or not key.strip():
        raise MissionError(f"--set {text}: write it as table.key=value")
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        parsed = value.strip()
    return key.strip().split("."), parsed


def _put(table: Any, keys: list[str], value: Any, override: str) -> None:
    for key in keys[:-1]:
        table = table.setdefault(key, {})
        if not isinstance(table, Mapping):
            raise MissionError(f"--set {override}: {key} is a value, not a table")
    table[keys[-1]] = value


def _make_absolute(table: Any, folder: Path) -> None:
    """The key files of a mission and of its bundled vehicle: told from the folder of the file, `~` from home."""
    for place in (table, table.get("sim")):
        signing = place.get("signing") if isinstance(place, Mapping) else None
        if isinstance(signing, Mapping) and isinstance(name := signing.get("key_file"), str) and name:
            signing["key_file"] = str((folder / Path(name).expanduser()).absolute())  # type: ignore[index]


def _problems(error: ValidationError) -> str:
    """The problems in words; unknown keys first, for a misspelt key is also a missing one."""
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    missing = [_key(problem) for problem in problems if problem["type"] == "missing"]
    told = [_in_words(problem) for problem in problems if problem["type"] != "missing"]
    if missing:
        told.append(f"{', '.join(missing)}: missing, add {'it' if len(missing) == 1 else 'them'}")
    more = f"; and {len(told) - MOST_PROBLEMS} more" if len(told) > MOST_PROBLEMS else ""
    return "; ".join(told[:MOST_PROBLEMS]) + more


def _key(problem: ErrorDetails) -> str:
    return ".".join(str(part) for part in problem["loc"])


def _in_words(problem: ErrorDetails) -> str:
    place = [str(part) for part in problem["loc"]]
    key, kind, context = _key(problem), problem["type"], problem.get("ctx", {})
    given = problem.get("input")
    if kind == "extra_forbidden":
        known = _known_keys(place[:-1])
        near = get_close_matches(place[-1], known, n=1)
        return f"{key}: unknown key, " + (f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}")
    if kind == "literal_error":
        return f"{key}: {given!r} is not one of {context['expected']}"
    if kind == "model_type":
        return f"{key}: must be a table, not {given!r}"
    bound = next((f"{words} {context[name]:g}" for name, words in _BOUNDS.items() if name in context), None)
    if bound is not None and isinstance(given, int | float):
        return f"{key}: must be {bound}, not {given:g}"
    return f"{key}: {problem['msg'].lower().removeprefix('input ')}, not {given!r}{_number_meant(kind, given)}"


def _number_meant(kind: str, given: Any) -> str:
    """The remedy for a number that TOML does not know as one: .5, 1. or one in quotes."""
    if kind not in ("float_type", "int_type") or not isinstance(given, str):
        return ""
    try:
        return f": write {float(given)!r}"
    except ValueError:
        return ""


_BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def _known_keys(place: list[str]) -> list[str]:
    """The keys that a table of the schema knows."""
    model: type[BaseModel] = MissionFile
    for part in place:
        annotation = model.model_fields[part].annotation
        candidates = (annotation, *get_args(annotation))
        model = next(item for item in candidates if isinstance(item, type) and issubclass(item, BaseModel))
    return list(model.model_fields)
