"""Export of a run folder as one MCAP file, for Foxglove and PlotJuggler."""

from circnav_mav.extension import Extension

EXTENSION = Extension(commands={"export": "circnav_mav.extras.mcap.commands:export"}, order=30)
