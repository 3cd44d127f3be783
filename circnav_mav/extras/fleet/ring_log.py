"""Record of the members on the circle, from the reports that one member receives: fleet.csv, and
the figures in summary.json."""

import io
from collections.abc import Mapping
from math import degrees, inf, isfinite, nan
from typing import Any

import numpy as np

from circnav_mav.extras.fleet.evenness import even_from, gap_error, rms
from circnav_mav.extras.fleet.law import Adjustment
from circnav_mav.extras.fleet.offset import PhaseOffset
from circnav_mav.extras.fleet.report import State

COLUMNS = (
    "time,state,phase_deg,phase_sigma_deg,error_deg,offset_m,pace,present,counted,ring,"
    "compass,ranges"
)
"""Columns of fleet.csv. Three columns are lists of `id:value`. ring: phase of each member on the
circle, deg. compass: correction of each member's phase, deg. ranges: distance to each member, m."""


class RingLog:
    """Rows of fleet.csv, gap errors over time, and the smallest distances to other members, m."""

    def __init__(self) -> None:
        self._rows = io.StringIO()
        self._gaps: list[tuple[float, float, float]] = []
        """Time, s, largest gap error, rad, and its standard deviation, rad, of each step with this
        member on the circle. The gaps are those of the exchanged phases. Compass errors cause the
        deviation."""
        self._nearest_layer = inf
        self._nearest = inf

    @property
    def csv(self) -> str:
        """Contents of fleet.csv."""
        return f"{COLUMNS}\n{self._rows.getvalue()}"

    def apart(self, heights: list[float], ranges: list[float]) -> None:
        """Record the distances to other members, m: in height, and measured."""
        self._nearest_layer = min([self._nearest_layer, *filter(isfinite, heights)])
        self._nearest = min([self._nearest, *ranges])

    def step(
        self,
        now: float,
        adjusted: Adjustment,
        present: int,
        offsets: Mapping[int, PhaseOffset],
        ranges: Mapping[int, float],
    ) -> None:
        """Record a step. present: number of members that send reports."""
        own = adjusted.own
        if adjusted.state is State.ON_CIRCLE:
            error = gap_error(adjusted.counted.values())
            self._gaps.append((now, error, gap_sigma(adjusted, offsets)))
        ring = {member: degrees(one) for member, one in adjusted.counted.items()}
        compass = {member: degrees(one.value) for member, one in offsets.items()}
        cells = [
            f"{now:.2f}",
            adjusted.state.name.lower(),
            "" if own.phase is None else f"{degrees(own.phase):.2f}",
            f"{degrees(own.phase_sigma):.2f}",
            "" if adjusted.error is None else f"{degrees(adjusted.error):.2f}",
            f"{adjusted.offset:.2f}",
            f"{adjusted.speed:.4f}",
            str(present),
            str(len(ring)),
            *map(_cell, (ring, compass, ranges)),
        ]
        self._rows.write(",".join(cells) + "\n")

    def figures(self) -> dict[str, Any]:
        """Return the figures for summary.json."""
        time, errors, sigmas = np.array(self._gaps).reshape(-1, 3).T
        # Compass errors can hide a gap error: add their standard deviation to it, so that the
        # figures do not report a better evenness than is certain.
        errors = np.hypot(errors, sigmas)
        even = even_from(time, errors, 0.0)
        late = errors[time >= (inf if even is None else even)]
        known = sigmas[np.isfinite(sigmas)]
        return {
            "even_after_s": None if even is None else _rounded(even - time[0]),
            "worst_gap_deg": _rounded(rms(np.degrees(late))),
            "compass_deg": _rounded(degrees([nan, *known][-1])),
            "nearest_layer_m": _rounded(self._nearest_layer),
            "nearest_m": _rounded(self._nearest),
        }


def gap_sigma(adjusted: Adjustment, offsets: Mapping[int, PhaseOffset]) -> float:
    """Return the largest standard deviation of the gaps that compass errors cause, rad; nan without
    other members on the circle."""
    return max((offsets[one].sigma for one in adjusted.counted if one in offsets), default=nan)


def _rounded(value: float | None) -> float | None:
    """Return a figure for summary.json, None if it is unknown."""
    return None if value is None or not isfinite(value) else round(float(value), 1)


def _cell(values: Mapping[int, float]) -> str:
    """Return values by id as a cell of fleet.csv."""
    return " ".join(f"{member}:{value:.2f}" for member, value in sorted(values.items()))
