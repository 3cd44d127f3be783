"""What a person sees while flying: a live panel on a terminal, one plain line a second elsewhere."""

from math import degrees, hypot

from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.table import Table

from circnav_mav.core.phases import Phase
from circnav_mav.mav.frames import compass_from_vector
from circnav_mav.pilot import Pilot, TickRecord

STYLES = {Phase.ENGAGED: "green", Phase.HOLDING: "yellow", Phase.YIELDED: "magenta", Phase.LEAVING: "cyan"}


class PlainDisplay:
    """One line a second of real time."""

    def __init__(self, console: Console, period: float) -> None:
        """period: seconds of the run's clock between two lines."""
        self._console = console
        self._period = period
        self._due = 0.0

    def show(self, pilot: Pilot, newest: TickRecord | None, now: float) -> None:
        """Print a line when one is due."""
        if newest is None or now < self._due:
            return
        self._due = now + self._period
        self._console.print(one_line(newest, pilot.settings.orbit.radius), highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Nothing to put back."""


class LiveDisplay:
    """A panel that is drawn anew four times a second."""

    def __init__(self, console: Console, period: float, title: str) -> None:
        """period: seconds of the run's clock between two drawings."""
        self._period = period
        self._title = title
        self._due = 0.0
        self._live = Live(console=console, auto_refresh=False)
        self._live.start()

    def show(self, pilot: Pilot, newest: TickRecord | None, now: float) -> None:
        """Draw when due."""
        if newest is None or (now < self._due and not pilot.done):
            return
        self._due = now + self._period
        self._live.update(self._panel(pilot, newest), refresh=True)

    def close(self) -> None:
        """Leave the last picture standing."""
        self._live.stop()

    def _panel(self, pilot: Pilot, tick: TickRecord) -> Panel:
        table = Table.grid(padding=(0, 2))
        radius, limit = pilot.settings.orbit.radius, pilot.settings.orbit.max_turn_rate
        style = STYLES.get(tick.phase, "white")
        rows = (
            ("phase", f"[bold {style}]{tick.phase.value}[/]   vehicle mode {tick.mode}   law {tick.law or '-'}"),
            ("target", _target(tick)),
            ("range", f"{_metres(tick.r)}   wanted {radius:.1f} m   error {_error(tick, radius)}"),
            ("range rate", "-" if tick.r_dot is None else f"{tick.r_dot:+.2f} m/s +- {tick.r_dot_sigma:.2f}"),
            (
                "turn rate",
                f"{_turn(tick)}   limit +-{degrees(limit):.1f} deg/s{'   SATURATED' if tick.saturated else ''}",
            ),
            ("turn gain", f"{tick.turn_gain:.2f} realised over commanded"),
            ("ages", f"range {_seconds(tick.range_age)}   link {_seconds(tick.link_age)}"),
            ("samples", f"{tick.accepted} taken, {tick.rejected} rejected   {pilot.setpoints_sent} setpoints sent"),
        )
        for name, value in rows:
            table.add_row(f"[dim]{name}[/]", value)
        return Panel(table, title=f"{self._title}   t = {tick.time:.1f} s", border_style=style, width=78)


def one_line(tick: TickRecord, radius: float) -> str:
    """A tick as a line of text."""
    rate = "-" if tick.r_dot is None else f"{tick.r_dot:+6.2f} m/s"
    return (
        f"{tick.time:7.1f} s  {tick.phase.value:<20}  range {_metres(tick.r):>9}  error {_error(tick, radius):>9}  "
        f"rate {rate:>10}  turn {_turn(tick):>11}  range age {_seconds(tick.range_age)}  "
        f"link age {_seconds(tick.link_age)}  mode {tick.mode}"
    )


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"


def _error(tick: TickRecord, radius: float) -> str:
    return "-" if tick.r is None else f"{tick.r - radius:+.2f} m"


def _target(tick: TickRecord) -> str:
    """Bearing to the target and drift, clockwise from north, where they are known."""
    if tick.x is None or tick.y is None or tick.drift_x is None or tick.drift_y is None:
        return "direction not known"
    bearing = degrees(compass_from_vector(-tick.x, -tick.y))
    towards = degrees(compass_from_vector(tick.drift_x, tick.drift_y))
    return (
        f"bearing {bearing:03.0f} deg   drift {hypot(tick.drift_x, tick.drift_y):.1f} m/s towards {towards:03.0f} deg"
    )


def _turn(tick: TickRecord) -> str:
    return "-" if tick.turn_rate is None else f"{degrees(tick.turn_rate):+.1f} deg/s"
