"""`python -m circnav_mav`: the `circnav` command."""

from circnav_mav.cli import main

if __name__ == "__main__":  # the locator's process imports this, too
    main()
