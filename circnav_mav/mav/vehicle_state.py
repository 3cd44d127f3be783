"""What our vehicle reports: its mode and when it left ours, whether it flies, when it has started."""

from collections import deque

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.clocks import BOOT_WRAP, ClockSpeed, RemoteClock
from circnav_mav.mav.codec import Message
from circnav_mav.mav.statustext import TextReader

REBOOT_STEP = 1.0
"""Backward step of the vehicle's boot time, s, that proves a reboot."""
AHEAD, AHEAD_SHARE = 5.0, 0.25
"""How much farther than ours the vehicle's time may have gone through a silence, s and share of the silence: links
buffer, and simulators hurry."""
OVERTAKEN = 64
"""Most frames, in half a second or more of the vehicle's, by which one may have been overtaken on its way. An older one
counts as new: there were losses, or the vehicle has started again."""
APART = 0.2
"""Least time between two heartbeats that come by themselves, s (ArduPilot's fastest: 0.25); those of a backlog come at
once."""
BATTERY_MAX_AGE = 5.0
"""Age, s, from which on a battery level is not known any more; SYS_STATUS comes once a second."""
NOT_FLYING = (
    dialect.MAV_LANDED_STATE_ON_GROUND,
    dialect.MAV_LANDED_STATE_TAKEOFF,
    dialect.MAV_LANDED_STATE_LANDING,
)
"""EXTENDED_SYS_STATE.landed_state in which an aircraft is not to be steered."""
BOOT_TIMES = ("SYSTEM_TIME", "ATTITUDE", "ATTITUDE_QUATERNION")
"""Types of the messages whose time since boot is read."""
READ = (
    *("HEARTBEAT", "CURRENT_MODE", "SYS_STATUS", "EXTENDED_SYS_STATE", "STATUSTEXT", "AUTOPILOT_VERSION"),
    *BOOT_TIMES,
)
"""Types of the messages that are read here."""


