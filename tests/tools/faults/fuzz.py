"""Random and damaged bytes sent to an engaged pilot.

    python -m tests.tools.faults.fuzz --frames 1000000

Between these bytes a good vehicle sends its frames, so that the pilot stays engaged. `receive` and
`step` must not raise, every setpoint must be finite and within the limits, and memory must not
grow.
"""

import struct
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from random import Random
from typing import NamedTuple

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.session import HANDLED
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING, VEHICLE, Pilot
from circnav_mav.pilot.mission_state import Phase
from tests.flight.lockstep import CONFIG
from tests.frames import output
from tests.process import resident_mb
from tests.rig import beacon, distance
from tests.tools import cells
from tests.tools.cells import Result
from tests.tools.fault_link.frames import frames, raw_frame, write
from tests.tools.faults.judge import Allowed, broken_rule, is_setpoint

RANGING_IDS = {"distance_sensor": 132, "named_value_float": 251, "ranging_beacon": 513}
IDS = sorted(HANDLED | set(RANGING_IDS.values()) | {22})


class Vehicle(NamedTuple):
    """Values in the heartbeat of a vehicle, and its ranging message. mode: used if the adapter has
    no guided mode."""

    autopilot: int
    kind: int
    mode: int
    ranging: str


VEHICLES = {
    "arducopter": Vehicle(3, 2, 4, "distance_sensor"),
    "arduplane": Vehicle(3, 1, 15, "named_value_float"),
    "px4_copter": Vehicle(12, 2, 6 << 16, "ranging_beacon"),
    "px4_plane": Vehicle(12, 1, 0, "distance_sensor"),
}
STATE = (0, 2, 30)
"""Messages of which the corpus has no all-zero frame, because such a frame would report a takeover
or a reboot every time. `valid` sends these messages."""
FRAME_TIME = 0.002
GOOD_EVERY = 25
ODD = tuple(
    map(bytes.fromhex, ["00", "ff", "7f800000", "0000c07f", "0000807f", "000080ff", "ffff"])
)
"""Bytes 0 and 255, and the infinities and NaN of a float in both byte orders."""
VEHICLE_IDS = (1, 1)
RADIO_IDS = (1, 192)
OUR_IDS = (1, 191)
WARM_UP = 20_000
PATIENCE = 20
FRESH = 500
"""Number of frames after which the corpus is recorded again, because old times since boot would
look like a reboot."""

Hostile = Callable[[Random, list[bytes]], bytes]


