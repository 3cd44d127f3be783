"""External position of a position to an autopilot that has lost its own.

The package does not steer: the core cannot import it. The position is computed from the beacon's
place that the extra `locate` estimates.
"""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    tables={
        "external_position": "circnav_mav.extras.external_position.settings:ExternalPositionTable"
    },
    checks=["circnav_mav.extras.external_position.settings:check_table"],
    listener="circnav_mav.extras.external_position.listener:open_listener",
    order=12,  # after `locate`, whose listener it needs
)
