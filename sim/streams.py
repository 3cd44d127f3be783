"""Messages sent again and again on a link because somebody asked for them."""

from functools import partial

from sim.agenda import Agenda
from sim.autopilots.contract import ACCEPTED, DENIED, INFO, Say
from sim.flight import Flight
from sim.links import Link
from sim.telemetry import BUILDERS

STOP, DEFAULT = -1, 0
SLOWEST_US = 60_000_000


class Streams:
    """The schedule of every link. Intervals are whole milliseconds, as ArduPilot keeps them."""

    def __init__(self, agenda: Agenda, flight: Flight) -> None:
        self._agenda = agenda
        self._flight = flight

    def ask(self, link: Link, number: int, interval: float, say: Say) -> int:
        """MAV_CMD_SET_MESSAGE_INTERVAL, microseconds; the ack."""
        identity = self._flight.autopilot.identity
        if number not in identity.streamable:
            say(INFO, f"No ap_message for mavlink id ({number})")
            return DENIED
        if interval != interval or interval < STOP:
            return DENIED
        if interval == DEFAULT:
            default = identity.default_streams.get(number)
            self.run(link, number, default) if default else self.stop(link, number)
        elif interval == STOP:
            self.stop(link, number)
        elif interval < identity.fastest_us:
            say(INFO, f"Interval too short for mavlink id ({number})")
            return DENIED
        else:
            self.run(link, number, max(1_000, int(min(interval, SLOWEST_US)) // 1_000 * 1_000))
        return ACCEPTED

    def interval(self, link: Link, number: int) -> int:
        """Microseconds between two, -1 when it is not sent."""
        return link.intervals.get(number, STOP)

    def run(self, link: Link, number: int, interval: int) -> None:
        link.intervals[number] = interval
        self._appoint(link, number, self._flight.now + interval)

    def stop(self, link: Link, number: int) -> None:
        link.intervals.pop(number, None)
        self._agenda.drop(("stream", link.name, number))

    def stop_all(self, link: Link) -> None:
        for number in list(link.intervals):
            self.stop(link, number)

    def send_once(self, link: Link, number: int) -> bool:
        """Send one now; False when this vehicle has no such message or nothing to put in it."""
        build = BUILDERS.get(number)
        message = build(self._flight) if build else None
        if message is None:
            return False
        link.send(message)
        return True

    def _appoint(self, link: Link, number: int, due: int) -> None:
        self._agenda.put(("stream", link.name, number), due, partial(self._fire, link, number, due))

    def _fire(self, link: Link, number: int, due: int) -> None:
        self.send_once(link, number)
        self._appoint(link, number, due + link.intervals[number])
