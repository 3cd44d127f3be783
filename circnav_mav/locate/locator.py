"""The survey of a flight: positions and ranges in, the target's place and what is said of it out. No socket, no clock.

Speaks as a component of its own, so that what the pilot sends stays what it is, byte for byte; and never says anything
that moves the vehicle: `SAYS` is all there is.
"""

from cmath import phase, rect
from collections import deque
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from itertools import islice
from math import hypot, isfinite

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.types import OwnMotion, RelativeMotion
from circnav_mav.locate.estimator import Knowledge, NotYet, Ranges, Track
from circnav_mav.locate.export import camera, named_values, orbit_status, own_beacon
from circnav_mav.locate.handback import COMPASS_SIGMA, PLACE_SIGMA, DeadReckoning, HandBack, HandBackSettings
from circnav_mav.locate.place import Place, Plane
from circnav_mav.locate.watch import Culprit, GpsWatch, Look, angle_between
from circnav_mav.mav.clocks import BOOT_WRAP, RemoteClock
from circnav_mav.mav.codec import Decoder, Encoder, Message
from circnav_mav.mav.commands import Command, CommandSender, StreamRequests
from circnav_mav.mav.framing import frame_at
from circnav_mav.mav.own_motion import ATTITUDE_MAX_AGE
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import Announcer
from circnav_mav.pilot import VEHICLE, OutputMode, Pilot

WANTED = frozenset({dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
                    dialect.MAVLINK_MSG_ID_COMMAND_ACK})  # fmt: skip
STREAMS = {dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0, dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0}
SAYS = frozenset({"NAMED_VALUE_FLOAT", "STATUSTEXT", "ORBIT_EXECUTION_STATUS", "RANGING_BEACON", "COMMAND_LONG",
                  "COMMAND_INT"})  # fmt: skip
"""Types of the messages that may leave here; of commands those of COMMANDS."""
COMMANDS = frozenset({
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_DO_SET_ROI_LOCATION,
    dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
})  # fmt: skip
REBOOTED = 5.0
"""Time, s, by which the vehicle's clock is off when it has started again."""
WINDOW = 600.0
"""Newest time, s, that the place is made from."""
MOST_KEPT = 2000
FIX_3D, FIX_SILENT = 3, 3.0
"""GPS_RAW_INT.fix_type from which a position is one, and the silence, s, after which there is none."""
GONE = 10.0
"""Silence of the vehicle, s, after which nothing is given back any more."""
AFTER = {dialect.MAVLINK_MSG_ID_ATTITUDE: 10.0, dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0}
"""Streams that dead reckoning needs when the pilot has given its own back, message id -> Hz."""
RECKON_EVERY = 0.1
SOLVE_EVERY, TELL_EVERY, TEXT_EVERY = 1.0, 1.0, 30.0
SOLVE_SHARE = 0.03
"""Of the time that the positions span, between two estimates: one takes up to half a second, and the more there is to
go by, the less a new second tells."""
HEIGHT_SIGMA = 5.0
"""Standard deviation, m, of a height that the mission gives: a barometer's drift and an operator's guess."""
HOME_SIGMA = 50.0
"""Of the height of a target of which nothing is said, above home, m."""
BIAS_MEMORY = 60.0
"""Time, s, over which the compass bias is learnt."""


@dataclass(frozen=True, slots=True)
class LocateSettings:
    """component: the id to speak under. gps_sigma, range_bias_sigma: standard deviations, m. beacon: whether to send
    RANGING_BEACON with the place filled in. camera: whether to point the camera at the place."""

    component: int
    gps_sigma: float = 1.5
    range_bias_sigma: float = 2.0
    beacon: bool = False
    camera: bool = False
    handback: HandBackSettings | None = None


