"""The small protocols every ground station speaks: parameters, missions, time, requests."""

from pymavlink.dialects.v20 import all as mavlink

from sim.autopilots.ardupilot import STREAM_GROUPS
from sim.flight import Flight
from sim.links import Link
from sim.streams import Streams
from sim.wire import Message

PARAM_READ, PARAM_LIST, PARAM_SET = 20, 21, 23
MISSION_LIST, MISSION_COUNT, MISSION_ACK = 43, 44, 47
DATA_STREAM, TIMESYNC, FILE_TRANSFER = 66, 111, 110
FTP_REFUSED, FTP_FILE_NOT_FOUND = 129, 10
MISSION_UNSUPPORTED, MISSION_ACCEPTED = 3, 0
ALL_STREAMS = 0


class Services:
    """Answers to one message at a time, on the link it came from."""

    def __init__(self, flight: Flight, streams: Streams) -> None:
        self._flight = flight
        self._streams = streams
        self._actions = {
            PARAM_READ: self._param_read,
            PARAM_LIST: self._param_list,
            PARAM_SET: self._param_set,
            MISSION_LIST: self._mission_list,
            MISSION_COUNT: self._mission_count,
            DATA_STREAM: self._data_stream,
            TIMESYNC: self._timesync,
            FILE_TRANSFER: self._file_transfer,
        }

    def answer(self, message: Message, link: Link) -> bool:
        """True if the message was one of these protocols."""
        action = self._actions.get(message.get_msgId())
        if action is not None:
            action(message, link)
        return action is not None

    def _param_read(self, message: Message, link: Link) -> None:
        self._reply(link, self._flight.autopilot.params.read(_text(message.param_id), message.param_index))

    def _param_list(self, message: Message, link: Link) -> None:
        for value in self._flight.autopilot.params.all_values():
            link.send(value)

    def _param_set(self, message: Message, link: Link) -> None:
        self._reply(link, self._flight.autopilot.params.write(_text(message.param_id), message.param_value))

    def _mission_list(self, message: Message, link: Link) -> None:
        link.send(mavlink.MAVLink_mission_count_message(*_sender(message), 0, message.mission_type))

    def _mission_count(self, message: Message, link: Link) -> None:
        """No missions are kept here: an upload of none is fine, any other is refused."""
        result = MISSION_ACCEPTED if message.count == 0 else MISSION_UNSUPPORTED
        link.send(mavlink.MAVLink_mission_ack_message(*_sender(message), result, message.mission_type))

    def _data_stream(self, message: Message, link: Link) -> None:
        """REQUEST_DATA_STREAM: the old way to ask, which MAVProxy uses."""
        groups = STREAM_GROUPS if message.req_stream_id == ALL_STREAMS else (message.req_stream_id,)
        for number in [n for group in groups for n in STREAM_GROUPS.get(group, ())]:
            if message.start_stop == 1 and message.req_message_rate > 0:
                fastest = self._flight.autopilot.identity.fastest_us
                self._streams.run(link, number, max(fastest, 1_000_000 // message.req_message_rate))
            else:
                self._streams.stop(link, number)

    def _timesync(self, message: Message, link: Link) -> None:
        if message.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message((self._flight.now - self._flight.booted) * 1000, message.ts1))

    def _file_transfer(self, message: Message, link: Link) -> None:
        """There are no files: saying so spares a ground station its timeouts."""
        asked = message.payload
        sequence = (asked[0] | asked[1] << 8) + 1 & 0xFFFF
        header = [sequence & 0xFF, sequence >> 8, asked[2], FTP_REFUSED, 1, asked[3], 0, 0, 0, 0, 0, 0]
        payload = [*header, FTP_FILE_NOT_FOUND]
        system, component = _sender(message)
        answer = [*payload, *[0] * (len(asked) - len(payload))]
        link.send(mavlink.MAVLink_file_transfer_protocol_message(0, system, component, answer))

    @staticmethod
    def _reply(link: Link, message: Message | None) -> None:
        if message is not None:
            link.send(message)


def _text(field: str | bytes) -> str:
    return field.decode("ascii", "replace") if isinstance(field, bytes) else str(field)


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()
