"""Choice of a circle before the flight: `circnav plan`."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"plan": "circnav_mav.extras.plan.commands:plan"}, order=5)
"""The command `circnav plan`."""
