"""The live page of a flight: a server in a process of its own, fed through a pipe that never makes the flight wait."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    fly_options=["circnav_mav.extras.web.commands:WEB"],
    onlooker="circnav_mav.extras.web.feed:open_onlooker",
    order=40,
)
