"""What every vehicle offers, what it is given to make a setpoint of, and the setpoint messages themselves."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan, radians
from typing import ClassVar, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.parameters import Rule
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.frames import GRAVITY, YawRate, euler_from_quaternion, quaternion_from_euler
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Steer

PLAUSIBLE_AIRSPEED = (0.5, 1.6)
"""Shares of the commanded airspeed between which a vehicle can fly at all: outside of them it is the sensor that lies
(a blocked pitot tube), and a bank or a thrust made from it would be wrong for the whole flight."""
TRUSTED_AGAIN = (0.6, 1.5)
"""Shares between which a doubted sensor is used again: at the bound itself thrust and bank would step each time that
noise crosses it."""
STANDING = 0.3
"""Speed, m/s, below which a reported velocity has no direction."""
VELOCITY_IGNORED = dialect.POSITION_TARGET_TYPEMASK_VX_IGNORE | dialect.POSITION_TARGET_TYPEMASK_AX_IGNORE
COPTER_KINDS = "QUADROTOR COAXIAL HELICOPTER HEXAROTOR OCTOROTOR TRICOPTER DECAROTOR DODECAROTOR GENERIC_MULTIROTOR"
COPTER_TYPES = frozenset(getattr(dialect, f"MAV_TYPE_{kind}") for kind in COPTER_KINDS.split())
PLANE_TYPES = frozenset((dialect.MAV_TYPE_FIXED_WING,))


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """What the mission says of the vehicle.

    speed: V, m/s. max_bank: rad, for vehicles that turn by banking. stick_bank: bank at full stick (PX4's FW_R_LIM),
    rad. trim_thrust: of level flight at V, 0 to 1, for a vehicle that takes thrust.
    """

    speed: float
    max_bank: float = 0.7
    stick_bank: float = 0.8727
    trim_thrust: float = 0.63

    def stick(self, bank: float) -> float:
        """The roll stick of MANUAL_CONTROL, in thousandths to the right, that holds a bank (rad, right positive)."""
        return 1000 * min(max(bank / self.stick_bank, -1.0), 1.0)


class Addressee(NamedTuple):
    """Whom a setpoint is for, and what may be used beside the command.

    target_system, target_component: its ids. motion: what is known of the vehicle's own motion. height: altitude to
    hold, m above sea level, None when the vehicle holds it or nothing is known. drag: of a copter, 1/s, as learnt.
    """

    target_system: int
    target_component: int
    motion: Motion
    height: float | None
    drag: float = 0.0


@dataclass(frozen=True, slots=True)
class Firmware:
    """What the vehicles of one autopilot share.

    key: its name in mission files. autopilot: MAV_AUTOPILOT of its HEARTBEAT. flown: the version whose behaviour our
    messages were flown with. streams: message id -> Hz to ask for. mode_numbers: custom_mode -> parameters 2 and 3 of
    MAV_CMD_DO_SET_MODE. bytewise: PARAM_VALUE carries the bytes of an integer, not its value. why_must_leave: why a
    flight must end by a change of mode, and is not resumed after a takeover, for people; empty where neither is so.
    """

    key: str
    autopilot: int
    flown: str
    streams: Mapping[int, float]
    mode_numbers: Callable[[int], tuple[int, ...]]
    bytewise: bool = False
    why_must_leave: str = ""


class Autopilot(ABC):
    """One vehicle kind: which mode is ours, the one setpoint message that steers it, and all that is special of it."""

    firmware: ClassVar[Firmware]
    name: ClassVar[str]
    """For people."""
    bundled: ClassVar[tuple[str, ...]]
    """Profiles of the bundled vehicle that imitate it."""
    vehicle_types: ClassVar[frozenset[int]]
    """MAV_TYPE values of its HEARTBEAT."""
    guided_mode: ClassVar[int]
    """custom_mode in which setpoints are obeyed."""
    mode_names: ClassVar[Mapping[int, str]]
    """custom_mode -> name, for people."""
    exits: ClassVar[Mapping[str, int]]
    """Exit action -> the custom_mode that it commands."""
    default_exit: ClassVar[str] = "loiter"
    """The exit action when the mission names none; "stop" leaves the vehicle in its mode and falls silent."""
    why_no_stop: ClassVar[str] = ""
    """Why it must not be left in its mode, for people; empty where it may."""
    shapes: ClassVar[frozenset[tuple[str, int | None]]]
    """(message type, type_mask or None) pairs that may be sent, and no others."""
    needs: ClassVar[frozenset[str]] = frozenset()
    """Names of `Motion` fields without which it cannot be flown."""
    parameters: ClassVar[tuple[Rule, ...]]
    """The autopilot's parameters that matter to a flight, and what their values imply."""
    flies: ClassVar[bool] = True
    """Whether it must be in the air before it may be engaged."""
    banks: ClassVar[bool] = False
    """Whether it turns by banking, and a mission must limit its bank."""
    measures_airspeed: ClassVar[bool] = False
    """Whether VFR_HUD.airspeed is one: a copter without a sensor sends its ground speed there, not to be used."""
    cruises: ClassVar[bool] = False
    """Whether it flies the airspeed that the autopilot itself holds, whatever the mission says."""
    ground_speed_sigma: ClassVar[float | None] = None
    """Share by which the ground speed may differ from the commanded one; None where the wind carries the vehicle."""
    velocity_loop: ClassVar[VelocityLoop | None] = None
    """How its velocity follows its nose; None where the nose shows the way."""
    least_turn_gain: ClassVar[float] = 1.0
    """The least realised over commanded turn rate to expect."""
    echo: ClassVar[int | None] = None
    """Id of the message in which it reports the setpoint that it flies; None if it reports none."""

    def __init__(self, facts: VehicleFacts) -> None:
        self._facts = facts
        self._doubts_airspeed = False

    @property
    def guided_name(self) -> str:
        """The mode that is ours, for people."""
        return self.mode_names[self.guided_mode]

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """Whether the guided mode is entered from this one only while setpoints flow, which it does not fly yet."""
        return False

    def request_mode(self, mode: int) -> Command:
        """The command that asks for a mode, by the autopilot's own numbers."""
        numbers = self.firmware.mode_numbers(mode)
        return Command(dialect.MAV_CMD_DO_SET_MODE, (dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *numbers))

    @abstractmethod
    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """The message that flies a steer."""

    def safe_setpoint(self, to: Addressee, now: float) -> Message:
        """The message to leave behind before falling silent: stand still, or fly straight on with the wings level."""
        return self.setpoint(Steer(YawRate(0.0), 0.0), to, now)

    def airspeed(self, measured: float | None) -> float:
        """The indicated airspeed to reckon with, m/s: as measured, or as commanded where that is missing or cannot be.
        Asked again with the same number, it says the same."""
        commanded = self._facts.speed
        if measured is None:
            return commanded
        least, most = (share * commanded for share in (TRUSTED_AGAIN if self._doubts_airspeed else PLAUSIBLE_AIRSPEED))
        self._doubts_airspeed = not least <= measured <= most
        return commanded if self._doubts_airspeed else measured

    def bank(self, steer: Steer, to: Addressee) -> float:
        """The bank of the coordinated turn, atan(w V/g), within the mission's limit; rad, right positive."""
        airspeed, most = to.motion.true_airspeed(self.airspeed(to.motion.airspeed)), self._facts.max_bank
        return min(max(atan(steer.yaw_rate * airspeed / GRAVITY), -most), most)


def turn_in(message: Message) -> float | None:
    """Return the turn in a setpoint, or in the vehicle's report of one, right positive: yaw rate (rad/s), or bank (rad)
    where attitudes are flown; None if it holds none."""
    kind, mask = message.get_type(), getattr(message, "type_mask", 0)
    if kind in ("SET_ATTITUDE_TARGET", "ATTITUDE_TARGET"):
        return euler_from_quaternion(message.q)[0]
    if kind == "NAV_CONTROLLER_OUTPUT":
        return radians(message.nav_roll)
    if not mask & dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE and hasattr(message, "yaw_rate"):
        return float(message.yaw_rate)
    if kind != "POSITION_TARGET_LOCAL_NED" or mask & VELOCITY_IGNORED:
        return None
    # ArduCopter does not report the yaw rate, but the velocity and the acceleration that we feed forward: a = V w to
    # the right of the velocity. Once our setpoints have timed out both are 0, which is no turn.
    speed2 = message.vx**2 + message.vy**2
    return float((message.vx * message.afy - message.vy * message.afx) / speed2) if speed2 > STANDING**2 else 0.0


def body_velocity(
    mask: int,
    to: Addressee,
    now: float,
    steer: Steer,
    *,
    down: float = 0.0,
    fed: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED in BODY_NED. down: m/s. fed: acceleration forward, right, down in the body frame,
    m/s^2. What the mask leaves out is sent as zero."""
    where = our_boot_ms(now), to.target_system, to.target_component, dialect.MAV_FRAME_BODY_NED
    position, velocity = (0.0, 0.0, 0.0), (steer.speed, 0.0, down)
    return dialect.MAVLink_set_position_target_local_ned_message(
        *where, mask, *position, *velocity, *fed, 0.0, steer.yaw_rate
    )


def attitude(mask: int, to: Addressee, now: float, *, roll: float, pitch: float = 0.0, thrust: float = 0.0) -> Message:
    """SET_ATTITUDE_TARGET: roll and pitch in rad (right and nose-up positive), thrust 0..1, no rates, yaw 0."""
    q, rates = quaternion_from_euler(roll, pitch, 0.0), (0.0, 0.0, 0.0)
    return dialect.MAVLink_set_attitude_target_message(
        our_boot_ms(now), to.target_system, to.target_component, mask, q, *rates, thrust
    )
