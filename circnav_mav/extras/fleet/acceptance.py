"""Acceptance of frames from the fleet link, without sockets and without a clock.

A datagram is accepted if it is one complete report of another member of the fleet. The report
must be authentic, new, finite and within bounds. Its timestamp must agree with this member's own
clock, and its phase with the sender's earlier reports. Rejections are counted by reason. Repeated
rejections raise an alarm for the operator.
"""

from collections import Counter, deque
from collections.abc import Hashable
from dataclasses import dataclass
from enum import Enum
from math import hypot, inf, isfinite, isnan, pi, remainder, tau

from circnav_mav.extras.fleet.frames import MESSAGE, from_message, is_report
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.identity import MOVES_AFTER, address_text
from circnav_mav.mav.signing import is_signed, is_signed_with

CLOCK_TOLERANCE = 0.5
"""Largest difference between a report's timestamp and this member's own clock, s. The delay of the
network is part of this difference."""
MOST_MEMBERS = 32
"""Largest number of other members that are accepted at a time."""
PHASE_RATE_TOLERANCE = 0.1
"""Growth rate of the phase tolerance, rad/s, between two reports that were both sent on the circle.
There, only changes of the commanded radius change the phase rate."""
CONFIRMED_AFTER = 2.0
"""Time, s, for which a phase must be consistent after a jump before it is accepted."""
ALARM_COUNT = 3
"""Number of rejections for one reason within ALARM_TIME that raises an alarm. Single rejections are
normal: a lossy network repeats and reorders frames."""
ALARM_TIME = 5.0
"""Time, s, within which ALARM_COUNT rejections raise an alarm. The alarm lasts for the same time
after them."""
_ROUNDING = 1e-6
"""Relative tolerance of the bounds: fields are rounded to 32 bits."""

MAX_DRIFT = 100.0
"""Largest drift in a report, per axis, m/s. Chosen: beyond any flight."""
MAX_VARIANCE = 1e4
"""Largest variance of the drift in a report, (m/s)^2. Chosen: beyond any flight."""
BOUNDS: dict[str, tuple[float, float]] = {
    "phase": (0.0, tau),
    "phase_sigma": (1e-6, 10.0),
    "lap_period": (1.0, 3600.0),
    "radius": (1.0, 10_000.0),
    "height": (-1000.0, 10_000.0),
    "drift east": (-MAX_DRIFT, MAX_DRIFT),
    "drift north": (-MAX_DRIFT, MAX_DRIFT),
    "drift variance east": (1e-9, MAX_VARIANCE),
    "drift covariance": (-MAX_VARIANCE, MAX_VARIANCE),
    "drift variance north": (1e-9, MAX_VARIANCE),
}
"""Smallest and largest value of each number in a report, SI units. An unknown height is nan."""


class Rejection(Enum):
    """Reason for rejecting a datagram. The value is the text of the alarm, with the remedy or the
    effect. Reasons with an empty value raise no alarm."""

    MALFORMED = "frames are not complete MAVLink 2 reports: give each program its own port"
    OTHER_MESSAGE = ""
    LINK = "reports are not sent, or not received"
    UNSIGNED = "frames are not signed: give every member the key of the fleet"
    WRONG_KEY = "frames are signed with another key: give every member the same key file"
    REPLAYED = "frames are repeated or late, and are ignored"
    NOT_FINITE = "a number is not finite"
    OUT_OF_BOUNDS = "a number is out of bounds"
    CLOCKS_DISAGREE = "clocks disagree, or frames are late: synchronize the clocks of all members"
    SAME_ID = "two members have the same id: give each member its own id"
    PHASE_JUMP = (
        "a phase jumps: the member's estimate is wrong, or another program sends as this member"
    )
    TOO_OFTEN = "a member sends more than 10 reports a second"
    TABLE_FULL = "the fleet has more members than its limit"
    FLOOD = "network flood: frames are lost"


