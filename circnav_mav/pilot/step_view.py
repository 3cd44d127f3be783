"""The frozen step: read by record, conditions, display and live page."""

from collections.abc import Mapping
from dataclasses import dataclass

from circnav_mav.guidance.monitors import AirspeedAlarm, ClosingAlarm, DriftAlarm, LapAlarm
from circnav_mav.guidance.types import Orbit
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.mission_state import STEERING, Outcome, OutputMode, Phase
from circnav_mav.pilot.rates import Rates
from circnav_mav.pilot.record import TickRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class StepView(TickRecord):
    """One step: the columns of ticks.csv, and the state of `Pilot` that is not recorded. Texts are
    human-readable, and empty if they do not apply."""

    settings: Mission
    output_mode: OutputMode

    # mission
    engaged_at: float | None
    """Time of the first engagement, s."""
    outcome: Outcome | None
    coast: float
    """Longest time in the phase COASTING, s."""
    waits: str
    """Reason why the vehicle is not steered."""
    not_airborne: str
    """Condition that must be met before an aircraft is steered, while circnav waits for it."""
    exit_name: str
    """Exit action that the vehicle can perform now."""

    # link
    vehicle: str
    """Autopilot and firmware."""
    trusted: str
    """Trusted vehicle and radio, with their addresses."""
    second_senders: tuple[str, ...]
    """One line per identity that a second sender uses."""
    second_controller: str
    """Evidence that another program steers the vehicle."""
    flood: float
    """Total of the dropped data of unknown senders, kB, 0 while no data are dropped."""
    uplink_silent: bool
    """True if the vehicle does not answer TIMESYNC."""
    stalled: float
    """Length of a gap between two steps, s, for some seconds after it, else 0."""
    clock_speed: float | None
    """Autopilot seconds per second of our clock, None while the two clocks agree."""

    # counts
    setpoints: int
    rejected_by: Mapping[str, int]
    """Rejected ranges by reason, the most frequent reason first."""
    rates: Rates | None
    """Newest rates, None before and after the flight."""
    full_rates: Rates | None
    """Newest rates, None until they cover `RATE_SPAN`."""
    steered_rates: Rates | None
    """Newest rates, None until the vehicle was steered for `RATE_SPAN`."""

    # ranges
    one_way: float
    """Least one-way delay of ranges on the vehicle's link, s."""
    frozen_for: float
    """Time for which the sensor has repeated its value, s, 0 if it is not frozen."""
    jumped_by: float
    """Jump of the rejected ranges, m, or 0."""
    noise_found: tuple[float, float] | None
    """Reported and measured standard deviation of the ranges, m, if the reported value was too
    small."""
    noise_lowered: tuple[float, float] | None
    """Reported and used standard deviation of the ranges, m, if the reported value was too
    large."""
    range_rate_trouble: str
    """Reason why range rates are not used."""
    sensor_clock_doubted: bool
    source_choice: str
    """Text with the mission key that selects one of several range sources."""

    # motion
    lost_reports: tuple[str, ...]
    """Telemetry that is missing or too rare."""
    failed_imu: str
    """Message of the first IMU if its accelerometer has failed, else empty."""
    used_imu: str
    """Message of the IMU in use, empty if no accelerations are received."""
    heading_jump: float
    """Sum of the heading jumps that are not treated as turns, rad."""
    height_held: bool
    """True if the height is held because no altitude is received."""
    altitude_jump: float
    """Sum of the altitude jumps that are not applied to the height, m, or 0."""
    implausible_airspeed: float | None
    """Measured airspeed that is ignored, m/s."""
    unchecked_bound: str
    """Bound of the mission that cannot be checked, and the missing telemetry."""
    method_failure: str | None
    """None before a change of the steering method. Then the reason why the vehicle refused the
    mode of this method, or an empty string."""
    drift_alarm: DriftAlarm
    airspeed_alarm: AirspeedAlarm
    closing_alarm: ClosingAlarm
    lap_alarm: LapAlarm

    # steering
    circle: Orbit
    """Circle of the mission, or of the newest accepted request."""
    flown_law: str
    """Law that `auto` or `drift` flies now."""
    why: str
    """Reason for this law."""
    follows: bool
    """True if the vehicle follows turn commands."""
    speed: float
    """Commanded speed, m/s."""
    lean_share: float
    """Share of the mission's speed that the lean limit allows."""
    lean_limit: float
    """Lean limit found in flight, rad."""
    bank_limit: float
    """Bank limit found in flight, rad, 90 deg while unknown."""

    @property
    def flies(self) -> bool:
        """True if setpoints are sent."""
        return self.output_mode is OutputMode.FLY

    @property
    def steering(self) -> bool:
        """True if the vehicle is steered."""
        return self.phase in STEERING

    @property
    def done(self) -> bool:
        """True if the mission is over."""
        return self.phase is Phase.ENDED
