"""State that our vehicle reports: mode, departures from the guided mode, landed state, battery and
reboots."""

from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.clocks import BOOT_WRAP, ClockSpeed, Order, StampFilter, UtcClock
from circnav_mav.mav.codec import Message
from circnav_mav.mav.identity import Identity
from circnav_mav.mav.statustext import TextReader
from circnav_mav.timers import Report

# During a silence of the vehicle, its clock may gain AHEAD seconds plus AHEAD_SHARE times the
# silence on ours, because links buffer messages and simulators may run faster than real time. A
# larger gain indicates another vehicle.
AHEAD = 5.0
AHEAD_SHARE = 0.25
APART = 0.2
"""Least time, s, between two heartbeats that were not queued on their way (ArduPilot's shortest
interval: 0.25 s). Queued heartbeats arrive closer together."""
NOT_FLYING = (
    dialect.MAV_LANDED_STATE_ON_GROUND,
    dialect.MAV_LANDED_STATE_TAKEOFF,
    dialect.MAV_LANDED_STATE_LANDING,
)
"""Values of EXTENDED_SYS_STATE.landed_state in which an aircraft must not be steered."""
HOVERS = (
    dialect.MAV_VTOL_STATE_TRANSITION_TO_FW,
    dialect.MAV_VTOL_STATE_TRANSITION_TO_MC,
    dialect.MAV_VTOL_STATE_MC,
)
"""Values of EXTENDED_SYS_STATE.vtol_state in which a quadplane must not be steered as a plane."""
BOOT_TIMES = ("SYSTEM_TIME", "ATTITUDE", "ATTITUDE_QUATERNION")
"""Message types from which the time since boot is read."""


class Change(Enum):
    """Change of the vehicle's state that a message reports."""

    LEFT = "the vehicle left the guided mode"
    DISARMED = "the vehicle was disarmed in the guided mode"
    REBOOTED = "the autopilot rebooted, or another vehicle has taken over its ids"


