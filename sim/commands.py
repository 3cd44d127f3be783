"""COMMAND_LONG and COMMAND_INT: what the vehicle itself answers, the rest goes to the autopilot."""

from pymavlink.dialects.v20 import all as mavlink

from sim.autopilots.contract import ACCEPTED, DENIED, FAILED, Command, Say
from sim.flight import Flight
from sim.links import Link
from sim.streams import Streams
from sim.wire import Message

COMMAND_LONG, COMMAND_INT = 76, 75
GET_INTERVAL, SET_INTERVAL, REQUEST_MESSAGE, REQUEST_CAPABILITIES, GET_HOME = 510, 511, 512, 520, 410
AUTOPILOT_VERSION, HOME_POSITION, MESSAGE_INTERVAL = 148, 242, 244


class Commands:
    """One command in, its acks out."""

    def __init__(self, flight: Flight, streams: Streams, say: Say) -> None:
        self._flight = flight
        self._streams = streams
        self._say = say

    def obey(self, message: Message, link: Link) -> None:
        command = read_command(message)
        for result in self._results(command, link):
            link.send(mavlink.MAVLink_command_ack_message(command.number, result, 0, 0, *command.sender))

    def _results(self, command: Command, link: Link) -> tuple[int, ...]:
        first = _whole(command.params[0])
        if command.number == SET_INTERVAL:
            return (self._streams.ask(link, first, command.params[1], self._say),)
        if command.number == GET_INTERVAL:
            return (self._tell_interval(link, first),)
        if command.number == REQUEST_MESSAGE:
            return (self._send_once(link, first),)
        if command.number == REQUEST_CAPABILITIES:
            return (self._send_once(link, AUTOPILOT_VERSION),)
        if command.number == GET_HOME:
            return (self._send_once(link, HOME_POSITION),)
        return self._flight.autopilot.command(command, self._flight.now, self._flight.body)

    def _send_once(self, link: Link, number: int) -> int:
        if number not in self._flight.autopilot.identity.streamable:
            return DENIED
        return ACCEPTED if self._streams.send_once(link, number) else FAILED

    def _tell_interval(self, link: Link, number: int) -> int:
        if not 0 <= number <= 65535:
            return DENIED
        link.send(mavlink.MAVLink_message_interval_message(number, self._streams.interval(link, number)))
        return ACCEPTED


def read_command(message: Message) -> Command:
    """Either message as a Command; COMMAND_INT's scaled integers become degrees."""
    params = (message.param1, message.param2, message.param3, message.param4)
    sender = (message.get_srcSystem(), message.get_srcComponent())
    if message.get_msgId() == COMMAND_INT:
        return Command(message.command, params, message.x * 1e-7, message.y * 1e-7, message.z, sender)
    return Command(message.command, params, message.param5, message.param6, message.param7, sender)


def _whole(value: float) -> int:
    """A message id sent as a float; anything else is no id."""
    return int(value) if 0 <= value < 2**24 else -1
