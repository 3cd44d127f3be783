"""The seam for what watches a flight from outside: the live page, the survey and other extras.

An onlooker is shown every step of the loop, and an error in it never ends the flight. The one thing that it may ask of
the pilot is another circle, which the pilot checks; an import contract keeps that from those that know positions.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.conditions import EXTRA_STOPPED
from circnav_mav.pilot.loop_step import LoopStep


class Onlooker:
    """Base class of onlookers: every method does nothing.

    name: for messages about the onlooker. pace: the speed (times real time) at which the bundled vehicle should fly for
    it; None if it does not matter. busy: True to keep the loop running after guidance has ended. called_off: True once
    a signal has asked for the end of the program. problem: what has failed, in one line.
    """

    name = "onlooker"
    pace: float | None = None
    busy = False
    called_off = False
    problem: str | None = None

    def start(self, epoch_us: int) -> None:
        """Begin: the clock was started. epoch_us: Unix time of run time zero, us."""

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Take in a step and the newest tick. Return frames to send to the vehicle, from a component of its own."""
        return ()

    def circle_requests(self, now: float) -> Sequence[CircleRequest]:
        """Return requests for another circle, for a fleet that spaces itself."""
        return ()

    def facts(self, now: float) -> Mapping[str, str]:
        """Return lines for the display and the live page, by their labels."""
        return {}

    def alarms(self, now: float) -> Mapping[str, str]:
        """Return the alarms of now by name: rows of the extra's own table of conditions."""
        return {}

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add to the summary, lines of the verdict to summary["notes"]. Return files for the run folder, by name."""
        return {}

    def show_verdict(self, verdict: str) -> None:
        """Show the verdict: the flight is over and recorded."""

    def close(self) -> None:
        """Release what was opened."""


@dataclass(frozen=True, slots=True)
class OnlookerSettings:
    """Everything that an onlooker may use. options: of `circnav fly`, by name. others: all onlookers of the flight."""

    mission: Mission
    pilot: Pilot
    signing: Signing | None
    options: Mapping[str, Any]
    others: "Onlookers"


@dataclass(slots=True)
class Onlookers:
    """The onlookers of a flight. One that fails is shown no more steps. problems: what has failed, a line each."""

    attached: list[Onlooker] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    _failed: set[int] = field(default_factory=set)

    @property
    def pace(self) -> float | None:
        """Speed at which the bundled vehicle should fly, times real time; None if it does not matter."""
        return min((onlooker.pace for onlooker in self.attached if onlooker.pace is not None), default=None)

    @property
    def busy(self) -> bool:
        """True while an onlooker has something to do after guidance has ended."""
        return any(self._guarded(onlooker, "", lambda one=onlooker: one.busy) for onlooker in self._working())

    def start(self, epoch_us: int) -> None:
        """Start every onlooker. epoch_us: Unix time of run time zero, us."""
        for onlooker in self.attached:
            self._guarded(onlooker, _at(0.0), onlooker.start, epoch_us)

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None, *, called_off: bool = False
    ) -> list[bytes]:
        """Show a step to every onlooker. Return the frames to send to the vehicle."""
        frames: list[bytes] = []
        for onlooker in self._working():
            onlooker.called_off = called_off
            frames += self._guarded(onlooker, _at(step.time), onlooker.on_step, newest, step, recording_problem) or ()
        return frames

    def circle_requests(self, now: float) -> list[CircleRequest]:
        """Return the requests of all onlookers for another circle."""
        requests: list[CircleRequest] = []
        for onlooker in self._working():
            requests += self._guarded(onlooker, _at(now), onlooker.circle_requests, now) or ()
        return requests

    def facts(self, now: float) -> dict[str, str]:
        """Return the lines of all onlookers, by their labels."""
        lines: dict[str, str] = {}
        for onlooker in self._working():
            lines |= self._guarded(onlooker, _at(now), onlooker.facts, now) or {}
        return lines

    def alarms(self, now: float) -> dict[str, str]:
        """Return the alarms of all onlookers by name, and which onlookers have failed."""
        alarms: dict[str, str] = {}
        for onlooker in self._working():
            alarms |= self._guarded(onlooker, _at(now), onlooker.alarms, now) or {}
        return alarms | (EXTRA_STOPPED.alarm(problem="; ".join(self.problems)) if self.problems else {})

    def finish(self, summary: dict[str, Any]) -> dict[str, str]:
        """Let every onlooker add to the summary. Return the files for the run folder, by name."""
        files: dict[str, str] = {}
        for onlooker in self.attached:
            files |= self._guarded(onlooker, " at the end", onlooker.finish, summary) or {}
        return files

    def show_verdict(self, verdict: str) -> None:
        """Show the verdict to every onlooker."""
        for onlooker in self.attached:
            self._guarded(onlooker, " at the end", onlooker.show_verdict, verdict)

    def all_problems(self) -> Iterator[str]:
        """Yield what has failed, a line each."""
        yield from self.problems
        yield from filter(None, (onlooker.problem for onlooker in self.attached))

    def close(self) -> None:
        """Close every onlooker."""
        for onlooker in self.attached:
            self._guarded(onlooker, " at the end", onlooker.close)

    def _working(self) -> list[Onlooker]:
        """Return the onlookers that have not failed."""
        return [onlooker for onlooker in self.attached if id(onlooker) not in self._failed]

    def _guarded(self, onlooker: Onlooker, when: str, call: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a call, None if it failed: from then on the onlooker is shown no more steps."""
        try:
            return call(*arguments)
        except Exception as error:
            self._failed.add(id(onlooker))
            self.problems.append(f"{onlooker.name}: stopped{when}: {error!r}")
            return None


def _at(time: float) -> str:
    return f" at {time:.1f} s"
