"""The live page of a flight: a server in a process of its own, fed through a pipe that never makes the flight wait."""
