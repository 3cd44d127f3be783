"""Option of `circnav fly` that opens the live page."""

import click

WEB = click.option(
    "--web",
    is_flag=False,
    flag_value="8080",
    metavar="[PORT]",
    help=(
        "Also serve a live page of the flight to browsers on this computer, at"
        " http://127.0.0.1:PORT. [default port: 8080]"
    ),
)
