"""Option of `circnav fly` that opens the live page."""

import click

WEB = click.option(
    "--web",
    is_flag=False,
    flag_value="8080",
    metavar="[PORT]",
    help=(
        "Also show the flight in a browser on this computer, at http://127.0.0.1:PORT. [default"
        " port: 8080]"
    ),
)
