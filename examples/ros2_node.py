"""ROS 2 node that uses the guidance: ranges and odometry in, velocity commands out.

    python3 examples/ros2_node.py --ros-args -p radius:=80 -p speed:=12 -p clockwise:=true \\
        -r odom:=/mavros/local_position/odom

The node subscribes to `range` (sensor_msgs/Range, horizontal, m) and `odom` (nav_msgs/Odometry:
yaw, yaw rate, speed; not the position), also from best-effort publishers such as MAVROS. It
publishes `cmd_vel` (geometry_msgs/Twist) at 20 Hz, but not before the first estimate and not while
ranges are missing. If commands are missing, the bridge to the autopilot must return control to the
autopilot.
"""

from contextlib import suppress
from math import atan2

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Range

from circnav_mav import Direction, Guidance, Orbit, OwnMotion, RangeSample

PERIOD = 0.05


def seconds(stamp):
    """Return a ROS time stamp in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def yaw_of(q):
    """Return the yaw of a quaternion, rad, counter-clockwise positive, as in the guidance and in
    ROS (REP 103)."""
    return atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


class Circle(Node):
    """Node that circles the beacon of the ranges."""

    def __init__(self):
        super().__init__("circnav")
        defaults = {
            "radius": 80.0,
            "speed": 12.0,
            "clockwise": True,
            "max_turn_rate": 0.4,
            "range_sigma": 0.5,
        }
        # Dynamic typing, because ROS reads `radius:=80` as an integer.
        any_type = ParameterDescriptor(dynamic_typing=True)
        values = {
            name: type(value)(self.declare_parameter(name, value, any_type).value)
            for name, value in defaults.items()
        }
        direction = Direction.CLOCKWISE if values["clockwise"] else Direction.COUNTERCLOCKWISE
        self.sigma = values["range_sigma"]
        self.orbit = Orbit(values["radius"], direction, values["speed"], values["max_turn_rate"])
        self.guidance = Guidance(self.orbit)
        self.commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Range, "range", self.on_range, qos_profile_sensor_data)
        self.create_subscription(Odometry, "odom", self.on_odometry, qos_profile_sensor_data)
        self.create_timer(PERIOD, self.on_timer)

    def now(self):
        """Return the node's time in seconds."""
        return 1e-9 * self.get_clock().now().nanoseconds

    def on_range(self, message):
        """Process a range."""
        stamp = seconds(message.header.stamp)
        self.guidance.update_range(
            RangeSample(stamp=stamp, time=self.now(), r=message.range, sigma=self.sigma)
        )

    def on_odometry(self, message):
        """Process yaw, yaw rate and speed."""
        twist = message.twist.twist
        yaw = yaw_of(message.pose.pose.orientation)
        self.guidance.update_motion(
            OwnMotion(self.now(), yaw, twist.angular.z, airspeed=twist.linear.x)
        )

    def on_timer(self):
        """Publish the turn command, if the guidance returns one."""
        command = self.guidance.command(self.now())
        if command is None:
            return
        message = Twist()
        message.linear.x = self.orbit.speed
        message.angular.z = command.turn_rate
        self.commands.publish(message)


def main():
    """Run the node until Ctrl-C."""
    rclpy.init()
    node = Circle()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
