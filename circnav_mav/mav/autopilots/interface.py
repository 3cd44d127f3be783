"""What every vehicle adapter offers, and what it is told."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Steer

PLAUSIBLE_AIRSPEED = (0.5, 1.6)
"""Shares of the commanded airspeed between which a vehicle can fly at all: outside of them it is the sensor that lies
(a blocked pitot tube), and a bank or a thrust made from it would be believed for the whole flight."""
BELIEVED_AGAIN = (0.6, 1.5)
"""Shares between which one that was doubted is believed again: at the bound itself thrust and bank would step each time
that noise crosses it."""


@dataclass(frozen=True, slots=True)
class AirLoops:
    """Our own height and airspeed loops, for a vehicle that is told pitch and thrust.

    pitch = pitch_per_height e_h - pitch_per_climb climb (rad, e_h = wanted - present height, m), within max_pitch;
    thrust = trim_thrust + thrust_per_speed e_V + thrust_per_bank (1/cos(roll) - 1), within 0 and 1.
    The defaults are those flown on PX4's simulated plane at 10 m/s.
    """

    trim_thrust: float = 0.63
    thrust_per_speed: float = 0.08
    thrust_per_bank: float = 0.25
    pitch_per_height: float = 0.02
    pitch_per_climb: float = 0.04
    max_pitch: float = 0.26


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """What the mission says of the vehicle.

    speed: V, m/s. max_bank: rad, for vehicles that turn by banking. stick_bank: bank at full stick (PX4's FW_R_LIM),
    rad. climb_gain, max_climb: our height hold by climb rate, 1/s and m/s. loops: pitch and thrust.
    """

    speed: float
    max_bank: float = 0.7
    stick_bank: float = 0.8727
    climb_gain: float = 0.5
    max_climb: float = 1.0
    loops: AirLoops = AirLoops()

    def stick(self, bank: float) -> float:
        """The roll stick of MANUAL_CONTROL, in thousandths to the right, that holds a bank (rad, right positive)."""
        return 1000 * min(max(bank / self.stick_bank, -1.0), 1.0)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What an adapter may use besides the command.

    target_system, target_component: whom to address. motion: what is known of the vehicle's own motion.
    height: altitude to hold, m above sea level, None when the vehicle holds it or nothing is known.
    """

    target_system: int
    target_component: int
    motion: Motion
    height: float | None


class Airspeed:
    """Which airspeed to reckon with. Asked again with the same number, it says the same."""

    def __init__(self, commanded: float) -> None:
        """commanded: V, m/s."""
        self._commanded = commanded
        self._doubted = False

    def believed(self, measured: float | None) -> float:
        """The measured one, m/s, or the commanded one where that is missing or cannot be."""
        if measured is None:
            return self._commanded
        least, most = (share * self._commanded for share in (BELIEVED_AGAIN if self._doubted else PLAUSIBLE_AIRSPEED))
        self._doubted = not least <= measured <= most
        return self._commanded if self._doubted else measured


class Autopilot(Protocol):
    """One vehicle kind: which mode is ours, and the one setpoint message that steers it."""

    @property
    def name(self) -> str:
        """For people."""
        ...

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT of its HEARTBEAT."""
        ...

    @property
    def vehicle_types(self) -> frozenset[int]:
        """MAV_TYPE values of its HEARTBEAT."""
        ...

    @property
    def guided_mode(self) -> int:
        """custom_mode in which setpoints are obeyed."""
        ...

    @property
    def mode_names(self) -> Mapping[int, str]:
        """custom_mode -> name, for people."""
        ...

    @property
    def exits(self) -> Mapping[str, int]:
        """Exit action -> the custom_mode that it commands."""
        ...

    @property
    def default_exit(self) -> str:
        """The exit action when the mission names none; "stop" leaves the vehicle in its mode and falls silent."""
        ...

    @property
    def shapes(self) -> frozenset[tuple[str, int | None]]:
        """(message type, type_mask or None) pairs that may be sent, and no others."""
        ...

    @property
    def streams(self) -> Mapping[int, float]:
        """Message id -> Hz to ask for."""
        ...

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """Whether the guided mode is entered from this one only while setpoints flow, which it does not fly yet."""
        ...

    @property
    def flies(self) -> bool:
        """Whether it must be in the air before it may be engaged."""
        ...

    @property
    def measures_airspeed(self) -> bool:
        """Whether VFR_HUD.airspeed is an airspeed. A copter without a sensor sends its ground speed there, which is a
        velocity and not to be used; it holds the commanded speed instead."""
        ...

    @property
    def velocity_loop(self) -> VelocityLoop | None:
        """How its velocity follows its nose; None where the nose shows the way."""
        ...

    def airspeed(self, measured: float | None) -> float:
        """The airspeed to reckon with, m/s: what was measured, as far as it is believed."""
        ...

    @property
    def needs(self) -> frozenset[str]:
        """Names of `Motion` fields without which it cannot be flown."""
        ...

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """The message that flies a steer."""
        ...

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """The message to leave behind before falling silent."""
        ...

    def request_mode(self, mode: int) -> Command:
        """The command that asks for a mode."""
        ...
