"""ROS 2 node that uses the guidance: ranges and odometry in, velocity commands out.

    python3 examples/ros2_node.py --ros-args -p radius:=80 -p speed:=12 -p clockwise:=true \\
        -r odom:=/mavros/local_position/odom

The node subscribes to `range` (sensor_msgs/Range, horizontal, m) and `odom` (nav_msgs/Odometry:
yaw, yaw rate, speed; not the position), also from best-effort publishers such as MAVROS. Messages
with empty fields, or in another frame, are named in warnings: see ros2_inputs.py. The node
publishes `cmd_vel` (geometry_msgs/Twist) at 20 Hz, but not before the first estimate and not while
ranges are missing. If commands are missing, the bridge to the autopilot must return control to the
autopilot.
"""

from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from ros2_inputs import Inputs
from sensor_msgs.msg import Range

from circnav_mav import Direction, Guidance, Orbit

PERIOD = 0.05


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
        self.orbit = Orbit(values["radius"], direction, values["speed"], values["max_turn_rate"])
        self.guidance = Guidance(self.orbit)
        warn = self.get_logger().warning
        self.inputs = Inputs(warn, values["range_sigma"], self.orbit.speed)
        self.commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Range, "range", self.on_range, qos_profile_sensor_data)
        self.create_subscription(Odometry, "odom", self.on_odometry, qos_profile_sensor_data)
        self.create_timer(PERIOD, self.on_timer)

    def now(self):
        """Return the node's time in seconds."""
        return 1e-9 * self.get_clock().now().nanoseconds

    def on_range(self, message):
        """Process a range."""
        self.guidance.update_range(self.inputs.range(message, self.now()))

    def on_odometry(self, message):
        """Process yaw, yaw rate and speed."""
        motion = self.inputs.motion(message, self.now())
        if motion is not None:
            self.guidance.update_motion(motion)

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
