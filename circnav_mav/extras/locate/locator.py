"""Live target localization: vehicle positions and ranges in, target estimate and its messages out. No socket, no clock.

The survey sends as a separate MAVLink component, so the pilot's frames stay the same, byte for byte. It sends only the
message types in `SENT_TYPES`: none of them moves the vehicle.
"""

from cmath import phase, rect
from collections import deque
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from itertools import islice
from math import hypot, isfinite, pi

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.conditions import RADIUS
from circnav_mav.extras.locate.estimator import Knowledge, NotLocated, Ranges, Track
from circnav_mav.extras.locate.export import named_values, orbit_status
from circnav_mav.extras.locate.handback import (
    FUSES,
    RECEIVERS,
    REPORTS,
    DeadReckoning,
    HandBack,
    HandBackSettings,
    Health,
)
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion, RangeSample, RelativeMotion
from circnav_mav.mav.clocks import BOOT_WRAP, Order, StampFilter
from circnav_mav.mav.codec import Decoder, Encoder, Message
from circnav_mav.mav.commands import CommandSender, StreamRequests, once
from circnav_mav.mav.framing import frame_at
from circnav_mav.mav.own_motion import ATTITUDE_MAX_AGE
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import Announcer
from circnav_mav.pilot import VEHICLE, OutputMode, Pilot

WANTED = frozenset({
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT, dialect.MAVLINK_MSG_ID_GPS2_RAW,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK, *REPORTS.values(),
})  # fmt: skip
STREAMS = {dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0, dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0}
SECOND = dialect.MAVLINK_MSG_ID_GPS2_RAW
"""Report of a second GPS receiver, which not every vehicle has."""
SENT_TYPES = frozenset({"NAMED_VALUE_FLOAT", "STATUSTEXT", "ORBIT_EXECUTION_STATUS", "COMMAND_LONG", "COMMAND_INT"})
"""Message types that the survey may send. Commands are limited to COMMANDS."""
COMMANDS = frozenset({dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE})
MOST_AHEAD = 5.0
"""Largest time, s, by which a vehicle's timestamp may be ahead of the estimate of its clock."""
WINDOW = 600.0
"""Length, s, of the window of positions and ranges used for the estimate."""
MOST_KEPT = 2000
"""Largest number of ranges kept. Above it, every second one is dropped: the pilot misses a tick when thousands are
passed to the process that runs `locate`."""
GONE = 10.0
"""Age of the newest heartbeat, s, after which no position is handed back."""
AFTER = {dialect.MAVLINK_MSG_ID_ATTITUDE: 10.0, dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0}
"""Streams for dead reckoning after the pilot has released its own streams: message id -> Hz."""
SOLVE_EVERY, MESSAGES_EVERY, TEXT_EVERY = 1.0, 1.0, 30.0
"""Shortest time, s, between two estimates, two map updates and two texts to the ground station; chosen."""
SOLVE_SHARE = 0.03
"""Shortest time between two estimates, as a share of the time span of the positions. An estimate takes up to 0.5 s, and
one more second of data adds little to a long track."""
HEIGHT_SIGMA = 5.0
"""Standard deviation, m, of a height given by the mission: drift of the barometer and error of the operator's value."""
HOME_SIGMA = 50.0
"""Standard deviation, m, of the target's altitude if the mission gives no height and the altitude of home is used."""
RADIUS_OFF = 0.02
"""Difference between the radius by ranges and by positions that raises an alarm, as a share of the radius. The
difference must also exceed the GPS error."""
COMPARED_LAPS, MIN_COMPARED, SETTLED = 1.2, 20, 0.05
"""Comparison of the radius by ranges with the radius by positions. Number of newest laps used. Smallest number of
positions and of ranges in these laps. Largest deviation of 90 % of the ranges from the range on the circle, as a share
of the radius: during the approach the mean distance is not a radius."""
FRESH_RANGE = 2.0
"""Largest age, s, of the newest range for which the range filter is used in the hand-back."""


@dataclass(frozen=True, slots=True)
class LocateSettings:
    """component: own MAVLink component id. gps_sigma: standard deviation of a position, m."""

    component: int
    gps_sigma: float = 1.5
    handback: HandBackSettings | None = None


