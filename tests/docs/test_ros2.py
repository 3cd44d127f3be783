"""The ROS 2 node of the documents, with a stub of rclpy, because pip cannot install ROS 2."""

import sys
from math import cos, hypot, sin
from pathlib import Path
from runpy import run_path
from types import ModuleType, SimpleNamespace

import pytest

FILE = Path(__file__).parents[2] / "docs" / "ros2_node.py"


def message(**fields):
    """Return a message type; each field is created by its own type."""
    return lambda: SimpleNamespace(**{name: make() for name, make in fields.items()})


class StubNode:
    """A node with a clock set by the test and a publisher that records the messages."""

    time = 0.0
    given = {}  # noqa: RUF012

    def __init__(self, name):
        self.published = []
        self.callbacks = {}
        self.timers = []

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.given.get(name, default))

    def create_publisher(self, kind, topic, depth):
        assert topic == "cmd_vel"
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind, topic, callback, depth):
        self.callbacks[topic] = callback

    def create_timer(self, period, callback):
        self.timers.append((period, callback))

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(1e9 * self.time)))


@pytest.fixture
def node_class(monkeypatch):
    vector = message(x=float, y=float, z=float)
    names = {
        "rclpy": {"init": None}, "rclpy.node": {"Node": StubNode},
        "geometry_msgs.msg": {"Twist": message(linear=vector, angular=vector)},
        "nav_msgs.msg": {"Odometry": None}, "sensor_msgs.msg": {"Range": None},
    }  # fmt: skip
    for name in (*names, "geometry_msgs", "nav_msgs", "sensor_msgs"):
        module = ModuleType(name)
        module.__dict__.update(names.get(name, {}))
        monkeypatch.setitem(sys.modules, name, module)
    return run_path(str(FILE))["Circle"]


@pytest.mark.parametrize("clockwise", [True, False])
def test_ros2_node_circles_beacon_and_stops_without_ranges(node_class, monkeypatch, clockwise):
    """The test integrates the vehicle's motion from the published commands. The beacon is at (0,
    0)."""
    monkeypatch.setattr(StubNode, "given", {"radius": 60.0, "clockwise": clockwise})
    node = node_class()
    ((period, on_timer),) = node.timers
    x = -250.0
    y = 90.0
    yaw = 0.2
    rate = 0.0
    swept = 0.0
    ranges_until = 120.0
    assert on_timer() is None and node.published == []
    steps = round(130.0 / period)
    for step in range(steps):
        node.time = 100.0 + step * period
        stamp = SimpleNamespace(sec=int(node.time), nanosec=round(1e9 * (node.time % 1)))
        pose = SimpleNamespace(
            pose=SimpleNamespace(
                orientation=SimpleNamespace(x=0, y=0, z=sin(yaw / 2), w=cos(yaw / 2))
            )
        )
        twist = SimpleNamespace(
            twist=SimpleNamespace(linear=SimpleNamespace(x=12.0), angular=SimpleNamespace(z=rate))
        )
        node.callbacks["odom"](SimpleNamespace(pose=pose, twist=twist))
        if step * period < ranges_until:
            node.callbacks["range"](
                SimpleNamespace(header=SimpleNamespace(stamp=stamp), range=hypot(x, y))
            )
            radius = hypot(x, y)
        before = len(node.published)
        on_timer()
        if len(node.published) > before:
            rate = node.published[-1].angular.z
            assert node.published[-1].linear.x == 12.0
        yaw += period * rate
        new_x = x + period * 12.0 * cos(yaw)
        new_y = y + period * 12.0 * sin(yaw)
        swept += (
            (x * new_y - y * new_x) / (x * x + y * y)
            if 60.0 < step * period < ranges_until
            else 0.0
        )
        x, y = new_x, new_y
    assert radius == pytest.approx(60.0, abs=2.0)
    assert (swept < -6) if clockwise else (swept > 6)
    assert len(node.published) < steps - 9.0 / period, "no command without ranges"
