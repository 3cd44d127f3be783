"""Live target localization. Input: vehicle positions and ranges. Output: target estimate and its
messages. No socket, no clock.

The locator sends as a separate MAVLink component, so the pilot's frames stay the same, byte for
byte. It sends only the message types in `SENT_TYPES`: none of them moves the vehicle.
"""

from collections import deque
from collections.abc import Hashable, Iterable, Iterator
from itertools import islice
from math import hypot, isfinite, pi

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.estimator import (
    GPS_SIGMA,
    HEIGHT_UNKNOWN,
    LEAST,
    Knowledge,
    NotLocated,
    Ranges,
    Track,
)
from circnav_mav.extras.locate.export import named_values, orbit_status
from circnav_mav.extras.locate.gps_fix import GpsFix
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import RangeSample
from circnav_mav.mav.clocks import BOOT_WRAP, Order, StampFilter
from circnav_mav.mav.codec import Decoder, Encoder, Message
from circnav_mav.mav.commands import CommandSender, StreamRequests, once
from circnav_mav.mav.framing import frame_at
from circnav_mav.mav.session import Session
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import Announcer
from circnav_mav.pilot import VEHICLE, OutputMode, Pilot
from circnav_mav.pilot.method import RECEIVERS
from circnav_mav.timers import Every, Since

WANTED = frozenset(
    {
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_GPS2_RAW,
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
    }
)
STREAMS = {dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0, dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0}
SENT_TYPES = frozenset(
    {"NAMED_VALUE_FLOAT", "STATUSTEXT", "ORBIT_EXECUTION_STATUS", "COMMAND_LONG"}
)
"""Message types that the locator may send. The only command is SET_MESSAGE_INTERVAL."""
WINDOW = 600.0
"""Length, s, of the window of positions and ranges used for the estimate."""
SOLVE_EVERY = 1.0
"""Shortest time between two estimates, s. Chosen."""
MESSAGES_EVERY = 1.0
"""Shortest time between two updates of the map in the ground station, s. Chosen."""
TEXT_EVERY = 30.0
"""Shortest time between two texts to the ground station, s. Chosen."""
HEIGHT_SIGMA = 5.0
"""Standard deviation of a height that the mission gives, m: drift of the barometer and error of the
operator's value."""
CALIBRATE = "Calibrate the radio: circnav ranging calibrate RUN"
SETTLED = 0.05
"""Deviation from the circle's range below which a range is settled, as a share of the radius. If
90 % of the ranges are settled, both radii are compared. During the approach, the mean distance is
not a radius."""


