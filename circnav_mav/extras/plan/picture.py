"""Picture of a plan: the circles at scale, and the expected figures over the radius."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from circnav_mav.extras.plan.candidates import Candidate, Site
from circnav_mav.report.plots import DESIRED, ESTIMATE, LIMIT, MEASURED, STYLE, TRUE, literal, save


def plot_plan(
    path: Path, found: Sequence[Candidate], best: Candidate, site: Site, title: str
) -> None:
    """Draw the circles of the recommended speed and write a PNG. Raises OSError."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 5.5), layout="constrained")
        figure.suptitle(literal(title))
        grid = figure.add_gridspec(3, 2, width_ratios=[1.1, 1])
        found = [one for one in found if one.speed == best.speed]
        _draw_circles(figure.add_subplot(grid[:, 0]), found, best)

        def values(name: str) -> NDArray[Any]:
            return np.array([getattr(one, name) for one in found], float)

        radius = values("radius")
        wind, error, bank = [figure.add_subplot(grid[row, 1]) for row in range(3)]
        winds = values("most_wind")
        if not np.isnan(winds).any():
            wind.plot(radius, winds, "o-", color=ESTIMATE, label="largest flyable wind, m/s")
            wind.axhline(site.strongest, ls=":", color=LIMIT, label="wind and gusts of the site")
        wind.plot(radius, values("lap"), "s-", color=TRUE, label="lap, s")
        error.plot(radius, values("rms"), "o-", color=ESTIMATE, label="radius RMS, m")
        error.plot(radius, values("place"), "s-", color=TRUE, label="beacon's place, m")
        used = 100 * values("used")
        bank.plot(radius, used, "o-", color=ESTIMATE, label="turn rate used, %")
        if best.bank is not None:
            bank.plot(radius, values("bank"), "s-", color=TRUE, label="bank, deg")
        for axis in (wind, error, bank):
            axis.axvline(best.radius, color=DESIRED, lw=1.5, alpha=0.6)
            axis.set_ylim(
                0.0, 1.08 * axis.get_ylim()[1]
            )  # leave room for the marker of the largest value
            axis.legend(loc="best", fontsize=8)
        bank.set_xlabel("radius, m")
        save(figure, path)


def _draw_circles(axes: Any, found: Sequence[Candidate], best: Candidate) -> None:
    """Draw the circles at scale, the recommended one last."""
    angle = np.linspace(0, 2 * np.pi, 361)
    for one in sorted(found, key=lambda one: one is best):
        color, width = (DESIRED, 2.5) if one is best else (MEASURED if one.sound else TRUE, 1.0)
        axes.plot(one.radius * np.cos(angle), one.radius * np.sin(angle), color=color, lw=width)
        axes.annotate(
            f"{one.radius:g} m",
            (0.0, one.radius),
            ha="center",
            va="bottom",
            fontsize=8,
            color=color,
        )
    axes.plot(0, 0, "k+", ms=12, mew=2)
    for color, words in (
        (DESIRED, "recommended"),
        (MEASURED, "passes"),
        (TRUE, "with warnings"),
    ):
        axes.plot([], [], color=color, label=words)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east of the beacon, m", ylabel="north, m")
    axes.legend(loc="upper right", fontsize=8)
