"""The links of a mission and the session with its vehicle: what a pilot and a survey have in common."""

from collections.abc import Hashable, Iterable, Iterator

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT
from circnav_mav.mav.parameter_server import REQUESTS
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.session import HANDLED, HEARTBEAT_PERIOD, Session
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.settings import LINKS, RANGING, VEHICLE, PilotSettings

HOME_RATE = 1.0
"""Rate, Hz, of HOME_POSITION where the height counts from home, which may be set anew until the engagement."""


class Connection:
    """Decodes what comes in on each link; encodes nothing but the greeting of a ranging link."""

    def __init__(self, settings: PilotSettings, signing: Signing | None, also: Iterable[int] = ()) -> None:
        """signing: signs what is sent and tells who is believed; None: neither. also: more message ids to decode."""
        self.ranging_message = RANGING_MESSAGES[settings.ranging.message]
        self.more_streams: dict[int, float] = {}
        """Streams to ask for beside the adapter's, message id -> Hz: ranges that the autopilot sends, and home."""
        if settings.ranging.component_id == AUTOPILOT_COMPONENT and not settings.ranging_apart:
            self.more_streams[self.ranging_message.id] = settings.ranging.rate_hz
        if settings.height.target_above_home is not None:
            self.more_streams[dialect.MAVLINK_MSG_ID_HOME_POSITION] = HOME_RATE
        vehicles = adapters(settings.autopilot, settings.kind, settings.facts)
        self.session = Session(settings.link, vehicles, self.more_streams, signing)
        self.ranging_link = RANGING if settings.ranging_apart else VEHICLE
        self.decoders = {
            link: Decoder(
                stream=link in settings.stream_links,
                wanted=HANDLED | REQUESTS | {self.ranging_message.id, *self.more_streams, *also},
                signing=signing,
                accept_unsigned=link in settings.unsigned_links,
            )
            for link in LINKS
        }
        self.counts = {link: decoder.counts for link, decoder in self.decoders.items()}
        """What came in on each link."""
        self._next_hello = float("-inf")

    def receive(self, data: bytes, now: float, source: Hashable, link: str) -> Iterator[tuple[Message, bool, bool]]:
        """One datagram (or chunk of a stream) that arrived at `now` from `source` on a link, message by message, each
        with whether it is of the pinned vehicle, and whether it may be a range: the mission's ranging message, on the
        link that ranging comes on."""
        decoder = self.decoders[link]
        for message in decoder.decode(data):
            of_vehicle = link == VEHICLE and self.session.receive(message, now, source)
            yield message, of_vehicle, link == self.ranging_link and message.get_msgId() == self.ranging_message.id
        if link == VEHICLE and decoder.behind:
            self.session.identity.greet(source, now)

    def hello(self, now: float) -> bytes:
        """What goes out on a separate ranging link: a heartbeat, for routers forward only to those who have spoken."""
        if now < self._next_hello:
            return b""
        self._next_hello = now + HEARTBEAT_PERIOD
        return self.session.encode(self.session.heartbeat())
