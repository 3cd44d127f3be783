"""The smallest mission file that names its vehicle and its link."""

TEXT = """\
name = "small"

[vehicle]
autopilot = "ardupilot"
kind = "copter"
speed_mps = 15.0
max_turn_rate_deg_s = 20.0

[orbit]
radius_m = 100.0
direction = "clockwise"

[guidance]
law = "smooth"

[ranging]
message = "distance_sensor"
rate_hz = 10.0
sigma_m = 0.5

[link]
endpoint = "udpin:127.0.0.1:14550"

[limits]
duration_s = 60.0
"""
