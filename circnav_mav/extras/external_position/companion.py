"""MAVLink component of the external position. Input: reports of the autopilot. Output: positions.
It has no socket and no clock.

It sends as a separate component, so the frames of the pilot and of the locator stay the same, byte
for byte. It sends only the message types in `SENT_TYPES`: none of them moves the vehicle.
"""

from cmath import phase, rect
from collections.abc import Hashable, Iterable

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.external_position.external_position import (
    FUSES,
    REPORTS,
    DeadReckoning,
    ExternalPosition,
    Health,
)
from circnav_mav.extras.external_position.settings import ExternalPositionSettings
from circnav_mav.extras.locate.estimator import HEIGHT_UNKNOWN
from circnav_mav.extras.locate.locator import STREAMS, Locator, place_of, vehicle_frames
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.mav.codec import Decoder, Encoder, Message
from circnav_mav.mav.commands import CommandSender, StreamRequests, once
from circnav_mav.mav.own_motion import ATTITUDE_MAX_AGE
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot import OutputMode, Pilot
from circnav_mav.pilot.method import RECEIVERS

SECOND = dialect.MAVLINK_MSG_ID_GPS2_RAW
"""Message id of the report of a second GPS receiver. Not every vehicle has one."""
WANTED = frozenset({
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT, SECOND,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK, *REPORTS.values(),
})  # fmt: skip
AFTER = {dialect.MAVLINK_MSG_ID_ATTITUDE: 10.0, dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0}
"""Streams that dead reckoning needs after the pilot has released its own streams: rate in Hz, by
message id."""
SENT_TYPES = frozenset({"COMMAND_LONG", "COMMAND_INT"})
"""Message types that the external position may send. Commands are limited to COMMANDS."""
COMMANDS = frozenset(
    {dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE}
)
GONE = 10.0
"""Age of the vehicle's newest heartbeat, s, above which no position is handed back."""


