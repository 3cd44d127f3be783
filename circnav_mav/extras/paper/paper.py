"""The paper's three examples, flown from many starts in its ideal world, with its proven properties
checked.

In this world the vehicle turns exactly as the law commands, without noise, lag or MAVLink.

Arrays over steps and starts; SI, radians, the paper's frame (x right, y up, angles
counter-clockwise).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from circnav_mav.guidance import laws
from circnav_mav.guidance.laws import LAWS
from circnav_mav.report.plots import COLUMN, PAPER, save
from circnav_mav.runlog import many_flights

Batch = NDArray[Any]
"""Array over starts, or over steps and starts."""
V = 1.0
"""Speed of the vehicle in the paper's examples (units of the paper)."""
TARGET = (0.0, -10.0)
"""Position of the target in the paper's examples."""
R_D = 10.0
"""Desired radius in the paper's examples."""
SECONDS = 200.0
"""Duration of a flight, s. It is longer than any flight of the paper needs to settle."""
MIRRORED = 40
"""Number of starts that are also flown mirrored, to check that a law with negative gain flies the
other sense of rotation."""
STEP = 0.02
"""Step of the simulation with a constant turn rate, s: a 500th of r_d/V."""


@dataclass(frozen=True, slots=True)
class Starts:
    """Position and heading of each start."""

    x: Batch
    y: Batch
    heading: Batch

    def mirrored(self, count: int) -> "Starts":
        """Return the first `count` starts, reflected in the vertical line through the target."""
        return Starts(2 * TARGET[0] - self.x[:count], self.y[:count], np.pi - self.heading[:count])

    def only(self, number: int) -> "Starts":
        """Return one start."""
        one = slice(number, number + 1)
        return Starts(self.x[one], self.y[one], self.heading[one])


@dataclass(frozen=True, slots=True)
class Tracks:
    """Recorded flights.

    time: (steps,), s.
    x, y, r: position and range (steps, starts).
    theta_b: angle from the line of sight to the heading (steps, starts), in [0, 2 pi); see `polar`.
    """

    time: Batch
    x: Batch
    y: Batch
    r: Batch
    theta_b: Batch


def random_starts(count: int, seed: int) -> Starts:
    """Return random starts as in the paper: uniform in [0, 10] x [0, 10] x [0, 2 pi)."""
    x, y, heading = np.random.default_rng(seed).uniform(size=(3, count))
    return Starts(10 * x, 10 * y, 2 * np.pi * heading)


def fly(starts: Starts, law: Callable[[Batch, Batch], Any], seconds: float) -> Tracks:
    """Fly all starts. law(range, range rate): turn rate.

    Each step is an exact arc with the law's turn rate at its midpoint (second order).
    """
    steps = round(seconds / STEP)
    tracks = Tracks(
        np.linspace(0, steps * STEP, steps + 1),
        *(np.empty((steps + 1, len(starts.x))) for _ in range(4)),
    )
    x = starts.x
    y = starts.y
    heading = starts.heading
    for step in range(steps + 1):
        r, theta_b = polar(x, y, heading)
        tracks.x[step], tracks.y[step], tracks.r[step], tracks.theta_b[step] = x, y, r, theta_b
        omega = law(r, -V * np.cos(theta_b))
        r, theta_b = polar(*arc(x, y, heading, V, omega, STEP / 2))
        x, y, heading = arc(x, y, heading, V, law(r, -V * np.cos(theta_b)), STEP)
    return tracks


def polar(x: Batch, y: Batch, heading: Batch) -> tuple[Batch, Batch]:
    """Return range and theta_b, the angle from the line of sight to the heading,
    counter-clockwise."""
    to_x = TARGET[0] - x
    to_y = TARGET[1] - y
    return np.hypot(to_x, to_y), np.mod(heading - np.arctan2(to_y, to_x), 2 * np.pi)


def arc(
    x: Batch, y: Batch, heading: Batch, V: float, omega: Batch, step: float
) -> tuple[Batch, Batch, Batch]:
    """Return position and heading after a turn at constant rate."""
    turn = omega * step
    length = V * step * np.sinc(turn / (2 * np.pi))
    middle = heading + turn / 2
    return x + length * np.cos(middle), y + length * np.sin(middle), heading + turn


def lyapunov(r: Batch, theta_b: Batch, *, r_d: float, r_a: float, k: float) -> Batch:
    """Return the paper's Lyapunov function of its law 1 (`smooth`), for r >= r_d, with the integral
    in closed form.

    The function is 1 - sin(theta_b) + integral from r_a to r of (-1/z + 2 k z cos asin(r_d/z)) dz.

    r_a: radius on which the vehicle settles.
    """

    def integral(z: Batch) -> Batch:
        root = np.sqrt(np.maximum(z**2 - r_d**2, 0.0))
        return np.asarray(k * (z * root - r_d**2 * np.log(z + root)) - np.log(z))

    return 1 - np.sin(theta_b) + integral(r) - integral(np.asarray(r_a))


