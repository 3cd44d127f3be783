"""Preflight check of the other members. It receives their reports and sends none."""

import select
from collections.abc import Iterator
from math import inf

from circnav_mav.extras.fleet.acceptance import Rejection
from circnav_mav.extras.fleet.onlooker import layer_lines, mission_carrier
from circnav_mav.extras.fleet.report import MemberReport
from circnav_mav.extras.fleet.settings import FleetTable
from circnav_mav.mav.check_result import FAIL, PASS, WARN, Check
from circnav_mav.mission.mission import Mission
from circnav_mav.runtime.clock import steady, unix_time

LISTEN = 3.0
"""Time to listen, s: 15 reports of each member."""
REFUSED = (Rejection.SAME_ID, Rejection.CLOCKS_DISAGREE, Rejection.WRONG_KEY, Rejection.UNSIGNED)
"""Rejections that fail the preflight. Others are counted in flight."""


def listen_to_fleet(mission: Mission, table: FleetTable) -> Iterator[Check]:
    """Receive reports, and yield checks of members, ids, clocks and height layers. Raises Refused."""
    carrier = mission_carrier(table)
    newest: dict[int, MemberReport] = {}
    until = steady() + LISTEN
    try:
        while steady() < until:
            newest |= {report.member: report for report in carrier.received(unix_time())}
            select.select([], [], [], 0.05)
        problems = carrier.alarms(unix_time())
    finally:
        carrier.close()
    yield from judge_fleet(mission, table, newest, dict(carrier.acceptance.rejected), problems)


def judge_fleet(
    mission: Mission,
    table: FleetTable,
    newest: dict[int, MemberReport],
    rejected: dict[Rejection, int],
    problems: list[str],
) -> Iterator[Check]:
    """Yield the checks of the received reports. newest: newest report of each member, by id."""
    others = ", ".join(map(str, sorted(newest))) or "none yet"
    yield Check(PASS, "fleet", f"group {table.group}, id {table.id}; members received: {others}")
    fatal = any(rejected.get(reason) for reason in REFUSED)
    for line in problems:
        yield Check(FAIL if fatal else WARN, "fleet link", line.removeprefix("fleet link: "))
    if rejected.get(Rejection.SAME_ID) and not problems:
        yield Check(FAIL, "fleet link", f"the id {table.id} is in use: give each member another id")
    heights = {member: report.height for member, report in newest.items()}
    own = mission.file.orbit.height_above_target_m
    heights[table.id or 0] = inf if own is None else own
    for line in layer_lines(heights, table.layer_m):
        yield Check(FAIL, "fleet layer", line.removeprefix("fleet: "))
