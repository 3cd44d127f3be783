"""`python -m circnav_mav`: the `circnav` command."""

from circnav_mav.cli import main

main()
