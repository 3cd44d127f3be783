"""COMMAND_LONG with retries and matched acknowledgements (timings of MAVSDK: 0.5 s, three retries, 3 s in progress)."""

from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message

ACK_TIMEOUT = 0.5
IN_PROGRESS_TIMEOUT = 3.0
MOST_IN_PROGRESS = 3
RETRIES = 3
RESULT_NAMES = {
    value: entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for value, entry in dialect.enums["MAV_RESULT"].items()
}
"""Names of MAV_RESULT values, as a person reads them."""


@dataclass(frozen=True, slots=True)
class Command:
    """A MAV_CMD number with its parameters (unset ones are 0)."""

    number: int
    params: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class CommandResult:
    """How a command ended: a MAV_RESULT, or None when nobody answered."""

    command: Command
    result: int | None

    @property
    def accepted(self) -> bool:
        return self.result == 0  # MAV_RESULT_ACCEPTED

    @property
    def refused(self) -> bool:
        """Whether the vehicle rejected it (silence is no answer)."""
        return self.result is not None and not self.accepted

    @property
    def said(self) -> str:
        return "no answer" if self.result is None else RESULT_NAMES.get(self.result, f"result {self.result}")


@dataclass(frozen=True, slots=True)
class _Pending:
    command: Command
    tries: int
    due: float
    in_progress: int = 0


class CommandSender:
    """At most one command per number is under way; others of the same number wait their turn."""

    def __init__(self) -> None:
        self._queue: list[Command] = []
        self._pending: dict[int, _Pending] = {}
        self._results: list[CommandResult] = []

    def send(self, command: Command) -> None:
        """Queue a command; one that is already waiting is not queued twice."""
        under_way = self._pending.get(command.number)
        if command not in self._queue and (under_way is None or under_way.command != command):
            self._queue.append(command)

    def clear(self) -> None:
        """Drop everything: the vehicle that was meant is gone."""
        self._queue.clear()
        self._pending.clear()

    def drop(self, number: int) -> bool:
        """Ask no more for what a command number stands for; tells whether anything was under way."""
        others = [command for command in self._queue if command.number != number]
        waited, self._queue = len(others) < len(self._queue), others
        return self._pending.pop(number, None) is not None or waited

    def take_results(self) -> list[CommandResult]:
        results, self._results = self._results, []
        return results

    def acknowledge(self, ack: Message, us: tuple[int, int], now: float) -> None:
        """Match a COMMAND_ACK of our vehicle; one that is addressed to somebody else is not ours."""
        pending = self._pending.get(ack.command)
        if pending is None or ack.target_system not in (0, us[0]) or ack.target_component not in (0, us[1]):
            return
        if ack.result == dialect.MAV_RESULT_IN_PROGRESS:
            if pending.in_progress < MOST_IN_PROGRESS:
                self._pending[ack.command] = replace(
                    pending, due=now + IN_PROGRESS_TIMEOUT, in_progress=pending.in_progress + 1, tries=RETRIES
                )
            return
        del self._pending[ack.command]
        self._results.append(CommandResult(pending.command, ack.result))

    def poll(self, target: tuple[int, int], now: float) -> list[Message]:
        """The messages due now: first tries and repeats, with `confirmation` counting the repeats."""
        messages = []
        for number, pending in list(self._pending.items()):
            if now < pending.due:
                continue
            if pending.tries >= RETRIES:
                del self._pending[number]
                self._results.append(CommandResult(pending.command, None))
            else:
                self._pending[number] = replace(pending, tries=pending.tries + 1, due=now + ACK_TIMEOUT)
                messages.append(once(pending.command, target, pending.tries + 1))
        waiting, self._queue = self._queue, []
        for command in waiting:
            if command.number in self._pending:
                self._queue.append(command)
            else:
                self._pending[command.number] = _Pending(command, 0, now + ACK_TIMEOUT)
                messages.append(once(command, target))
        return messages


def once(command: Command, target: tuple[int, int], confirmation: int = 0) -> Message:
    """A COMMAND_LONG, whether anybody waits for its answer or not. confirmation: how often it was sent before."""
    params = command.params + (0.0,) * (7 - len(command.params))
    return dialect.MAVLink_command_long_message(*target, command.number, confirmation, *params)
