"""Commands with retries and matched acknowledgments.

An unanswered command is repeated every 0.5 s, three times (as in MAVSDK). An IN_PROGRESS answer
extends the wait to 3 s. Also the telemetry streams: they are requested with SET_MESSAGE_INTERVAL,
measured, and requested again when they slow down.
"""

from collections import Counter, deque
from collections.abc import Container, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, Message

RETRIES = 3
"""Number of repeats of a command (as in MAVSDK)."""
UNASKED = 2
"""Number of answers to commands that we did not send, within UNASKED_WITHIN. So many answers
indicate another program with our ids."""
UNASKED_WITHIN = 10.0
"""Time in which unrequested answers are counted, s."""
CHECK_EVERY = 3.0
"""Time, s, over which stream rates are measured."""
USUAL = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    for name in (
        "SYSTEM_TIME",
        "SYS_STATUS",
        "NAV_CONTROLLER_OUTPUT",
        "ATTITUDE_TARGET",
        "POSITION_TARGET_LOCAL_NED",
    )
)
"""Streams that a ground station often requests, at 2 to 4 Hz. They are requested only if the first
measurement does not find them: each request costs an acknowledgment, which MAVProxy prints. All
other streams are requested at once."""
LOW = 0.5
"""Fraction of the requested rate below which a stream is requested again."""
RESULT_NAMES = {
    value: entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for value, entry in dialect.enums["MAV_RESULT"].items()
}
"""Names of MAV_RESULT values, human-readable."""


@dataclass(frozen=True, slots=True)
class Command:
    """A MAV_CMD number with its parameters. Missing parameters are 0."""

    number: int
    params: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Result of a command: a MAV_RESULT, or None without an answer."""

    command: Command
    result: int | None

    @property
    def accepted(self) -> bool:
        return self.result == 0  # MAV_RESULT_ACCEPTED

    @property
    def refused(self) -> bool:
        """True if the vehicle rejected the command. A missing answer is not a rejection."""
        return self.result is not None and not self.accepted

    @property
    def answer(self) -> str:
        return (
            "no answer"
            if self.result is None
            else RESULT_NAMES.get(self.result, f"result {self.result}")
        )


@dataclass(slots=True)
class _Pending:
    command: Command
    due: float
    began: float
    last: float
    sent: int = 0
    in_progress: int = 0


class CommandSender:
    """Sender of commands. At most one command of each number is pending at a time.

    An answer contains only the command number. The next command of that number waits until the
    previous command is finished and late answers to it can no longer arrive.
    """

    def __init__(self) -> None:
        self._queue: list[Command] = []
        self._pending: dict[int, _Pending] = {}
        self._results: list[CommandResult] = []
        self._held: dict[int, float] = {}
        """Time until which late answers to finished commands may arrive, s, by command number."""
        # Newest answers kept to recognize a duplicate that arrives by another route.
        self._newest: deque[bytes] = deque(maxlen=16)
        self._owed: Counter[int] = Counter()
        """Number of answers that may still arrive, by command number."""
        self._unasked: deque[float] = deque(maxlen=UNASKED)

    def sent(self, number: int) -> None:
        """Count the answers expected for a command that is sent. PX4 answers a mode change
        twice."""
        answers = 2 if number == dialect.MAV_CMD_DO_SET_MODE else 1
        # 64: limit of the expected answers per command number, more than the commands that are sent
        # while a link is lost.
        self._owed[number] = min(self._owed[number] + answers, 64)

    def answered_unasked(self, now: float) -> bool:
        """True if answers arrive to commands that we did not send: another program sends commands
        with our ids."""
        return len(self._unasked) == UNASKED and now - self._unasked[0] <= UNASKED_WITHIN

    def send(self, command: Command) -> None:
        """Queue a command, unless it is already queued or pending."""
        under_way = self._pending.get(command.number)
        if command not in self._queue and (under_way is None or under_way.command != command):
            self._queue.append(command)

    def clear(self) -> None:
        """Drop all commands after the link to their vehicle is lost."""
        self._queue.clear()
        self._pending.clear()
        self._held.clear()

    def drop(self, number: int) -> bool:
        """Drop the commands of this number and do not wait for late answers. Return True if any
        command was dropped."""
        waited = len(self._queue)
        self._queue = [command for command in self._queue if command.number != number]
        self._held.pop(number, None)
        return self._pending.pop(number, None) is not None or len(self._queue) < waited

    def take_results(self) -> list[CommandResult]:
        results = self._results
        self._results = []
        return results

    def acknowledge(self, ack: Message, us: Ids, now: float) -> None:
        """Match a COMMAND_ACK of our vehicle to its command.

        Answers to other systems are ignored. A frame that arrives by two routers is processed once.
        """
        frame = bytes(ack.get_msgbuf())
        target = (ack.target_system, ack.target_component)
        known = frame in self._newest
        repeated = bool(self._newest) and self._newest[-1] == frame
        self._newest.append(frame)
        if target[0] not in (0, us[0]) or target[1] not in (0, us[1]) or repeated:
            return
        ends = ack.result != dialect.MAV_RESULT_IN_PROGRESS
        if ends and not known:
            self._settle(ack.command, target == us, now)
        pending = self._pending.get(ack.command)
        if pending is None:
            return
        if ends:
            self._end(pending, ack.result, now)
        # 3: limit of IN_PROGRESS answers per command, so that a vehicle cannot keep a command
        # pending forever.
        elif pending.in_progress < 3:
            # 3.0: time, s, for which an IN_PROGRESS answer extends the wait (three heartbeats).
            pending.due = now + 3.0
            pending.sent = 1 + RETRIES
            pending.in_progress += 1

    def _settle(self, number: int, to_us: bool, now: float) -> None:
        """Take an answer off the expected ones. An unexpected answer to us shows that another
        program uses our ids."""
        if self._owed[number] > 0:
            self._owed[number] -= 1
        elif to_us:
            self._unasked.append(now)

    def poll(self, target: Ids, now: float, mode_age: float = 0.0) -> list[Message]:
        """Return the messages due now: first tries and repeats, with `confirmation` counting the
        repeats. mode_age: age of the newest report of the vehicle's mode, s."""
        for pending in list(self._pending.values()):
            if now >= pending.due and pending.sent > RETRIES:
                self._end(pending, None, now)
        self._start_queued(now)
        # 0.1: largest age of the mode, s, at which a mode request is repeated. A repeat replaces
        # any mode that the operator has entered since the newest report.
        repeats_mode = mode_age <= 0.1
        due = [
            pending
            for pending in self._pending.values()
            if now >= pending.due
            and (
                repeats_mode
                or pending.sent == 0
                or pending.command.number != dialect.MAV_CMD_DO_SET_MODE
            )
        ]
        for pending in due:
            # 0.5: time, s, until an unanswered command is repeated (as in MAVSDK).
            pending.due = now + 0.5
            pending.last = now
            pending.sent = pending.sent + 1
        return [once(pending.command, target, pending.sent - 1) for pending in due]

    def _start_queued(self, now: float) -> None:
        """Start the queued commands of each number that has no pending command and expects no late
        answer."""
        waiting = self._queue
        self._queue = []
        for command in waiting:
            if command.number in self._pending or now < self._held.get(command.number, now):
                self._queue.append(command)
            else:
                self._pending[command.number] = _Pending(command, now, now, now)

    def _end(self, pending: _Pending, result: int | None, now: float) -> None:
        number = pending.command.number
        del self._pending[number]
        # After repeats, this answer may belong to any of the tries, and answers to the remaining
        # tries may follow. They may arrive within 1.2 times the time between the first and the last
        # try (0 after a single try).
        self._held[number] = now + 1.2 * (pending.last - pending.began)
        self._results.append(CommandResult(pending.command, result))