@dataclass(frozen=True, slots=True)
class Example:
    """One example of the paper.

    law: name of the law in mission files.
    k: gain.
    fed: radius given to the law, which may differ from the desired one.
    """

    number: int
    law: str
    k: float
    fed: float

    @property
    def predicted(self) -> float:
        """Radius on which the vehicle settles according to theory."""
        return LAWS[self.law].reached_radius(V, self.fed, self.k)

    def fly(self, starts: Starts, seconds: float, sign: int = 1) -> Tracks:
        """Fly all starts with this law, or with its mirror image (sign -1)."""
        law = partial(LAWS[self.law].function, V=V, r_d=self.fed, k=sign * self.k)
        return fly(starts, np.vectorize(law, otypes=[float]), seconds)


EXAMPLES = (
    Example(1, "smooth", 0.01, R_D),
    Example(2, "smooth", 0.01, laws.corrected_radius(R_D, 0.01)),
    Example(3, "switching", 0.12, R_D),
)


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of an example.

    reached: smallest and largest final radius of all starts.
    settling: time to the band round the predicted radius for each start, s (inf: never).
    outside: for each start, True if the track stays outside the circle (r >= r_d).
    clockwise: number of starts that end clockwise.
    most_entries: largest number of entries into the circle of a track.
    bearings: smallest and largest final theta_b, rad.
    rise: largest rise of the Lyapunov function in a step; None if the paper gives no function.
    mirror: largest distance between the track of a mirrored start and the mirror image of the
        original track.
    mirrored_counterclockwise: number of mirrored starts that end counter-clockwise.
    """

    example: Example
    starts: int
    reached: tuple[float, float]
    settling: Batch
    outside: Batch
    clockwise: int
    most_entries: int
    bearings: tuple[float, float]
    rise: float | None
    mirror: float
    mirrored_counterclockwise: int


def study(example: Example, starts: Starts, seconds: float = SECONDS) -> tuple[Findings, Tracks]:
    """Fly one example from all starts and evaluate every track."""
    tracks = example.fly(starts, seconds)
    last = tracks.r[-len(tracks.time) // 5 :].mean(axis=0)
    mirror = example.fly(starts.mirrored(MIRRORED), seconds, sign=-1)
    apart = np.hypot(
        mirror.x + tracks.x[:, :MIRRORED] - 2 * TARGET[0], mirror.y - tracks.y[:, :MIRRORED]
    )
    # 0.05: largest distance of a settled flight from the predicted radius, as a fraction of r_d.
    findings = Findings(
        example,
        len(starts.x),
        (float(last.min()), float(last.max())),
        many_flights.last_exit(tracks.time, tracks.r, example.predicted, 0.05 * R_D),
        outside=entries(tracks.r, example.fed) == 0,
        clockwise=int((turning(tracks) < 0).sum()),
        most_entries=int(entries(tracks.r, example.fed).max()),
        bearings=(float(tracks.theta_b[-1].min()), float(tracks.theta_b[-1].max())),
        rise=lyapunov_rise(example, tracks),
        mirror=float(apart.max()),
        mirrored_counterclockwise=int((turning(mirror) > 0).sum()),
    )
    return findings, tracks


def shown_start(found: list[Findings]) -> int:
    """Return the number of the first start that shows the statements of the paper about its first
    example: r >= r_d, and the smooth law settles before the switching one. 0 if no start does."""
    smooth, *_, switching = found
    return int((smooth.outside & (smooth.settling < switching.settling)).argmax())


def turning(tracks: Tracks) -> Batch:
    """Return the angle swept round the target over the last tenth of the flight, rad,
    counter-clockwise positive."""
    tail = slice(-len(tracks.time) // 10, None)
    return np.asarray(
        many_flights.swept(np.arctan2(tracks.y[tail] - TARGET[1], tracks.x[tail] - TARGET[0]))
    )


def entries(r: Batch, r_d: float) -> Batch:
    """Return the number of entries of each track into the circle. A lemma of the paper allows at
    most one. A start inside the circle is one entry."""
    # 1e-3: depth inside the circle that is not yet an entry, as a fraction of r_d. The switching
    # law chatters by V STEP.
    inside = r < r_d * (1 - 1e-3)
    return np.asarray(inside[0] + (inside[1:] & ~inside[:-1]).sum(axis=0))


def lyapunov_rise(example: Example, tracks: Tracks) -> float | None:
    """Return the largest rise of the Lyapunov function between two steps with r >= r_d and theta_b
    in [0, pi].

    None if the paper gives no function.
    """
    if example.law != "smooth":
        return None
    holds = (tracks.r >= example.fed) & (tracks.theta_b <= np.pi)
    values = lyapunov(
        np.maximum(tracks.r, example.fed),
        tracks.theta_b,
        r_d=example.fed,
        r_a=example.predicted,
        k=example.k,
    )
    return float(np.diff(values, axis=0)[holds[1:] & holds[:-1]].max())


def draw(folder: Path, example: Example, start: Starts, form: str = "png") -> list[Path]:
    """Draw the two figures of an example in the paper's form, from one start. Raises OSError."""
    tracks = example.fly(start, 120.0)
    paths = [folder / f"example_{example.number}_{kind}.{form}" for kind in ("track", "error")]
    with mpl.rc_context(PAPER):
        figure = Figure(figsize=(COLUMN, COLUMN), layout="constrained")
        axis = figure.subplots()
        angle = np.linspace(0, 2 * np.pi, 361)
        circle = TARGET[0] + R_D * np.cos(angle), TARGET[1] + R_D * np.sin(angle)
        axis.plot(*circle, "k--", lw=1.0, zorder=3, label="desired")
        axis.plot(tracks.x, tracks.y, color="#5b9bd5", lw=1.5, label="UAV")
        axis.plot(tracks.x[0], tracks.y[0], "^", color="#d55e00", ms=7, label="start")
        axis.plot(*TARGET, "k*", ms=7, label="target")
        axis.set_aspect("equal", adjustable="datalim")
        axis.set(xlabel="x, m", ylabel="y, m")
        axis.set_title(_title(example), fontsize=8)
        figure.legend(loc="outside lower center", ncols=4, frameon=False)
        save(figure, paths[0], dpi=200)
        figure = Figure(figsize=(COLUMN, 2.4), layout="constrained")
        axis = figure.subplots()
        axis.plot(tracks.time, tracks.r - R_D, color="#1f5fa8", lw=1.0)
        axis.axhline(0, color="black", lw=0.8)
        axis.set(xlabel="time, s", ylabel="$r - r_d$, m", xlim=(0, 120))
        axis.set_title(_title(example), fontsize=8)
        save(figure, paths[1], dpi=200)
    return paths


