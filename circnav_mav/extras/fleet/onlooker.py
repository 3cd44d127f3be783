"""Onlooker of a fleet member: sends and receives reports, and requests changes that space the fleet
evenly.

The onlooker uses the relative motion estimated by the pilot. It requests only changes of radius and
speed within narrow limits. Without reports from other members it requests nothing, and the vehicle
flies as a single vehicle.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import cos, degrees, inf, isfinite, isnan, nan, pi, sin
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.cli.exits import Refused
from circnav_mav.extras.fleet.acceptance import CLOCK_TOLERANCE
from circnav_mav.extras.fleet.carrier import FrameCarrier, UdpPort
from circnav_mav.extras.fleet.evenness import even_from, gap_error, rms
from circnav_mav.extras.fleet.law import Adjustment, OwnState, Spacing
from circnav_mav.extras.fleet.limits import spacing_settings
from circnav_mav.extras.fleet.offset import PhaseOffset, offset_by_drift, offset_by_range
from circnav_mav.extras.fleet.phase import LAP, Drift, PhaseMap, circle_angle, wrapped
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.extras.fleet.settings import FleetTable, table_of
from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.types import RelativeMotion
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.keys import KeyFileError, read_key
from circnav_mav.runtime.onlookers import Onlooker, OnlookerSettings, OtherVehicle

REQUEST_EVERY = 0.5
"""Shortest time between two requests of the circle, s."""
LEAST_OFFSET = 0.1
"""Smallest requested change of the radius, m."""
LEAST_PACE = 0.002
"""Smallest requested change of the speed, as a share of the speed."""
LAYER_SHARE = 0.5
"""Height difference, as a share of the layer distance, below which two members are in the same
layer."""
UNKNOWN_VARIANCE = 1e4
"""Variance that is reported for an unknown drift, (m/s)^2."""
COLUMNS = (
    "time,state,phase_deg,phase_sigma_deg,error_deg,offset_m,pace,present,counted,ring,"
    "compass,ranges"
)
"""Columns of fleet.csv. Three columns are lists of `id:value`. ring: phase of each member on the
circle, deg. compass: correction of each member's phase, deg. ranges: distance to each member, m."""


def layer_lines(heights: Mapping[int, float], layer: float) -> list[str]:
    """Return a line for each pair of members in the same height layer.

    heights: heights above the target by id, m.
    layer: distance of the layers, m.
    """
    known = sorted((member, height) for member, height in heights.items() if isfinite(height))
    return [
        f"fleet: members {one} and {other} are {abs(a - b):.0f} m apart in height, but the height"
        f" layers are {layer:g} m apart: change the height of one member"
        for i, (one, a) in enumerate(known)
        for other, b in known[i + 1 :]
        if abs(a - b) < LAYER_SHARE * layer
    ]


def fleet_line(found: Mapping[str, Any]) -> str:
    """Return the line of the verdict from the fleet's part of the summary."""
    even = "never evenly spaced (within 5 deg for 20 s)"
    if found["even_after_s"] is not None:
        worst = f"worst gap off by {found['worst_gap_deg']:.1f} deg rms"
        even = f"even {found['even_after_s']:.0f} s after entering the circle, {worst}"
    layer = (
        ""
        if found["nearest_layer_m"] is None
        else f", nearest in height {found['nearest_layer_m']:.0f} m"
    )
    return f"  fleet      id {found['id']}, {len(found['members'])} members, {even}{layer}"