class Target:
    """A pilot, and a minimal good vehicle that keeps the pilot engaged."""

    def __init__(self, profile: str) -> None:
        self.profile = profile
        self.ranging = VEHICLES[profile].ranging
        overrides = [
            f'ranging.message="{self.ranging}"',
            'engage.on_takeover="wait"',
            "limits.duration_s=1e9",
            "limits.coast_s=3600",
            "link.wait_s=1e6",
            "engage.min_height_m=0",
        ]
        if self.ranging == "ranging_beacon":
            overrides.append('ranging.endpoint="udpin:127.0.0.1:14560"')
        self.settings = load_mission(CONFIG / f"{profile}.toml", overrides)
        self.allowed = Allowed.of(self.settings)
        self.now = 0.0
        self.broken: list[str] = []
        self.counts: Counter[str] = Counter()
        self.slowest = 0.0
        self.start()

    def start(self) -> None:
        """Start a new pilot and bring it onto its circle."""
        self.pilot = Pilot(self.settings)
        self._idle = 0
        for _ in range(200):
            self.now += FRAME_TIME * GOOD_EVERY
            self.good()
            self.step()
        self.counts["pilots"] += 1

    def good(self) -> list[bytes]:
        """Send the frames of the good vehicle and return them."""
        vehicle = VEHICLES[self.profile]
        ms = int(self.now * 1000) & 0xFFFFFFFF
        adapter = self.pilot.session.adapter
        mode = adapter.guided_mode or vehicle.mode
        self._idle = 0 if self.pilot.mission.phase is Phase.ENGAGED else self._idle + 1
        # the operator takes over the vehicle and returns it
        if self._idle % PATIENCE in (PATIENCE - 2, PATIENCE - 1):
            mode = adapter.exits["loiter"]
        messages = (
            mavlink.MAVLink_heartbeat_message(vehicle.kind, vehicle.autopilot, 129, mode, 4, 3),
            mavlink.MAVLink_attitude_message(ms, 0.1, 0.0, self.now % 3.0, 0, 0, 0.2),
            mavlink.MAVLink_vfr_hud_message(20.0, 20.0, 90, 50, 60.0, 0.0),
            mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR),
        )
        sent = [write(message, *VEHICLE_IDS) for message in messages]
        for frame in sent:
            self.pilot.receive(frame, self.now, "sim")
        apart = self.settings.ranging_apart
        measured = self._measured(ms)
        self.pilot.receive(measured, self.now, "sim", RANGING if apart else VEHICLE)
        return [*sent, measured]

    def receive(self, data: bytes) -> None:
        """Deliver one hostile datagram."""
        self.now += FRAME_TIME
        self.pilot.receive(data, self.now, "sim")
        if self.settings.ranging_apart:
            self.pilot.receive(data, self.now, "sim", RANGING)
        self.pilot.take_frames()

    def step(self) -> None:
        """Run one step of the pilot and check its output."""
        began = time.perf_counter()
        out = output(self.pilot, self.now)
        self.slowest = max(self.slowest, time.perf_counter() - began)
        self.pilot.take_records()
        self.counts["engaged steps"] += self.pilot.mission.phase is Phase.ENGAGED
        for frame in filter(is_setpoint, frames(out)):
            self.counts["setpoints"] += 1
            rule = broken_rule(frame, self.allowed)
            if rule is not None:
                self.broken.append(f"{self.profile}: {rule}")
        if self.pilot.done:
            outcome = self.pilot.mission.outcome
            self.counts[f"ended: {outcome.reason[:40] if outcome else ''}"] += 1
            if outcome is not None and "internal error" in outcome.reason:
                self.broken.append(f"{self.profile}: {outcome.reason}")
            self.start()

    def _measured(self, ms: int) -> bytes:
        r = self.settings.orbit.radius + 1.0
        if height := self.settings.file.orbit.height_above_target_m:
            r = (r * r + height**2) ** 0.5
        if self.ranging == "distance_sensor":
            message = distance(
                int(r * 100), ms, orientation=self.settings.ranging.orientation or 24
            )
        elif self.ranging == "named_value_float":
            message = mavlink.MAVLink_named_value_float_message(ms, b"RANGE", r)
        else:
            message = beacon(
                int(r * 1000),
                ms * 1000,
                ms // 50 & 255,
                beacon_id=self.settings.ranging.beacon_id or 0,
            )
        return write(message, *RADIO_IDS)


