"""Preflight check of the other members. It receives their reports and sends none."""

import select
from collections.abc import Iterator
from math import inf

from circnav_mav.cli.exits import Refused
from circnav_mav.extras.fleet.acceptance import Rejection
from circnav_mav.extras.fleet.listener import layer_lines, mission_link
from circnav_mav.extras.fleet.report import MemberReport
from circnav_mav.extras.fleet.settings import FleetTable
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check
from circnav_mav.mission.mission import Mission
from circnav_mav.runtime.clock import steady, unix_time

LISTEN = 3.0
"""Time to listen in preflight, s: 15 reports of each member."""
LISTEN_AT_START = 1.0
"""Time to listen before a flight, s: 5 reports of each member."""
REFUSED = (Rejection.SAME_ID, Rejection.CLOCKS_DISAGREE, Rejection.WRONG_KEY, Rejection.UNSIGNED)
"""Rejections that fail the preflight. Other rejections give a warning."""


def listen_to_fleet(mission: Mission, table: FleetTable) -> Iterator[Check]:
    """Receive reports, and yield checks of members, ids, clocks and height layers. Raises
    Refused."""
    newest, rejected, problems = _listen(table, LISTEN)
    yield from judge_fleet(mission, table, newest, rejected, problems)


def refuse_taken(mission: Mission, table: FleetTable) -> None:
    """Receive reports for a moment. Raises Refused if this member's id or height layer is taken."""
    newest, rejected, _ = _listen(table, LISTEN_AT_START)
    # Other rejections do not prevent the start. Otherwise one member with a wrong clock would
    # ground all members.
    relevant: dict[Rejection, int] = {
        reason: count for reason, count in rejected.items() if reason is Rejection.SAME_ID
    }
    checks = judge_fleet(mission, table, newest, relevant, [])
    if failed := [check.text for check in checks if check.grade is FAIL]:
        raise Refused(f"fleet: {'; '.join(failed)}")


def _listen(
    table: FleetTable, seconds: float
) -> tuple[dict[int, MemberReport], dict[Rejection, int], list[str]]:
    """Return the newest report of each member, the counts of rejections and the problems. Raises
    Refused."""
    # The stamps are UTC of the autopilots. Before the flight, this computer cannot check them.
    link = mission_link(table, inf)
    newest: dict[int, MemberReport] = {}
    until = steady() + seconds
    try:
        while steady() < until:
            newest |= {report.member: report for report in link.received(unix_time())}
            select.select([], [], [], 0.05)
        return newest, dict(link.acceptance.rejected), link.alarms(unix_time())
    finally:
        link.close()


def judge_fleet(
    mission: Mission,
    table: FleetTable,
    newest: dict[int, MemberReport],
    rejected: dict[Rejection, int],
    problems: list[str],
) -> Iterator[Check]:
    """Yield the checks of the received reports. newest: newest report of each member, by id."""
    others = ", ".join(map(str, sorted(newest))) or "none yet"
    yield Check(PASS, "fleet", f"id {table.id}; members received: {others}")
    fatal = any(rejected.get(reason) for reason in REFUSED)
    for line in problems:
        yield Check(FAIL if fatal else WARN, "fleet link", line.removeprefix("fleet link: "))
    if rejected.get(Rejection.SAME_ID) and not problems:
        yield Check(FAIL, "fleet link", f"the id {table.id} is in use: give each member its own id")
    own = mission.file.orbit.height_above_target_m
    if own is None or mission.file.vehicle.kind == "rover":
        return
    for member, report in newest.items():
        for line in layer_lines({table.id or 0: own, member: report.height}, table.layer_m):
            yield Check(FAIL, "fleet layer", line.removeprefix("fleet: "))