class Locator:
    """Receives the same frames as the pilot, after the pilot, and does not change the pilot."""

    def __init__(self, settings: LocateSettings, pilot: Pilot, signing: Signing | None = None) -> None:
        self._settings, self._pilot = settings, pilot
        self._decoder = Decoder(wanted=WANTED)
        self._encoder = Encoder(1, settings.component, signing)
        self._announcer, self._commands = Announcer(), CommandSender()
        self._streams: StreamRequests | None = None
        self.plane: Plane | None = None
        self.place: Place | None = None
        self.why = "no position of the vehicle"
        """Human-readable reason why the place is unknown."""
        self.handback = HandBack(settings.handback) if settings.handback else None
        self._health, self._reckoning = Health(), DeadReckoning()
        self.only_hand_back = False
        """True if the survey has failed. The hand-back then continues with the last place of the target."""
        self.problem: str | None = None
        """Human-readable failure, or None."""
        self._track: deque[tuple[float, float, float, float]] = deque()
        self._ranges: deque[tuple[float, float, float]] = deque()
        self._accepted = 0
        self._gps_sigma = settings.gps_sigma
        self._home = 0.0
        self._clock = StampFilter(pilot.session.timesync.delay_increase, wrap=BOOT_WRAP)
        self._solve_at = self._messages_at = 0.0
        self._solved_to = float("-inf")
        self._announced_at = float("-inf")
        self._announced: Place | None = None
        self._alone = self._ended = False
        self.called_off = False
        """True if no position may be handed back after guidance has ended."""
        self._now = 0.0
        self.radius_alarm = ""
        """Human-readable error of the ranges on the circle, and the true radius. Empty if no error was found."""

    # --- in ---------------------------------------------------------------------------------------------------------

    def on_frames(self, link: str, source: Hashable, frames: Iterable[bytes], now: float) -> None:
        """Handle complete, trusted frames once the pilot has handled them. now: s."""
        session, tracker = self._pilot.session, self._pilot.tracker
        if link == VEHICLE and session.peer is not None and source == session.peer.source:
            for frame in frames:
                header = frame_at(frame, 0)  # most frames are not needed: checking the header is cheaper than decoding
                if header is None or (header.system, header.component) != session.vehicle_ids:
                    continue
                if self._streams is not None:
                    self._streams.received(header.ident)
                for message in self._decoder.decode(frame) if header.ident in WANTED else ():
                    self._take(message, now)
        fresh, self._accepted = tracker.accepted - self._accepted, tracker.accepted
        if not self.only_hand_back:
            for sample in list(tracker.recent)[-fresh:] if fresh > 0 else ():
                self._range(sample, now)

    def _take(self, message: Message, now: float) -> None:
        kind = message.get_type()
        if kind in RECEIVERS or kind in FUSES:
            self._health.on_message(message, now)
        if kind == "GPS_RAW_INT":
            reported = message.h_acc / 1000 / 1.414 if message.h_acc else 0.0  # per axis, m; 0 if not reported
            self._gps_sigma = max(self._settings.gps_sigma, min(reported, 100.0))
        elif kind == "COMMAND_ACK":
            us = self._encoder.system, self._settings.component
            self._commands.acknowledge(message, us, now)
            if self.handback is not None:
                self.handback.answered(message, us, now)
        elif kind == "GLOBAL_POSITION_INT" and 0 < max(abs(message.lat), abs(message.lon) / 2) <= 90e7:
            self._position(message, now)

    @property
    def track(self) -> list[tuple[float, float]]:
        """Latitude and longitude, degrees, of the vehicle positions used for the estimate."""
        if self.plane is None:
            return []
        return [self.plane.to_degrees(east, north) for _, east, north, _ in self._track]

    def _position(self, message: Message, now: float) -> None:
        latitude, longitude, up = message.lat / 1e7, message.lon / 1e7, message.alt / 1000
        fix = self._health.has_fix(now)
        if self.plane is None and fix:
            self.plane = Plane(latitude, longitude)
        if self.plane is None:
            return
        east, north = self.plane.to_metres(latitude, longitude)
        self._home = up - message.relative_alt / 1000
        if self.handback is not None:
            self.handback.reported(east, north, self._reckoning.where, now)
        if not fix or self.only_hand_back:
            return  # without a GPS fix the position is the autopilot's own dead reckoning
        # Use the vehicle's timestamp: with the arrival time, a delay of the link is a position error of meters.
        stamp = self._clock.unwrapped(message.time_boot_ms / 1000)
        order = self._clock.order(stamp, now, most_ahead=MOST_AHEAD)
        if order in (Order.OLDER, Order.JUMPED):
            return
        time = self._clock.local(stamp, now)
        self._clock.take(stamp, now)
        self._learn_compass(east, north, time, now)
        if not (self._track and time <= self._track[-1][0]):
            self._track.append((time, east, north, up))
            while now - self._track[0][0] > WINDOW:
                self._track.popleft()

    def _range(self, sample: RangeSample, now: float) -> None:
        if self._ranges and sample.time <= self._ranges[-1][0]:
            return
        slant = hypot(sample.r, self._pilot.tracker.height.at(now) or 0.0)
        self._ranges.append((sample.time, slant, max(sample.sigma * sample.r / max(slant, 1e-3), 0.02)))
        while self._ranges and now - self._ranges[0][0] > WINDOW:
            self._ranges.popleft()
        if len(self._ranges) > MOST_KEPT:  # keep every second range
            self._ranges = deque(islice(self._ranges, 0, None, 2))

    def _learn_compass(self, east: float, north: float, time: float, now: float) -> None:
        """Compare the bearings of the target by compass and by a reported position, if the newest range is less than
        1 s old. east, north: m. time: of the position, s. now: s."""
        place, newest, relative = self.place, self._pilot.tracker.newest, self._relative(time)
        if place is None or relative is None or newest is None or now - newest.time >= 1.0:
            return
        there = place.at(time)
        way = complex(there.east - east, there.north - north)
        if abs(way) > 10:
            off = phase(complex(-relative.x, -relative.y) / way)
            self._reckoning.compass.learn(rect(1.0, off), now)

    def _relative(self, time: float) -> RelativeMotion | None:
        """Return the position relative to the target by ranges and compass, or None if it is not trusted."""
        estimate = self._pilot.tracker.estimator.at(time)
        relative = estimate.relative if estimate else None
        return relative if relative is not None and relative.trusted else None

    # --- the estimate -----------------------------------------------------------------------------------------------

    def job(self, now: float) -> tuple[Plane, Track, Ranges, Knowledge, Place | None] | None:
        """Return the arguments of the next `locate` call, or None if none is due.

        The caller runs `locate` in another process, because a call takes several hundredths of a second.
        """
        if now < self._solve_at or self.plane is None or len(self._track) < 2 or not self._ranges:
            return None
        newest = self._track[-1][0]
        self._solve_at = now + max(SOLVE_EVERY, SOLVE_SHARE * (newest - self._track[0][0]))
        if newest == self._solved_to:
            return None
        self._solved_to = newest
        track = Track(*np.array(self._track).T)
        ranges = Ranges(*np.array(self._ranges).T)
        height = self._pilot.tracker.height.at(now)
        up, sigma = (self._home, HOME_SIGMA) if height is None else (self._track[-1][3] - height, HEIGHT_SIGMA)
        return self.plane, track, ranges, Knowledge(up=up, up_sigma=sigma, gps_sigma=self._gps_sigma), self.place

    def found(self, place: Place | NotLocated) -> None:
        """Process the result of a job. Keep the previous place if none was found."""
        if isinstance(place, Place):
            self.place = place
            self._compare_radius(place)
        else:
            self.why = place.why

    def _compare_radius(self, place: Place) -> None:
        """Compare the radius by ranges with the radius by positions. The vehicle keeps flying the radius by ranges."""
        before, self.radius_alarm = self.radius_alarm, ""
        if not self._track:
            return
        orbit, height = self._pilot.controller.orbit, self._pilot.tracker.height.at(place.time) or 0.0
        begin = self._track[-1][0] - COMPARED_LAPS * 2 * pi * orbit.radius / orbit.speed
        newest = [(place.at(time), east, north) for time, east, north, _ in self._track if time >= begin]
        ranges = np.array([slant for time, slant, _ in self._ranges if time >= begin])
        ways = np.array([(east - there.east, north - there.north) for there, east, north in newest])
        if len(ranges) < MIN_COMPARED or len(ways) < MIN_COMPARED:
            return
        # A whole lap around the place gives the radius from positions alone, without the height or the radio's scale
        # and bias. An error of the place or of the GPS shifts the circle but does not change its radius.
        settled = np.percentile(np.abs(ranges - hypot(orbit.radius, height)), 90) < SETTLED * orbit.radius
        if not settled or abs(np.ptp(np.unwrap(np.arctan2(*ways.T)))) < 2 * pi:
            return
        true = float(np.mean(np.hypot(*ways.T)))
        measured, length = float(np.mean(ranges)), hypot(true, height)
        off = max(measured**2 - height**2, 0.0) ** 0.5 - true
        if abs(off) > max(RADIUS_OFF * orbit.radius, self._gps_sigma):
            which = "long" if measured > length else "short"
            self.radius_alarm = f"ranges {100 * abs(measured / length - 1):.0f} % too {which}, true radius {true:.1f} m"
            if not before:
                self._announcer.say(RADIUS.name, RADIUS.short.format(found=self.radius_alarm), severity=RADIUS.severity)

    # --- out --------------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """True if work remains after the end of guidance: positions to hand back, then streams to release."""
        return self._gives or (self._alone and not self._ended and self._pilot.session.up)

    @property
    def _gives(self) -> bool:
        back, session = self.handback, self._pilot.session
        if back is None or not back.begun or self.called_off:
            return False
        return session.vehicle.armed and session.heartbeat_age(self._now) < GONE

    def step(self, now: float) -> list[bytes]:
        """Return the frames to send now."""
        session, mode = self._pilot.session, self._pilot.settings.output_mode
        self._now = now
        if session.peer is None:
            return []
        self._encoder.system = session.encoder.system
        messages: list[Message] = []
        place = None if self.place is None else self.place.at(now)
        whole = not self.only_hand_back
        if whole and place is not None and now >= self._messages_at:
            self._messages_at = now + MESSAGES_EVERY
            messages += self._operator_messages(place, now, mode)
        if mode is not OutputMode.SHADOW:
            messages += self._requests(place, now)
        if whole and mode is not OutputMode.SHADOW:
            self._say(place, now)
            messages += self._announcer.texts(now)
        return [self._encode(message) for message in messages]

    def _operator_messages(self, place: Place, now: float, mode: OutputMode) -> list[Message]:
        messages = named_values(place, now)
        if mode is not OutputMode.SHADOW and not self._pilot.done:
            messages.append(orbit_status(place, self._pilot.controller.orbit, now))
        return messages

    def _requests(self, place: Place | None, now: float) -> list[Message]:
        """Return stream requests and the position to hand back."""
        session, done = self._pilot.session, self._pilot.done
        assert session.peer is not None
        target, flies = session.peer.ids, self._pilot.settings.output_mode is OutputMode.FLY
        farewell = self._stream(now, done=done)
        for result in self._commands.take_results():
            if result.refused and self._streams:
                self._streams.denied(result)
        messages = farewell + self._commands.poll(target, now)
        if flies and self.handback is not None:
            messages += self._give_back(self.handback, place, target, now)
        return messages

    def _stream(self, now: float, *, done: bool) -> list[Message]:
        """Request the streams that are due. At the end, return the requests that restore the vehicle's own rates."""
        session = self._pilot.session
        assert session.peer is not None
        if self._streams is None or (done and not self._alone and self._gives):
            self._alone = done  # after guidance the pilot has released its own streams
            health = {REPORTS[session.adapter.firmware.key]: 2.0, SECOND: 2.0} if self.handback else {}
            self._streams = StreamRequests(STREAMS | health | (AFTER if done else {}), maybe={SECOND})
        if not done or self._gives:
            for request in self._streams.poll(now):
                self._commands.send(request)
            return []
        ended, self._ended = self._ended, True
        return [] if ended else [once(request, session.peer.ids) for request in self._streams.give_back()]

    def _give_back(self, back: HandBack, place: Place | None, target: tuple[int, int], now: float) -> list[Message]:
        """Return the command with a position for an autopilot that has lost its own, if a command is due."""
        given, newest = back.settings.place, self._pilot.tracker.newest
        if given is not None:
            self.plane = self.plane or Plane(*given)
            east, north = self.plane.to_metres(*given)
            place = Place(now, self.plane, east, north, 0.0, np.eye(2), up_sigma=HOME_SIGMA, up_known=False)
        if self.plane is None:
            return []
        fresh = newest is not None and now - newest.time < FRESH_RANGE
        self._reckoning.step(now, self._own(now), place, self._pilot.tracker.estimator.at(now) if fresh else None)
        good = self._health.good(now) if self._pilot.session.vehicle.armed else None
        message = back.step(now, good=good, where=self._reckoning.where, plane=self.plane, target=target)
        return [] if message is None else [message]

    def _own(self, now: float) -> OwnMotion | None:
        """Return the vehicle's motion through the air, or None if it is stale."""
        own = self._pilot.own
        return own if own is not None and now - own.time <= ATTITUDE_MAX_AGE else None

    def _say(self, place: Place | None, now: float) -> None:
        """Queue STATUSTEXT messages: the place when found or moved."""
        if place is None or now - self._announced_at < TEXT_EVERY:
            return
        if self._announced is None or place.distance(self._announced) > max(place.sigma, 1.0) / 2:
            self._announced_at, self._announced = now, place
            sigma = f"{place.sigma:.1f}" if isfinite(place.sigma) else "?"
            self._announcer.say("place", f"target {place.latitude:.6f} {place.longitude:.6f} {sigma} m")
            if place.up_known:  # a second message: the first one has the maximum length
                self._announcer.say("altitude", f"target at {place.up:.1f} m AMSL, sigma {place.up_sigma:.1f} m")

    def _encode(self, message: Message) -> bytes:
        """Return one frame. Raises ValueError if the survey must not send this message."""
        kind = message.get_type()
        if kind not in SENT_TYPES or (kind.startswith("COMMAND") and message.command not in COMMANDS):
            raise ValueError(f"the survey must not send {kind}")
        return self._encoder.encode(message)
