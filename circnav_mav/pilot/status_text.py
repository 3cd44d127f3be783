"""Why a vehicle is not steered yet, in words for people."""

from collections import Counter

from circnav_mav.mav.codec import LinkCounts
from circnav_mav.mav.ranging.interface import RangingMessage, describe_rejected
from circnav_mav.mav.session import Session


def why_no_vehicle(session: Session, counts: LinkCounts) -> str:
    """Nobody that the mission means has been heard."""
    if session.up and session.told.unproven:
        return "whether this is the vehicle of before is not known until it tells its time (ATTITUDE, SYSTEM_TIME)"
    if session.misfits:
        return "; ".join(session.misfits.values())
    return f"no autopilot heartbeat, {counts.describe()}"


def why_not_ready(
    session: Session, message: RangingMessage, rejected: Counter[str], *, missing: list[str], counts: LinkCounts
) -> str:
    """Ranging, or something that the vehicle must tell (`missing`), does not come. counts: of the ranging's link."""
    if missing:
        return why_not_told(session, missing)
    refused = describe_rejected(rejected)
    return f"no ranging: no usable {message.type}, samples rejected: {refused}; {counts.describe()}{_denied(session)}"


def why_not_sure(estimator: str, accepted: int) -> str:
    """Ranges come, but do not tell enough."""
    needs = "" if estimator == "kalman" else "; before that it must see the vehicle's own motion (auto need not)"
    return f"{accepted} ranges taken, the estimator {estimator} is not sure of the range rate yet{needs}"


def why_not_told(session: Session, missing: list[str]) -> str:
    """The vehicle does not tell what it must."""
    name = session.adapter.name
    return f"no {' and no '.join(missing)} in VFR_HUD, which a {name} cannot be flown without{_denied(session)}"


def why_withheld(session: Session, *, left_mode: bool) -> str:
    """The operator has taken the vehicle over."""
    again = "entered again" if left_mode else "left and entered again"
    return f"the operator has the vehicle: {session.adapter.guided_name} {again} hands it over"


def why_slow(round_trip: float | None, most: float) -> str:
    """The link is slower than the mission allows, s, or that is not known yet."""
    if round_trip is None:
        return "how long an answer of the vehicle takes is not known yet (TIMESYNC)"
    return f"the link is slow: {round_trip:.2f} s to the vehicle and back, limits.round_trip_s allows {most:g} s"


def why_not_guided(session: Session, *, request_mode: bool) -> str:
    """Not armed, or in another mode."""
    if not session.told.armed:
        return "the vehicle is not armed"
    whose = "asked for" if request_mode else "the operator's to enter"
    return f"mode {session.adapter.guided_name}, {whose}"


def _denied(session: Session) -> str:
    denied = session.streams.refused
    return f"; the vehicle denied the streams {', '.join(denied)}" if denied else ""
