"""Messages sent again and again on a link because somebody asked for them, or because this autopilot always does."""

from functools import partial

from .agenda import Agenda
from .autopilots.contract import Ack, Say, Severity
from .flight import Flight
from .links import Link
from .telemetry import BUILDERS

STOP, DEFAULT = -1, 0
SLOWEST_US = 60_000_000
HEARTBEAT, DISTANCE_SENSOR = 0, 132
HEARTBEAT_US = 1_000_000
PX4 = 12


class Streams:
    """The schedule of every link. ArduPilot keeps intervals in whole milliseconds."""

    def __init__(self, agenda: Agenda, flight: Flight) -> None:
        self._agenda = agenda
        self._flight = flight
        self._range_sent: dict[str, int] = {}

    def open(self, link: Link) -> None:
        """A new link: a heartbeat at once and then whatever this autopilot sends unasked."""
        self._agenda.put(("stream", link.name, "first"), self._flight.now, partial(self.send_once, link, HEARTBEAT))
        self.run(link, HEARTBEAT, HEARTBEAT_US)
        if self._flight.config.vehicle.default_streams:
            for number, interval in self._flight.autopilot.identity.default_streams.items():
                self.run(link, number, interval)

    def ask(self, link: Link, number: int, interval: float, say: Say) -> int:
        """MAV_CMD_SET_MESSAGE_INTERVAL, microseconds; the ack."""
        identity = self._flight.autopilot.identity
        refused = number not in identity.streamable
        if refused and identity.autopilot != PX4:
            say(Severity.INFO, f"No ap_message for mavlink id ({number})")
        if refused or interval != interval or interval < STOP:
            return identity.interval_refusal
        if interval == DEFAULT:
            self._run_default(link, number)
        elif interval == STOP:
            self.stop(link, number)
        elif interval < identity.fastest_us:
            say(Severity.INFO, f"Interval too short for mavlink id ({number})")
            return identity.interval_refusal
        else:
            self.run(link, number, max(1_000, int(min(interval, SLOWEST_US)) // 1_000 * 1_000))
        return Ack.ACCEPTED

    def _run_default(self, link: Link, number: int) -> None:
        default = HEARTBEAT_US if number == HEARTBEAT else self._flight.autopilot.identity.default_streams.get(number)
        if default is None:
            self.stop(link, number)
        else:
            self.run(link, number, default)

    def run(self, link: Link, number: int, interval: int) -> None:
        link.intervals[number] = interval
        if number != DISTANCE_SENSOR or not self._flight.autopilot.identity.ranges_on_update:
            self._appoint(link, number, self._flight.now + interval)

    def stop(self, link: Link, number: int) -> None:
        link.intervals.pop(number, None)
        self._agenda.drop(("stream", link.name, number))

    def forget_all(self, links: list[Link]) -> None:
        """A reboot: nobody has asked for anything."""
        self._agenda.drop_all("stream")
        for link in links:
            link.intervals.clear()

    def send_once(self, link: Link, number: int) -> bool:
        """Send one now; False when this vehicle has no such message or nothing to put in it."""
        build = BUILDERS.get(number)
        message = build(self._flight) if build else None
        if message is None:
            return False
        link.send(message)
        return True

    def range_updated(self, links: list[Link]) -> None:
        """A new sample at a rangefinder driver that reports on update: PX4 sends it once, where it is asked for."""
        now = self._flight.now
        for link in links:
            interval = link.intervals.get(DISTANCE_SENSOR)
            if interval is not None and now - self._range_sent.get(link.name, -interval) >= interval * 0.9:
                self._range_sent[link.name] = now
                self.send_once(link, DISTANCE_SENSOR)

    def _appoint(self, link: Link, number: int, due: int) -> None:
        self._agenda.put(("stream", link.name, number), due, partial(self._fire, link, number, due))

    def _fire(self, link: Link, number: int, due: int) -> None:
        self.send_once(link, number)
        self._appoint(link, number, due + link.intervals[number])
