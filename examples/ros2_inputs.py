"""Inputs of ros2_node.py: a range or an odometry message in, a value for `Guidance` out.

Many publishers leave fields of these messages empty, or fill them in another frame. A message that
cannot be used is dropped with a warning that names the input. This file does not import ROS.
"""

from math import atan2, hypot, remainder, tau

from circnav_mav import OwnMotion, RangeSample

EVERY = 5.0
"""Time between two equal warnings, s."""


class Inputs:
    """Reader of the messages. warn: function that logs a line. sigma: of a range, m. speed:
    commanded speed, m/s."""

    def __init__(self, warn, sigma, speed):
        self._warn = warn
        self._sigma = sigma
        self._speed = speed
        self._warned = {}
        self._yaw = None

    def range(self, message, now):
        """Return the sample of a sensor_msgs/Range."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if stamp == 0:
            self._throttled("range: its stamp is 0: the time of its arrival is used", now)
        return RangeSample(stamp=stamp or now, time=now, r=message.range, sigma=self._sigma)

    def motion(self, message, now):
        """Return the motion of a nav_msgs/Odometry, or None if it has no orientation."""
        q = message.pose.pose.orientation
        norm = q.w**2 + q.x**2 + q.y**2 + q.z**2
        # A publisher without orientation sends 0. Rounding changes the norm by much less than 0.1.
        if not abs(norm - 1) < 0.1:
            self._throttled(f"odom: |orientation|^2 is {norm:.2f}, not 1: not used", now)
            return None
        # counter-clockwise positive, as in the guidance and in ROS (REP 103)
        yaw = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        before = self._yaw
        self._yaw = (now, yaw)
        linear = message.twist.twist.linear
        turn_rate = message.twist.twist.angular.z
        speed = hypot(linear.x, linear.y)
        # The speed is the same in each frame. A vehicle flies along its nose, except for the angle
        # of its drift in the wind.
        if linear.x < 0.5 * speed:
            self._throttled(
                "odom: its twist does not point forward: is it in the frame of the map, not of the"
                " vehicle? Its speed alone is used",
                now,
            )
        if speed == 0:
            self._throttled("odom: its twist is 0: the commanded speed is used", now)
            speed = self._speed
            if turn_rate == 0:
                if before is None or now <= before[0]:
                    return None
                turn_rate = remainder(yaw - before[1], tau) / (now - before[0])
        return OwnMotion(now, yaw, turn_rate, airspeed=speed)

    def _throttled(self, text, now):
        """Warn, but not more than once per EVERY seconds about one fault."""
        fault = text[:20]
        if now - self._warned.get(fault, now - EVERY) >= EVERY:
            self._warned[fault] = now
            self._warn(text)