def _settling(times: Batch) -> str:
    known = times[np.isfinite(times)]
    if not len(known):
        return "never"
    return f"{np.median(known):.0f} / {np.quantile(known, 0.95):.0f} / {known.max():.0f} s"


ROWS: dict[str, Callable[[Findings], str]] = {
    "law, k, law radius": lambda f: f"{f.example.law}, {f.example.k:g}, {f.example.fed:.5f} m",
    "starts": lambda f: str(f.starts),
    "predicted radius": lambda f: f"{f.example.predicted:.5f} m",
    "reached radius, least to most": lambda f: f"{f.reached[0]:.5f} to {f.reached[1]:.5f} m",
    "settled: predicted radius ±5 % of r_d": lambda f: (
        f"{np.isfinite(f.settling).sum()} of {f.starts}"
    ),
    "settling, median / 95 % / worst": lambda f: _settling(f.settling),
    "r >= law radius at all times": lambda f: f"{f.outside.sum()} of {f.starts}",
    "clockwise": lambda f: f"{f.clockwise} of {f.starts}",
    "enters the circle at most": lambda f: (
        f"{f.most_entries} time{'' if f.most_entries == 1 else 's'}"
    ),
    "theta_b at the end (theory: pi/2)": lambda f: (
        f"{f.bearings[0]:.4f} to {f.bearings[1]:.4f} rad"
    ),
    "largest rise of the Lyapunov function": lambda f: "-" if f.rise is None else f"{f.rise:.1e}",
    "k < 0: mirrored track differs by": lambda f: f"{f.mirror:.1e} m",
    "k < 0: counter-clockwise": lambda f: (
        f"{f.mirrored_counterclockwise} of {min(MIRRORED, f.starts)}"
    ),
}
"""Rows of the table: text of the results of an example, by the name of the row."""


def table(found: list[Findings]) -> str:
    """Return predictions and results as a Markdown table."""
    lines = [
        ["", *(f"example {one.example.number}" for one in found)],
        ["---"] * (len(found) + 1),
        *([name, *map(text, found)] for name, text in ROWS.items()),
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |"
        for line in lines
    )


def _title(example: Example) -> str:
    return (
        f"Example {example.number}: {example.law}, k = {example.k:g}"
        f" {LAWS[example.law].gain_unit}, law radius {example.fed:.4g} m"
    )
