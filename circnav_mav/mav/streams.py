"""Telemetry streams: asked for with SET_MESSAGE_INTERVAL, measured, asked for again when they fall away."""

from collections.abc import Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.commands import Command

CHECK_EVERY = 3.0
LOW = 0.5
"""Fraction of the wanted rate below which a stream is asked for again."""


@dataclass(slots=True)
class _Stream:
    wanted: float
    heard: int = 0
    rate: float | None = None
    denied: bool = False


class StreamRequests:
    """Keeps the wanted streams flowing: other clients reset rates, and a reboot forgets them."""

    def __init__(self, wanted: Mapping[int, float]) -> None:
        """wanted: message id -> Hz."""
        self._streams = {message_id: _Stream(rate) for message_id, rate in wanted.items()}
        self._since: float | None = None

    @property
    def rates(self) -> dict[int, float | None]:
        """Measured rate of each wanted stream in Hz, None before the first check."""
        return {message_id: stream.rate for message_id, stream in self._streams.items()}

    @property
    def refused(self) -> list[str]:
        """Names of the streams that the vehicle has denied."""
        return [dialect.mavlink_map[ident].msgname for ident, stream in self._streams.items() if stream.denied]

    def heard(self, message_id: int) -> None:
        if message_id in self._streams:
            self._streams[message_id].heard += 1

    def restart(self) -> None:
        """Ask for everything anew: a new link or a rebooted vehicle."""
        self._since = None

    def denied(self, command: Command) -> None:
        """The vehicle denied a stream: asking again would only fill the link."""
        if stream := self._streams.get(int(command.params[0])):
            stream.denied = True

    def poll(self, now: float) -> list[Command]:
        """The requests due now."""
        if self._since is None:
            self._since = now
            self._streams = {message_id: _Stream(stream.wanted) for message_id, stream in self._streams.items()}
            return [_interval(message_id, stream.wanted) for message_id, stream in self._streams.items()]
        elapsed = now - self._since
        if elapsed < CHECK_EVERY:
            return []
        self._since, requests = now, []
        for message_id, stream in self._streams.items():
            stream.rate, stream.heard = stream.heard / elapsed, 0
            if stream.rate < LOW * stream.wanted and not stream.denied:
                requests.append(_interval(message_id, stream.wanted))
        return requests

    def give_back(self) -> list[Command]:
        """The requests that restore the vehicle's own rates."""
        return [Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (message_id, 0)) for message_id in self._streams]


def _interval(message_id: int, rate: float) -> Command:
    """MAV_CMD_SET_MESSAGE_INTERVAL: p1 id, p2 microseconds."""
    return Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (message_id, round(1e6 / rate)))