class FleetOnlooker(Onlooker):
    """Onlooker of one fleet member."""

    name = "fleet"

    def __init__(
        self,
        mission: Mission,
        pilot: Pilot,
        table: FleetTable,
        carrier: FrameCarrier | None,
        *,
        lockstep: bool,
    ) -> None:
        """carrier: carrier of the reports, None without a fleet link.
        lockstep: True if timestamps are simulated time.
        """
        assert table.id is not None
        self.spacing = Spacing(spacing_settings(mission, table.id))
        self.carrier = carrier
        self.state = State.SEARCH
        self.adjusted: Adjustment | None = None
        self._pilot = pilot
        self._table = table
        self._lockstep = lockstep
        self._flies = mission.file.vehicle.kind != "rover"
        self._speed = mission.orbit.speed
        self._duration = mission.file.limits.duration_s
        self._started = 0.0
        self._drift: tuple[float, float] | None = None
        self._airspeed = self._speed
        self._covariance = (UNKNOWN_VARIANCE, 0.0, UNKNOWN_VARIANCE)
        self._map: PhaseMap | None = None
        self._map_at = self._stepped_at = float("-inf")
        self._requested = (0.0, 1.0)
        self._requested_at = float("-inf")
        self._own = OwnState(None, 0.0, nan)
        self._offsets: dict[int, PhaseOffset] = {}
        self._compared: dict[int, float] = {}
        """Stamp of the newest report of each member that `_offsets` has used."""
        self._over_at: float | None = None
        self._now = 0.0
        self._log = io.StringIO()
        self._gap_errors: list[tuple[float, float]] = []
        """Time, s, and largest gap error of the ring, rad, for each step with this member on the
        circle."""
        self._nearest_layer = self._nearest = inf

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """True for a short time after the end, while the departure is still reported."""
        # 1.0: time after the end for which a member still reports that it leaves, s. Some of these
        # reports may be lost.
        return self._over_at is not None and self._now - self._over_at < 1.0

    def start(self, epoch_us: int) -> None:
        self._started = 0.0 if self._lockstep else epoch_us / 1e6

    @property
    def _epoch(self) -> float:
        """Stamp of run time zero, s: UTC of the autopilot if known and configured, else of this
        computer."""
        utc = self._pilot.session.vehicle.utc.offset
        by_computer = self._lockstep or self._table.clock == "computer"
        return self._started if by_computer or utc is None else utc

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Process received reports, estimate this member's phase, and send its report."""
        self._now = now = step.time
        if self._pilot.done and self._over_at is None:
            self._over_at = now
        if self.carrier is not None:
            self.spacing.take(self.carrier.received(self._epoch + now))
        # 0.1: shortest time between two steps of the fleet law, s.
        if now - self._stepped_at < 0.1 - 1e-6:
            return ()
        dt = min(now - self._stepped_at, 1.0)
        self._stepped_at = now
        if self.spacing.sense != self._sense:
            self.spacing.sense = self._sense
            self._map = None
            self._offsets.clear()
            self.spacing.offsets.clear()
        if self._pilot.session.airspeed_refused:
            self.spacing.settings = replace(self.spacing.settings, speed_share=0.0)
        self._find_phase(now, dt)
        self._compare_phases(now)
        self.adjusted = self.spacing.step(self._epoch + now, self._own)
        self.state = self.adjusted.state
        if self.carrier is not None:
            self.carrier.send(self.report(now))
        self._judge_ring(now)
        self._note(now)
        return ()

    def take_exchanged(self) -> Sequence[bytes]:
        """Return the frames of the fleet link, for the recorder."""
        return self.carrier.take_frames() if self.carrier is not None else ()

    def circle_requests(self, now: float) -> Sequence[CircleRequest]:
        """Return the requested change of radius and speed, at most twice a second."""
        adjusted = self.adjusted
        steering = self._pilot.mission.phase is Phase.ENGAGED
        if adjusted is None or not steering or now - self._requested_at < REQUEST_EVERY:
            return ()
        offset = round(adjusted.offset, 2) + 0.0
        pace = round(adjusted.speed, 4)
        before = self._requested
        if abs(offset - before[0]) < LEAST_OFFSET and abs(pace - before[1]) < LEAST_PACE:
            return ()
        self._requested = (offset, pace)
        self._requested_at = now
        return (CircleRequest(offset=offset, pace=pace, by="fleet"),)

    def facts(self, now: float) -> Mapping[str, str]:
        adjusted = self.adjusted
        if adjusted is None:
            return {}
        present = len(self.spacing.present(self._epoch + now)) + 1
        words = (
            f"{self.state.name.lower().replace('_', ' ')}, {len(adjusted.counted)} of {present}"
            " members on the circle"
        )
        if self._own.shares_layer and self.state is State.PHASE_KNOWN:
            words += ": waits outside, the height layer is taken"
        if adjusted.error is not None and self._own.phase is not None:
            apart = sorted((phase - self._own.phase) % LAP for phase in adjusted.counted.values())
            ahead = [*apart[1:2], LAP][0]
            behind = LAP - apart[-1] if len(apart) > 1 else LAP
            words += f", gap {degrees(ahead):.0f} deg ahead, {degrees(behind):.0f} deg behind"
            words += f", radius {adjusted.offset:+.1f} m"
        return {"fleet": words}

    def vehicles(self, now: float) -> Sequence[OtherVehicle]:
        """Return the other members for the live page. Their positions follow from their phases by
        the phase map."""
        if self._map is None:
            return ()
        ring = self.spacing.phases(self._epoch + now)
        found = []
        for member, report in sorted(self.spacing.present(self._epoch + now).items()):
            words = report.state.name.lower().replace("_", " ")
            words += "" if isnan(report.height) else f", {report.height:.0f} m high"
            place = None
            if report.state is not State.SEARCH:
                angle = self._map.angle(report.phase_at(self._epoch + now))
                place = report.radius * cos(angle), self._sense * report.radius * sin(angle)
            if member in ring and self.state is State.ON_CIRCLE and self._own.phase is not None:
                words += f", {degrees((ring[member] - self._own.phase) % LAP):.0f} deg ahead"
            found.append(OtherVehicle(str(member), place, words))
        return found

    def alarms(self, now: float) -> Mapping[str, str]:
        found: dict[str, str] = {}
        if self.carrier is not None and (problems := self.carrier.alarms(self._epoch + now)):
            found["fleet_link"] = "; ".join(problems)
        if not self._pilot.mission.steering:
            return found
        present = self.spacing.present(self._epoch + now)
        heights = {member: report.height for member, report in present.items()}
        if (height := self._pilot.height(now)) is not None:
            heights[self.spacing.settings.member] = height
        # Every member of the fleet raises this alarm, not only the two in the same layer.
        if self._flies and (lines := layer_lines(heights, self._table.layer_m)):
            found["fleet_layer"] = "; ".join(lines)
        near = [
            f"fleet: member {member} is {distance:.0f} m away, limit {self._table.nearest_m:g} m:"
            " take one of the two over"
            for member, distance in self._ranges(now).items()
            if distance < self._table.nearest_m
        ]
        if near:
            found["fleet_near"] = "; ".join(near)
        return found

    def report(self, now: float) -> MemberReport:
        """Return this member's report."""
        height = self._pilot.height(now)
        drift = self._own_drift()
        return MemberReport(
            group=self._table.group,
            member=self.spacing.settings.member,
            state=self.state,
            stamp=self._epoch + now,
            phase=self._own.phase or 0.0,
            phase_sigma=min(max(self._own.phase_sigma, 1e-3), pi),
            lap_period=self._lap_period(),
            radius=self._pilot.orbit.radius,
            height=nan if height is None else height,
            sense=self._sense,
            drift=drift.mean,
            drift_covariance=drift.covariance,
        )

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        carrier = self.carrier
        time, errors = np.array(self._gap_errors).reshape(-1, 2).T
        even = even_from(time, errors, 0.0)
        worst = rms(np.degrees(errors[time >= even])) if even is not None else None
        nearest = self._nearest_layer
        members = sorted({self.spacing.settings.member, *self.spacing.known})
        summary["fleet"] = {
            "group": self._table.group,
            "id": self.spacing.settings.member,
            "members": members,
            "even_after_s": None if even is None else round(even - float(time[0]), 1),
            "worst_gap_deg": None if worst is None else round(worst, 2),
            "nearest_layer_m": round(nearest, 1) if isfinite(nearest) else None,
            "nearest_m": round(self._nearest, 1) if isfinite(self._nearest) else None,
            "trim": round(self.spacing.trim, 4),
            "link": None if carrier is None else carrier.summary(),
        }
        summary["notes"].append(fleet_line(summary["fleet"]))
        return {"fleet.csv": f"{COLUMNS}\n{self._log.getvalue()}"}

    def close(self) -> None:
        if self.carrier is not None:
            self.carrier.close()

    def _find_phase(self, now: float, dt: float) -> None:
        estimate = self._pilot.estimate if self._pilot.mission.steering else None
        relative = None if estimate is None else estimate.relative
        leaving = self._leaves(now)
        shares = self._shares_layer(now)
        if estimate is None or relative is None or not relative.trusted:
            self._own = OwnState(None, pi, nan, leaving, shares)
            return
        self._follow(relative, now, dt)
        assert self._map is not None
        phase, rate = self._map.at(circle_angle(relative.x, relative.y, self._sense))
        # The estimate is for the time of the pilot's last step. Extrapolate the phase to the
        # present time.
        phase += LAP * (now - estimate.time) / self._lap_period()
        sigma = relative.sigma / max(estimate.r, 1.0) * rate
        self._own = OwnState(phase % LAP, sigma, estimate.r, leaving, shares)

    def _follow(self, relative: RelativeMotion, now: float, dt: float) -> None:
        """Smooth the drift and the airspeed, and update the phase map every second."""
        # 10.0: time constant of the filter on the drift for the phase map, s. The filter removes
        # gusts, which do not change the lap.
        share = dt / (10.0 + dt)
        before = self._drift or (relative.drift_x, relative.drift_y)
        self._drift = (
            before[0] + share * (relative.drift_x - before[0]),
            before[1] + share * (relative.drift_y - before[1]),
        )
        self._covariance = relative.drift_covariance or (UNKNOWN_VARIANCE, 0.0, UNKNOWN_VARIANCE)
        self._airspeed += share * (relative.airspeed - self._airspeed)
        # 1.0: time between two updates of the phase map, s.
        if self._map is None or now - self._map_at >= 1.0:
            self._map = PhaseMap.of(self._airspeed, self._own_drift().mean, self._sense)
            self._map_at = now

    def _ranges(self, now: float) -> dict[int, float]:
        """Return the measured ranges to other members, m, by id."""
        first = self._table.ranging
        if first is None:
            return {}
        # 1.0: largest age of a range to a member that is used, s.
        return {
            beacon - first: distance
            for beacon, (time, distance) in self._pilot.tracker.ranging.other_beacons.items()
            if now - time < 1.0 and beacon > first
        }

    def _compare_phases(self, now: float) -> None:
        """Update the correction of every member's phase, from the member's drift and from the range
        to the member."""
        if self._own.phase is None or self._map is None:
            return
        ranges = self._ranges(now)
        for member, report in self.spacing.present(self._epoch + now).items():
            before = self._compared.get(member, report.stamp)
            self._compared[member] = report.stamp
            if report.state is State.SEARCH or report.sense != self._sense:
                continue
            found = self._offsets.setdefault(member, PhaseOffset())
            drift = Drift(report.drift, report.drift_covariance)
            seen = [offset_by_drift(self._own_drift(), drift, self._sense, self._map.at(0.0)[1])]
            if member in ranges and self.state is report.state is State.ON_CIRCLE:
                seen.append(self._offset_by_range(report, ranges[member], now))
            found.observe(seen, min(max(report.stamp - before, 0.0), 1.0))
            self.spacing.offsets[member] = found.value

    def _offset_by_range(
        self, report: MemberReport, distance: float, now: float
    ) -> tuple[float, float]:
        """Return the correction of a member's phase computed from the range to the member, and its
        sigma, rad."""
        assert self._map is not None and self._own.phase is not None
        height = self._pilot.height(now)
        if self._flies and (height is None or isnan(report.height)):
            return 0.0, inf
        phase = report.phase_at(self._epoch + now)
        return offset_by_range(
            distance,
            report.height - height if height is not None and self._flies else 0.0,
            (self._own.range, report.radius),
            self._map.angle(self._own.phase),
            wrapped(phase - self._own.phase),
            phase,
            self._map,
        )

    @property
    def _sense(self) -> int:
        """Sense of rotation of the current circle."""
        return self._pilot.orbit.direction.turn_sign

    def _own_drift(self) -> Drift:
        if self._drift is None:
            return Drift((0.0, 0.0), (UNKNOWN_VARIANCE, 0.0, UNKNOWN_VARIANCE))
        ee, en, nn = self._covariance
        return Drift(self._drift, (max(ee, 1e-6), en, max(nn, 1e-6)))

    def _lap_period(self) -> float:
        orbit = self._pilot.orbit
        if self._map is None:
            return LAP * orbit.radius / orbit.speed
        return self._map.lap_time * orbit.radius

    def _leaves(self, now: float) -> bool:
        """True if the vehicle is about to leave the circle, or the pilot no longer controls it."""
        mission = self._pilot.mission
        if mission.phase in (Phase.YIELDED, Phase.LEAVING, Phase.ENDED):
            return True
        # 15.0: time before the end of the flight at which a member reports that it leaves, s.
        return mission.engaged_at is not None and now - mission.engaged_at > self._duration - 15.0

    def _shares_layer(self, now: float) -> bool:
        """True if another member is in the same height layer and has priority: the other member is
        on the circle or has the lower id."""
        height = self._pilot.height(now)
        if height is None or not self._flies:
            return False
        return any(
            abs(report.height - height) < LAYER_SHARE * self._table.layer_m
            for member, report in self.spacing.present(self._epoch + now).items()
            if report.state is State.ON_CIRCLE or member < self.spacing.settings.member
        )

    def _judge_ring(self, now: float) -> None:
        """Store the gap error of the ring and the smallest vertical distance, for the summary."""
        assert self.adjusted is not None
        if self.state is State.ON_CIRCLE:
            self._gap_errors.append((now, gap_error(self.adjusted.counted.values())))
        height = self._pilot.height(now)
        if height is not None and self._pilot.mission.steering:
            self._nearest = min([self._nearest, *self._ranges(now).values()])
            heights = (report.height for report in self.spacing.present(self._epoch + now).values())
            self._nearest_layer = min(
                [self._nearest_layer, *(abs(other - height) for other in heights)]
            )

    def _note(self, now: float) -> None:
        own = self._own
        adjusted = self.adjusted
        assert adjusted is not None
        phase = "" if own.phase is None else f"{degrees(own.phase):.2f}"
        error = "" if adjusted.error is None else f"{degrees(adjusted.error):.2f}"
        present = len(self.spacing.present(self._epoch + now)) + 1
        ring = " ".join(
            f"{member}:{degrees(one):.1f}" for member, one in sorted(adjusted.counted.items())
        )
        compass = " ".join(
            f"{member}:{degrees(one):.2f}" for member, one in sorted(self.spacing.offsets.items())
        )
        ranges = " ".join(
            f"{member}:{one:.2f}" for member, one in sorted(self._ranges(now).items())
        )
        self._log.write(
            f"{now:.2f},{self.state.name.lower()},{phase},{degrees(own.phase_sigma):.2f},{error},"
            f"{adjusted.offset:.2f},{adjusted.speed:.4f},{present},{len(adjusted.counted)},{ring},"
            f"{compass},{ranges}\n"
        )


