"""What the ArduPilot vehicles have in common: mode switching, arming, streams."""

from collections.abc import Callable, Mapping

from sim.autopilots.contract import ACCEPTED, DENIED, FAILED, FORCE, WARNING, Command, Say

VERSION_4_6_3 = 0x040603FF
CUSTOM_MODE_ENABLED = 1
DO_SET_MODE, ARM_DISARM = 176, 400

# Mission float and int, param float, command int, attitude target, flight termination, compass calibration, MAVLink 2,
# fence and rally; FTP is left out because nobody answers it here.
CAPABILITIES = 1 | 2 | 4 | 8 | 64 | 2048 | 4096 | 8192 | 16384 | 32768
SET_LOCAL_POSITION = 128 | 256

# Not in ArduPilot 4.6's dialect: its parser drops them, so they are neither obeyed nor forwarded.
UNKNOWN_IDS = frozenset({53, 220, 221, 222, 223, 224, 420, 435, 436, 437, 441, 513, 516, 517})

# What SET_MESSAGE_INTERVAL takes (mavlink_id_to_ap_message_id in GCS_Common.cpp), whether or not this vehicle fills it.
_STREAMABLE_IDS = (
    "0 1 2 24 26 27 29 30 31 32 33 35 36 42 46 49 62 65 74 83 85 87 110 116 124 125 128 129 132 "
    "136 137 143 147 148 152 158 163 164 165 168 173 178 182 191 192 193 226 230 241 242 245 246 251 259 11020 11039"
)
STREAMABLE = frozenset(int(number) for number in _STREAMABLE_IDS.split())

# REQUEST_DATA_STREAM groups (GCS_Mavlink.cpp of the vehicles).
STREAM_GROUPS: Mapping[int, tuple[int, ...]] = {
    2: (1, 24, 62),
    3: (65,),
    6: (33, 32),
    10: (30,),
    11: (74,),
    12: (2, 132, 147, 168, 193),
}


class ModeSwitch:
    """The mode and its changes: which are refused, with which ack and text."""

    def __init__(self, modes: Mapping[str, int], mode: int, say: Say) -> None:
        self._names = {number: name for name, number in modes.items()}
        self._say = say
        self.mode = mode

    def command(self, command: Command, obstacle: Callable[[int], str | None], enter: Callable[[int], None]) -> int:
        """MAV_CMD_DO_SET_MODE: the ack."""
        base, custom = command.params[0], command.params[1]
        if not (base == base and int(base) & CUSTOM_MODE_ENABLED):
            return DENIED
        return self.change(int(custom) if custom == custom and abs(custom) < 2**31 else -1, obstacle, enter)

    def change(self, number: int, obstacle: Callable[[int], str | None], enter: Callable[[int], None]) -> int:
        """Enter a mode unless it is unknown or `obstacle` names what stands against it."""
        if number == self.mode:
            return ACCEPTED
        if number not in self._names:
            self._say(WARNING, f"No such mode {number}")
            return FAILED
        reason = obstacle(number)
        if reason is not None:
            self._say(WARNING, f"Mode change to {self._names[number]} failed: {reason}")
            return FAILED
        self.mode = number
        enter(number)
        return ACCEPTED


def arming_ack(command: Command, armed: bool, refusal: str | None, flying: bool, say: Say) -> tuple[int, bool]:
    """MAV_CMD_COMPONENT_ARM_DISARM: the ack, and whether the vehicle is armed afterwards."""
    wish, force = command.params[0], command.params[1] == FORCE
    if wish == 1:
        if armed:
            return ACCEPTED, True
        if refusal is not None and not force:
            say(WARNING, f"Arm: {refusal}")
            return FAILED, False
        return ACCEPTED, True
    if wish == 0:
        return (FAILED, True) if armed and flying and not force else (ACCEPTED, False)
    return DENIED, armed
