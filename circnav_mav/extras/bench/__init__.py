"""Every law through wind, gusts, moving targets and bad sensors: one table."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"bench": "circnav_mav.extras.bench.commands:bench"}, order=60)
