"""MAVLink services: commands, parameters, missions, time synchronization, requests and message
streams.

Commands about streams are answered here. All other commands are passed to the autopilot.
"""

from functools import partial

from pymavlink.dialects.v20 import all as mavlink

from .agenda import Agenda
from .autopilots.ardupilot import DO_SET_MODE, STREAM_GROUPS
from .autopilots.contract import Ack, Command, Say, Severity
from .flight import Flight
from .links import Link, Message
from .telemetry import BUILDERS

GET_INTERVAL = 510
SET_INTERVAL = 511
REQUEST_MESSAGE = 512
REQUEST_CAPABILITIES = 520
GET_HOME = 410
AUTOPILOT_VERSION = 148
HOME_POSITION = 242
FTP_REFUSED = 129
FTP_FILE_NOT_FOUND = 10
MISSION_UNSUPPORTED = 3
MISSION_ACCEPTED = 0
ALL_STREAMS = 0
RELATIVE = 3  # MAV_FRAME_GLOBAL_RELATIVE_ALT
STOP = -1
DEFAULT = 0
SLOWEST_US = 60_000_000
HEARTBEAT = 0
DISTANCE_SENSOR = 132
HEARTBEAT_US = 1_000_000
PX4 = 12


class Streams:
    """Message intervals of all links. ArduPilot stores intervals in whole milliseconds."""

    def __init__(self, agenda: Agenda, flight: Flight) -> None:
        self._agenda = agenda
        self._flight = flight
        self._range_sent: dict[str, int] = {}

    def open(self, link: Link) -> None:
        """Start the streams of a new link: a heartbeat at once, then the default streams of this
        autopilot."""
        self._agenda.put(
            ("stream", link.name, "first"),
            self._flight.now,
            partial(self.send_once, link, HEARTBEAT),
        )
        self.run(link, HEARTBEAT, HEARTBEAT_US)
        if self._flight.config.vehicle.default_streams:
            for number, interval in self._flight.autopilot.identity.default_streams.items():
                self.run(link, number, interval)

    def ask(self, link: Link, number: int, interval: float, say: Say) -> int:
        """Handle MAV_CMD_SET_MESSAGE_INTERVAL and return the ack. interval: microseconds."""
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
        default = (
            HEARTBEAT_US
            if number == HEARTBEAT
            else self._flight.autopilot.identity.default_streams.get(number)
        )
        if default is None:
            self.stop(link, number)
        else:
            self.run(link, number, default)

    def run(self, link: Link, number: int, interval: int) -> None:
        link.intervals[number] = interval
        on_update = number == DISTANCE_SENSOR and self._flight.autopilot.identity.ranges_on_update
        # For a message that this vehicle lacks, the interval is only stored.
        if number in BUILDERS and not on_update:
            send = partial(self.send_once, link, number)
            first = self._flight.now + interval
            self._agenda.every(("stream", link.name, number), interval, first, send)

    def stop(self, link: Link, number: int) -> None:
        link.intervals.pop(number, None)
        self._agenda.drop(("stream", link.name, number))

    def send_once(self, link: Link, number: int) -> bool:
        """Send one message now. Return False if this vehicle lacks it or has no value for it."""
        build = BUILDERS.get(number)
        message = build(self._flight) if build else None
        if message is None:
            return False
        link.send(message)
        return True

    def range_updated(self, links: list[Link]) -> None:
        """Send a new sample of the rangefinder driver once on every link that requested it, as PX4
        does."""
        now = self._flight.now
        for link in links:
            interval = link.intervals.get(DISTANCE_SENSOR)
            if (
                interval is not None
                and now - self._range_sent.get(link.name, -interval) >= interval * 0.9
            ):
                self._range_sent[link.name] = now
                self.send_once(link, DISTANCE_SENSOR)


