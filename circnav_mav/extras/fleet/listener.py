"""Listener of a fleet member: sends and receives reports, and requests changes that space the fleet
evenly.

The listener uses the relative motion estimated by the pilot. It requests only changes of radius and
speed within narrow limits. Without reports from other members it requests nothing, and the vehicle
flies as a single vehicle.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import cos, degrees, inf, isfinite, isnan, nan, pi, sin
from pathlib import Path
from typing import Any

from circnav_mav.cli.exits import Refused
from circnav_mav.extras.fleet.acceptance import CLOCK_TOLERANCE
from circnav_mav.extras.fleet.evenness import EVEN
from circnav_mav.extras.fleet.law import Adjustment, Spacing
from circnav_mav.extras.fleet.limits import spacing_settings
from circnav_mav.extras.fleet.link import FleetLink, Transport
from circnav_mav.extras.fleet.offset import PhaseOffset, offset_by_drift, offset_by_range
from circnav_mav.extras.fleet.own_phase import OwnPhase
from circnav_mav.extras.fleet.phase import LAP, Drift, wrapped
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.extras.fleet.ring_log import RingLog, gap_sigma
from circnav_mav.extras.fleet.settings import FleetTable, table_of
from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.keys import KeyFileError, read_key
from circnav_mav.runtime.listeners import Listener, ListenerSettings, OtherVehicle
from circnav_mav.timers import Since

LAYER_SHARE = 0.5
"""Height difference, as a share of the layer distance, below which two members are in the same
layer."""


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
    known = found["compass_deg"]
    if found["even_after_s"] is not None:
        worst = f"worst gap off by {found['worst_gap_deg']:.1f} deg rms"
        even = f"even {found['even_after_s']:.0f} s after entering the circle, {worst}"
    elif known is not None and known > degrees(EVEN):
        even = "even spacing cannot be verified"
    if known is not None:
        even += f", gap uncertainty {known:.1f} deg at the end (compass errors)"
    nearest = found["nearest_layer_m"]
    layer = "" if nearest is None else f", nearest in height {nearest:.0f} m"
    return f"  fleet      id {found['id']}, {len(found['members'])} members, {even}{layer}"


class FleetListener(Listener):
    """Listener of one fleet member."""

    name = "fleet"

    def __init__(self, mission: Mission, pilot: Pilot, link: FleetLink | None) -> None:
        """link: None without a fleet link."""
        table = table_of(mission)
        assert table.id is not None
        self.spacing = Spacing(spacing_settings(mission, table.id))
        self.link = link
        self.adjusted: Adjustment | None = None
        self._mission = mission
        self._pilot = pilot
        self._phase = OwnPhase(pilot)
        self._ring = RingLog()
        self._started = 0.0
        self._stepped_at = -inf
        self._requested = CircleRequest(offset=0.0, pace=1.0, by="fleet")
        self._since_requested = Since()
        self._over_at: float | None = None

    @property
    def state(self) -> State:
        """State of this member."""
        return State.SEARCH if self.adjusted is None else self.adjusted.state

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """True for a short time after the end, while the departure is still reported."""
        # 1.0: time after the end for which a member still reports that it leaves, s. Some of these
        # reports may be lost.
        return self._over_at is not None and self._stepped_at - self._over_at < 1.0

    def start(self, epoch_us: int) -> None:
        # The stamps of the emulated fleet are simulated time.
        self._started = 0.0 if self._mission.flies_sim else epoch_us / 1e6

    @property
    def _table(self) -> FleetTable:
        return table_of(self._mission)

    def _stamp(self, now: float) -> float:
        """Return the stamp of a time, s: UTC of the autopilot if known, else of this computer."""
        utc = self._pilot.session.vehicle.utc.offset
        return now + (self._started if self._mission.flies_sim or utc is None else utc)

    def _present(self, now: float) -> dict[int, MemberReport]:
        """Return the newest reports of the members that are not silent."""
        return self.spacing.present(self._stamp(now))

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Process received reports, estimate this member's phase, and send its report."""
        now = step.time
        stamp = self._stamp(now)
        if self._pilot.done and self._over_at is None:
            self._over_at = now
        if self.link is not None:
            self.spacing.take(self.link.received(stamp))
        # 0.1: shortest time between two steps of the fleet law, s.
        if now - self._stepped_at < 0.1 - 1e-6:
            return ()
        dt = min(now - self._stepped_at, 1.0)
        self._stepped_at = now
        if self.spacing.sense != self._phase.sense:
            self.spacing.sense = self._phase.sense
            self._phase.map = None
            self.spacing.offsets.clear()
        if self._pilot.session.airspeed_refused:
            self.spacing.settings = replace(self.spacing.settings, speed_share=0.0)
        own = self._phase.update(
            now, dt, leaving=self._leaves(now), shares_layer=self._shares_layer(now)
        )
        if own.phase is not None:
            self._compare_phases(now, own.phase, own.range)
        self.adjusted = self.spacing.step(stamp, own)
        if self.link is not None:
            self.link.send(self.report(now))
        self._record(now, self.adjusted)
        return ()

    def take_exchanged(self) -> Sequence[bytes]:
        """Return the frames of the fleet link, for the recorder."""
        return self.link.take_frames() if self.link is not None else ()

    def circle_requests(self, now: float) -> Sequence[CircleRequest]:
        """Return the requested change of radius and speed, at most twice a second."""
        adjusted = self.adjusted
        steering = self._pilot.mission.phase is Phase.ENGAGED
        if adjusted is None or not steering or self._since_requested.age(now) < 0.5:
            return ()
        offset = round(adjusted.offset, 2) + 0.0
        pace = round(adjusted.speed, 4)
        before = self._requested
        # 0.1, 0.002: smallest requested change of the radius, m, and of the speed, as a share.
        if abs(offset - (before.offset or 0.0)) < 0.1 and abs(pace - (before.pace or 1.0)) < 0.002:
            return ()
        self._requested = before._replace(offset=offset, pace=pace)
        self._since_requested.restart(now)
        return (self._requested,)

    def facts(self, now: float) -> Mapping[str, str]:
        adjusted = self.adjusted
        if adjusted is None:
            return {}
        own = adjusted.own
        words = (
            f"{self.state.words}, {len(adjusted.counted)} of {len(self._present(now)) + 1}"
            " members on the circle"
        )
        if own.shares_layer and self.state is State.PHASE_KNOWN:
            words += ": waits outside, the height layer is taken"
        if adjusted.error is not None and own.phase is not None:
            apart = sorted((phase - own.phase) % LAP for phase in adjusted.counted.values())
            ahead = [*apart[1:2], LAP][0]
            behind = LAP - apart[-1] if len(apart) > 1 else LAP
            words += f", gap {degrees(ahead):.0f} deg ahead, {degrees(behind):.0f} deg behind"
            if not isnan(sigma := gap_sigma(adjusted, self.spacing.offsets)):
                words += f", gap uncertainty {degrees(sigma):.0f} deg"
            words += f", radius {adjusted.offset:+.1f} m"
        return {"fleet": words}

    def vehicles(self, now: float) -> Sequence[OtherVehicle]:
        """Return the other members for the live page. Their positions follow from their phases by
        the phase map."""
        phases = self._phase.map
        if phases is None or self.adjusted is None:
            return ()
        stamp = self._stamp(now)
        ring = self.spacing.phases(stamp)
        own = self.adjusted.own.phase
        found = []
        for member, report in sorted(self._present(now).items()):
            words = report.state.words
            words += "" if isnan(report.height) else f", {report.height:.0f} m high"
            place = None
            if report.state is not State.SEARCH:
                angle = phases.angle(report.phase_at(stamp))
                place = report.radius * cos(angle), report.radius * self._phase.sense * sin(angle)
            if member in ring and self.state is State.ON_CIRCLE and own is not None:
                words += f", {degrees((ring[member] - own) % LAP):.0f} deg ahead"
            found.append(OtherVehicle(str(member), place, words))
        return found

    def alarms(self, now: float) -> Mapping[str, str]:
        found: dict[str, str] = {}
        if self.link is not None and (problems := self.link.alarms(self._stamp(now))):
            found["fleet_link"] = "; ".join(problems)
        if not self._pilot.mission.steering:
            return found
        # Every member of the fleet raises this alarm, not only the two in the same layer.
        heights = {member: report.height for member, report in self._present(now).items()}
        heights[self.spacing.settings.member] = self._height(now)
        if lines := layer_lines(heights, self._table.layer_m):
            found["fleet_layer"] = "; ".join(lines)
        least = self._table.nearest_m
        near = [
            f"fleet: member {member} is {distance:.0f} m away, limit {least:g} m:"
            " take one of the two over"
            for member, distance in self._ranges(now).items()
            if distance < least
        ]
        if near:
            found["fleet_near"] = "; ".join(near)
        return found

    def report(self, now: float) -> MemberReport:
        """Return this member's report."""
        own = self.adjusted.own if self.adjusted is not None else None
        return MemberReport(
            member=self.spacing.settings.member,
            state=self.state,
            stamp=self._stamp(now),
            phase=(own.phase if own is not None else None) or 0.0,
            phase_sigma=pi if own is None else min(max(own.phase_sigma, 1e-3), pi),
            lap_period=self._phase.lap_period,
            radius=self._pilot.orbit.radius,
            height=self._height(now),
            sense=self._phase.sense,
            drift=self._phase.drift.mean,
            drift_covariance=self._phase.drift.covariance,
        )

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        member = self.spacing.settings.member
        summary["fleet"] = {
            "id": member,
            "members": sorted({member, *self.spacing.known}),
            **self._ring.figures(),
            "trim": round(self.spacing.trim, 4),
            "link": None if self.link is None else self.link.summary(),
        }
        summary["notes"].append(fleet_line(summary["fleet"]))
        return {"fleet.csv": self._ring.csv}

    def close(self) -> None:
        if self.link is not None:
            self.link.close()

    def _height(self, now: float) -> float:
        """Return the height above the target, m; nan if it is unknown or the vehicle is a rover,
        which has no height layer."""
        height = self._pilot.height(now)
        is_rover = self._mission.file.vehicle.kind == "rover"
        return nan if height is None or is_rover else height

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

    def _compare_phases(self, now: float, own: float, own_range: float) -> None:
        """Update the correction of every member's phase, from the member's drift and from the range
        to the member. own: phase of this member, rad. own_range: range to the target, m."""
        phases = self._phase.map
        assert phases is not None
        ranges = self._ranges(now)
        for member, report in self._present(now).items():
            if report.state is State.SEARCH or report.sense != self._phase.sense:
                continue
            found = self.spacing.offsets.setdefault(member, PhaseOffset(report.stamp))
            drift = Drift(report.drift, report.drift_covariance)
            seen = [offset_by_drift(self._phase.drift, drift, report.sense, phases)]
            # nan: the height of a rover. Rovers are all at one height.
            above = report.height - self._height(now)
            is_rover = self._mission.file.vehicle.kind == "rover"
            on_circle = self.state is report.state is State.ON_CIRCLE
            if member in ranges and on_circle and (is_rover or isfinite(above)):
                phase = report.phase_at(self._stamp(now))
                seen.append(
                    offset_by_range(
                        ranges[member],
                        0.0 if is_rover else above,
                        (own_range, report.radius),
                        phases.angle(own),
                        wrapped(phase - own),
                        phase,
                        phases,
                    )
                )
            found.observe(seen, report.stamp)

    def _leaves(self, now: float) -> bool:
        """True if the vehicle is about to leave the circle, or the pilot no longer controls it."""
        mission = self._pilot.mission
        if mission.phase in (Phase.YIELDED, Phase.LEAVING, Phase.ENDED):
            return True
        # 15.0: time before the end of the flight at which a member reports that it leaves, s.
        lasts = self._mission.file.limits.duration_s - 15.0
        return mission.engaged_at is not None and now - mission.engaged_at > lasts

    def _shares_layer(self, now: float) -> bool:
        """True if another member is in the same height layer and has priority: the other member is
        on the circle or has the lower id."""
        height = self._height(now)
        return any(
            abs(report.height - height) < LAYER_SHARE * self._table.layer_m
            for member, report in self._present(now).items()
            if report.state is State.ON_CIRCLE or member < self.spacing.settings.member
        )

    def _record(self, now: float, adjusted: Adjustment) -> None:
        """Record the step for fleet.csv and the summary."""
        present = self._present(now)
        ranges = self._ranges(now)
        if self._pilot.mission.steering:
            height = self._height(now)
            heights = [abs(report.height - height) for report in present.values()]
            self._ring.apart(heights, list(ranges.values()))
        self._ring.step(now, adjusted, len(present) + 1, self.spacing.offsets, ranges)


def mission_link(table: FleetTable, tolerance: float = CLOCK_TOLERANCE) -> FleetLink:
    """Open the link configured in a mission, with the signing key of the fleet. tolerance: largest
    accepted difference of clocks, s. Raises Refused."""
    assert table.id is not None
    try:
        key = None if table.key_file is None else read_key(Path(table.key_file))
        transport = Transport(table.port, table.interface, table.peers or ())
        return FleetLink(transport, table.id, key, tolerance)
    except (LinkError, KeyFileError) as error:
        raise Refused(f"fleet: {error}") from None


def join_fleet(given: ListenerSettings) -> FleetListener:
    """Return the listener of a fleet member. Raises Refused.

    With the bundled vehicle, only `circnav fly --fleet` provides a link: a real network is slower
    than simulated time.
    """
    mission = given.mission
    link: FleetLink | None = given.options.get("fleet_link")
    if link is None and not mission.flies_sim:
        from circnav_mav.extras.fleet.listening import refuse_taken

        table = table_of(mission)
        refuse_taken(mission, table)
        link = mission_link(table)
    return FleetListener(mission, given.pilot, link)
