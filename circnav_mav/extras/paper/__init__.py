"""The founding paper's three examples, flown and drawn."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"paper": "circnav_mav.extras.paper.commands:paper"}, order=70)