class RejectedError(Exception):
    """A datagram was rejected. The message has the offending values."""

    def __init__(self, reason: Rejection, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


def check_numbers(report: MemberReport) -> None:
    """Raise RejectedError if a number of a report is not finite or out of bounds."""
    ee, en, nn = report.drift_covariance
    height = 0.0 if isnan(report.height) else report.height
    numbers = (report.phase, report.phase_sigma, report.lap_period, report.radius, height)
    values = (*numbers, *report.drift, ee, en, nn)
    for (name, (least, greatest)), value in zip(BOUNDS.items(), values, strict=True):
        if not isfinite(value):
            raise RejectedError(Rejection.NOT_FINITE, f"{name} {value}")
        if not least - _ROUNDING * abs(least) <= value <= greatest * (1 + _ROUNDING):
            raise RejectedError(
                Rejection.OUT_OF_BOUNDS, f"{name} {value:g}, not {least:g} to {greatest:g}"
            )
    if en**2 > ee * nn * (1 + _ROUNDING):
        raise RejectedError(
            Rejection.OUT_OF_BOUNDS, f"drift covariance {en:g} with variances {ee:g} and {nn:g}"
        )


def phase_error(before: MemberReport, report: MemberReport) -> float:
    """Return the distance of a phase from the extrapolated phase of an earlier report, rad, 0 to
    pi."""
    return abs(remainder(report.phase - before.phase_at(report.stamp), tau))


def phase_tolerance(before: MemberReport, report: MemberReport) -> float:
    """Return the largest plausible distance of a phase from its extrapolation, rad; infinite if a
    phase is unknown."""
    if State.SEARCH in (before.state, report.state):
        return inf
    # On the circle the phase grows at its nominal rate, except for changes of the radius. During
    # the approach and the departure, the bearing may be constant or turn at twice the rate.
    on_circle = before.state is State.ON_CIRCLE and report.state is State.ON_CIRCLE
    rate = PHASE_RATE_TOLERANCE if on_circle else max(tau / report.lap_period, PHASE_RATE_TOLERANCE)
    sigmas = 3 * hypot(before.phase_sigma, report.phase_sigma)
    # 0.35: tolerance between a phase and its extrapolation, rad, in addition to three standard
    # deviations.
    return 0.35 + sigmas + rate * (report.stamp - before.stamp)


@dataclass(slots=True)
class Member:
    """Accepted state of another member.

    report: newest accepted report.
    address: address of the sender.
    received_at: Unix time of reception, s.
    jumped: first and newest report after a jump of the member's phase.
    """

    report: MemberReport
    address: Hashable
    received_at: float
    jumped: tuple[MemberReport, MemberReport] | None = None


class Acceptance:
    """Decides on every datagram of the fleet link, and keeps a bounded table of the members."""

    def __init__(
        self,
        member: int,
        key: bytes | None = None,
        *,
        tolerance: float = CLOCK_TOLERANCE,
    ) -> None:
        """member: id of this member.
        key: signing key of the fleet, None for unsigned frames.
        tolerance: largest difference between a stamp and this member's clock, s.
        """
        self.members: dict[int, Member] = {}
        self.rejected: Counter[Rejection] = Counter()
        self.accepted = self.copies = 0
        self._member = member
        self._key = key
        self._tolerance = tolerance
        self._newest = -inf
        self._decoder = Decoder(wanted={MESSAGE})
        self._seen: dict[bytes, float] = {}
        self._recent: dict[Rejection, deque[tuple[str, float]]] = {}
        """Details and times of the newest rejections, s, by reason."""

    def remember(self, frame: bytes, now: float) -> None:
        """Store a frame, to recognize its copies."""
        self._seen[frame] = now
        # 16_384: number of newest frames that are stored to recognize copies. They cover 13 s of
        # 255 members at 5 Hz, or 18 min of 3 members.
        if len(self._seen) > 16_384:
            del self._seen[next(iter(self._seen))]

    def take(self, data: bytes, address: Hashable, now: float) -> MemberReport | None:
        """Return the report in a datagram, None if it is rejected. now: Unix time, s."""
        # After this member's clock was set back, new reports look older than the stored ones.
        # Discard the stored ones.
        if now < self._newest - 1.0:
            self.members.clear()
        self._newest = now
        try:
            return self._take(data, address, now)
        except RejectedError as rejected:
            self.note(rejected.reason, f"{rejected}, from {address_text(address)}", now)
            return None

    def note(self, reason: Rejection, detail: str, now: float) -> None:
        """Count a rejection."""
        self.rejected[reason] += 1
        self._recent.setdefault(reason, deque(maxlen=ALARM_COUNT)).append((detail, now))

    def alarms(self, now: float) -> list[str]:
        """Return a line for each reason with repeated rejections in the last ALARM_TIME."""
        lines = []
        for reason, noted in self._recent.items():
            needed = 1 if reason in (Rejection.FLOOD, Rejection.LINK) else ALARM_COUNT
            # abs(): after the clock was set back, old times lie in the future.
            recent = [detail for detail, time in noted if abs(now - time) <= ALARM_TIME]
            if reason.value and len(recent) >= needed:
                lines.append(f"fleet link: {reason.value} ({recent[-1]})")
        return lines

    def _take(self, data: bytes, address: Hashable, now: float) -> MemberReport | None:
        messages = self._decoder.decode(data)
        if self._decoder.frames != [data]:
            raise RejectedError(Rejection.MALFORMED, f"{len(data)} bytes")
        # Copies arrive by multicast loopback, by a mesh, or by a second route.
        if data in self._seen:
            age = now - self._seen[data]
            if age > CLOCK_TOLERANCE:
                raise RejectedError(
                    Rejection.REPLAYED, f"id {data[5]}, copy of a frame of {age:.1f} s ago"
                )
            self.copies += 1
            return None
        # MAVLink's rule of increasing timestamps is not applied: it locks out a member whose clock
        # was ahead once. The stamp in the report protects from replayed frames.
        if self._key is not None and not is_signed(data):
            raise RejectedError(Rejection.UNSIGNED, f"id {data[5]}")
        if self._key is not None and not is_signed_with(self._key, data):
            raise RejectedError(Rejection.WRONG_KEY, f"id {data[5]}")
        report = _report(messages)
        self.remember(data, now)
        check_numbers(report)
        self._check_time(report, now)
        if report.member == self._member:
            words = f"another sender has this member's id {self._member}"
            raise RejectedError(Rejection.SAME_ID, words)
        self._check_member(report, address, now)
        self.members[report.member] = Member(report, address, now)
        self.accepted += 1
        return report

    def _check_time(self, report: MemberReport, now: float) -> None:
        known = self.members.get(report.member)
        is_new = known is None or report.stamp > known.report.stamp
        ahead = report.stamp - now
        if abs(ahead) > self._tolerance:
            reason = Rejection.CLOCKS_DISAGREE if is_new else Rejection.REPLAYED
            raise RejectedError(
                reason,
                f"id {report.member} is {abs(ahead):.1f} s {'ahead' if ahead > 0 else 'behind'}",
            )

    def _check_member(self, report: MemberReport, address: Hashable, now: float) -> None:
        """Raise RejectedError if a report contradicts earlier reports of the same member."""
        # 60.0: silence after which a member is removed from the table, s. If the clock was set
        # back, the reception times of earlier reports are in the future.
        self.members = {
            ident: one for ident, one in self.members.items() if abs(now - one.received_at) <= 60.0
        }
        known = self.members.get(report.member)
        if known is None:
            if len(self.members) >= MOST_MEMBERS:
                raise RejectedError(
                    Rejection.TABLE_FULL, f"id {report.member} beside {len(self.members)} members"
                )
            return
        # Signed frames are accepted from any address: otherwise a relay that is faster than the
        # sender could make the sender's own frames look foreign. Two addresses still raise an
        # alarm. Without signatures, only the first address is accepted until it is silent.
        if address != known.address and now - known.received_at <= MOVES_AFTER:
            first = address_text(known.address)
            detail = f"id {report.member} at {first} and at {address_text(address)}"
            if self._key is None:
                raise RejectedError(Rejection.SAME_ID, detail)
            self.note(Rejection.SAME_ID, detail, now)
        newer_by = report.stamp - known.report.stamp
        if newer_by <= 0:
            raise RejectedError(
                Rejection.REPLAYED,
                f"id {report.member}, {-newer_by:.1f} s older than this member's newest report",
            )
        # 0.1: shortest accepted time between two reports of one member, s: half the interval at the
        # highest rate.
        if newer_by < 0.1:
            raise RejectedError(
                Rejection.TOO_OFTEN, f"id {report.member}, reports {newer_by:.3f} s apart"
            )
        self._check_phase(known, report, now)

    def _check_phase(self, known: Member, report: MemberReport, now: float) -> None:
        """Raise RejectedError if a phase contradicts its extrapolation. After a jump, accept phases
        that were consistent for CONFIRMED_AFTER."""
        error = phase_error(known.report, report)
        tolerance = phase_tolerance(known.report, report)
        if error <= tolerance:
            return
        # A member whose estimator moves the target to the other side reports one jump of the phase,
        # then consistent phases. A wrong frame has no consistent successors. Until the new phase is
        # confirmed, keep the last accepted report, from which the phase of the member is
        # extrapolated.
        first, newest = known.jumped or (report, report)
        if known.jumped and phase_error(newest, report) > phase_tolerance(newest, report):
            first = report
        known.jumped = (first, report)
        known.received_at = now
        if report.stamp - first.stamp < CONFIRMED_AFTER:
            raise RejectedError(
                Rejection.PHASE_JUMP, f"id {report.member} by {error * 180 / pi:.0f} deg"
            )


def _report(messages: list[Message]) -> MemberReport:
    """Return the report that a decoded frame contains. Raises RejectedError."""
    if not messages or not is_report(messages[0]):
        raise RejectedError(Rejection.OTHER_MESSAGE, "not a report")
    try:
        report = from_message(messages[0])
    except ValueError as error:
        raise RejectedError(Rejection.OUT_OF_BOUNDS, str(error)) from None
    if not report.member:
        raise RejectedError(Rejection.OUT_OF_BOUNDS, "id 0, not 1 to 255")
    return report
