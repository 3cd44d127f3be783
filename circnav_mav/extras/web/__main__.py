"""Server of the live page, started by the flight: `python -m circnav_mav.extras.web FD AWAY`. FD is
a listening socket, and stdin is the feed. The server prints "ready". After the flight, the server
closes stdout. It then serves the page and the report until no browser has shown them for AWAY
seconds, or until LONGEST_STAY is over."""

import asyncio
import json
import os
import socket
import sys
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from math import inf
from pathlib import Path
from time import monotonic
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from circnav_mav.report.charts import with_charts

POLL = 0.1
"""Interval of updates to a browser, s. A slow browser gets fewer updates."""
LONGEST_STAY = 3600.0
"""Longest time for which the page is served after the flight, s. Chosen: a forgotten tab must not
keep a process."""
LONGEST_LINE = 1 << 16
MOST_POINTS = 3000
"""Maximum number of points of a chart. When it is exceeded, every second point is dropped, and of
later points half as many are stored."""
NEWEST = 100
"""Number of newest ticks that are stored completely. A browser that has missed more ticks receives
the whole history again."""
COLUMNS = (
    "time",
    "measured",
    "r",
    "r_dot",
    "turn_rate",
    "x",
    "y",
    "drift_x",
    "drift_y",
    "east",
    "north",
    "heading",
    "state",
    "mode",
    "law",
    "desired",
    "turn_gain",
)
"""Values of a tick that are stored in a point of the charts."""
PAGE = with_charts(Path(__file__).with_name("page.html"))
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        "img-src data:; connect-src 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
}


class History:
    """History of the flight for browsers that connect late, of bounded size. Converts lines of the
    feed to server-sent events."""

    def __init__(self) -> None:
        self.count = 0
        """Number of ticks received."""
        self.over = False
        """True after the feed has ended."""
        self.closed = False
        """True when the server stops."""
        self.seen = -inf
        """Time at which the last event stream to a browser ended, s; infinity while a stream is
        open."""
        self._flight: dict[str, Any] = {}
        self._end: dict[str, Any] = {"verdict": None}
        self._points: list[list[float | str | None]] = []
        self._every = 1
        self._newest: deque[str] = deque(maxlen=NEWEST)

    def take(self, line: bytes) -> None:
        """Process a line of the feed."""
        what = json.loads(line)
        kind = what.pop("kind")
        if kind == "flight":
            self._flight = what
        elif kind == "end":
            self._end = what
        else:
            self._newest.append(json.dumps(what))
            self._keep([what[name] for name in COLUMNS])

    def _keep(self, point: list[float | str | None]) -> None:
        if self.count % self._every == 0:
            self._points.append(point)
        self.count += 1
        if len(self._points) > MOST_POINTS:
            self._points = self._points[::2]
            self._every *= 2

    def since(self, seen: int | None) -> list[str]:
        """Return the events for a browser that has received `seen` ticks, None for a new
        browser."""
        if seen is None or self.count - seen > len(self._newest):
            return [_event("history", self._all())]
        behind = self.count - seen
        return [_event("tick", tick) for tick in list(self._newest)[len(self._newest) - behind :]]

    @property
    def end(self) -> str:
        """Event at the end of the flight, with the verdict. The verdict is null if the flight's
        process was killed."""
        return _event("end", json.dumps(self._end))

    @property
    def report(self) -> Path | None:
        """Report of the flight once it is written, else None."""
        path = self._end.get("report")
        return Path(path) if path and Path(path).is_file() else None

    def _all(self) -> str:
        """Return the whole history as JSON, for a new browser."""
        newest = json.loads(self._newest[-1]) if self._newest else None
        whole = {
            "flight": self._flight,
            "columns": COLUMNS,
            "points": self._points,
            "every": self._every,
        }
        return json.dumps({**whole, "most": MOST_POINTS, "count": self.count, "newest": newest})


def _event(kind: str, data: str) -> str:
    return f"event: {kind}\ndata: {data}\n\n"


def application(history: History) -> Starlette:
    """Return the web application: the page, its event stream and the report, all read-only.

    Requests for a host name other than 127.0.0.1 or localhost are rejected, so that no other page
    in the browser can read the flight.
    """

    async def page(request: Request) -> Response:
        return HTMLResponse(PAGE, headers=HEADERS)

    async def report(request: Request) -> Response:
        with suppress(OSError):
            if (path := history.report) is not None:
                return HTMLResponse(path.read_bytes(), headers=HEADERS)
        return PlainTextResponse("no report yet", status_code=404, headers=HEADERS)

    streams: set[object] = set()

    async def stream() -> AsyncIterator[str]:
        me = object()
        seen: int | None = None
        ended = False
        written = False
        streams.add(me)
        history.seen = inf
        try:
            while not history.closed:
                over = history.over
                news = history.since(seen)
                seen = history.count
                for event in news:
                    yield event
                if over and not ended:
                    ended = True
                    yield history.end
                if ended and not written and history.report is not None:
                    written = True
                    yield _event("report", "{}")
                await asyncio.sleep(POLL)
        finally:
            streams.remove(me)
            history.seen = inf if streams else monotonic()

    async def events(request: Request) -> Response:
        return StreamingResponse(stream(), media_type="text/event-stream", headers=HEADERS)

    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"])
    routes = [Route("/", page), Route("/events", events), Route("/report", report)]
    return Starlette(routes=routes, middleware=[hosts])


async def serve(listener: socket.socket, away: float) -> None:
    """Serve until stdin ends, and then as long as a browser shows the page. away: see `stay`."""
    history = History()
    reader = asyncio.StreamReader(limit=LONGEST_LINE)
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    config = uvicorn.Config(
        application(history),
        http="h11",
        log_config=None,
        access_log=False,
        lifespan="off",
        ws="none",
        limit_concurrency=100,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    os.write(1, b"ready\n")
    async for line in reader:
        history.take(line)
    history.over = True
    # 0.5: time for the last event to reach the browsers, s.
    await asyncio.sleep(0.5)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # close stdout: the flight then stops waiting
    await stay(history, away)
    history.closed = server.should_exit = True
    await serving


async def stay(history: History, away: float) -> None:
    """Wait until no browser has shown the page for `away` seconds, or LONGEST_STAY is over."""
    begun = monotonic()
    while monotonic() - history.seen < away and monotonic() - begun < LONGEST_STAY:
        await asyncio.sleep(POLL)


if __name__ == "__main__":
    # 10: niceness of the server process, so that the flight has priority on a busy processor.
    os.nice(10)
    asyncio.run(serve(socket.socket(fileno=int(sys.argv[1])), float(sys.argv[2])))
