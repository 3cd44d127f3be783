"""The judge of the fault matrix detects each forbidden setpoint, so the matrix can fail."""

from math import nan

from pymavlink.dialects.v20 import all as mavlink

from tests.tools.fault_link.frames import write
from tests.tools.faults.judge import Allowed, Witness, broken_rule, is_safe, is_setpoint

ALLOWED = Allowed(yaw_rate=0.5, speed=10.0, bank=0.7, pitch=0.26, climb=1.0)
LEVEL = (1.0, 0.0, 0.0, 0.0)
BANKED = (0.9, 0.43589, 0.0, 0.0)  # quaternion of a bank of 0.90 rad


def velocity(forward: float = 10.0, yaw_rate: float = 0.5, climb: float = 0.0) -> bytes:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x407, *(0.0, 0.0, 0.0), *(forward, 0.0, climb), *(0.0, 0.0, 0.0), 0.0, yaw_rate
    )
    return write(message, 1, 191)


def attitude(q: tuple[float, ...]) -> bytes:
    return write(
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0xC6, q, 0.0, 0.0, 0.0, 0.0), 1, 191
    )


def test_fault_matrix_verdict_names_limit_that_setpoint_exceeds() -> None:
    for frame in (velocity(), attitude(LEVEL)):
        assert is_setpoint(frame)
        assert broken_rule(frame, ALLOWED) is None
    for frame, words in (
        (velocity(forward=10.1), "forward"),
        (velocity(yaw_rate=-0.51), "yaw rate"),
        (velocity(climb=2.0), "climb"),
        (velocity(yaw_rate=nan), "not finite"),
        (attitude(BANKED), "bank"),
    ):
        assert words in (broken_rule(frame, ALLOWED) or "")


def test_safe_setpoint_commands_no_turn() -> None:
    assert is_safe(velocity(forward=0.0, yaw_rate=0.0, climb=0.5))
    assert is_safe(attitude(LEVEL))
    assert not is_safe(velocity(forward=0.0, yaw_rate=0.1))
    assert not is_safe(attitude(BANKED))


def test_fault_matrix_records_loss_and_return_of_control() -> None:
    witness = Witness("arducopter")

    def beat(mode: int, armed: int = 128, system: int = 1, *, waited: bool = False) -> None:
        frame = write(mavlink.MAVLink_heartbeat_message(2, 3, 1 | armed, mode, 4, 3), system, 1)
        witness.receive(frame, waited=waited)

    beat(5)
    assert not witness.taken
    beat(4)
    beat(5, system=2)
    assert not witness.taken
    beat(5)
    assert witness.taken
    beat(4)
    assert not witness.taken
    beat(4, armed=0)
    assert witness.taken
    witness.stood_still()
    beat(4, waited=True)
    assert witness.unproved
    beat(4)
    assert not witness.unproved
