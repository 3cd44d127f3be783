"""Links of a mission and session with its vehicle, used by `Pilot` and `PreflightListener`."""

from collections.abc import Hashable, Iterable, Iterator

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT, Allowance, LinkSettings, Sender
from circnav_mav.mav.parameter_server import REQUESTS
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.request_server import ANSWERED
from circnav_mav.mav.session import HANDLED, HEARTBEAT_PERIOD, Session
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import LINKS, RANGING, VEHICLE, Mission
from circnav_mav.pilot.method import streams
from circnav_mav.timers import Every


class Connection:
    """Decodes the data of each link, and encodes the hello message of a ranging link."""

    def __init__(
        self, settings: Mission, signing: Signing | None, also: Iterable[int] = ()
    ) -> None:
        """signing: signs sent frames and authenticates received ones, or None. also: ids of further
        messages to decode."""
        self.ranging_message = RANGING_MESSAGES[settings.ranging.message]
        self.more_streams: dict[int, float] = {}
        """Streams to request in addition to the adapter's, message id -> Hz: the autopilot's
        ranges, and home."""
        if settings.ranging.component_id == AUTOPILOT_COMPONENT and not settings.ranging_apart:
            self.more_streams[self.ranging_message.id] = settings.ranging.rate_hz
        if settings.file.orbit.target_above_home_m is not None:
            # HOME_POSITION at 1 Hz, if the height is relative to home. Home may change until the
            # engagement.
            self.more_streams[dialect.MAVLINK_MSG_ID_HOME_POSITION] = 1.0
        self.more_streams.update(streams(settings))
        file = settings.file
        vehicles = adapters(*settings.vehicle_key, settings.facts)
        ids = LinkSettings(file.vehicle.system_id, file.link.component_id)
        self.session = Session(ids, vehicles, self.more_streams, signing)
        self.ranging_link = RANGING if settings.ranging_apart else VEHICLE
        self.decoders = {
            link: Decoder(
                stream=link in settings.stream_links,
                wanted=HANDLED
                | REQUESTS
                | ANSWERED
                | {self.ranging_message.id, *self.more_streams, *also},
                signing=signing,
                accept_unsigned=link in settings.unsigned_links,
            )
            for link in LINKS
        }
        self.counts = {link: decoder.counts for link, decoder in self.decoders.items()}
        """Counts of received frames by link."""
        self.allowance = Allowance()
        self._frames: list[bytes] = []
        self._hello_timer = Every(HEARTBEAT_PERIOD)

    def receive(
        self, data: bytes, now: float, source: Hashable, link: str
    ) -> Iterator[tuple[Message, bool, bool]]:
        """Yield the messages of a datagram (or chunk of a stream) that arrived at `now` from
        `source` on a link.

        Each message is yielded with two flags. The first is True if the session's vehicle sent the
        message. The second is True if the message may be a range: the mission's ranging message on
        the ranging link.
        """
        decoder = self.decoders[link]
        for message in decoder.decode(data):
            of_vehicle = link == VEHICLE and self.session.receive(message, now, source)
            yield (
                message,
                of_vehicle,
                link == self.ranging_link and message.get_msgId() == self.ranging_message.id,
            )
        if link == VEHICLE and decoder.behind:
            self.session.identity.say_hello(source, now)
        self._frames += decoder.frames

    def admits(
        self, size: int, now: float, source: Hashable, link: str, radio: Sender | None
    ) -> bool:
        """True if a datagram must be read. Data of the vehicle and the ranging radio are always
        read, data of other senders up to an allowance. radio: trusted radio, or None."""
        peer = self.session.peer
        if (peer if link == VEHICLE else radio) is None:
            return True
        trusted = {
            sender.source
            for sender, of_link in ((peer, VEHICLE), (radio, self.ranging_link))
            if sender is not None and link == of_link
        }
        return source in trusted or self.allowance.take(size, now)

    @property
    def no_vehicle(self) -> str:
        """Reason why no vehicle of the mission was found, human-readable."""
        misfits = "; ".join(self.session.identity.misfits.values())
        return misfits or f"no autopilot heartbeat, {self.counts[VEHICLE].describe()}"

    def take_frames(self) -> list[bytes]:
        """Return the complete frames received on all links since the last call."""
        frames = self._frames
        self._frames = []
        return frames

    def hello(self, now: float) -> bytes:
        """Return the frames for a separate ranging link: a heartbeat, because routers forward
        messages only to senders that they have received."""
        return self.session.encode(self.session.heartbeat()) if self._hello_timer.due(now) else b""
