"""Figures of a fleet from its true tracks: evenness in time, separation, radius."""

from dataclasses import asdict, dataclass
from itertools import combinations
from math import inf
from typing import Any

import numpy as np

from circnav_mav.extras.fleet.evenness import Array, even_from, gap_error, rms
from circnav_mav.extras.fleet.flight import Tracks
from circnav_mav.extras.fleet.phase import LAP, PhaseMap
from circnav_mav.extras.fleet.report import State

NEAR_ABOVE = 10.0
"""Vertical distance below which two members are too near each other, m, if they are also within
NEAR_BESIDE."""
NEAR_BESIDE = 25.0
"""Horizontal distance below which two members are too near each other, m, if they are also within
NEAR_ABOVE."""


@dataclass(frozen=True, slots=True)
class FleetFigures:
    """Figures of one fleet.

    all_on_circle_s: time from the start until every member flew on the circle.
    even_after_s: time from then to the start of the first 20 s with all gap errors within 5 deg.
    worst_gap_deg: RMS of the worst gap error after the fleet became even. If the fleet never became
        even, over the last third of the time on the circle.
    radius_rms_m: RMS radius error of all members over the same time.
    smallest_horizontal_m, smallest_vertical_m: smallest distances of any two members.
    too_near: number of pairs that were within 10 m vertically and 25 m horizontally.
    """

    members: int
    all_on_circle_s: float | None
    even_after_s: float | None
    worst_gap_deg: float | None
    radius_rms_m: float | None
    smallest_horizontal_m: float | None
    smallest_vertical_m: float | None
    too_near: int

    def plain(self) -> dict[str, Any]:
        """Return the figures for fleet.json."""
        return {
            name: round(value, 2) if isinstance(value, float) else value
            for name, value in asdict(self).items()
        }


def true_phases(tracks: Tracks) -> Array:
    """Return the true temporal phase of every member at every sample, rad."""
    east, north = np.array(tracks.east), np.array(tracks.north)
    angle = np.arctan2(tracks.sense * north, east) % LAP
    phases: Array = np.empty_like(angle)
    phase_map = None
    mapped = (inf, inf)
    for i, drift in enumerate(tracks.drift):
        # 0.5: change of the true drift, m/s, after which the map of the phase is computed again.
        if phase_map is None or np.hypot(drift[0] - mapped[0], drift[1] - mapped[1]) > 0.5:
            phase_map = PhaseMap.of(tracks.speed, drift, tracks.sense)
            mapped = drift
        phases[i] = [phase_map.at(one)[0] for one in angle[i]]
    return phases


def gap_errors(tracks: Tracks) -> Array:
    """Return the largest gap error of the members on the circle at every sample, rad; nan for fewer
    than two."""
    pairs = zip(true_phases(tracks), tracks.state, strict=True)
    rings = (phases[[state is State.ON_CIRCLE for state in states]] for phases, states in pairs)
    found: Array = np.array([gap_error(ring.tolist()) for ring in rings])
    return found


def figures(tracks: Tracks) -> FleetFigures:
    """Return the figures of a fleet."""
    states = np.array([[int(state) for state in row] for row in tracks.state]).reshape(
        len(tracks.time), -1
    )
    whole = (states == State.ON_CIRCLE).all(axis=1)
    first = int(np.argmax(whole)) if whole.any() else None
    errors = gap_errors(tracks)
    time = np.array(tracks.time)
    began = None if first is None else tracks.time[first]
    even = None if began is None else even_from(time, errors, began)
    radius = np.hypot(np.array(tracks.east), np.array(tracks.north))
    after = np.flatnonzero(whole) if even is None else np.flatnonzero(whole & (time >= even))
    late = after if even is not None else after[len(after) * 2 // 3 :]
    horizontal, vertical, near = _separation(tracks)
    return FleetFigures(
        members=states.shape[1],
        all_on_circle_s=began,
        even_after_s=None if even is None or began is None else even - began,
        worst_gap_deg=rms(np.degrees(errors[late])),
        radius_rms_m=rms(radius[late] - tracks.radius),
        smallest_horizontal_m=horizontal,
        smallest_vertical_m=vertical,
        too_near=near,
    )


def _separation(tracks: Tracks) -> tuple[float | None, float | None, int]:
    """Return the smallest horizontal and vertical distance of two steered members, m, and the
    number of pairs that were too near each other."""
    places = np.array([tracks.east, tracks.north, tracks.height])
    flying = np.array(tracks.flying)
    beside = []
    above = []
    near = 0
    for i, j in combinations(range(len(tracks.flying and tracks.flying[0])), 2):
        east, north, up = (places[:, :, i] - places[:, :, j])[:, flying[:, i] & flying[:, j]]
        if len(up):
            flat = np.hypot(east, north)
            beside.append(float(flat.min()))
            above.append(float(np.abs(up).min()))
            near += bool(((flat < NEAR_BESIDE) & (np.abs(up) < NEAR_ABOVE)).any())
    return min(beside, default=None), min(above, default=None), near
