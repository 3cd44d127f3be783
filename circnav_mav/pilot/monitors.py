"""Monitors of a flight. In each step, each monitor looks at one thing, and returns the events that
change the phase and the outcomes that end the flight.

`Pilot.step` applies them in the order of `monitors_of`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from pymavlink.dialects.v20.all import MAV_SEVERITY_WARNING

from circnav_mav.mav.clocks import UNANSWERED
from circnav_mav.mav.session import LOST_AFTER
from circnav_mav.mav.vehicle_state import Change
from circnav_mav.pilot.authority import unwatched
from circnav_mav.pilot.conditions import NOT_FOLLOWING
from circnav_mav.pilot.method import MethodMonitor
from circnav_mav.pilot.mission_state import Ending, Event, Outcome, Phase
from circnav_mav.pilot.status_text import height_differs, overdue
from circnav_mav.timers import Since

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot

Findings = Iterable[Event | Outcome]
Monitor = Callable[["Pilot", float], Findings]


def link(pilot: Pilot, now: float) -> Findings:
    """Change the phase when the link is established or lost."""
    session = pilot.session
    if not session.up:
        return ()
    if session.heartbeat_age(now) > LOST_AFTER:
        session.lose()
        return (Event.LINK_LOST,)
    if not session.vehicle.unproven:
        return (Event.LINK_UP,)
    # While the vehicle's identity is unconfirmed, treat the link as lost. In LEAVING, keep waiting
    # so that the exit action can still be sent.
    return () if pilot.mission.phase is Phase.LEAVING else (Event.LINK_LOST,)


def takeover(pilot: Pilot, now: float) -> Findings:
    """Stop sending setpoints in the same step in which a takeover is detected."""
    changes = pilot.session.take_changes()
    found = pilot.authority.watch_takeover(changes, now)
    if Change.REBOOTED in changes:
        pilot.tracker.estimator.reset()
    if found is None:
        return ()
    pilot.session.drop_mode_requests()
    pilot.controller.disengage()
    pilot.tracker.ranging.sender_stays = False
    # In LEAVING, the change of mode is the exit action taking effect.
    if pilot.mission.outcome is not None:
        return (Event.MODE_LEFT,)
    text, outcome = found
    pilot.session.announcer.say("yield", text, severity=MAV_SEVERITY_WARNING)
    ends = pilot.settings.file.engage.on_takeover == "end"
    return (Event.MODE_LEFT, outcome) if ends else (Event.MODE_LEFT,)


def time_limits(pilot: Pilot, now: float) -> Findings:
    """End the flight after its duration, or if a time limit has passed."""
    outcome = overdue(pilot, now)
    return () if outcome is None else (outcome,)


def estimate(pilot: Pilot, now: float) -> Findings:
    """Predict the range for this step, after the monitors that may change the estimator."""
    pilot.tracker.estimate = pilot.tracker.estimator.at(now)
    return ()


def ground(pilot: Pilot, now: float) -> Findings:
    """End the flight if a steered aircraft lands or flies too low."""
    if pilot.airborne.step(now):
        # On the ground and in the take-off a plane does not fly along its nose at its measured
        # airspeed. The estimator had learned an airspeed scale of 0.87 from this motion.
        pilot.tracker.estimator.reset()
    if not (pilot.mission.steering and pilot.flies and (why := pilot.airborne.grounded(now))):
        return ()
    pilot.exit_action.low = True
    return (Outcome(Ending.ABORTED, why),)


def companion(pilot: Pilot, now: float) -> Findings:
    """End the flight if another companion uses our MAVLink ids."""
    if not pilot.session.doubled:
        return ()
    ids = f"{pilot.session.encoder.system}/{pilot.settings.file.link.component_id}"
    reason = (
        f"another companion sends with our ids {ids}: change link.component_id on one of the two"
        " companions"
    )
    return (Outcome(Ending.ABORTED, reason),)


class Bounds:
    """End the flight if a bound of the mission is violated while steering. A bound that is violated
    before the engagement prevents it."""

    def __init__(self) -> None:
        self._checked = Since()
        """Since the newest step in which all bounds could be checked."""

    def __call__(self, pilot: Pilot, now: float) -> Findings:
        broken = _broken_bound(pilot, now)
        pilot.authority.broken_bound = broken
        unchecked = unwatched(pilot.settings, pilot.session, now)
        if not unchecked:
            self._checked.restart(now)
        # The values of the bounds may be missing for as long as ranges.
        elif self._checked.age(now) >= pilot.mission.coast and broken is None:
            broken = f"bound not checked for {pilot.mission.coast:g} s: {unchecked}"
        if broken is None or not pilot.mission.steering:
            return ()
        return (Outcome(Ending.ABORTED, broken),)


def _broken_bound(pilot: Pilot, now: float) -> str | None:
    """Return a description of the first violated bound, or None. Unknown values violate no
    bound."""
    session = pilot.session
    bounds = pilot.settings.file.bounds
    estimate = pilot.tracker.estimate
    r = estimate.r if estimate and pilot.mission.phase is not Phase.COASTING else None
    altitude = session.motion.at(now).altitude
    battery = session.vehicle.battery(now)
    limits = (
        (r, bounds.min_range_m, -1, "range {:.1f} m is nearer than {:.1f} m"),
        (r, pilot.settings.farthest, 1, "range {:.1f} m is farther than {:.1f} m"),
        (altitude, bounds.min_altitude_m, -1, "altitude {:.1f} m is below {:.1f} m"),
        (altitude, bounds.max_altitude_m, 1, "altitude {:.1f} m is above {:.1f} m"),
        (battery, bounds.min_battery_percent, -1, "battery {:.0f} % is below {:.0f} %"),
    )
    for value, bound, side, words in limits:
        if value is not None and bound is not None and side * (value - bound) > 0:
            return words.format(value, bound)
    return None


class Following:
    """End the flight if the vehicle has not followed turn commands for too long, unless it keeps
    its circle. A vehicle with badly tuned steering may follow commands poorly and still keep its
    circle."""

    def __init__(self) -> None:
        self._since_unanswered = Since()
        """Since the newest step in which answers to TIMESYNC were missing."""
        self._since_circling = Since()
        """Since the newest step in which the vehicle kept its circle (`_keeps_circle`)."""

    def __call__(self, pilot: Pilot, now: float) -> Findings:
        vehicle = pilot.controller.vehicle
        command_following = vehicle.command_following
        most = pilot.settings.file.limits.not_following_s
        # A vehicle that does not receive setpoints cannot follow them. Such an outage of the uplink
        # must not end the flight: while answers to TIMESYNC are missing, do not judge the turns.
        # After the outage start the judgment again, because a plane that flies straight back to the
        # circle needs time to show that it follows.
        if pilot.session.timesync.silent(now, UNANSWERED):
            self._since_unanswered.restart(now)
        # 3.0: time, s, from the first TIMESYNC answer after an outage of the uplink until the turns
        # are judged again.
        if self._since_unanswered.age(now) < 3.0:
            vehicle.judge_again()
            pilot.conditions.forget(NOT_FOLLOWING)
        if _keeps_circle(pilot):
            self._since_circling.restart(now)
        not_following = min(now - command_following.since, self._since_circling.age(now))
        if command_following.follows or not_following <= most or not pilot.mission.steering:
            return ()
        reason = (
            "vehicle did not follow turn commands, and did not turn along its circle for"
            f" {most:g} s: check steering and compass"
        )
        return (Outcome(Ending.ABORTED, reason),)


def _keeps_circle(pilot: Pilot) -> bool:
    """True if the vehicle is near its circle, and turns in the circle's direction at more than a
    third of the circle's turn rate. In wind, the turn rate varies along the circle."""
    circle = pilot.controller.orbit
    estimate = pilot.tracker.estimate
    if estimate is None or abs(estimate.r - circle.radius) > 0.1 * circle.radius:
        return False
    turn = circle.direction.turn_sign * pilot.controller.vehicle.command_gain.rate
    return turn > circle.speed / circle.radius / 3


