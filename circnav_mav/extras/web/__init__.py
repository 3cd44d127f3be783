"""Live page of a flight: a server in a separate process. A pipe to this process never blocks the
flight."""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    fly_options=["circnav_mav.extras.web.commands:WEB"],
    listener="circnav_mav.extras.web.feed:open_listener",
    order=40,
)