class Locator:
    """Hears what the pilot hears, after it. Nothing goes from here to the pilot."""

    def __init__(self, settings: LocateSettings, pilot: Pilot, signing: Signing | None = None) -> None:
        self._settings, self._pilot = settings, pilot
        self._decoder = Decoder(wanted=WANTED)
        self._encoder = Encoder(1, settings.component, signing)
        self._announcer, self._commands = Announcer(), CommandSender()
        self._streams, self._after = StreamRequests(STREAMS), StreamRequests(AFTER)
        self.plane: Plane | None = None
        self.place: Place | None = None
        self.why = "no position of the vehicle"
        """Why there is no place, for people."""
        self.watch = GpsWatch()
        self.handback = HandBack(settings.handback) if settings.handback else None
        self._reckoning = DeadReckoning()
        self._reckoned_at = float("-inf")
        self._track: deque[tuple[float, float, float, float]] = deque()
        self._ranges: deque[tuple[float, float, float]] = deque()
        self._accepted = 0
        self._fix, self._fix_at, self._gps_sigma = 0, float("-inf"), settings.gps_sigma
        self._home = 0.0
        self._clock = RemoteClock(pilot.session.timesync.slower, wrap=BOOT_WRAP)
        self._turned: complex = 0j
        self._turned_for, self._turned_at = 0.0, 0.0
        self._solve_at = self._tell_at = 0.0
        self._solved_to = float("-inf")
        self._said_at = float("-inf")
        self._said: Place | None = None
        self._culprit: Culprit | None = None
        self._aimed: Place | None = None
        self._ended = False
        self._now = 0.0
        self.cot_due = False

    # --- in ---------------------------------------------------------------------------------------------------------

    def hear(self, link: str, source: Hashable, frames: Iterable[bytes], now: float) -> None:
        """Whole frames that are believed, after the pilot has had them."""
        session, tracker = self._pilot.session, self._pilot.tracker
        if link == VEHICLE and session.peer is not None and source == session.peer.source:
            for frame in frames:
                header = frame_at(frame, 0)  # most are of no interest: that is cheaper than to decode them
                for message in self._decoder.decode(frame) if header is not None and header.ident in WANTED else ():
                    if (message.get_srcSystem(), message.get_srcComponent()) == session.vehicle_ids:
                        self._take(message, now)
        if tracker.accepted > self._accepted and tracker.newest is not None:
            height, sample = tracker.height.at(now) or 0.0, tracker.newest
            slant = hypot(sample.r, height)
            self._range(sample.time, slant, sample.sigma * sample.r / max(slant, 1e-3), now)
        self._accepted = tracker.accepted

    def _take(self, message: Message, now: float) -> None:
        kind = message.get_type()
        if kind == "GPS_RAW_INT":
            self._fix, self._fix_at = message.fix_type, now
            reported = message.h_acc / 1000 / 1.414 if message.h_acc else 0.0  # of one axis; 0: not known
            self._gps_sigma = max(self._settings.gps_sigma, min(reported, 100.0))
        elif kind == "COMMAND_ACK":
            us = self._encoder.system, self._settings.component
            self._commands.acknowledge(message, us, now)
            if self.handback is not None:
                self.handback.answered(message, us, now)
        elif (message.lat, message.lon) != (0, 0) and abs(message.lat) <= 90e7 and abs(message.lon) <= 180e7:
            self._position(message, now)

    @property
    def track(self) -> list[tuple[float, float]]:
        """Latitude and longitude of the positions by which the place was made."""
        if self.plane is None:
            return []
        return [self.plane.to_degrees(east, north) for _, east, north, _ in self._track]

    def has_fix(self, now: float) -> bool:
        """Whether the newest word of the GPS is a fix, and not old."""
        return self._fix >= FIX_3D and now - self._fix_at <= FIX_SILENT

    def _position(self, message: Message, now: float) -> None:
        latitude, longitude, up = message.lat / 1e7, message.lon / 1e7, message.alt / 1000
        if self.plane is None and self.has_fix(now):
            self.plane = Plane(latitude, longitude)
        if self.plane is None:
            return
        east, north = self.plane.to_metres(latitude, longitude)
        self._home = up - message.relative_alt / 1000
        if self.handback is not None:
            self.handback.reported(east, north, self._reckoning.where, now)
        if not self.has_fix(now):
            return  # a position without GPS is the autopilot's own dead reckoning
        # by the vehicle's own clock: on the way it may have waited, and V times that is metres
        stamp = self._clock.unwrapped(message.time_boot_ms / 1000)
        if self._clock.newest is not None and abs(stamp - self._clock.newest) > now - self._clock.newest_at + REBOOTED:
            self._clock.reset()  # the vehicle has started again
        time = self._clock.local(stamp, now)
        self._clock.take(stamp, now)
        self._look(east, north, up, time, now)
        if self.watch.trusts_positions and not (self._track and time <= self._track[-1][0]):
            self._track.append((time, east, north, up))
            while now - self._track[0][0] > WINDOW:
                self._track.popleft()

    def _range(self, time: float, slant: float, sigma: float, now: float) -> None:
        if self._ranges and time <= self._ranges[-1][0]:
            return
        if self.watch.trusts_positions or self.watch.culprit is None:
            self._ranges.append((time, slant, max(sigma, 0.02)))
        while self._ranges and now - self._ranges[0][0] > WINDOW:
            self._ranges.popleft()
        if len(self._ranges) > MOST_KEPT:  # every second one: to hand over thousands would cost a tick
            self._ranges = deque(islice(self._ranges, 0, None, 2))

    def _look(self, east: float, north: float, up: float, time: float, now: float) -> None:
        """Let the watch compare the position of a time with the range and the bearing of then."""
        pilot, place, own = self._pilot, self.place, self._own(now)
        range_off = bearing_off = None
        tracker = pilot.tracker
        if place is not None and tracker.newest is not None and now - tracker.newest.time < 1.0:
            there = place.at(time)
            way = there.east - east, there.north - north
            sigma = hypot(there.sigma, self._gps_sigma, tracker.newest.sigma)
            height = tracker.height.at(now)
            flat = hypot(*way) if height is not None else hypot(*way, there.up - up)
            range_off = tracker.newest.r - flat - place.bias, sigma
            relative = self._relative(time)
            if relative is not None and hypot(*way) > 10:
                off = angle_between((-relative.x, -relative.y), way)
                sigma_bearing = (relative.sigma + sigma) / hypot(*way)
                self._learn_compass(off, now)
                bearing_off = off, sigma_bearing + 0.05
        heading, airspeed = (None, pilot.settings.orbit.speed) if own is None else (own.heading, own.airspeed)
        self.watch.see(Look(now, east, north, heading, airspeed, range_off, bearing_off))
        if self.watch.culprit is Culprit.BEACON and self.place is not None:
            # the beacon has moved, or another one answers: what was surveyed is no longer so
            self.place = None
            self._track.clear()
            self._ranges.clear()
            self.watch.forget_ranges()

    def _learn_compass(self, off: float, now: float) -> None:
        """The compass bias while there is GPS: a mean of unit vectors with a memory."""
        dt = min(now - self._turned_at, 1.0)
        self._turned_at = now
        self._turned_for = min(self._turned_for + dt, BIAS_MEMORY)
        self._turned += dt / max(self._turned_for, dt, 1e-3) * (rect(1.0, off) - self._turned)

    @property
    def _compass_bias(self) -> tuple[float, float]:
        """Of bearings by compass less those by GPS, rad, counter-clockwise positive, and its standard deviation; 0
        before it was learnt."""
        learnt = self._turned_for > 10.0
        return (phase(self._turned), COMPASS_SIGMA) if learnt else (0.0, 3 * COMPASS_SIGMA)

    def _relative(self, time: float) -> RelativeMotion | None:
        """Where the vehicle is from the target by ranges and compass, where that is trusted."""
        estimate = self._pilot.tracker.estimator.at(time)
        relative = estimate.relative if estimate else None
        return relative if relative is not None and relative.trusted else None

    # --- the estimate -----------------------------------------------------------------------------------------------

    def job(self, now: float) -> tuple[Plane, Track, Ranges, Knowledge, Place | None] | None:
        """What to call `locate` with, when that is due: it takes some hundredths of a second, so somebody else does."""
        if now < self._solve_at or self.plane is None or len(self._track) < 2 or not self._ranges:
            return None
        newest = self._track[-1][0]
        self._solve_at = now + max(SOLVE_EVERY, SOLVE_SHARE * (newest - self._track[0][0]))
        if not self.watch.trusts_positions or newest == self._solved_to:
            return None
        self._solved_to = newest
        track = Track(*np.array(self._track).T)
        ranges = Ranges(*np.array(self._ranges).T)
        height = self._pilot.tracker.height.at(now)
        up, sigma = (self._home, HOME_SIGMA) if height is None else (self._track[-1][3] - height, HEIGHT_SIGMA)
        known = Knowledge(up=up, up_sigma=sigma, gps_sigma=self._gps_sigma, bias_sigma=self._settings.range_bias_sigma)
        return self.plane, track, ranges, known, self.place

    def found(self, place: Place | NotYet) -> None:
        """The answer to a job. What was found before stays where nothing is found now."""
        if isinstance(place, Place):
            self.place = place
        else:
            self.why = place.why

    # --- out --------------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """Whether there is something to do after guidance has ended."""
        back, session = self.handback, self._pilot.session
        return back is not None and back.begun and session.vehicle.armed and session.heartbeat_age(self._now) < GONE

    def step(self, now: float) -> list[bytes]:
        """The frames due now."""
        session, mode = self._pilot.session, self._pilot.settings.output_mode
        self._now = now
        if session.peer is None:
            return []
        self._encoder.system = session.encoder.system
        messages: list[Message] = []
        place = None if self.place is None else self.place.at(now)
        if place is not None and now >= self._tell_at:
            self._tell_at, self.cot_due = now + TELL_EVERY, True
            messages += self._tell(place, now, mode)
        if mode is not OutputMode.SHADOW:
            messages += self._requests(place, now)
            self._say(place, now)
            messages += self._announcer.texts(now)
        return [self._encode(message) for message in messages]

    def _tell(self, place: Place, now: float, mode: OutputMode) -> list[Message]:
        assert self.plane is not None
        messages = named_values(place, now)
        if mode is OutputMode.SHADOW or self._pilot.done:
            return messages
        messages.append(orbit_status(place, self._pilot.controller.orbit, now))
        newest = self._pilot.tracker.newest
        if self._settings.beacon and newest is not None:
            slant = hypot(newest.r, self._pilot.tracker.height.at(now) or 0.0)
            messages.append(own_beacon(place, slant, newest.sigma, self._pilot.session.vehicle_ids, now))
        return messages

    def _requests(self, place: Place | None, now: float) -> list[Message]:
        """Streams, the camera, and the position that is given back."""
        peer = self._pilot.session.peer
        assert peer is not None
        requests: list[Command] = []
        if not self._pilot.done:
            requests = self._streams.poll(now)
        elif self.busy:
            requests = [*self._streams.poll(now), *self._after.poll(now)]
        elif not self._ended:
            self._ended = True
            requests = [*self._streams.give_back(), *(self._after.give_back() if self.handback else ())]
        for request in requests:
            self._commands.send(request)
        messages = self._commands.poll(peer.ids, now)
        for result in self._commands.take_results():
            if result.refused and result.command.number == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._streams.denied(result.command)
        flies = self._pilot.settings.output_mode is OutputMode.FLY
        if flies and self.handback is not None:
            messages += self._give_back(self.handback, place, peer.ids, now)
        if flies and self._settings.camera and place is not None and not self._pilot.done and self._aim(place):
            self._aimed = place
            messages.append(camera(place, peer.ids))
        return messages

    def _give_back(self, back: HandBack, place: Place | None, target: tuple[int, int], now: float) -> list[Message]:
        """The position for an autopilot that has lost its own, when it is due."""
        given = back.settings.place
        if given is not None and self.plane is None:
            self.plane = Plane(*given)
        if self.plane is None:
            return []
        if now - self._reckoned_at >= RECKON_EVERY:
            self._reckoned_at = now
            if given is not None:
                east, north = self.plane.to_metres(*given)
                place = Place(now, self.plane, east, north, 0.0, np.eye(2), up_sigma=HOME_SIGMA, up_known=False)
            self._reckon(place, now)
        heard = now - self._fix_at <= FIX_SILENT and self._pilot.session.vehicle.armed
        fix = self._fix >= FIX_3D if heard else None
        message = back.step(now, fix=fix, where=self._reckoning.where, plane=self.plane, target=target)
        return [] if message is None else [message]

    def _reckon(self, place: Place | None, now: float) -> None:
        """Where the vehicle is by ranges and compass, or by its way through the air since."""
        newest, relative = self._pilot.tracker.newest, self._relative(now)
        fresh = newest is not None and now - newest.time < 2.0
        if place is not None and place.sigma <= PLACE_SIGMA and relative is not None and fresh:
            self._reckoning.ranged(now, place, relative, self._compass_bias)
            return
        self._reckoning.flown(now, self._own(now), self._compass_bias[0])

    def _own(self, now: float) -> OwnMotion | None:
        """How the vehicle moves through the air, unless that is stale."""
        own = self._pilot.own
        return own if own is not None and now - own.time <= ATTITUDE_MAX_AGE else None

    def _aim(self, place: Place) -> bool:
        """Whether the camera must be pointed anew."""
        before = self._aimed
        return before is None or (place.time - before.time > 1.0 and place.distance(before) > max(2.0, place.sigma / 2))

    def _say(self, place: Place | None, now: float) -> None:
        """STATUSTEXT: the place when it is first known and when it has moved; alarms as they begin and end."""
        culprit = self.watch.culprit
        if culprit is not self._culprit:
            self._culprit = culprit
            severity = dialect.MAV_SEVERITY_WARNING if culprit else dialect.MAV_SEVERITY_NOTICE
            text = f"GPS WATCH: {culprit.value} likeliest wrong" if culprit else "GPS, ranges agree again"
            self._announcer.say("watch", text, severity=severity)
        if place is None or now - self._said_at < TEXT_EVERY:
            return
        if self._said is None or place.distance(self._said) > max(place.sigma, 1.0) / 2:
            self._said_at, self._said = now, place
            sigma = f"{place.sigma:.1f}" if isfinite(place.sigma) else "?"
            self._announcer.say("place", f"target {place.latitude:.6f} {place.longitude:.6f} {sigma} m")

    def _encode(self, message: Message) -> bytes:
        """One frame; only what may be said. Raises ValueError."""
        kind = message.get_type()
        if kind not in SAYS or (kind.startswith("COMMAND") and message.command not in COMMANDS):
            raise ValueError(f"{kind} must not leave the survey")
        return self._encoder.encode(message)