def ranging(pilot: Pilot, now: float) -> Findings:
    """Change the phase when ranges may steer, and when they may not."""
    phase = pilot.mission.phase
    good = pilot.tracker.good(now, coasting=phase is Phase.COASTING)
    if phase is Phase.WAIT_RANGING and pilot.session.missing(now):
        return ()
    return (Event.RANGE_GOOD if good else Event.RANGE_LOST,)


def engagement(pilot: Pilot, now: float) -> Findings:
    """Engage the vehicle when no obstacle is left. Request the guided mode if only the mode is
    missing."""
    phase = pilot.mission.phase
    authority = pilot.authority
    # While the vehicle is steered, obstacles are not checked: a slow link or a landing does not end
    # the flight.
    if pilot.mission.steering or phase is Phase.LEAVING or not authority.certain:
        return ()
    # A dry run always engages.
    engages = not pilot.flies or not authority.obstacle(now)
    if not engages or phase not in (Phase.YIELDED, Phase.READY):
        failure = authority.ask_for_mode(now)
        return () if failure is None else (Outcome(Ending.ABORTED, failure),)
    if phase is Phase.READY:
        _begin(pilot, now)
    return (Event.MODE_OURS,)


def _begin(pilot: Pilot, now: float) -> None:
    """Prepare the parts of `Pilot` for steering."""
    session = pilot.session
    pilot.tracker.ranging.sender_stays = pilot.flies
    session.identity.stays |= pilot.flies
    if pilot.flies:  # a dry run may begin on the ground, far from the mission's height
        pilot.tracker.height.engage()
        if words := height_differs(pilot, now):
            session.announcer.say("height", words)
    session.drop_mode_requests()
    how = "engaged" if pilot.flies else "dry run"
    session.announcer.say("engage", f"{how}, {pilot.controller.circle.label}")


def monitors_of(method: MethodMonitor) -> tuple[Monitor, ...]:
    """Return the monitors of a flight, in their order."""
    before = (link, takeover, method, time_limits)
    after = (ground, companion, Bounds(), Following(), ranging, engagement)
    return (*before, estimate, *after)
