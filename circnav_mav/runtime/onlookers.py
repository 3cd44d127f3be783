"""Interface for extras that observe a flight: the live page, the survey and others.

An onlooker receives every step of the loop, and an error in it never ends the flight. The only
influence of an onlooker on `Pilot` is a request for another circle, which `Pilot` checks. An import
contract denies such requests to extras that use positions.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep


class OtherVehicle(NamedTuple):
    """Another vehicle as known to an onlooker, for the live page.

    place: position east and north of the target, m, None if unknown.
    words: human-readable state of the vehicle.
    """

    name: str
    place: tuple[float, float] | None
    words: str


class Onlooker:
    """Base class of onlookers: every method does nothing.

    name: name of the onlooker in messages.
    pace: simulation speed of the bundled vehicle that the onlooker needs, times real time, None for
        any.
    busy: True to keep the loop running after guidance has ended.
    called_off: True after a signal to end the program.
    problem: description of a failure in one line, or None.
    """

    name = "onlooker"
    pace: float | None = None
    busy = False
    called_off = False
    problem: str | None = None

    def start(self, epoch_us: int) -> None:
        """Called when the clock starts. epoch_us: Unix time of run time zero, us."""

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Process a step and the newest tick. Return frames to send to the vehicle, from a separate
        component id."""
        return ()

    def take_exchanged(self) -> Sequence[bytes]:
        """Return the frames exchanged with other systems since the last step. They are recorded,
        and never sent to the vehicle."""
        return ()

    def circle_requests(self, now: float) -> Sequence[CircleRequest]:
        """Return requests for another circle, as a fleet needs for its spacing."""
        return ()

    def facts(self, now: float) -> Mapping[str, str]:
        """Return lines for the display and the live page, by label."""
        return {}

    def vehicles(self, now: float) -> Sequence[OtherVehicle]:
        """Return other vehicles at the same target, for the live page."""
        return ()

    def alarms(self, now: float) -> Mapping[str, str]:
        """Return the texts of active alarms by name."""
        return {}

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add keys to the summary, and verdict lines to summary["notes"]. Return files for the run
        folder, by name."""
        return {}

    def show_verdict(self, verdict: str, folder: Path) -> None:
        """Show the verdict. Called after the flight is recorded, before its report is written.
        folder: run folder."""

    def close(self) -> None:
        """Release all resources."""


@dataclass(frozen=True, slots=True)
class OnlookerSettings:
    """Inputs of an onlooker. options: options of `circnav fly`, by name. others: all onlookers of
    the flight."""

    mission: Mission
    pilot: Pilot
    signing: Signing | None
    options: Mapping[str, Any]
    others: "Onlookers"


@dataclass(slots=True)
class Onlookers:
    """Onlookers of a flight. An onlooker that fails receives no more steps. problems: failures, one
    line each."""

    attached: list[Onlooker] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    _failed: set[int] = field(default_factory=set)

    @property
    def pace(self) -> float | None:
        """Simulation speed of the emulator that all onlookers can follow, times real time. None:
        any speed."""
        return min(
            (onlooker.pace for onlooker in self.attached if onlooker.pace is not None), default=None
        )

    @property
    def busy(self) -> bool:
        """True while an onlooker still has work after guidance has ended."""
        return any(
            self._guarded(onlooker, "", lambda one=onlooker: one.busy)
            for onlooker in self._working()
        )

    def start(self, epoch_us: int) -> None:
        """Start every onlooker. epoch_us: Unix time of run time zero, us."""
        for onlooker in self.attached:
            self._guarded(onlooker, " at 0.0 s", onlooker.start, epoch_us)

    def on_step(
        self,
        newest: TickRecord | None,
        step: LoopStep,
        recording_problem: str | None,
        *,
        called_off: bool = False,
    ) -> list[bytes]:
        """Pass a step to every onlooker. Return the frames to send to the vehicle."""
        for onlooker in self._working():
            onlooker.called_off = called_off
        return self._all(step.time, "on_step", newest, step, recording_problem)

    def take_exchanged(self, now: float) -> list[bytes]:
        """Return the frames that onlookers exchanged with other systems than the vehicle, for the
        recorder."""
        return self._all(now, "take_exchanged")

    def circle_requests(self, now: float) -> list[CircleRequest]:
        """Return the requests of all onlookers for another circle."""
        return self._all(now, "circle_requests", now)

    def facts(self, now: float) -> dict[str, str]:
        """Return the lines of all onlookers, by label."""
        return dict(self._all(now, "facts", now, by=Mapping.items))

    def vehicles(self, now: float) -> list[OtherVehicle]:
        """Return the other vehicles known to all onlookers."""
        return self._all(now, "vehicles", now)

    def alarms(self, now: float) -> dict[str, str]:
        """Return the alarms of all onlookers by name, and one alarm that lists failed onlookers, if
        any."""
        alarms = dict(self._all(now, "alarms", now, by=Mapping.items))
        if self.problems:
            alarms["extra_stopped"] = "; ".join(self.problems)
        return alarms

    def finish(self, summary: dict[str, Any]) -> dict[str, str]:
        """Let every onlooker add to the summary. Return the files for the run folder, by name."""
        files: dict[str, str] = {}
        for onlooker in self.attached:
            files |= self._guarded(onlooker, " at the end", onlooker.finish, summary) or {}
        return files

    def show_verdict(self, verdict: str, folder: Path) -> None:
        """Show the verdict to every onlooker. folder: run folder."""
        for onlooker in self.attached:
            self._guarded(onlooker, " at the end", onlooker.show_verdict, verdict, folder)

    def all_problems(self) -> Iterator[str]:
        """Yield all failures, one line each."""
        yield from self.problems
        yield from filter(None, (onlooker.problem for onlooker in self.attached))

    def close(self) -> None:
        """Close every onlooker."""
        for onlooker in self.attached:
            self._guarded(onlooker, " at the end", onlooker.close)

    def _working(self) -> list[Onlooker]:
        """Return the onlookers that have not failed."""
        return [onlooker for onlooker in self.attached if id(onlooker) not in self._failed]

    def _all(
        self, now: float, name: str, *arguments: Any, by: Callable[[Any], Iterable[Any]] = iter
    ) -> list[Any]:
        """Return the results of a method of all working onlookers. by: function from one result to
        its items."""
        results = [
            self._guarded(one, f" at {now:.1f} s", getattr(one, name), *arguments)
            for one in self._working()
        ]
        return [item for result in results if result for item in by(result)]

    def _guarded(
        self, onlooker: Onlooker, when: str, call: Callable[..., Any], *arguments: Any
    ) -> Any:
        """Return the result of a call, or None if it raised. An onlooker that raised receives no
        more steps."""
        try:
            return call(*arguments)
        except Exception as error:
            self._failed.add(id(onlooker))
            self.problems.append(f"{onlooker.name}: stopped{when}: {error!r}")
            return None
