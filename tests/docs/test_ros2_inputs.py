"""Inputs of the ROS 2 node: messages with empty fields or in another frame."""

import importlib.util
from math import cos, pi, sin
from pathlib import Path
from types import SimpleNamespace as Message

import pytest

PLACE = Path(__file__).parents[2] / "examples" / "ros2_inputs.py"


@pytest.fixture
def warned():
    return []


@pytest.fixture
def inputs(warned):
    spec = importlib.util.spec_from_file_location("ros2_inputs", PLACE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Inputs(warned.append, sigma=0.5, speed=12.0)


def odometry(yaw, velocity=(11.0, 2.0), turn_rate=0.2, w=None):
    q = Message(w=cos(yaw / 2) if w is None else w, x=0.0, y=0.0, z=sin(yaw / 2))
    twist = Message(
        linear=Message(x=velocity[0], y=velocity[1]), angular=Message(x=0.0, y=0.0, z=turn_rate)
    )
    return Message(pose=Message(pose=Message(orientation=q)), twist=Message(twist=twist))


def range_of(sec, nanosec):
    return Message(range=99.0, header=Message(stamp=Message(sec=sec, nanosec=nanosec)))


def test_complete_messages_are_read_without_warning(inputs, warned):
    assert inputs.range(range_of(7, 500_000_000), 8.0)[:3] == (7.5, 8.0, 99.0)
    own = inputs.motion(odometry(pi / 3), 8.0)
    assert own[:4] == pytest.approx((8.0, pi / 3, 0.2, 125**0.5))
    assert warned == []


def test_range_with_stamp_0_uses_arrival_time(inputs, warned):
    samples = [inputs.range(range_of(0, 0), 8.0 + 0.1 * step) for step in range(60)]
    assert all(sample.stamp == sample.time for sample in samples)
    assert warned == 2 * ["range: its stamp is 0: the time of its arrival is used"]


def test_odometry_without_twist_uses_commanded_speed(inputs, warned):
    owns = [
        inputs.motion(odometry(3.1 + 0.02 * step, (0.0, 0.0), 0.0), 0.1 * step) for step in range(6)
    ]
    assert owns[0] is None
    assert all(own[2:4] == pytest.approx((0.2, 12.0)) for own in owns[1:])
    assert warned == ["odom: its twist is 0: the commanded speed is used"]


@pytest.mark.parametrize("w", [0.0, float("nan")])
def test_odometry_without_orientation_is_not_used(inputs, warned, w):
    assert inputs.motion(odometry(0.0, w=w), 8.0) is None
    assert len(warned) == 1 and warned[0].startswith("odom: |orientation|^2 is")


def test_warning_names_twist_given_in_map_frame(inputs, warned):
    """The vehicle flies north and its twist is east, north."""
    own = inputs.motion(odometry(pi / 2, (0.0, 12.0)), 8.0)
    assert own.airspeed == 12.0
    assert len(warned) == 1 and "twist does not point forward" in warned[0]
