"""circnav_mav: circle an unknown target with nothing but a range, over MAVLink."""

__version__ = "0.1.0"
