"""Columns of ticks.csv, and the values that a ground station plots."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple, get_type_hints

from circnav_mav.guidance.types import Orbit, RangeEstimate, TurnCommand
from circnav_mav.mav.frames import yaw_rate_from_turn_rate
from circnav_mav.pilot.mission_state import OutputMode, Phase

_WOULD = {Phase.ENGAGED: "would steer", Phase.COASTING: "would coast"}


def phase_name(phase: Phase, output_mode: OutputMode) -> str:
    """Return the human-readable phase: "would steer" instead of "engaged" if no setpoints are
    sent."""
    return phase.value if output_mode is OutputMode.FLY else _WOULD.get(phase, phase.value)


Number = float | None
"""Number in a record, None if it is unknown or was not sent."""


class Column(NamedTuple):
    """Description of a column of ticks.csv.

    meaning: text for docs/logs.md and the schema of exports. unit: empty for a number without unit.
    """

    meaning: str
    unit: str = ""

    @property
    def description(self) -> str:
        """Meaning and unit."""
        return f"{self.meaning} ({self.unit})" if self.unit else self.meaning


@dataclass(frozen=True, slots=True, kw_only=True)
class TickRecord:
    """One step: a row of ticks.csv. None means "unknown" or "not sent".

    Turn rates are counterclockwise positive, except `yaw_rate_sent`, which is clockwise positive as
    in MAVLink.
    """

    # Each column is declared here once. Header, schema and documentation are derived from it.
    time: Annotated[float, Column("time since the run began", "s")]
    phase: Annotated[Phase, Column(", ".join(phase.value for phase in Phase))]
    measured: Annotated[Number, Column("last accepted range", "m")]
    r: Annotated[Number, Column("estimated range", "m")]
    r_dot: Annotated[Number, Column("estimated range rate, positive away from the beacon", "m/s")]
    r_sigma: Annotated[Number, Column("standard deviation of `r`", "m")]
    r_dot_sigma: Annotated[Number, Column("standard deviation of `r_dot`", "m/s")]
    nis: Annotated[
        Number,
        Column(
            "squared innovation of the range divided by its variance; a range is rejected above 25"
        ),
    ]
    demanded: Annotated[Number, Column("turn rate demanded by the law", "rad/s")]
    turn_rate: Annotated[
        Number, Column("commanded turn rate: `demanded` divided by `turn_gain`", "rad/s")
    ]
    saturated: Annotated[bool, Column("1 if `turn_rate` was reduced by the limit")]
    yaw_rate_sent: Annotated[
        Number, Column("yaw rate in the setpoint, **right positive**", "rad/s")
    ]
    turn_gain: Annotated[float, Column("estimated ratio of actual to commanded turn rate")]
    turn_delay: Annotated[float, Column("estimated delay from a turn command to the turn", "s")]
    gain_share: Annotated[float, Column("factor on the law's gains; below 1 after a limit cycle")]
    law: Annotated[
        str, Column("active law; `trial`: `auto` flies to the most likely place of the beacon")
    ]
    x: Annotated[
        Number, Column("estimated position, vehicle minus beacon, east; empty if uncertain", "m")
    ]
    y: Annotated[
        Number, Column("estimated position, vehicle minus beacon, north; empty if uncertain", "m")
    ]
    drift_x: Annotated[
        Number, Column("estimated wind minus beacon velocity, east; empty if uncertain", "m/s")
    ]
    drift_y: Annotated[
        Number, Column("estimated wind minus beacon velocity, north; empty if uncertain", "m/s")
    ]
    airspeed_scale: Annotated[
        Number, Column("estimated ratio of true to measured airspeed; empty if uncertain")
    ]
    acceleration_weight: Annotated[
        Number, Column("weight of the measured accelerations in the estimate, 0 to 1")
    ]
    heading: Annotated[Number, Column("heading of the vehicle, clockwise from north", "rad")]
    airspeed: Annotated[Number, Column("VFR_HUD.airspeed", "m/s")]
    altitude: Annotated[Number, Column("VFR_HUD.alt", "m")]
    height: Annotated[
        Number, Column("height of the vehicle above the target, used to convert slant ranges", "m")
    ]
    range_age: Annotated[Number, Column("age of the last accepted range", "s")]
    link_age: Annotated[Number, Column("age of the vehicle's last mode report", "s")]
    mode: Annotated[str, Column("flight mode of the vehicle")]
    accepted: Annotated[int, Column("number of accepted ranges so far")]
    rejected: Annotated[int, Column("number of rejected ranges so far")]
    measured_rate: Annotated[
        Number, Column("range rate of the radio, minus its estimated offset", "m/s")
    ]
    desired: Annotated[float, Column("radius of the current circle", "m")]
    direction: Annotated[str, Column("direction of the current circle")]


COLUMNS: dict[str, Column] = {
    name: kind.__metadata__[0]
    for name, kind in get_type_hints(TickRecord, include_extras=True).items()
}
"""Columns of ticks.csv, by name, in the order of the file."""


def plot_values(
    orbit: Orbit, estimate: RangeEstimate | None, command: TurnCommand | None
) -> dict[str, float]:
    """Return NAMED_VALUE_FLOAT names and values: range, range rate, error, yaw rate (clockwise
    positive)."""
    if estimate is None:
        return {}
    yaw_rate = yaw_rate_from_turn_rate(command.turn_rate) if command else 0.0
    return {
        "CN_RNG": estimate.r,
        "CN_RRATE": estimate.r_dot,
        "CN_ERR": estimate.r - orbit.radius,
        "CN_YRATE": yaw_rate,
    }
