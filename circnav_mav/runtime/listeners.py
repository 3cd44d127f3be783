"""Interface for extras that observe a flight: the live page, the locator and others.

A listener receives every step of the loop, and an error in it never ends the flight. The only
influence of a listener on `Pilot` is a request for another circle, which `Pilot` checks. An import
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
    """Another vehicle as known to a listener, for the live page.

    place: position east and north of the target, m, None if unknown.
    words: human-readable state of the vehicle.
    """

    name: str
    place: tuple[float, float] | None
    words: str


class Listener:
    """Base class of listeners: every method does nothing.

    name: name of the listener in messages.
    pace: simulation speed of the bundled vehicle that the listener needs, times real time, None for
        any.
    busy: True to keep the loop running after guidance has ended.
    called_off: True after a signal to end the program.
    problem: description of a failure in one line, or None.
    """

    name = "listener"
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
class ListenerSettings:
    """Inputs of a listener. options: options of `circnav fly`, by name. others: all listeners of
    the flight."""

    mission: Mission
    pilot: Pilot
    signing: Signing | None
    options: Mapping[str, Any]
    others: "Listeners"


@dataclass(slots=True)
class Listeners:
    """Listeners of a flight. A listener that fails receives no more steps. problems: failures, one
    line each."""

    attached: list[Listener] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    _failed: set[int] = field(default_factory=set)

    @property
    def pace(self) -> float | None:
        """Simulation speed of the emulator that all listeners can follow, times real time. None:
        any speed."""
        return min(
            (listener.pace for listener in self.attached if listener.pace is not None), default=None
        )

    @property
    def busy(self) -> bool:
        """True while a listener still has work after guidance has ended."""
        return any(
            self._guarded(listener, "", lambda one=listener: one.busy)
            for listener in self._working()
        )

    def start(self, epoch_us: int) -> None:
        """Start every listener. epoch_us: Unix time of run time zero, us."""
        for listener in self.attached:
            self._guarded(listener, 0.0, listener.start, epoch_us)

    def on_step(
        self,
        newest: TickRecord | None,
        step: LoopStep,
        recording_problem: str | None,
        *,
        called_off: bool = False,
    ) -> list[bytes]:
        """Pass a step to every listener. Return the frames to send to the vehicle."""
        for listener in self._working():
            listener.called_off = called_off
        return self._all(step.time, "on_step", newest, step, recording_problem)

    def take_exchanged(self, now: float) -> list[bytes]:
        """Return the frames that listeners exchanged with other systems than the vehicle, for the
        recorder."""
        return self._all(now, "take_exchanged")

    def circle_requests(self, now: float) -> list[CircleRequest]:
        """Return the requests of all listeners for another circle."""
        return self._all(now, "circle_requests", now)

    def facts(self, now: float) -> dict[str, str]:
        """Return the lines of all listeners, by label."""
        return dict(self._all(now, "facts", now, by=Mapping.items))

    def vehicles(self, now: float) -> list[OtherVehicle]:
        """Return the other vehicles that the listeners report."""
        return self._all(now, "vehicles", now)

    def alarms(self, now: float) -> dict[str, str]:
        """Return the alarms of all listeners by name, and one alarm that lists failed listeners, if
        any."""
        alarms = dict(self._all(now, "alarms", now, by=Mapping.items))
        if self.problems:
            alarms["extra_stopped"] = "; ".join(self.problems)
        return alarms

    def finish(self, summary: dict[str, Any]) -> dict[str, str]:
        """Let every listener add to the summary. Return the files for the run folder, by name."""
        files: dict[str, str] = {}
        for listener in self.attached:
            files |= self._guarded(listener, " at the end", listener.finish, summary) or {}
        return files

    def show_verdict(self, verdict: str, folder: Path) -> None:
        """Show the verdict to every listener. folder: run folder."""
        for listener in self.attached:
            self._guarded(listener, " at the end", listener.show_verdict, verdict, folder)

    def all_problems(self) -> Iterator[str]:
        """Yield all failures, one line each."""
        yield from self.problems
        yield from filter(None, (listener.problem for listener in self.attached))

    def close(self) -> None:
        """Close every listener."""
        for listener in self.attached:
            self._guarded(listener, " at the end", listener.close)

    def _working(self) -> list[Listener]:
        """Return the listeners that have not failed."""
        return [listener for listener in self.attached if id(listener) not in self._failed]

    def _all(
        self, now: float, name: str, *arguments: Any, by: Callable[[Any], Iterable[Any]] = iter
    ) -> list[Any]:
        """Return the results of a method of all working listeners. by: function from one result to
        its items."""
        results = [
            self._guarded(one, now, getattr(one, name), *arguments) for one in self._working()
        ]
        return [item for result in results if result for item in by(result)]

    def _guarded(
        self, listener: Listener, moment: float | str, call: Callable[..., Any], *arguments: Any
    ) -> Any:
        """Return the result of a call, or None if it raised. A listener that raised receives no
        more steps. moment: time of the step, s, or a text."""
        try:
            return call(*arguments)
        except Exception as error:
            self._failed.add(id(listener))
            when = f" at {moment:.1f} s" if isinstance(moment, float) else moment
            self.problems.append(f"{listener.name}: stopped{when}: {error!r}")
            return None