class Locator:
    """Live locator of the target. It receives the same frames as the pilot, after the pilot, and
    does not change the pilot."""

    def __init__(self, component: int, pilot: Pilot, signing: Signing | None = None) -> None:
        """component: own MAVLink component id."""
        self._pilot = pilot
        self._decoder = Decoder(wanted=WANTED)
        self._encoder = Encoder(1, component, signing)
        self._announcer = Announcer()
        self._commands = CommandSender()
        self._streams = StreamRequests(STREAMS)
        self.plane: Plane | None = None
        self.place: Place | None = None
        self.why = "no position of the vehicle"
        """Human-readable reason why the place is unknown."""
        self._gps = GpsFix()
        self._track: deque[tuple[float, float, float, float]] = deque()
        self._ranges: deque[tuple[float, float, float]] = deque()
        self._gps_sigma = GPS_SIGMA
        self._home = 0.0
        self._clock = StampFilter(pilot.session.timesync.delay_increase, wrap=BOOT_WRAP)
        self._solve_at = 0.0
        self._message_timer = Every(MESSAGES_EVERY)
        self._solved_to = float("-inf")
        self._since_announced = Since()
        self._announced: Place | None = None
        self.true_radius: float | None = None
        """Mean horizontal distance from the place over the newest lap, computed from positions,
        m."""
        self.radius_alarm = ""
        """Human-readable error of the ranges on the circle, and the true radius. Empty if no error
        was found."""
        self.radius_remedy = ""
        """Human-readable remedy: calibrate the radio, and the other height that would also explain
        the error."""

    # --- in

    def on_frames(self, link: str, source: Hashable, frames: Iterable[bytes], now: float) -> None:
        """Process complete, trusted frames after the pilot has processed them. now: run time, s."""
        for ident, frame in vehicle_frames(self._pilot.session, link, source, frames):
            self._streams.received(ident)
            for message in self._decoder.decode(frame) if ident in WANTED else ():
                self._take(message, now)
        for sample in self._pilot.tracker.recent:
            self._range(sample, now)

    def _take(self, message: Message, now: float) -> None:
        kind = message.get_type()
        if kind in RECEIVERS:
            self._gps.on_message(message, now)
        if kind == "GPS_RAW_INT":
            # standard deviation per axis, m; 0 if not reported
            reported = message.h_acc / 1000 / 1.414 if message.h_acc else 0.0
            # Without RTK, the error of a receiver changes slowly and is larger than reported.
            is_exact = reported > 0 and message.fix_type >= dialect.GPS_FIX_TYPE_RTK_FLOAT
            least = 0.01 if is_exact else GPS_SIGMA
            self._gps_sigma = max(least, min(reported, 100.0))
        elif kind == "COMMAND_ACK":
            self._commands.acknowledge(message, self._encoder.ids, now)
        elif kind == "GLOBAL_POSITION_INT" and (place := place_of(message)) is not None:
            self._position(message, *place, now)

    @property
    def track(self) -> list[tuple[float, float]]:
        """Latitude and longitude, degrees, of the vehicle positions used for the estimate."""
        if self.plane is None:
            return []
        return [self.plane.to_degrees(east, north) for _, east, north, _ in self._track]

    @property
    def newest_position(self) -> tuple[float, float, float, float] | None:
        """Newest position used for the estimate: time (s), east, north and altitude (m). None
        before the first position."""
        return self._track[-1] if self._track else None

    def _position(self, message: Message, latitude: float, longitude: float, now: float) -> None:
        up = message.alt / 1000
        fix = self._gps.has_fix(now)
        if self.plane is None and fix:
            self.plane = Plane(latitude, longitude)
        if self.plane is None:
            return
        east, north = self.plane.to_metres(latitude, longitude)
        self._home = up - message.relative_alt / 1000
        if not fix:
            return  # without a GPS fix, the position is the autopilot's own dead reckoning
        # Use the vehicle's timestamp. With the time of reception, a delay of the link would be a
        # position error of meters.
        stamp = self._clock.unwrapped(message.time_boot_ms / 1000)
        # 5.0: largest time by which a vehicle's timestamp may be ahead of the estimate of the
        # vehicle's clock, s.
        order = self._clock.order(stamp, now, most_ahead=5.0)
        if order in (Order.OLDER, Order.JUMPED):
            return
        time = self._clock.local(stamp, now)
        self._clock.take(stamp, now)
        if not (self._track and time <= self._track[-1][0]):
            self._track.append((time, east, north, up))
            while now - self._track[0][0] > WINDOW:
                self._track.popleft()

    def _range(self, sample: RangeSample, now: float) -> None:
        """Add a range, unless it was added before."""
        if self._ranges and sample.time <= self._ranges[-1][0]:
            return
        slant = hypot(sample.r, self._pilot.height(now) or 0.0)
        self._ranges.append(
            (sample.time, slant, max(sample.sigma * sample.r / max(slant, 1e-3), 0.02))
        )
        while self._ranges and now - self._ranges[0][0] > WINDOW:
            self._ranges.popleft()
        # 2000: largest number of ranges kept. Above it, every second one is dropped. Passing
        # thousands of ranges to the process of `locate` takes so long that the pilot misses a tick.
        if len(self._ranges) > 2000:
            self._ranges = deque(islice(self._ranges, 0, None, 2))

    # --- the estimate

    def job(self, now: float) -> tuple[Plane, Track, Ranges, Knowledge] | None:
        """Return the arguments of the next `locate` call, or None if none is due.

        The caller runs `locate` in another process, because a call takes several hundredths of a
        second.
        """
        if now < self._solve_at or self.plane is None or len(self._track) < 2 or not self._ranges:
            return None
        newest = self._track[-1][0]
        # 0.1: shortest time between two estimates, as a share of the time span of the positions.
        # An estimate takes up to 0.5 s, and a few more seconds add little to a long track.
        self._solve_at = now + max(SOLVE_EVERY, 0.1 * (newest - self._track[0][0]))
        if newest == self._solved_to:
            return None
        self._solved_to = newest
        track = Track(*np.array(self._track).T)
        ranges = Ranges(*np.array(self._ranges).T)
        height = self._pilot.height(now)
        up, sigma = (
            (self._home, HEIGHT_UNKNOWN)
            if height is None
            else (self._track[-1][3] - height, HEIGHT_SIGMA)
        )
        return (
            self.plane,
            track,
            ranges,
            Knowledge(up=up, up_sigma=sigma, gps_sigma=self._gps_sigma),
        )

    def found(self, place: Place | NotLocated) -> None:
        """Process the result of a job. Keep the previous place if none was found."""
        before = self.radius_alarm
        if isinstance(place, Place):
            self.place = place
            self.radius_alarm = ""
            self._compare_radius(place)
        else:
            self.why = place.why
            if place.range_error:
                self.radius_alarm = f"ranges {_too_long(place.range_error)}: no place fits"
                self.radius_remedy = CALIBRATE
        if self.radius_alarm and not before:
            self._announcer.say("radius", self.radius_alarm, severity=dialect.MAV_SEVERITY_WARNING)

    def _compare_radius(self, place: Place) -> None:
        """Compare the mean range on the circle with the mean distance computed from positions. Only
        report a difference: the vehicle keeps flying the radius by ranges."""
        time, east, north, _ = np.array(self._track).reshape(-1, 4).T
        ahead = time - place.time
        ways = np.array([
            east - place.east - place.velocity[0] * ahead,
            north - place.north - place.velocity[1] * ahead,
        ])  # fmt: skip
        # A whole lap around the located target gives the flown radius from positions alone, without
        # the height or the radio's scale and bias. An error of the target's position or of the GPS
        # shifts the circle but does not change its radius. The lap is found by its angle, because a
        # lap of a wrong radius may take much longer than a lap of the desired one.
        around = np.unwrap(np.arctan2(*ways))
        whole = np.flatnonzero(np.abs(around - around[-1:]) >= 2 * pi)
        if not len(whole):
            return
        lap = slice(whole[-1], None)
        ranges = np.array([slant for at, slant, _ in self._ranges if at >= time[whole[-1]]])
        if min(len(ranges), len(around[lap])) < LEAST:
            return
        radius = self._pilot.orbit.radius
        height = self._pilot.height(place.time) or 0.0
        if np.percentile(np.abs(ranges - hypot(radius, height)), 90) >= SETTLED * radius:
            return
        true = float(np.mean(np.hypot(*ways[:, lap])))
        measured = float(np.mean(ranges))
        self.true_radius = true
        length = hypot(true, height)
        off = max(measured**2 - height**2, 0.0) ** 0.5 - true
        # 0.02: largest difference between the radius by ranges and the radius by positions, as a
        # share of the radius. A larger difference raises an alarm if it also exceeds the GPS error.
        if abs(off) <= max(0.02 * radius, self._gps_sigma):
            return
        share = f"{100 * abs(measured / length - 1):.0f} %"
        self.radius_alarm = (
            f"ranges {share} too {'long' if measured > length else 'short'}, true radius"
            f" {true:.1f} m"
        )
        self.radius_remedy = f"The ranges are {_too_long(measured - length)}. {CALIBRATE}"
        if measured > true:
            self.radius_remedy += (
                f". A height of {(measured**2 - true**2) ** 0.5:.0f} m instead of {height:.0f} m"
                f" would also explain it; above home: {self._track[-1][3] - self._home:.0f} m"
            )

    # --- out

    def step(self, now: float) -> list[bytes]:
        """Return the frames to send now."""
        session = self._pilot.session
        mode = self._pilot.output_mode
        if session.peer is None:
            return []
        self._encoder.system = session.encoder.system
        messages: list[Message] = []
        place = None if self.place is None else self.place.at(now)
        if place is not None and self._message_timer.due(now):
            messages += self._operator_messages(place, now, mode)
        if mode is not OutputMode.SHADOW:
            messages += self._requests(session.peer.ids, now)
            self._say(place, now)
            messages += self._announcer.texts(now)
        return [self._encode(message) for message in messages]

    def _operator_messages(self, place: Place, now: float, mode: OutputMode) -> list[Message]:
        messages = named_values(place, now)
        if mode is not OutputMode.SHADOW and not self._pilot.done:
            messages.append(orbit_status(place, self._pilot.orbit, now))
        return messages

    def _requests(self, target: tuple[int, int], now: float) -> list[Message]:
        """Return the stream requests that are due. At the end, return the requests that restore the
        vehicle's own rates."""
        farewell: list[Message] = []
        if not self._pilot.done:
            for request in self._streams.poll(now):
                self._commands.send(request)
        else:
            farewell = [once(request, target) for request in self._streams.give_back()]
        for result in self._commands.take_results():
            if result.refused:
                self._streams.denied(result)
        return farewell + self._commands.poll(target, now)

    def _say(self, place: Place | None, now: float) -> None:
        """Queue a STATUSTEXT message with the place when it is first found, and when it has
        moved."""
        if place is None or self._since_announced.age(now) < TEXT_EVERY:
            return
        if self._announced is None or place.distance(self._announced) > max(place.sigma, 1.0) / 2:
            self._since_announced.restart(now)
            self._announced = place
            sigma = f"{place.sigma:.1f}" if isfinite(place.sigma) else "?"
            self._announcer.say(
                "place", f"target {place.latitude:.6f} {place.longitude:.6f} {sigma} m"
            )
            if place.up_known:  # a second message, because the first one has the maximum length
                self._announcer.say(
                    "altitude", f"target at {place.up:.1f} m AMSL, sigma {place.up_sigma:.1f} m"
                )

    def _encode(self, message: Message) -> bytes:
        """Return one frame. Raises ValueError if the locator must not send this message."""
        kind = message.get_type()
        is_command = kind == "COMMAND_LONG"
        if kind not in SENT_TYPES or (
            is_command and message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        ):
            raise ValueError(f"the locator must not send {kind}")
        return self._encoder.encode(message)


def _too_long(error: float) -> str:
    return f"{abs(error):.0f} m too {'long' if error > 0 else 'short'}"


def place_of(message: Message) -> tuple[float, float] | None:
    """Return latitude and longitude of a GLOBAL_POSITION_INT, degrees. None if they are unset or
    impossible."""
    latitude = message.lat / 1e7
    longitude = message.lon / 1e7
    return (latitude, longitude) if 0 < max(abs(latitude), abs(longitude) / 2) <= 90 else None


def vehicle_frames(
    session: Session, link: str, source: Hashable, frames: Iterable[bytes]
) -> Iterator[tuple[int, bytes]]:
    """Yield message id and bytes of the frames that the vehicle sent. The other frames of a link
    are left out."""
    if link != VEHICLE or session.peer is None or source != session.peer.source:
        return
    for frame in frames:
        # Check the header first: most frames are not needed, and decoding them costs more.
        header = frame_at(frame, 0)
        if header is not None and (header.system, header.component) == session.vehicle_ids:
            yield header.ident, frame