class Companion:
    """External position component. It receives the same frames as the pilot, after the pilot and
    the locator, and changes neither."""

    def __init__(
        self,
        settings: ExternalPositionSettings,
        pilot: Pilot,
        locator: Locator,
        signing: Signing | None = None,
    ) -> None:
        self._pilot = pilot
        self._locator = locator
        self._decoder = Decoder(wanted=WANTED)
        self._encoder = Encoder(1, settings.component, signing)
        self._commands = CommandSender()
        self._streams: StreamRequests | None = None
        self.external_position = ExternalPosition()
        self._health = Health()
        self.reckoning = DeadReckoning()
        self._given = None if settings.place is None else Plane(*settings.place)
        self._compared_to = float("-inf")
        """Time of the newest position with which the compass was compared, s."""
        self._alone = False
        """True after guidance has ended while positions are handed back."""
        self._ended = False
        self.called_off = False
        """True if no position may be handed back after guidance has ended."""
        self._now = 0.0

    @property
    def plane(self) -> Plane | None:
        """Plane in which all positions are expressed. None if the mission gives no place and the
        locator has no position yet."""
        return self._given or self._locator.plane

    # --- in

    def on_frames(self, link: str, source: Hashable, frames: Iterable[bytes], now: float) -> None:
        """Process complete, trusted frames after the pilot and the locator have processed them.
        now: run time, s."""
        for ident, frame in vehicle_frames(self._pilot.session, link, source, frames):
            if self._streams is not None:
                self._streams.received(ident)
            for message in self._decoder.decode(frame) if ident in WANTED else ():
                self._take(message, now)
        self._compare_compass(now)

    def _take(self, message: Message, now: float) -> None:
        kind = message.get_type()
        if kind in RECEIVERS or kind in FUSES:
            self._health.on_message(message, now)
        elif kind == "COMMAND_ACK":
            us = self._encoder.ids
            self._commands.acknowledge(message, us, now)
            self.external_position.answered(message, us, now)
        elif self.plane is not None and (place := place_of(message)) is not None:
            east, north = self.plane.to_metres(*place)
            self.external_position.reported(east, north, self.reckoning.where, now)

    def _compare_compass(self, now: float) -> None:
        """Compare two bearings of the estimated position: by the compass, and by the newest
        position with a GPS fix."""
        place = self._locator.place
        position = self._locator.newest_position
        newest = self._pilot.tracker.newest
        if place is None or position is None or newest is None:
            return
        time, east, north, _ = position
        # Compare the compass only while the newest range is less than 1 s old.
        if time <= self._compared_to or now - newest.time >= 1.0:
            return
        self._compared_to = time
        estimate = self._pilot.tracker.estimator.at(time)
        relative = estimate.relative if estimate else None
        there = place.at(time)
        way = complex(there.east - east, there.north - north)
        if relative is not None and relative.trusted and abs(way) > 10:
            off = phase(complex(-relative.x, -relative.y) / way)
            self.reckoning.compass.learn(rect(1.0, off), now)

    # --- out

    @property
    def busy(self) -> bool:
        """True if work remains after the end of guidance: positions to hand back, then streams to
        release."""
        return self._gives or (self._alone and not self._ended and self._pilot.session.up)

    @property
    def after_guidance(self) -> bool:
        """True while positions are handed back after the end of guidance."""
        return self._pilot.done and self._gives

    @property
    def _gives(self) -> bool:
        session = self._pilot.session
        if not self.external_position.begun or self.called_off:
            return False
        return session.vehicle.armed and session.heartbeat_age(self._now) < GONE

    def step(self, now: float) -> list[bytes]:
        """Return the frames to send now."""
        session = self._pilot.session
        mode = self._pilot.output_mode
        self._now = now
        if session.peer is None or mode is OutputMode.SHADOW:
            return []
        self._encoder.system = session.encoder.system
        messages = self._stream(session.peer.ids, now)
        for result in self._commands.take_results():
            if result.refused and self._streams is not None:
                self._streams.denied(result)
        messages += self._commands.poll(session.peer.ids, now)
        if mode is OutputMode.FLY:
            messages += self._give_back(session.peer.ids, now)
        return [self._encode(message) for message in messages]

    def _stream(self, target: tuple[int, int], now: float) -> list[Message]:
        """Request the streams that are due. At the end, return the requests that restore the
        vehicle's own rates."""
        session = self._pilot.session
        done = self._pilot.done
        if self._streams is None or (done and not self._alone and self._gives):
            # After guidance, pilot and locator have released their own streams.
            self._alone = done
            health = {REPORTS[session.adapter.firmware.key]: 2.0, SECOND: 2.0}
            self._streams = StreamRequests(
                health | (STREAMS | AFTER if done else {}), maybe={SECOND}
            )
        if not done or self._gives:
            for request in self._streams.poll(now):
                self._commands.send(request)
            return []
        self._ended = True
        return [once(request, target) for request in self._streams.give_back()]

    def _place(self, now: float) -> Place | None:
        """Return the target's place: the place given by the mission, else the estimated position.
        None if it is unknown."""
        if self._given is not None:
            return Place(
                now, self._given, 0.0, 0.0, 0.0, np.eye(2), up_sigma=HEIGHT_UNKNOWN, up_known=False
            )
        estimated = self._locator.place
        return None if estimated is None else estimated.at(now)

    def _give_back(self, target: tuple[int, int], now: float) -> list[Message]:
        """Return the command with a position for an autopilot that has lost its own, if a command
        is due."""
        tracker = self._pilot.tracker
        if self.plane is None:
            return []
        # 2.0: largest age of the newest range with which the range filter is used, s.
        fresh = tracker.newest is not None and now - tracker.newest.time < 2.0
        self.reckoning.step(
            now, self._own(now), self._place(now), tracker.estimator.at(now) if fresh else None
        )
        good = self._health.good(now) if self._pilot.session.vehicle.armed else None
        message = self.external_position.step(
            now, good=good, where=self.reckoning.where, plane=self.plane, target=target
        )
        return [] if message is None else [message]

    def _own(self, now: float) -> OwnMotion | None:
        """Return the vehicle's motion through the air, or None if it is stale."""
        own = self._pilot.own
        return own if own is not None and now - own.time <= ATTITUDE_MAX_AGE else None

    def _encode(self, message: Message) -> bytes:
        """Return one frame. Raises ValueError if the external position must not send this
        message."""
        kind = message.get_type()
        if kind not in SENT_TYPES or message.command not in COMMANDS:
            raise ValueError(f"the external position must not send {kind}")
        return self._encoder.encode(message)
