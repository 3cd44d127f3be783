"""The ROS 2 node of the examples as a process, with the real rclpy (pip: see .ci/nightly)."""

import signal
import time
from math import cos, hypot, sin

import pytest

from tests.process import PATIENCE, python

PERIOD = 0.05
SPEED = 12.0


@pytest.mark.nightly
@pytest.mark.parametrize("clockwise", [True, False])
def test_ros2_node_circles_beacon_until_signal(clockwise):
    """The test integrates the vehicle's motion from the published commands. The beacon is at (0,
    0). The test publishes with best-effort QoS, as MAVROS does."""
    rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed (.ci/nightly installs it)")
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import Range

    process = python(
        "examples/ros2_node.py",
        *("--ros-args", "-p", "radius:=60", "-p", f"clockwise:={str(clockwise).lower()}"),
    )
    rclpy.init()
    node = rclpy.create_node("vehicle")
    ranges = node.create_publisher(Range, "range", qos_profile_sensor_data)
    odometry = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
    commands = []
    node.create_subscription(Twist, "cmd_vel", commands.append, 10)
    x = -100.0
    y = 30.0
    yaw = 0.2
    rate = 0.0
    swept = 0.0
    try:
        for step in range(round(45.0 / PERIOD)):
            began = time.monotonic()
            own = Odometry()
            own.pose.pose.orientation.z = sin(yaw / 2)
            own.pose.pose.orientation.w = cos(yaw / 2)
            own.twist.twist.linear.x = SPEED
            own.twist.twist.angular.z = rate
            odometry.publish(own)
            measured = Range(range=hypot(x, y))
            measured.header.stamp = node.get_clock().now().to_msg()
            ranges.publish(measured)
            while time.monotonic() - began < PERIOD:
                rclpy.spin_once(node, timeout_sec=0.005)
            rate = commands[-1].angular.z if commands else 0.0
            yaw += PERIOD * rate
            new_x = x + PERIOD * SPEED * cos(yaw)
            new_y = y + PERIOD * SPEED * sin(yaw)
            if step * PERIOD > 20.0:
                swept += (x * new_y - y * new_x) / (x * x + y * y)
            x, y = new_x, new_y
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        node.destroy_node()
        rclpy.try_shutdown()
    assert commands[-1].linear.x == SPEED
    assert hypot(x, y) == pytest.approx(60.0, abs=4.0)
    assert (swept < -3) if clockwise else (swept > 3)
    assert (process.returncode, errors) == (0, "")
