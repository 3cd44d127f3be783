"""Texts for the operator: the condition that a mission waits for, and the reason why the mission
ends."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from circnav_mav.mav.ranging.interface import Reject, describe_rejected
from circnav_mav.pilot.authority import denied, unreported
from circnav_mav.pilot.mission_state import Ending, Outcome, Phase
from circnav_mav.pilot.range_tracker import FRESH

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot

_NEEDS = {
    "auto": "",
    "kalman": "",
    "measured": "; it also needs the range rate (ranging.rate_name)",
}


def waits_for(pilot: Pilot, now: float) -> str:
    """Return the reason why the vehicle is not steered now, or an empty string."""
    phase = pilot.mission.phase
    if phase is Phase.WAIT_LINK:
        rejected = pilot.session.identity.second_senders.recent(now) if pilot.mission.begun else ()
        until = "until the rejected one reports its time since boot as expected"
        return "; ".join(f"{line} {until}" for line in rejected) or _no_vehicle(pilot)
    if phase is Phase.WAIT_RANGING:
        return _not_ready(pilot, now)
    return pilot.authority.obstacle(now) if phase in (Phase.READY, Phase.YIELDED) else ""


def overdue(pilot: Pilot, now: float) -> Outcome | None:
    """Return the outcome if the duration or a time limit of the mission has passed, else None."""
    mission = pilot.mission
    limits = pilot.settings.file.limits
    waited = now - mission.since
    if mission.engaged_at is not None and now - mission.engaged_at >= limits.duration_s:
        if mission.steering:
            flown = "flown" if pilot.flies else "dry run"
            return Outcome(Ending.COMPLETED, f"{flown} to its end")
        return Outcome(
            Ending.ABORTED,
            f"time ran out while {mission.phase.value}{_age_of_lost_data(pilot, now)}",
        )
    if mission.phase is Phase.COASTING and waited > mission.coast:
        return Outcome(Ending.ABORTED, _why_coasting(pilot, now))
    if mission.lost_at is not None and now - mission.lost_at > limits.outage:
        return Outcome(Ending.ABORTED, f"no vehicle or no ranging for {limits.outage:.0f} s")
    if mission.begun or mission.started is None:
        return None
    return _nothing_received(pilot, now - mission.started, waited, now)


def _nothing_received(pilot: Pilot, run: float, waited: float, now: float) -> Outcome | None:
    """Return the outcome if vehicle or ranging were not received in time. run, waited: time since
    the first step and since the beginning of the phase, s."""
    phase = pilot.mission.phase
    wait = pilot.settings.file.link.wait_s
    if phase is Phase.WAIT_LINK and run > wait:
        return Outcome(Ending.NOTHING_RECEIVED, f"no vehicle: {_no_vehicle(pilot)}")
    if phase is Phase.WAIT_RANGING and waited > wait:
        return Outcome(Ending.NOTHING_RECEIVED, _not_ready(pilot, now))
    return None


def height_differs(pilot: Pilot, now: float) -> str:
    """Return a text if the height above the place of arming is far from the assumed height above
    the target, else an empty string. The radio measures the slant range: with another height, the
    circle has another radius."""
    given = pilot.settings.file.orbit.height_above_target_m
    assumed = pilot.height(now)
    found = pilot.airborne.height(now) if pilot.session.adapter.flies else None
    if given is None or assumed is None or found is None:
        return ""
    # 0.2: largest difference without a text, as a share of the assumed height.
    if abs(found - assumed) <= 0.2 * abs(assumed):
        return ""
    squared = pilot.controller.circle.radius**2 + assumed**2 - found**2
    radius = f"{sqrt(squared):.0f} m" if squared > 0 else "0 m, directly above it,"
    return (
        f"engaged {found:.0f} m above the place of arming, orbit.height_above_target_m ="
        f" {assumed:g}: the true radius is {radius} if the beacon is as high as that place"
    )


# --- missing data


def _no_vehicle(pilot: Pilot) -> str:
    """Return a text about why no vehicle of the mission was found."""
    session = pilot.session
    if session.up and session.vehicle.unproven:
        return "the vehicle's identity is not confirmed: no boot time yet (ATTITUDE, SYSTEM_TIME)"
    return pilot.connection.no_vehicle


def _not_ready(pilot: Pilot, now: float) -> str:
    """Return a text about missing ranging or missing required telemetry."""
    tracker = pilot.tracker
    ready = tracker.estimator.ready
    if missing := unreported(pilot.session, now):
        return missing if ready else _no_ranging(pilot, now)
    if unknown := tracker.height.why_unknown(now):
        return unknown
    age = tracker.age(now)
    # A user-defined estimator may reject all ranges until it receives the vehicle's motion. A
    # hovering copter reports no motion before the engagement, which waits for the estimator.
    gated = tracker.ranging.rejected[Reject.GATED.value] if age is None else 0
    received_any = gated or (age is not None and age <= pilot.settings.stale)
    if not ready and received_any:
        name = pilot.settings.estimator
        needs = _NEEDS.get(
            name, "; this estimator first needs the vehicle's motion (estimator auto does not)"
        )
        counted = f"{gated} ranges gated" if gated else f"{tracker.accepted} ranges accepted"
        return f"{counted}, estimator {name} has not converged yet{needs}"
    return _no_ranging(pilot, now)


def _no_ranging(pilot: Pilot, now: float) -> str:
    """Return a text about ranges that are missing, or not used yet."""
    connection = pilot.connection
    sources = pilot.tracker.ranging.sources
    if choice := sources.choice(now):
        return choice
    if pilot.tracker.estimator.ready and not sources.listened(now):
        return "checking for a second range source"
    rejected = pilot.tracker.ranging.rejected
    received = connection.counts[connection.ranging_link].describe()
    others = f"; {found}" if (found := sources.others(now)) else ""
    words = f"rejected: {describe_rejected(rejected)}; {received}{denied(pilot.session)}{others}"
    return f"no ranging: no usable {connection.ranging_message.type}, {words}"


# --- lost data


def _why_coasting(pilot: Pilot, now: float) -> str:
    """Return the reason why no range could be used while coasting."""
    tracker = pilot.tracker
    waited = now - pilot.mission.since
    age = tracker.age(now)
    if tracker.estimator.ready and age is not None and FRESH * pilot.settings.stale < age < waited:
        return f"no fresh range for {waited:.1f} s, the newest is {age:.2f} s old"
    if tracker.ranging.clock.doubted:
        return f"no range for {waited:.1f} s: all ranges rejected, the sensor clock stepped"
    if tracker.one_way > pilot.settings.stale:
        return (
            f"no range for {waited:.1f} s: all ranges rejected, the round trip takes"
            f" {2 * tracker.one_way:.1f} s"
        )
    if jump := tracker.jumps.found:
        return f"no range for {waited:.1f} s: all ranges rejected, they jumped by {jump:+.0f} m"
    # the same number as in the alarm RANGE STALE
    return f"no range for {waited if age is None else age:.1f} s"


def _age_of_lost_data(pilot: Pilot, now: float) -> str:
    """Return the age of the lost data, as text, if the mission waits for the link or for ranges.
    Otherwise return an empty string."""
    if pilot.mission.phase is Phase.WAIT_LINK:
        return f", no heartbeat for {pilot.session.heartbeat_age(now):.0f} s"
    age = pilot.tracker.age(now) if pilot.mission.phase is Phase.WAIT_RANGING else None
    return "" if age is None else f", no range for {age:.0f} s"
