"""A test rig: a vehicle's messages, made by pymavlink alone, and a pilot that receives them tick by
tick."""

from collections.abc import Callable, Hashable
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.identity import LinkSettings
from circnav_mav.mav.session import Session
from circnav_mav.mission.load import parse_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import VEHICLE, OutputMode, Pilot
from circnav_mav.timers import Hysteresis
from tests.frames import output

GUIDED = 4
LOITER = 5
ARMED = 128 | 1
"""MAV_MODE_FLAG_SAFETY_ARMED and CUSTOM_MODE_ENABLED."""
TICK = 0.05

MISSION = """\
name = "rig"

[vehicle]
autopilot = "ardupilot"
kind = "copter"
speed_mps = 15.0
max_turn_rate_deg_s = 20.05352282957881
max_bank_deg = 40.107045659157625
turn_gain = 1.0

[orbit]
radius_m = 100.0
direction = "clockwise"

[guidance]
law = "smooth"
gain = 1e-4
estimator = "kalman"

[ranging]
message = "distance_sensor"
rate_hz = 10.0
sigma_m = 0.5
orientation = 24

[link]
endpoint = "udpin:127.0.0.1:14550"

[engage]
min_height_m = 0.0

[limits]
duration_s = 600.0
"""
"""The rig's mission. Its largest turn rate is 0.35 rad/s, its largest bank 0.7 rad."""


ANY_SENSOR = MISSION.replace("orientation = 24\n", "")
"""The rig's mission without a choice of the range sensor."""


def rig_mission(*overrides: str, text: str = MISSION) -> Mission:
    """Return the rig's mission with overrides."""
    return parse_mission(text, "rig.toml", overrides)


def flown_for_long(pilot: Pilot) -> Pilot:
    """Return the pilot of a vehicle that has been in the air for a long time."""
    pilot.airborne.in_air = Hysteresis(raise_after=0.0)
    return pilot


class Voice:
    """A MAVLink sender that packs messages as one component does, in MAVLink 2 by default."""

    def __init__(self, system: int = 1, component: int = 1, *, version: int = 2) -> None:
        self._mavlink = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._version = version

    def pack(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._mavlink, force_mavlink1=self._version == 1))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame

    def message(self, message: Any) -> Any:
        """Return the message as a receiver decodes it: packed and unpacked."""
        return mavlink.MAVLink(None).decode(bytearray(self.pack(message)))


def heartbeat(mode: int = GUIDED, *, armed: bool = True, kind: int = 2, autopilot: int = 3) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, ARMED if armed else 1, mode, 4, 3)


def distance(cm: int, stamp_ms: int, **rest: Any) -> Any:
    fields = {
        "min_distance": 20,
        "max_distance": 60000,
        "type": 4,
        "id": 0,
        "orientation": 24,
        "covariance": 0,
    }
    fields |= {"signal_quality": 0, **rest}
    return mavlink.MAVLink_distance_sensor_message(
        time_boot_ms=stamp_ms, current_distance=cm, **fields
    )


