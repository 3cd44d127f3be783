"""Fleets of the emulated vehicle without run folders, for tests and benchmarks."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from circnav_mav.extras.fleet.flight import FleetFlight, Member, member_overrides
from circnav_mav.extras.fleet.link import FleetLink, LocalNetwork
from circnav_mav.extras.fleet.listener import FleetListener
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listeners


class NoRecord:
    """Recorder that keeps nothing."""

    problem: str | None = None

    def step(self, step: LoopStep) -> None:
        """Discard the step."""

    def ticks(self, records: list[TickRecord]) -> None:
        """Discard the ticks."""


def bare_fleet(
    path: str | Path,
    size: int,
    overrides: Sequence[str] = (),
    each: Callable[[int], Sequence[str]] = lambda member: (),
    *,
    loss: float = 0.0,
    delay: float = 0.0,
    seed: int = 0,
) -> FleetFlight:
    """Return a fleet without run folders. each(member): further overrides
    of a member."""
    network = LocalNetwork(loss, delay, seed)

    def members() -> Iterator[Member]:
        for member in range(1, size + 1):
            mission = load_mission(
                path, [*member_overrides(path, member, overrides, size), *each(member)]
            )
            pilot = Pilot(mission)
            link = FleetLink(network.port(member), member)
            listener = FleetListener(mission, pilot, link)
            yield Member(mission, link, NoRecord(), Listeners([listener]), pilot)  # type: ignore[arg-type]

    return FleetFlight(members(), network)
