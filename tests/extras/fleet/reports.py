"""Reports of members that fly on one circle, for tests of the fleet link."""

from dataclasses import replace
from math import tau

from circnav_mav.extras.fleet.frames import COMPONENT, to_message
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.signing import Signing

NOON = 1_790_000_000.0
"""Unix time at which tests begin, s."""
LAP = 41.9
KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))


def report(member: int, stamp: float, **changes) -> MemberReport:
    """Return the report of a member at a time. Members are evenly spaced by 60 deg."""
    made = MemberReport(
        member=member,
        state=State.ON_CIRCLE,
        stamp=stamp,
        phase=(member * tau / 6 + (stamp - NOON) * tau / LAP) % tau,
        phase_sigma=0.05,
        lap_period=LAP,
        radius=100.0,
        height=60.0,
        sense=1,
        drift=(3.0, -1.5),
        drift_covariance=(0.2, 0.01, 0.3),
    )
    return replace(made, **changes)


def frame(one: MemberReport, key: bytes | None = None) -> bytes:
    """Return the frame of a report as its sender encodes it."""
    signing = None if key is None else Signing(key, link_id=1)
    if signing is not None:
        signing.advance(one.stamp)
    return Encoder(one.member, COMPONENT, signing).encode(to_message(one))