class VehicleState:
    """Keeps the newest of everything; only messages of the pinned vehicle come here."""

    def __init__(self, adapter: Autopilot) -> None:
        self._adapter = adapter
        self.boot = RemoteClock(wrap=BOOT_WRAP)
        """The vehicle's times since boot, the newest None before it has reported one."""
        self._lost_ours = False
        self._sequence: int | None = None
        self._late = False
        self._late_heartbeat: tuple[int, float] | None = None
        self.mode: int | None = None
        self.armed = False
        self.heard_at = float("-inf")
        """When the vehicle last reported its mode, s."""
        self.heartbeats = 0
        self.departures = 0
        """Times that the guided mode was left, or the vehicle disarmed in it: also between two looks at it."""
        self.left_for: str | None = None
        """The mode of the newest departure, None where the vehicle was disarmed."""
        self.on_ground: bool | None = None
        self._battery: float | None = None
        self._battery_at = float("-inf")
        self.reboots = 0
        """Times that the vehicle has started again, or that another one has taken its ids over."""
        self.unproven = False
        """Whether it is not known yet, after a silence or from another address, that it is the vehicle of before: ids
        are what every vehicle of a maker comes with. Its time tells; one that has reported none before need not."""
        self.clock_speed = ClockSpeed()
        self.texts: deque[str] = deque(maxlen=8)
        self._text_reader = TextReader()
        self.firmware: str | None = None

    @property
    def in_our_mode(self) -> bool:
        """Whether the vehicle obeys setpoints: armed, and its own heartbeat names the guided mode."""
        return self.armed and self.mode == self._adapter.guided_mode

    @property
    def mode_name(self) -> str:
        return "unknown" if self.mode is None else self._adapter.mode_names.get(self.mode, f"mode {self.mode}")

    def battery(self, now: float) -> float | None:
        """What is left, percent; None where it is not reported, or not any more."""
        return self._battery if now - self._battery_at <= BATTERY_MAX_AGE else None

    def found(self, adapter: Autopilot) -> None:
        """The vehicle is there, for the first time or again."""
        self._adapter, self.on_ground = adapter, None
        self.moved()

    def moved(self) -> None:
        """The vehicle speaks from another address, maybe by another way."""
        self._sequence, self.unproven = None, self.boot.newest is not None

    def lost(self) -> None:
        """The vehicle has fallen silent."""
        self._lost_ours = self.in_our_mode
        self.mode, self.armed = None, False

    def continues(self, message: Message, now: float) -> bool:
        """True if a message from another address carries the time since boot that this vehicle must have by now. A
        frame that was sent before, and is sent again, does not."""
        if self.boot.newest is None or message.get_type() not in BOOT_TIMES:
            return False
        passed = (now - self.boot.newest_at) * (self.clock_speed.found or 1.0)
        step = self.boot.unwrapped(message.time_boot_ms / 1000) - self.boot.newest
        return step > 0 and abs(step - passed) <= AHEAD + AHEAD_SHARE * passed

    def receive(self, message: Message, now: float) -> None:
        kind = message.get_type()
        self._late = self._overtaken(message.get_seq())
        if kind == "HEARTBEAT":
            self._late = self._is_late_heartbeat(message.get_seq(), now)
            self._tells_mode(message.custom_mode, bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED), now)
            self.heartbeats += not self._late
        elif kind == "CURRENT_MODE" and message.custom_mode:
            # proves the mode and the link as a heartbeat does: PX4 sends those once a second only, and some are lost
            self._tells_mode(message.custom_mode, self.armed, now)
        elif kind in BOOT_TIMES:
            self._tells_boot_time(message.time_boot_ms / 1000, now)
        elif kind == "SYS_STATUS":
            self._battery = float(message.battery_remaining) if message.battery_remaining >= 0 else None
            self._battery_at = now
        elif kind == "EXTENDED_SYS_STATE":
            unknown = message.landed_state == dialect.MAV_LANDED_STATE_UNDEFINED
            self.on_ground = None if unknown else message.landed_state in NOT_FLYING
        elif kind == "STATUSTEXT":
            text, before = self._text_reader.read(message)
            if before is not None and self.texts:
                self.texts.pop()
            self.texts.append(text)
        elif kind == "AUTOPILOT_VERSION":
            version = message.flight_sw_version
            self.firmware = f"{version >> 24}.{version >> 16 & 255}.{version >> 8 & 255}"

    def _overtaken(self, sequence: int) -> bool:
        """Whether a frame of the vehicle was sent before one that is here already."""
        behind = 0 if self._sequence is None else (self._sequence - sequence) % 256
        if 0 < behind <= OVERTAKEN:
            return True
        self._sequence = sequence
        return False

    def _is_late_heartbeat(self, sequence: int, now: float) -> bool:
        """Not, where the one before seemed overtaken, too, and they go on from one to the other at their own pace: then
        they come by a counter of their own, or all else comes without one."""
        before = self._late_heartbeat
        if not self._late:
            self._late_heartbeat = None
        elif before is None or now - before[1] > APART:
            self._late_heartbeat = (sequence, now)
            return before is None or not 0 < (sequence - before[0]) % 256 < 128
        return self._late

    def _tells_mode(self, mode: int, armed: bool, now: float) -> None:
        """The vehicle's mode, and whether that takes it out of our hands. What was overtaken may take it, and never
        gives it: the operator may have it by now."""
        self.heard_at = now
        if self._late and not self.in_our_mode and armed and mode == self._adapter.guided_mode:
            return
        was_ours, self._lost_ours = self.in_our_mode or self._lost_ours, False
        self.mode, self.armed = mode, armed
        if was_ours and not self.in_our_mode:
            self.departures += 1
            self.left_for = None if mode == self._adapter.guided_mode else self.mode_name

    def _tells_boot_time(self, stamp: float, now: float) -> None:
        """A boot time that steps back is a reboot; the counter's own wrap after 49.7 days is not. After a silence one
        that has gone on by more than ours is another vehicle's."""
        boot, newest = self.boot.unwrapped(stamp), self.boot.newest
        step = 0.0 if newest is None else boot - newest
        if step < -REBOOT_STEP:
            if not self.boot.set_anew(boot, now):
                return
            self.reboots += 1
        else:
            if self.unproven and self.clock_speed.noticed is None:
                silence = now - self.boot.newest_at
                self.reboots += step - silence > AHEAD + AHEAD_SHARE * silence
            self.clock_speed.heard(boot, now)
        self.boot.take(boot, now)
        self.unproven = False
