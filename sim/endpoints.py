"""Where the vehicle is reached: udpin:HOST:PORT, udpout:HOST:PORT or tcpin:HOST:PORT, with or without slashes."""

import re
from typing import NamedTuple

KINDS = ("udpin", "udpout", "tcpin")
PATTERN = re.compile(r"^(?P<kind>\w+):(?://)?(?P<host>[^:/]*):(?P<port>\d+)/?$")


class EndpointError(ValueError):
    """An endpoint that cannot be used, in one line."""


class Endpoint(NamedTuple):
    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


def parse_endpoint(text: str) -> Endpoint:
    match = PATTERN.match(text.strip())
    if match is None or match["kind"] not in KINDS or not match["host"]:
        raise EndpointError(
            f'"{text}" is not an endpoint, write udpin:127.0.0.1:14550, udpout:HOST:PORT or tcpin:HOST:PORT'
        )
    port = int(match["port"])
    if not 0 < port < 65536:
        raise EndpointError(f'"{text}": port {port} is outside 1 .. 65535')
    return Endpoint(match["kind"], match["host"], port)