def _cell(values: Mapping[int, float]) -> str:
    """Return values by id as a cell of fleet.csv."""
    return " ".join(f"{member}:{value:.1f}" for member, value in sorted(values.items()))


def mission_carrier(table: FleetTable, tolerance: float = CLOCK_TOLERANCE) -> FrameCarrier:
    """Open the carrier configured in a mission, with the signing key of the fleet. tolerance:
    largest accepted difference of clocks, s. Raises Refused."""
    assert table.id is not None
    try:
        key = None if table.key_file is None else read_key(Path(table.key_file))
        port = UdpPort(table.port, table.interface, table.peers or ())
        return FrameCarrier(port, table.group, table.id, key, tolerance)
    except (LinkError, KeyFileError) as error:
        raise Refused(f"fleet: {error}") from None


def join_fleet(given: OnlookerSettings) -> FleetOnlooker:
    """Return the onlooker of a fleet member. Raises Refused.

    With the bundled vehicle, only `circnav fly --fleet` provides a carrier: a real network is
    slower than simulated time.
    """
    mission = given.mission
    table = table_of(given.mission)
    assert table.id is not None
    carrier: FrameCarrier | None = given.options.get("fleet_carrier")
    if carrier is None and not mission.flies_sim:
        from circnav_mav.extras.fleet.listening import refuse_taken

        refuse_taken(mission, table)
        carrier = mission_carrier(table)
    return FleetOnlooker(mission, given.pilot, table, carrier, lockstep=mission.flies_sim)
