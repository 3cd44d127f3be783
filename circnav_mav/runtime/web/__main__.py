"""The server of the live page, which the flight starts: `python -m circnav_mav.runtime.web FD`, its feed on stdin.

FD is a listening socket. It says "ready" and serves until its input ends.
"""

import asyncio
import os
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.routing import Route

from circnav_mav.runtime.web import with_charts
from circnav_mav.runtime.web.history import History

POLL = 0.1
"""Time, s, between two looks for news; a browser that reads slowly is asked less often and skips."""
GRACE = 0.5
"""Time, s, for the last event to reach the browsers."""
MOST_BROWSERS = 40
MOST_CONNECTIONS = 500
"""Those count, too, that were opened and ask for nothing."""
NICENESS = 10
"""The flight comes first where there is too little of the processor."""
LONGEST_LINE = 1 << 16
PAGE = with_charts(Path(__file__).with_name("page.html"))
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'",
    "X-Content-Type-Options": "nosniff",
}


def application(history: History) -> Starlette:
    """The page and its stream. There is nothing else, and nothing that can be changed. Other names for this host are
    refused, so that no other page in the browser can read it."""

    async def page(request: Request) -> Response:
        return HTMLResponse(PAGE, headers=HEADERS)

    streams = 0

    async def stream() -> AsyncIterator[str]:
        nonlocal streams
        streams += 1
        seen: int | None = None
        try:
            while True:
                over, news, seen = history.over, history.since(seen), history.count
                for event in news:
                    yield event
                if over:
                    yield history.end
                    return
                await asyncio.sleep(POLL)
        finally:
            streams -= 1

    async def events(request: Request) -> Response:
        if streams >= MOST_BROWSERS:
            return Response("too many browsers are watching", status_code=503)
        return StreamingResponse(stream(), media_type="text/event-stream", headers=HEADERS)

    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"])
    return Starlette(routes=[Route("/", page), Route("/events", events)], middleware=[hosts])


async def serve(listener: socket.socket) -> None:
    """Serve until the input ends."""
    history = History()
    reader = asyncio.StreamReader(limit=LONGEST_LINE)
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    config = uvicorn.Config(
        application(history), log_config=None, access_log=False, lifespan="off", ws="none",
        limit_concurrency=MOST_CONNECTIONS, timeout_graceful_shutdown=1,
    )  # fmt: skip
    server = uvicorn.Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    os.write(1, b"ready\n")
    async for line in reader:
        history.take(line)
    history.over = True
    await asyncio.sleep(GRACE)
    server.should_exit = True
    await serving


if __name__ == "__main__":
    os.nice(NICENESS)
    asyncio.run(serve(socket.socket(fileno=int(sys.argv[1]))))