def scattering(cm: int, stamp_ms: int, **rest: Any) -> Any:
    """Return a range message that alternates by 1 cm, so that the radio does not look frozen."""
    return distance(cm + stamp_ms // 100 % 2 if 0 < cm < 60000 else cm, stamp_ms, **rest)


def beacon(mm: int, stamp_us: int, sequence: int, **rest: Any) -> Any:
    fields = {
        "target_system": 0,
        "target_component": 0,
        "beacon_id": 0,
        "lat": 2**31 - 1,
        "lon": 2**31 - 1,
    }
    fields |= {
        "alt": float("nan"),
        "alt_type": 0,
        "hacc_est": 2**32 - 1,
        "vacc_est": 2**32 - 1,
        "carrier_freq": 0,
    }
    fields |= {"range_accuracy": 2**32 - 1, "status": 0, **rest}
    return mavlink.MAVLink_ranging_beacon_message(
        time_usec=stamp_us, range=mm, sequence=sequence, **fields
    )


def decode(data: bytes) -> list[Any]:
    """Return all messages in the output of the pilot, decoded by pymavlink."""
    parser = mavlink.MAVLink(None)
    return parser.parse_buffer(bytearray(data)) or []


class Rig:
    """A pilot without links, and the messages of its vehicle. Every 0.05 s the vehicle sends what
    is due (heartbeats at 4 Hz, ranges at 10 Hz), then the pilot makes a step."""

    def __init__(
        self, *overrides: str, output_mode: OutputMode = OutputMode.FLY, text: str = MISSION
    ) -> None:
        mission = rig_mission(*overrides, text=text)
        self.pilot = flown_for_long(Pilot(mission, output_mode=output_mode))
        self.vehicle = Voice()
        self.source: Hashable = "vehicle"
        self.mode = GUIDED
        self.armed = True
        self.landed_state: int | None = 2  # MAV_LANDED_STATE_IN_AIR
        self.speaks = True
        self.ranges = True
        self.round_trip: float | None = 0.0
        """Round-trip time of TIMESYNC, s. None: TIMESYNC is not answered."""
        self.answers: list[tuple[float, int]] = []
        self.range_cm = 15000
        self.tick = 0
        self.now = 0.0
        self.sent: list[tuple[float, Any]] = []
        self.raw: list[bytes] = []

    def receive(
        self,
        message: Any,
        *,
        voice: Voice | None = None,
        link: str = VEHICLE,
        source: Hashable = None,
    ) -> None:
        """Pass a message to the pilot at the present time."""
        self.pilot.receive(
            (voice or self.vehicle).pack(message), self.now, source or self.source, link
        )

    def heartbeat(self) -> None:
        self.receive(heartbeat(self.mode, armed=self.armed))
        if self.landed_state is not None:
            self.receive(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))

    def answer(self) -> None:
        """Send the answers to TIMESYNC that are due."""
        due = [stamp for at, stamp in self.answers if at <= self.now + 1e-9]
        self.answers = [one for one in self.answers if one[1] not in due]
        for stamp in due if self.speaks else ():
            self.receive(mavlink.MAVLink_timesync_message(round(self.now * 1e9), stamp))

    def range(self, cm: int | None = None, **sender: Any) -> None:
        """Send a range measured now. sender: as in `receive`."""
        self.receive(scattering(cm or self.range_cm, 1_000_000 + round(self.now * 1000)), **sender)

    def step(self) -> list[Any]:
        """Run one step of the pilot and read its output."""
        data = output(self.pilot, self.now)
        self.raw.append(data)
        messages = decode(data)
        self.sent += [(self.now, message) for message in messages]
        if self.round_trip is not None:
            asked = [
                message.ts1
                for message in messages
                if message.get_type() == "TIMESYNC" and not message.tc1
            ]
            self.answers += [(self.now + self.round_trip, stamp) for stamp in asked]
        return messages

    def now_is(self, **state: Any) -> "Rig":
        """Change the state of the vehicle and its link from now on."""
        for name, value in state.items():
            assert hasattr(self, name)
            setattr(self, name, value)
        return self

    def run(self, seconds: float, also: Callable[[], object] = lambda: None, **state: Any) -> "Rig":
        """Let time pass, s. also: function called before each tick. state: changes of the vehicle
        from now on."""
        self.now_is(**state)
        for _ in range(round(seconds / TICK)):
            also()
            self.tick += 1
            self.now = round(self.tick * TICK, 6)
            if self.speaks and self.tick % 5 == 0:
                self.heartbeat()
            if self.ranges and self.tick % 2 == 0:
                self.range()
            self.answer()
            self.step()
        return self

    def engage(self, **state: Any) -> "Rig":
        """Run until the pilot is engaged, and some time longer."""
        self.run(3.0, **state)
        assert self.pilot.mission.phase.name == "ENGAGED"
        return self

    def pass_time(self, seconds: float) -> None:
        """Advance the time without messages and without a step of the pilot."""
        self.tick += round(seconds / TICK)
        self.now = round(self.tick * TICK, 6)

    def of(self, kind: str, since: float = -1.0) -> list[Any]:
        """Return the messages of a kind sent after a time."""
        return [
            message for then, message in self.sent if then > since and message.get_type() == kind
        ]

    def setpoints(self, since: float = -1.0) -> list[Any]:
        return self.of("SET_POSITION_TARGET_LOCAL_NED", since)

    def texts(self, since: float = -1.0) -> list[str]:
        return [message.text for message in self.of("STATUSTEXT", since)]

    def commands(self, number: int, since: float = -1.0) -> list[Any]:
        return [message for message in self.of("COMMAND_LONG", since) if message.command == number]

    def acknowledge(self, number: int, result: int = 0) -> None:
        self.receive(mavlink.MAVLink_command_ack_message(number, result))


@pytest.fixture
def rig() -> Rig:
    return Rig()


@pytest.fixture(scope="session")
def make_rig() -> type[Rig]:
    return Rig


@pytest.fixture(scope="session")
def copter() -> Any:
    """The adapter of ArduCopter in GUIDED."""
    return AUTOPILOTS["ardupilot", "copter"](VehicleFacts(speed=15.0, max_bank=0.7, drag=0.25))


@pytest.fixture
def make_session(copter: Any) -> Callable[..., Session]:
    """Return a session for an ArduCopter."""
    return lambda **settings: Session(LinkSettings(**settings), (copter,))


def x25(data: bytes) -> int:
    """Return the checksum of MAVLink, CRC-16/MCRF4XX, computed bit by bit without a library."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def attitude(ms: int, yaw: float = 0.0, **rest: float) -> Any:
    """Return ATTITUDE at a time since boot (ms), with angles in rad and rates in rad/s. Other
    fields are 0."""
    fields = dict.fromkeys(("roll", "pitch", "rollspeed", "pitchspeed", "yawspeed"), 0.0) | rest
    return mavlink.MAVLink_attitude_message(time_boot_ms=ms, yaw=yaw, **fields)


def vfr_hud(altitude: float, airspeed: float = 15.0) -> Any:
    """Return VFR_HUD with an altitude, m, and an airspeed, m/s."""
    return mavlink.MAVLink_vfr_hud_message(airspeed, 15.0, 0, 50, altitude, 0.0)


def boot_time(seconds: float) -> Any:
    """Return SYSTEM_TIME with a time since boot, s."""
    return mavlink.MAVLink_system_time_message(0, round(1000 * seconds))
