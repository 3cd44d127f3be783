"""Drivers of ranging radios: they convert received bytes to readings, without I/O. docs/radios.md
shows how to write a driver."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"ranging": "circnav_mav.extras.radios.commands:ranging"}, order=20)