def mutated(chance: Random, corpus: list[bytes]) -> bytes:
    """Return a good frame with flipped, lost, doubled or foreign bytes, or two frames spliced."""
    data = bytearray(chance.choice(corpus))
    for _ in range(chance.randint(1, 4)):
        kind = chance.randrange(6)
        at = chance.randrange(len(data) or 1)
        if not data:
            break
        if kind == 0:
            data[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            data[at] = chance.randrange(256)
        elif kind == 2:
            del data[at : at + chance.randint(1, 8)]
        elif kind == 3:
            data[at:at] = chance.choice(ODD)
        elif kind == 4:
            data += chance.choice(corpus)[: chance.randrange(40)]
        else:
            data[at : at + 4] = chance.choice(ODD)
    return bytes(data)


def valid(chance: Random, corpus: list[bytes]) -> bytes:
    """Return a frame of a handled message with correct CRC and random payload, under the ids of the
    vehicle or of another sender."""
    number = chance.choice(IDS)
    size = mavlink.mavlink_map[number].unpacker.size
    length = size if chance.random() < 0.7 else chance.randrange(256)
    payload = bytearray(chance.randbytes(length))
    for _ in range(chance.randrange(4)):
        at = chance.randrange(length + 1) & ~3
        odd = chance.choice(ODD)
        payload[at : at + len(odd)] = odd
    if number in (132, 251, 513) and chance.random() < 0.5 and length == size:
        _plausible(number, payload, chance)
    ids = chance.choice(
        (
            VEHICLE_IDS,
            VEHICLE_IDS,
            RADIO_IDS,
            OUR_IDS,
            (chance.randrange(256), chance.randrange(256)),
        )
    )
    if ids == OUR_IDS and chance.random() < 0.98:
        ids = VEHICLE_IDS  # frames under circnav's own ids would end the flight at once
    return raw_frame(number, bytes(payload[:255]), *ids, chance.randrange(256))


def _plausible(number: int, payload: bytearray, chance: Random) -> None:
    """Set name, beacon id and orientation to those of the mission, because a random payload would
    never pass these filters."""
    if number == 251:
        payload[8:18] = b"RANGE".ljust(10, b"\0")
    elif number == 132:
        payload[12] = 24
        struct.pack_into("<HHH", payload, 4, 0, 65535, chance.randrange(65536))


def flood(frames_wanted: int) -> Iterator[bytes]:
    """Yield unknown ids, new names and new systems in turn."""
    for n in range(frames_wanted):
        kind = n % 3
        if kind == 0:
            yield raw_frame(50_000 + n, bytes(n % 40), n % 250 + 1, n % 255 + 1, n)
        elif kind == 1:
            yield write(
                mavlink.MAVLink_named_value_float_message(n, f"N{n}"[:10].encode(), 1.0),
                1,
                1,
                n & 255,
            )
        else:
            yield write(
                mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3),
                n % 250 + 1,
                n // 250 % 250 + 1,
                n & 255,
            )


def assault(target: Target, source: Iterator[bytes]) -> None:
    """Pass hostile datagrams to a target, with frames of the good vehicle between them."""
    for n, data in enumerate(source):
        target.receive(data)
        if n % GOOD_EVERY == 0:
            target.good()
        if n % 5 == 0:
            target.step()


def corpus_of(target: Target) -> list[bytes]:
    """Return good frames to mutate: the vehicle's, and an all-zero frame of each handled
    message."""
    empty = [
        raw_frame(n, bytes(mavlink.mavlink_map[n].unpacker.size), *VEHICLE_IDS)
        for n in IDS
        if n not in STATE
    ]
    return [*target.good(), *empty]


def hostile(target: Target, make: Hostile, chance: Random, wanted: int) -> Iterator[bytes]:
    """Yield a number of hostile datagrams, made from the current frames of the good vehicle."""
    for n in range(wanted):
        if n % FRESH == 0:
            corpus = corpus_of(target)
        yield make(chance, corpus)


MAKERS: dict[str, Hostile] = {"mutated": mutated, "valid": valid}
ROWS = {f"{what}, {name}": (what, name) for what in (*MAKERS, "flood") for name in VEHICLES}


def fly(row: str, seed: int, frames: int) -> Result:
    """Send one kind of hostile frames to a pilot. Return the broken rules, the growth of the
    memory, MB, the longest step, ms, and counts."""
    what, name = ROWS[row]
    target = Target(name)
    chance = Random(seed)

    def source(wanted: int) -> Iterator[bytes]:
        if what == "flood":
            return flood(wanted)
        return hostile(target, MAKERS[what], chance, wanted)

    assault(target, source(min(WARM_UP, frames // 4)))
    before = resident_mb()
    target.slowest = 0.0
    assault(target, source(frames))
    return {
        "broken": target.broken,
        "rss_mb": resident_mb() - before,
        "slowest_ms": 1000 * target.slowest,
        "counts": target.counts,
    }


def main() -> int:
    parser = cells.parser(__doc__, ROWS, (1, 1))
    parser.add_argument("--frames", type=int, default=1_000_000, help="frames of each kind")
    options = parser.parse_args()
    frames = options.frames // len(VEHICLES)
    found = cells.flown(partial(fly, frames=frames), options)
    rows = [
        (row, one["seed"], one["broken"] or "none", one["rss_mb"], one["slowest_ms"], one["counts"])
        for row, flights in found.items()
        for one in flights
    ]
    print(cells.table("frames | seed | broken rules | RSS, MB | slowest step, ms | counts", rows))
    return 1 if any(broken != "none" for _, _, broken, *_ in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