class Services:
    """Handlers of service messages. Each handler answers on the link on which the message was
    received."""

    def __init__(self, flight: Flight, streams: Streams, say: Say) -> None:
        self._flight = flight
        self._streams = streams
        self._say = say
        # Number of the next mode requests that are lost: themselves, or only their acks
        self._losses = {"request": 0, "ack": 0}
        self._actions = {
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "PARAM_REQUEST_READ": self._param_read,
            "PARAM_REQUEST_LIST": self._param_list,
            "PARAM_SET": self._param_set,
            "MISSION_REQUEST_LIST": self._mission_list,
            "MISSION_COUNT": self._mission_change,
            "MISSION_CLEAR_ALL": self._mission_change,
            "LOG_REQUEST_LIST": self._log_list,
            "REQUEST_DATA_STREAM": self._data_stream,
            "TIMESYNC": self._timesync,
            "FILE_TRANSFER_PROTOCOL": self._file_transfer,
        }

    def answer(self, message: Message, link: Link) -> bool:
        """Handle a message of these services. Return False if it belongs to none of them."""
        action = self._actions.get(message.get_type())
        if action is not None:
            action(message, link)
        return action is not None

    def lose(self, part: str, count: int) -> None:
        """Lose a part of the next requests of a mode (DO_SET_MODE): "request" or "ack"."""
        self._losses[part] = count

    def _loses(self, part: str, command: Command) -> bool:
        if command.number != DO_SET_MODE or self._losses[part] == 0:
            return False
        self._losses[part] -= 1
        return True

    def _command(self, message: Message, link: Link) -> None:
        command = read_command(message)
        if self._loses("request", command):
            return
        results = self._results(command, link)
        if self._loses("ack", command):
            return
        for result in results:
            link.send(
                mavlink.MAVLink_command_ack_message(command.number, result, 0, 0, *command.sender)
            )

    def _results(self, command: Command, link: Link) -> tuple[int, ...]:
        first = _whole(command.params[0])
        if command.number == SET_INTERVAL:
            return (self._streams.ask(link, first, command.params[1], self._say),)
        if command.number == GET_INTERVAL:
            return (self._send_interval(link, first),)
        asked = {
            REQUEST_MESSAGE: first,
            REQUEST_CAPABILITIES: AUTOPILOT_VERSION,
            GET_HOME: HOME_POSITION,
        }
        if command.number in asked:
            return (self._send_once(link, asked[command.number]),)
        return self._flight.autopilot.command(command, self._flight.now)

    def _send_once(self, link: Link, number: int) -> int:
        if number not in self._flight.autopilot.identity.streamable:
            return Ack.DENIED
        return Ack.ACCEPTED if self._streams.send_once(link, number) else Ack.FAILED

    def _send_interval(self, link: Link, number: int) -> int:
        if not 0 <= number <= 65535:
            return Ack.DENIED
        link.send(
            mavlink.MAVLink_message_interval_message(number, link.intervals.get(number, STOP))
        )
        return Ack.ACCEPTED

    def _param_read(self, message: Message, link: Link) -> None:
        link.send(self._flight.autopilot.params.read(message.param_id, message.param_index))

    def _param_list(self, message: Message, link: Link) -> None:
        for value in self._flight.autopilot.params.all_values():
            link.send(value)

    def _param_set(self, message: Message, link: Link) -> None:
        link.send(self._flight.autopilot.params.write(message.param_id, message.param_value))

    def _mission_list(self, message: Message, link: Link) -> None:
        link.send(mavlink.MAVLink_mission_count_message(*_sender(message), 0, message.mission_type))

    def _mission_change(self, message: Message, link: Link) -> None:
        """Accept clearing the mission and uploading an empty one. Refuse any other upload: missions
        are not stored."""
        result = MISSION_UNSUPPORTED if getattr(message, "count", 0) else MISSION_ACCEPTED
        link.send(
            mavlink.MAVLink_mission_ack_message(*_sender(message), result, message.mission_type)
        )

    def _log_list(self, message: Message, link: Link) -> None:
        """Send the entry for "no logs"."""
        link.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _data_stream(self, message: Message, link: Link) -> None:
        """Handle REQUEST_DATA_STREAM, the old request for streams, which MAVProxy uses."""
        groups = STREAM_GROUPS if message.req_stream_id == ALL_STREAMS else (message.req_stream_id,)
        for number in [n for group in groups for n in STREAM_GROUPS.get(group, ())]:
            if message.start_stop == 1 and message.req_message_rate > 0:
                fastest = self._flight.autopilot.identity.fastest_us
                self._streams.run(link, number, max(fastest, 1_000_000 // message.req_message_rate))
            else:
                self._streams.stop(link, number)

    def _timesync(self, message: Message, link: Link) -> None:
        if message.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(self._flight.boot_us * 1000, message.ts1))

    def _file_transfer(self, message: Message, link: Link) -> None:
        """Answer "file not found" to every request. Without an answer, a ground station would wait
        for its timeouts."""
        asked = message.payload
        sequence = (asked[0] | asked[1] << 8) + 1 & 0xFFFF
        header = [sequence & 0xFF, sequence >> 8, asked[2], FTP_REFUSED, 1, asked[3], *[0] * 6]
        answer = [*header, FTP_FILE_NOT_FOUND, *[0] * (len(asked) - 13)]
        link.send(mavlink.MAVLink_file_transfer_protocol_message(0, *_sender(message), answer))


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def read_command(message: Message) -> Command:
    """Return a COMMAND_LONG or COMMAND_INT as a Command. Scaled integers of COMMAND_INT become
    degrees."""
    params = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        place = (message.x * 1e-7, message.y * 1e-7, message.z)
        frame = message.frame
    else:
        place = (message.param5, message.param6, message.param7)
        frame = RELATIVE
    return Command(message.command, params, *place, _sender(message), frame)


def _whole(value: float) -> int:
    """Return a message id that was sent as a float, or -1 if it is not an id."""
    return int(value) if 0 <= value < 2**24 else -1
