"""Conversion between member reports and MAVLink messages.

A report is one DEBUG_FLOAT_ARRAY: every log reader decodes it, and no autopilot acts on it. The
sender's system id is its id within the fleet, and its component id is COMPONENT. `time_usec` holds
the stamp in microseconds, so that it is not rounded to a 32-bit float. NAME ends in the version of
the format.

The other fields are 32-bit floats in the order of `_numbers`. Their coarsest steps are 1 mm in
height (at 10 km), 0.25 ms in lap period (at one hour), and 0.5 microradian in phase.
"""

from math import tau

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.mav.codec import Message

NAME = "circfleet1"
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
MESSAGE = dialect.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY
_SENSES = {1.0: 1, -1.0: -1}


def to_message(report: MemberReport) -> Message:
    """Return a report as a message. The sender's ids are set by its encoder."""
    numbers = _numbers(report)
    # 1e13: latest timestamp that is sent, s: below the limit of the 64 bits of `time_usec`.
    stamp_us = round(min(max(report.stamp, 0.0), 1e13) * 1e6)
    # 58: number of floats in DEBUG_FLOAT_ARRAY.
    data = [*numbers, *[0.0] * (58 - len(numbers))]
    return dialect.MAVLink_debug_float_array_message(stamp_us, NAME.encode(), 0, data)


def is_report(message: Message) -> bool:
    """True if a message holds a report in this version of the format."""
    ours = message.get_srcComponent() == COMPONENT and message.name == NAME
    return bool(ours and message.get_msgId() == MESSAGE)


def from_message(message: Message) -> MemberReport:
    """Return the report in a message. Raises ValueError if a state or sense does not exist."""
    state, sense, phase, sigma, period, radius, east, north, ee, en, nn, height = message.data[:12]
    if state not in tuple(State) or sense not in _SENSES:
        raise ValueError(f"state {state:g} or sense {sense:g} does not exist")
    return MemberReport(
        member=message.get_srcSystem(),
        state=State(int(state)),
        stamp=message.time_usec / 1e6,
        # In 32 bits, the largest phase below 2 pi is rounded up to 6.2831855, which exceeds 2 pi.
        phase=phase % tau if 0 <= phase < tau + 1e-6 else phase,
        phase_sigma=sigma,
        lap_period=period,
        radius=radius,
        height=height,
        sense=_SENSES[sense],
        drift=(east, north),
        drift_covariance=(ee, en, nn),
    )


def _numbers(report: MemberReport) -> list[float]:
    """Return the fields in the order of the format. The height is last, because MAVLink 2 does not
    send trailing zeros: a height of 0 shortens the frame."""
    return [
        float(report.state),
        float(report.sense),
        report.phase,
        report.phase_sigma,
        report.lap_period,
        report.radius,
        *report.drift,
        *report.drift_covariance,
        report.height,
    ]