class VehicleState:
    """Newest reported state of the pinned vehicle. Messages of other senders must not be passed
    in."""

    def __init__(self, identity: Identity) -> None:
        """identity: holds the adapter of the vehicle."""
        self._identity = identity
        self.boot = StampFilter(wrap=BOOT_WRAP)
        """Filter of the vehicle's times since boot. Its `newest` is None until the vehicle has
        reported a time since boot."""
        self._lost_ours = False
        self._sequence: int | None = None
        self._late = False
        self._late_heartbeat: tuple[int, float] | None = None
        self.mode: int | None = None
        self.armed = False
        self.received_at = float("-inf")
        """Time of the vehicle's last mode report, s."""
        self.heartbeat_at = float("-inf")
        """Time of the newest heartbeat that is not reordered, s."""
        self.left_for: str | None = None
        """Mode entered when the vehicle last left the guided mode, None if it was disarmed."""
        self.landed: Report[int | None] = Report()
        """MAV_LANDED_STATE, None if undefined."""
        self.hovers = False
        """True for a quadplane that is not carried by its wing: in hover or in a transition."""
        self._battery: Report[float | None] = Report()
        self.reboots = 0
        """Number of reboots, including takeovers of the vehicle's ids by another vehicle."""
        self.unproven = False
        """True if the vehicle's identity is unconfirmed, after a silence or a change of address.
        Ids prove nothing, because many vehicles have the default ids. The time since boot proves
        the identity. If the vehicle has never reported it, no proof is needed."""
        self.clock_speed = ClockSpeed()
        self.utc = UtcClock()
        self.texts: deque[str] = deque(maxlen=8)
        self._text_reader = TextReader()
        self.firmware: str | None = None

    @property
    def in_our_mode(self) -> bool:
        """True if the vehicle follows setpoints: it is armed and reports the guided mode."""
        return self.armed and self.mode in self._identity.adapter.our_modes

    def on_ground(self, now: float) -> bool | None:
        """True on the ground, in a take-off or a landing. None: not reported."""
        # 10.0: largest age of a landed state that is used, s. circnav requests one per second; some
        # links send one in five seconds.
        landed = self.landed.live(now, 10.0)
        return None if landed is None else landed in NOT_FLYING

    def stands(self, now: float) -> bool:
        """True if the vehicle stands on the ground and has sent a mode report since then.

        Autopilots also report ON_GROUND when the motors are stopped in flight: the next mode report
        then shows that the vehicle is disarmed.
        """
        on_ground = self.on_ground(now) and self.landed.value == dialect.MAV_LANDED_STATE_ON_GROUND
        return bool(on_ground) and self.received_at > self.landed.changed

    @property
    def mode_name(self) -> str:
        return (
            "unknown"
            if self.mode is None
            else self._identity.adapter.mode_names.get(self.mode, f"mode {self.mode}")
        )

    def battery(self, now: float) -> float | None:
        """Return the remaining charge, percent, or None if it is not reported or stale."""
        # Largest age of a battery level that is used, s. SYS_STATUS arrives once a second.
        return self._battery.live(now, 5.0)

    def found(self) -> None:
        """Prepare for a vehicle that was found, for the first time or again."""
        self.landed = Report()
        self.moved()

    def moved(self) -> None:
        """Prepare for messages of the vehicle from another address, possibly by another route."""
        self._sequence, self.unproven = None, self.boot.newest is not None

    def lost(self) -> None:
        """Reset mode and armed state after the vehicle has become silent."""
        self._lost_ours = self.in_our_mode
        self.mode = None
        self.armed = False

    def continues(self, message: Message, now: float) -> bool:
        """True if a message from another address carries this vehicle's expected time since boot.

        A replayed frame carries an older time.
        """
        if self.boot.newest is None or message.get_type() not in BOOT_TIMES:
            return False
        passed = (now - self.boot.newest_at) * (self.clock_speed.found or 1.0)
        step = self.boot.unwrapped(message.time_boot_ms / 1000) - self.boot.newest
        return step > 0 and abs(step - passed) <= AHEAD + AHEAD_SHARE * passed

    def receive(self, message: Message, now: float) -> Change | None:
        """Process a message. Return the change that it reports, even if the vehicle's next message
        in the same step reverses the change."""
        self._late = self._overtaken(message.get_seq())
        reader = self.READERS.get(message.get_type())
        return None if reader is None else reader(self, message, now)

    def _read_heartbeat(self, message: Message, now: float) -> Change | None:
        self._late = self._is_late_heartbeat(message.get_seq(), now)
        if not self._late:
            self.heartbeat_at = now
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        return self._on_mode(message.custom_mode, armed, now)

    def _read_mode(self, message: Message, now: float) -> Change | None:
        """Process a CURRENT_MODE, which reports the mode as a heartbeat does. PX4 sends heartbeats
        at 1 Hz only, and some are lost."""
        mode = message.custom_mode
        return self._on_mode(mode, self.armed, now) if mode else None

    def _read_boot_time(self, message: Message, now: float) -> Change | None:
        return self._on_boot_time(message.time_boot_ms / 1000, now)

    def _read_system_time(self, message: Message, now: float) -> Change | None:
        self.utc.received(message.time_unix_usec / 1e6, now)
        return self._read_boot_time(message, now)

    def _read_battery(self, message: Message, now: float) -> None:
        charge = float(message.battery_remaining)
        self._battery.update(charge if charge >= 0 else None, now)

    def _read_landed_state(self, message: Message, now: float) -> None:
        # MAV_LANDED_STATE_UNDEFINED is 0. PX4 sends it until its land detector runs.
        self.landed.update(message.landed_state or None, now)
        self.hovers = message.vtol_state in HOVERS

    def _read_text(self, message: Message, now: float) -> None:
        text, before = self._text_reader.read(message)
        if before is not None and self.texts:
            self.texts.pop()
        self.texts.append(text)

    def _read_version(self, message: Message, now: float) -> None:
        version = message.flight_sw_version
        self.firmware = f"{version >> 24}.{version >> 16 & 255}.{version >> 8 & 255}"

    READERS: ClassVar[Mapping[str, Callable[["VehicleState", Message, float], Change | None]]] = {
        "HEARTBEAT": _read_heartbeat,
        "CURRENT_MODE": _read_mode,
        "SYSTEM_TIME": _read_system_time,
        "ATTITUDE": _read_boot_time,
        "ATTITUDE_QUATERNION": _read_boot_time,
        "SYS_STATUS": _read_battery,
        "EXTENDED_SYS_STATE": _read_landed_state,
        "STATUSTEXT": _read_text,
        "AUTOPILOT_VERSION": _read_version,
    }
    """Readers by message type."""

    def _overtaken(self, sequence: int) -> bool:
        """True if a frame is reordered: the vehicle sent it before a frame that has already
        arrived."""
        behind = 0 if self._sequence is None else (self._sequence - sequence) % 256
        # 64: largest backward step of the sequence number that is taken as reordering, half a
        # second or more of frames. A frame with a larger step is taken as new: frames were lost, or
        # the vehicle has rebooted.
        if 0 < behind <= 64:
            return True
        self._sequence = sequence
        return False

    def _is_late_heartbeat(self, sequence: int, now: float) -> bool:
        """True if a heartbeat is reordered."""
        # Some senders number their heartbeats separately, or number only their heartbeats. Then
        # every heartbeat looks reordered. A heartbeat that looks reordered is accepted if the
        # previous heartbeat looked reordered too and both arrive at heartbeat rate.
        before = self._late_heartbeat
        if not self._late:
            self._late_heartbeat = None
        elif before is None or now - before[1] > APART:
            self._late_heartbeat = (sequence, now)
            return before is None or not 0 < (sequence - before[0]) % 256 < 128
        return self._late

    def _on_mode(self, mode: int, armed: bool, now: float) -> Change | None:
        """Store the mode and armed state. Return the end of the guided mode, or None."""
        self.received_at = now
        ours = mode in self._identity.adapter.our_modes
        # A reordered report may end our control, but never start it: the operator may have taken
        # over after the report was sent.
        if self._late and not self.in_our_mode and armed and ours:
            return None
        was_ours = self.in_our_mode or self._lost_ours
        self._lost_ours = False
        self.mode = mode
        self.armed = armed
        if not was_ours or self.in_our_mode:
            return None
        self.left_for = None if ours else self.mode_name
        return Change.DISARMED if self.left_for is None else Change.LEFT

    def _on_boot_time(self, stamp: float, now: float) -> Change | None:
        """Return a reboot if the time since boot steps backward, but not for its wrap after 49.7
        days.

        After a silence, a boot time that has advanced more than plausible (AHEAD) belongs to
        another vehicle. It is treated as a reboot, too.
        """
        boot = self.boot.unwrapped(stamp)
        newest = self.boot.newest
        order = self.boot.order(boot, now)
        if order in (Order.OLDER, Order.JUMPED):
            return None
        rebooted = order is Order.RESTARTED
        if not rebooted:
            if newest is not None and self.unproven and self.clock_speed.noticed is None:
                silence = now - self.boot.newest_at
                rebooted = boot - newest - silence > AHEAD + AHEAD_SHARE * silence
            self.clock_speed.received(boot, now)
        self.boot.take(boot, now)
        self.unproven = False
        self.reboots += rebooted
        return Change.REBOOTED if rebooted else None
