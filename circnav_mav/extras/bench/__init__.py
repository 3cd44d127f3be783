"""Benchmark of all laws in wind and gusts, with moving targets and bad sensors, as one table."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    commands={"bench": "circnav_mav.extras.bench.commands:bench"},
    functions={"bench": "circnav_mav.extras.bench.api:bench"},
    order=60,
)