def once(command: Command, target: Ids, confirmation: int = 0) -> Message:
    """Return the message of a command without tracking its answer. confirmation: number of earlier
    tries."""
    params = command.params + (0.0,) * (7 - len(command.params))
    return dialect.MAVLink_command_long_message(*target, command.number, confirmation, *params)


@dataclass(slots=True)
class _Stream:
    """Stream with its wanted rate, Hz. optional: True if the vehicle may lack it."""

    wanted: float
    optional: bool
    asked: bool = False
    received: int = 0
    ever: bool = False
    denied: bool = False

    def is_low(self, elapsed: float, *, first: bool) -> bool:
        """End a measurement of this length, s. Return True if the stream must be requested
        again."""
        received = self.received
        self.received = 0
        self.ever |= received > 0
        # A stream that was requested during the first measurement has arrived for a part of it
        # only: its rate is still unknown.
        unknown = first and self.asked
        lacking = self.optional and self.asked and not self.ever
        is_low = received / elapsed < LOW * self.wanted
        return is_low and not (unknown or lacking or self.denied)


class StreamRequests:
    """Requests that keep the streams at their rates. Other clients change the rates, and a reboot
    resets them.

    A stream that already arrives at its rate is not requested.
    """

    def __init__(self, wanted: Mapping[int, float], maybe: Container[int] = ()) -> None:
        """wanted: message id -> Hz. maybe: ids of streams that the vehicle may lack. These streams
        are requested again only if they have been received before."""
        self._streams = {ident: _Stream(rate, ident in maybe) for ident, rate in wanted.items()}
        self._since: float | None = None
        self._is_first_check = True

    @property
    def refused(self) -> list[str]:
        """Names of the streams that the vehicle has denied."""
        return [
            dialect.mavlink_map[ident].msgname
            for ident, stream in self._streams.items()
            if stream.denied
        ]

    def received(self, message_id: int) -> None:
        if message_id in self._streams:
            self._streams[message_id].received += 1

    def restart(self) -> None:
        """Request all streams again after a new link or a reboot."""
        self._since = None

    def denied(self, result: CommandResult) -> None:
        """Stop requesting a stream that the vehicle denied, to save bandwidth."""
        if stream := self._streams.get(int(result.command.params[0])):
            stream.denied = True

    def poll(self, now: float) -> list[Command]:
        """Return the requests due now."""
        if self._since is None:
            self._since = now
            self._is_first_check = True
            self._streams = {
                ident: _Stream(stream.wanted, stream.optional)
                for ident, stream in self._streams.items()
            }
            return self._requests([ident for ident in self._streams if ident not in USUAL])
        elapsed = now - self._since
        first = self._is_first_check
        # 0.6: duration, s, of the first measurement, which checks whether the streams in USUAL
        # already arrive.
        if elapsed < (0.6 if first else CHECK_EVERY):
            return []
        self._since = now
        self._is_first_check = False
        return self._requests(
            [
                ident
                for ident, stream in self._streams.items()
                if stream.is_low(elapsed, first=first)
            ]
        )

    def _requests(self, idents: list[int]) -> list[Command]:
        """Return requests for these streams at their rates."""
        requests = []
        for ident in idents:
            stream = self._streams[ident]
            stream.asked = True
            interval = round(1e6 / stream.wanted)  # microseconds
            requests.append(Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (ident, interval)))
        return requests

    def give_back(self) -> list[Command]:
        """Return the requests that restore the vehicle's own rates of the requested streams. A
        second call returns none."""
        asked = [message_id for message_id, stream in self._streams.items() if stream.asked]
        for message_id in asked:
            self._streams[message_id].asked = False
        return [
            Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (message_id, 0)) for message_id in asked
        ]
