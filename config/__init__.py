"""The mission and campaign files that come with circnav; installed as circnav_mav.config."""
