"""F1 to F7: faults of the link, in both directions unless stated otherwise."""

from typing import Any

from tests.tools.fault_link import Impairment
from tests.tools.faults.cell import FRESH, FRESH_PATIENCE, Scenario, Want
from tests.tools.faults.course import Course

PX4 = ("px4_copter", "px4_plane")


def both(fault: str, level: str, impairment: Impairment, **more: Any) -> Scenario:
    return Scenario(fault, level, up=impairment, down=impairment, **more)


def outage(seconds: float, way: str, **more: Any) -> Scenario:
    cut = Impairment(outages=((0.0, seconds),))
    directions = dict.fromkeys(("up", "down") if way == "both" else (way,), cut)
    want = Want.REGAIN if seconds > 0.3 else Want.HOLD
    options = {"want": want, "lasts": seconds, "after": 60.0, **more}
    return Scenario("F2", f"{seconds:g} s {way}", **directions, **options)


def engages_only_when_the_link_is_quick(course: Course) -> str | None:
    """Return a fault if the flight began during the delay, which lasts for FRESH_PATIENCE."""
    at = course.pilot.mission.engaged_at
    return (
        f"engaged after {at:.1f} s over a slow link"
        if at is not None and at < FRESH_PATIENCE
        else None
    )


OLDER_RANGES = ("limits.stale_s=1.5",)
ONLY_WHEN_QUICK = {
    **FRESH,
    "want": Want.ENGAGE,
    "after": 15.0,
    "check": engages_only_when_the_link_is_quick,
}
LOSS = [
    *(both("F1", f"{p} %", Impairment(loss=p / 100), quick=p == 20) for p in (1, 5, 10, 20)),
    *(both("F1", f"{p} %", Impairment(loss=p / 100), want=Want.REGAIN) for p in (33, 50)),
    both("F1", "33 % from the start", Impairment(loss=0.33), want=Want.ENGAGE, quick=True, **FRESH),
]
OUTAGES = [
    *(outage(s, "both", quick=s == 3) for s in (0.2, 0.5, 1, 3, 10, 60)),
    *(outage(s, "up", quick=s == 10) for s in (0.5, 1, 3, 10, 60)),
    outage(90, "up", want=Want.SAFE),
    Scenario(
        "F2",
        "up, bursts of 1 s every 10 s",
        up=Impairment(burst_every=10, burst=1),
        want=Want.REGAIN,
    ),
    Scenario(
        "F2",
        "up, 2 s of every 4 s",
        up=Impairment(outages=tuple((float(at), at + 2.0) for at in range(0, 40, 4))),
        want=Want.REGAIN,
        reported="UPLINK SILENT",
        quick=True,
        lasts=40.0,
        profiles=("arducopter", "arduplane", "ardurover"),
    ),
    *(outage(s, "down") for s in (1, 10, 60)),
    both("F2", "bursts of 1 s every 10 s", Impairment(burst_every=10, burst=1), want=Want.REGAIN),
    outage(90, "both", want=Want.END, reason="no vehicle or no ranging for", quick=True),
]
DELAY = [
    *(
        both("F3", f"{ms} ms", Impairment(delay=ms / 1000), quick=ms == 250)
        for ms in (20, 100, 250)
    ),
    both("F3", "500 ms", Impairment(delay=0.5), want=Want.REGAIN),
    both("F3", "1000 ms", Impairment(delay=1.0), want=Want.REGAIN, on={"px4_copter": Want.SAFE}),
    *(
        both(
            "F3",
            f"{1000 * s:.0f} ms, stale_s 1.5",
            Impairment(delay=s),
            overrides=OLDER_RANGES,
            want=Want.REGAIN,
        )
        for s in (0.5, 1.0)
    ),
    Scenario(
        "F3",
        "3 s of the uplink alone",
        up=Impairment(delay=3.0),
        want=Want.REGAIN,
        reported="LINK TOO SLOW",
        quick=True,
        lasts=20.0,
        profiles=("arducopter", "arduplane"),
    ),
    both("F3", "250 ms from the start", Impairment(delay=0.25), want=Want.ENGAGE, **FRESH),
    *(
        both(
            "F3",
            f"{1000 * s:.0f} ms from the start",
            Impairment(delay=s),
            quick=s == 0.5,
            **ONLY_WHEN_QUICK,
        )
        for s in (0.5, 1.0)
    ),
]
JITTER = [
    *(both("F4", f"{ms} ms", Impairment(jitter=ms / 1000), quick=ms == 200) for ms in (50, 200)),
    both("F4", "200 ms in order", Impairment(jitter=0.2, in_order=True)),
]
ORDER = [
    *(
        both("F5", f"{p} %, depth 1 to 5", Impairment(reorder=p / 100), quick=p == 25, blind=0.5)
        for p in (1, 5, 25)
    )
]
DUPLICATES = [
    *(
        both("F6", f"{p} %", Impairment(duplicate=p / 100), quick=p == 50, rejects=("repeat",))
        for p in (10, 50)
    ),
    both("F6", "1 %", Impairment(duplicate=0.01)),
    both("F6", "two routes, 30 ms", Impairment(duplicate=1.0, echo=0.03), rejects=("repeat",)),
    both("F6", "two routes, 300 ms", Impairment(duplicate=1.0, echo=0.3), rejects=("older",)),
]
DAMAGE = [
    *(
        both("F7", f"{p:g} per byte", Impairment(corrupt=p), quick=p == 1e-3)
        for p in (1e-5, 1e-4, 1e-3)
    ),
    both("F7", "0.01 per byte", Impairment(corrupt=1e-2), want=Want.REGAIN),
    both("F7", "truncated 10 %", Impairment(truncate=0.1)),
    both("F7", "split 10 %", Impairment(split=0.1)),
    both("F7", "joined 25 %", Impairment(join=0.25), blind=0.5),
    both("F7", "stray bytes 50 %", Impairment(stray=0.5), quick=True),
    both("F7", "stream, split 100 %", Impairment(split=1.0), stream=True),
    both(
        *("F7", "stream, 1e-3 per byte, stray 10 %", Impairment(corrupt=1e-3, stray=0.1)),
        stream=True,
        # PX4 leaves ALTCTL after half a second without stick messages.
        on={"px4_plane": Want.SAFE},
    ),
]
LINE = [*LOSS, *OUTAGES, *DELAY, *JITTER, *ORDER, *DUPLICATES, *DAMAGE]
