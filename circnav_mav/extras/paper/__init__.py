"""The three examples of the founding paper, flown and drawn."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"paper": "circnav_mav.extras.paper.commands:paper"}, order=70)
