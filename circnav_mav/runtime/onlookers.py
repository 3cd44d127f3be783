"""What watches a flight from outside: the seam for the live page, the survey and other extras.

An onlooker is shown every step of the loop. Nothing that it does reaches the pilot, and an error in it never ends the
flight.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
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
        """The clock was started. epoch_us: Unix time of run time zero, us."""

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Take in a step and the newest tick. Return frames to send to the vehicle, from a component of its own."""
        return ()

    def facts(self, now: float) -> Mapping[str, str]:
        """Return lines for the display and the live page, by their labels."""
        return {}

    def alarms(self, now: float) -> Sequence[str]:
        """Return what is wrong now."""
        return ()

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add to the summary, lines of the verdict to summary["notes"]. Return files for the run folder, by name."""
        return {}

    def show_verdict(self, verdict: str) -> None:
        """The flight is over and recorded."""

    def close(self) -> None:
        """Release what was opened."""


@dataclass(frozen=True, slots=True)
class OnlookerSettings:
    """What an onlooker may use. options: of `circnav fly`, by name. others: all onlookers of the flight. speed: of the
    run, times real time, as far as it is known."""

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
        """Speed at which the bundled vehicle should fly, times real time; None if no onlooker minds."""
        return min((one.pace for one in self.attached if one.pace is not None), default=None)

    @property
    def busy(self) -> bool:
        """True while one of them has something to do after guidance has ended."""
        return any(one.busy for one in self._sound())

    def start(self, epoch_us: int) -> None:
        """The clock was started."""
        for one in self.attached:
            one.start(epoch_us)

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None, *, called_off: bool = False
    ) -> list[bytes]:
        """Show a step to each. Return the frames to send to the vehicle."""
        frames: list[bytes] = []
        for one in self._sound():
            one.called_off = called_off
            answer = self._guarded(one, step.time, one.on_step, newest, step, recording_problem)
            frames += answer or ()
        return frames

    def facts(self, now: float) -> dict[str, str]:
        """The lines of all, by their labels."""
        found = (self._guarded(one, now, one.facts, now) for one in self._sound())
        return {label: words for facts in found for label, words in (facts or {}).items()}

    def alarms(self, now: float) -> list[str]:
        """The alarms of all."""
        found = (self._guarded(one, now, one.alarms, now) for one in self._sound())
        return [alarm for alarms in found for alarm in alarms or ()]

    def finish(self, summary: dict[str, Any]) -> dict[str, str]:
        """Let each add to the summary. Return the files for the run folder, by name."""
        files: dict[str, str] = {}
        for one in self.attached:
            files |= self._guarded(one, None, one.finish, summary) or {}
        return files

    def show_verdict(self, verdict: str) -> None:
        """Show each the verdict."""
        for one in self.attached:
            self._guarded(one, None, one.show_verdict, verdict)

    def all_problems(self) -> Iterator[str]:
        """What has failed, a line each."""
        yield from self.problems
        yield from filter(None, (one.problem for one in self.attached))

    def close(self) -> None:
        """Close each."""
        for one in self.attached:
            self._guarded(one, None, one.close)

    def _sound(self) -> Iterable[Onlooker]:
        return [one for one in self.attached if id(one) not in self._failed]

    def _guarded(self, one: Onlooker, now: float | None, call: Callable[..., Any], *given: Any) -> Any:
        """Return the result of a call, None if it failed: then the onlooker is shown no more steps."""
        try:
            return call(*given)
        except Exception as error:
            self._failed.add(id(one))
            when = "at the end" if now is None else f"at {now:.1f} s"
            self.problems.append(f"{one.name}: stopped {when}: {error!r}")
            return None
