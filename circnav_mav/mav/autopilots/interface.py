"""What every vehicle adapter offers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.gate import Steer


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What an adapter may use besides the command: whom to address, and our own clock."""

    target_system: int
    target_component: int


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
    def shapes(self) -> frozenset[tuple[str, int]]:
        """(message type, type_mask) pairs that may be sent, and no others."""
        ...

    @property
    def streams(self) -> Mapping[int, float]:
        """Message id -> Hz to ask for."""
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
