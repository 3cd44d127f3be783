"""Interface for extras that observe a flight: the live page, the survey and others.

An onlooker receives every step of the loop, and an error in it never ends the flight. Its only influence on the pilot
is a request for another circle, which the pilot checks. An import contract denies that to extras that use positions.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.conditions import EXTRA_STOPPED
from circnav_mav.pilot.loop_step import LoopStep


class OtherVehicle(NamedTuple):
    """Another vehicle as known to an onlooker, for the live page. place: east and north of the target, m, None if
    unknown. words: its state."""

    name: str
    place: tuple[float, float] | None
    words: str


class Onlooker:
    """Base class of onlookers: every method does nothing.

    name: for messages about the onlooker. pace: speed that it needs of the bundled vehicle, times real time, None for
    any. busy: True to keep the loop running after guidance has ended. called_off: True after a signal to end the
    program. problem: failure, in one line.
    """

    name = "onlooker"
    pace: float | None = None
    busy = False
    called_off = False
    problem: str | None = None

    def start(self, epoch_us: int) -> None:
        """Called when the clock starts. epoch_us: Unix time of run time zero, us."""

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Process a step and the newest tick. Return frames to send to the vehicle, from a separate component id."""
        return ()

    def take_exchanged(self) -> Sequence[bytes]:
        """Return frames exchanged with other systems since the last step: recorded, never sent to the vehicle."""
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
        """Return the active alarms by name: rows of the extra's own table of conditions."""
        return {}

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add keys to the summary, and verdict lines to summary["notes"]. Return files for the run folder, by name."""
        return {}

    def show_verdict(self, verdict: str) -> None:
        """Show the verdict. Called after the flight is recorded."""

    def close(self) -> None:
        """Release all resources."""


@dataclass(frozen=True, slots=True)
class OnlookerSettings:
    """Inputs of an onlooker. options: of `circnav fly`, by name. others: all onlookers of the flight."""

    mission: Mission
    pilot: Pilot
    signing: Signing | None
    options: Mapping[str, Any]
    others: "Onlookers"


@dataclass(slots=True)
class Onlookers:
    """Onlookers of a flight. One that fails receives no more steps. problems: failures, one line each."""

    attached: list[Onlooker] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    _failed: set[int] = field(default_factory=set)

    @property
    def pace(self) -> float | None:
        """Lowest speed that an onlooker needs of the bundled vehicle, times real time; None for any."""
        return min((onlooker.pace for onlooker in self.attached if onlooker.pace is not None), default=None)

    @property
    def busy(self) -> bool:
        """True while an onlooker still has work after guidance has ended."""
        return any(self._guarded(onlooker, "", lambda one=onlooker: one.busy) for onlooker in self._working())

    def start(self, epoch_us: int) -> None:
        """Start every onlooker. epoch_us: Unix time of run time zero, us."""
        for onlooker in self.attached:
            self._guarded(onlooker, _at(0.0), onlooker.start, epoch_us)

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None, *, called_off: bool = False
    ) -> list[bytes]:
        """Pass a step to every onlooker. Return the frames to send to the vehicle."""
        frames: list[bytes] = []
        for onlooker in self._working():
            onlooker.called_off = called_off
            frames += self._guarded(onlooker, _at(step.time), onlooker.on_step, newest, step, recording_problem) or ()
        return frames

    def take_exchanged(self, now: float) -> list[bytes]:
        """Return the frames that onlookers exchanged with other systems than the vehicle, for the recorder."""
        frames: list[bytes] = []
        for onlooker in self._working():
            frames += self._guarded(onlooker, _at(now), onlooker.take_exchanged) or ()
        return frames

    def circle_requests(self, now: float) -> list[CircleRequest]:
        """Return the requests of all onlookers for another circle."""
        requests: list[CircleRequest] = []
        for onlooker in self._working():
            requests += self._guarded(onlooker, _at(now), onlooker.circle_requests, now) or ()
        return requests

    def facts(self, now: float) -> dict[str, str]:
        """Return the lines of all onlookers, by label."""
        lines: dict[str, str] = {}
        for onlooker in self._working():
            lines |= self._guarded(onlooker, _at(now), onlooker.facts, now) or {}
        return lines

    def vehicles(self, now: float) -> list[OtherVehicle]:
        """Return the other vehicles known to all onlookers."""
        found: list[OtherVehicle] = []
        for onlooker in self._working():
            found += self._guarded(onlooker, _at(now), onlooker.vehicles, now) or ()
        return found

    def alarms(self, now: float) -> dict[str, str]:
        """Return the alarms of all onlookers by name, and one that lists failed onlookers."""
        alarms: dict[str, str] = {}
        for onlooker in self._working():
            alarms |= self._guarded(onlooker, _at(now), onlooker.alarms, now) or {}
        return alarms | (EXTRA_STOPPED.alarm("; ".join(self.problems)) if self.problems else {})

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

    def _guarded(self, onlooker: Onlooker, when: str, call: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a call, or None if it raised. After that the onlooker receives no more steps."""
        try:
            return call(*arguments)
        except Exception as error:
            self._failed.add(id(onlooker))
            self.problems.append(f"{onlooker.name}: stopped{when}: {error!r}")
            return None


def _at(time: float) -> str:
    return f" at {time:.1f} s"
