"""Hand-back of a position to an autopilot that has lost its own.

The package does not steer: the core cannot import it. The position is computed from the beacon's
place that the extra `locate` estimates.
"""

from circnav_mav.extension import Extension

EXTENSION = Extension(
    tables={"handback": "circnav_mav.extras.handback.settings:HandBackTable"},
    checks=["circnav_mav.extras.handback.settings:check_table"],
    onlooker="circnav_mav.extras.handback.onlooker:open_onlooker",
    order=12,  # after `locate`, whose onlooker it needs
)
