"""The live page's server over real HTTP, without any delay of the flight."""

import http.client
import importlib.util
import json
import os
import re
import select
import signal
import socket
from contextlib import ExitStack, closing
from itertools import product
from math import inf, nan

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.web import feed
from circnav_mav.extras.web.__main__ import COLUMNS, MOST_POINTS, NEWEST, History
from circnav_mav.extras.web.feed import LivePage, WebError
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listeners
from tests.flight.lockstep import flight
from tests.process import PATIENCE

VERDICT = "COMPLETED: flown to its end"


@pytest.fixture(scope="module", autouse=True)
def patient():
    """Allow long times to start and end the server, because the test machine may be busy."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("START_PATIENCE", "STOP_PATIENCE"):
            patch.setattr(feed, name, PATIENCE)
        patch.setattr(feed, "AWAY", 5.0)  # a server without a browser ends 5 s after its flight
        yield


def open_page(pilot, port=0, *, truth=False):
    # send every tick to the page
    return LivePage(pilot, Listeners(), port, name="small", tolerance=5.0, speed=0.0, truth=truth)


@pytest.fixture
def flown():
    return flight("quickstart")


@pytest.fixture
def page(flown):
    with closing(open_page(flown.pilot)) as page:
        yield page


@pytest.fixture(scope="module")
def idle():
    """The page of a flight that has not begun, for read-only tests."""
    with closing(open_page(flight("quickstart").pilot)) as page:
        yield page


def fly(flown, seconds, page):
    """Fly, and show each tick to the page after its step, as the runner does. Wait for the server,
    so that no line is dropped."""

    def show(flown):
        select.select([], [page._pipe], [])
        page.on_step(flown.ticks[-1] if flown.ticks else None, LoopStep(flown.now), None)

    flown.fly(seconds, show)


def address(page):
    host, port = page.url.removeprefix("http://").rstrip("/").split(":")
    return host, int(port)


def ask(page, method, path, **headers):
    connection = http.client.HTTPConnection(*address(page), timeout=PATIENCE)
    connection.request(method, path, headers=headers)
    return connection.getresponse()


class Stream:
    """A browser that reads the events one by one."""

    def __init__(self, page):
        self.response = ask(page, "GET", "/events")

    def next(self):
        """Return kind and content of the next event."""
        kind = self.response.readline().decode().removeprefix("event: ").strip()
        data = self.response.readline().decode().removeprefix("data: ")
        self.response.readline()
        return kind, json.loads(data)

    def until(self, kind):
        """Return the content of the first event of a kind."""
        while True:
            found, content = self.next()
            if found == kind:
                return content

    def until_tick(self, time):
        """Return the tick of a time. A browser that reads too slowly receives the tick as part of
        the history."""
        while True:
            kind, content = self.next()
            tick = content["newest"] if kind == "history" else content
            if kind != "end" and tick is not None and tick["time"] == round(time, 5):
                return tick


# --- HTTP


def test_page_loads_nothing_from_other_hosts(idle):
    answer = ask(idle, "GET", "/")
    body = answer.read().decode()
    assert answer.status == 200
    assert answer.headers["Content-Type"].startswith("text/html")
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert not any(
        word in body for word in ("http://", "https://", "@import", "url(", '<link rel="stylesheet')
    )


def test_server_refuses_other_paths_and_methods(idle):
    for method, path in product(
        ("POST", "PUT", "DELETE", "PATCH", "OPTIONS"), ("/", "/events", "/report")
    ):
        assert ask(idle, method, path).status == 405, (method, path)
    for method, path in product(("GET", "POST"), ("/nothing", "/../history.py", "/stop")):
        assert ask(idle, method, path).status == 404, (method, path)
    assert ask(idle, "GET", "/events", Host="elsewhere.example").status == 400


def test_idle_connections_do_not_block_the_page(idle):
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", address(idle)[1]))
    with ExitStack() as held:
        for _ in range(60):
            held.enter_context(socket.create_connection(address(idle)))
        assert ask(idle, "GET", "/").status == 200
        assert Stream(idle).response.status == 200


# --- the stream


def test_browser_receives_history_state_and_verdict(flown, page, tmp_path):
    early = Stream(page)
    fly(flown, 8.0, page)
    early.until_tick(flown.ticks[-1].time)  # wait until the server has received the whole flight
    stream = Stream(page)
    begun = stream.until("history")
    assert (begun["flight"]["name"], begun["flight"]["radius"]) == ("small", 100.0)
    assert {point[0] for point in begun["points"]} == {round(tick.time, 5) for tick in flown.ticks}
    assert begun["newest"]["time"] == round(flown.ticks[-1].time, 5)
    assert re.fullmatch(r"2\d{3}-\d\d-\d\d \d\d:\d\d UTC", begun["flight"]["date"])
    assert begun["newest"]["facts"]["vehicle"] == "ardupilot copter, firmware 4.6.3"
    fly(flown, 10.0, page)
    newest = stream.until_tick(flown.ticks[-1].time)
    assert (newest["phase"], newest["r"]) == ("engaged", round(flown.ticks[-1].r, 5))
    page.show_verdict(VERDICT, tmp_path)
    page.close()
    assert stream.until("end") == {"verdict": VERDICT, "report": str(tmp_path / "report.html")}


# --- after the flight


def test_finished_page_reloads_with_report(flown, page, tmp_path):
    first = Stream(page)
    fly(flown, 6.0, page)
    page.show_verdict(VERDICT, tmp_path)
    page.close()
    first.until("end")
    assert ask(page, "GET", "/report").status == 404
    (tmp_path / "report.html").write_text("<p>flown</p>")
    reloaded = Stream(page)
    assert reloaded.until("history")["count"] > 50
    assert reloaded.until("end")["verdict"] == VERDICT
    assert reloaded.until("report") == first.until("report") == {}
    assert ask(page, "GET", "/report").read() == b"<p>flown</p>"


def test_server_ends_after_flight_without_browser(flown, monkeypatch, tmp_path):
    monkeypatch.setattr(feed, "AWAY", 0.2)
    seen = open_page(flown.pilot)
    unseen = open_page(flown.pilot)
    stream = Stream(seen)
    stream.until("history")
    for page in (unseen, seen):
        page.show_verdict(VERDICT, tmp_path)
        page.close()
    assert unseen._process.wait(PATIENCE) == 0
    stream.until("end")
    assert seen._process.poll() is None
    stream.response.close()
    assert seen._process.wait(PATIENCE) == 0


# --- page and browser do not delay the flight


@pytest.fixture(scope="module")
def ticks_alone():
    """Return the ticks of a flight without a page: about 600, more than the pipe's buffer can
    hold."""
    return flight("quickstart").fly(20.0).ticks


def test_blocked_server_does_not_delay_ticks(flown, page, ticks_alone, tmp_path):
    def show(flown):
        page.on_step(flown.ticks[-1] if flown.ticks else None, LoopStep(flown.now), None)

    os.kill(page._process.pid, signal.SIGSTOP)
    flown.fly(15.0, show)
    os.kill(page._process.pid, signal.SIGKILL)
    page._process.wait()
    flown.fly(20.0, show)
    page.show_verdict(VERDICT, tmp_path)
    assert flown.ticks == ticks_alone


def test_slow_browser_does_not_delay_flight_or_page(flown, page, ticks_alone, tmp_path):
    with ExitStack() as stuck:
        for _ in range(5):
            browser = stuck.enter_context(socket.create_connection(address(page)))
            browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            browser.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        stream = Stream(page)
        fly(flown, 20.0, page)
        page.show_verdict(VERDICT, tmp_path)
        page.close()
        assert flown.ticks == ticks_alone
        assert stream.until("end")["verdict"] == VERDICT


# --- frames that any sender may send


def truth_frame(north, east):
    """Truth message of the bundled vehicle at a position relative to the target."""
    message = mavlink.MAVLink_debug_float_array_message(
        0, b"SIM_TRUTH", 0, [north, east] + [0.0] * 56
    )
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=7)))


@pytest.mark.parametrize("bundled", [True, False], ids=["bundled vehicle", "another vehicle"])
def test_browser_receives_true_position_of_simulated_vehicle(flown, monkeypatch, bundled):
    assert [feed._plain(value) for value in (nan, inf, 1.000001)] == [None, None, 1.0]
    queued = []
    good = truth_frame(30.0, 4.0)
    frames = [truth_frame(nan, 2.0), good, truth_frame(1.0, inf), truth_frame(-inf, 1.0)]
    flown.fly(8.0)
    with closing(open_page(flown.pilot, truth=bundled)) as page:
        monkeypatch.setattr(page, "_queue_event", queued.append)
        for frame in frames:
            page.on_step(
                flown.ticks[-1], LoopStep(flown.now, received=[("main", "anybody", [frame])]), None
            )
    known = [(None, None), *[(4.0, 30.0)] * 3] if bundled else [(None, None)] * 4
    assert [(what["east"], what["north"]) for what in queued] == known


# --- bounded


def history_of(many):
    history = History()
    for number in range(many):
        history.take(
            json.dumps({"kind": "tick", **dict.fromkeys(COLUMNS), "time": number}).encode()
        )
    return history


def test_history_of_long_flight_is_bounded():
    many = 4 * MOST_POINTS + 1000
    (event,) = history_of(many).since(None)
    begun = json.loads(event.partition("data: ")[2])
    times = [point[0] for point in begun["points"]]
    assert MOST_POINTS / 2 <= len(times) <= MOST_POINTS
    assert times == [number * begun["every"] for number in range(len(times))]
    assert times[-1] > many - begun["every"] - 1
    assert begun["newest"]["time"] == many - 1
    history = history_of(500)
    assert [json.loads(event.partition("data: ")[2])["time"] for event in history.since(497)] == [
        497,
        498,
        499,
    ]
    assert history.since(500) == []
    assert len(history.since(500 - NEWEST)) == NEWEST
    assert [event.partition("\n")[0] for event in history.since(500 - NEWEST - 1)] == [
        "event: history"
    ]


# --- refusals


def test_missing_web_packages_are_named(flown, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "uvicorn" else find(name)
    )
    with pytest.raises(WebError, match=r"--web needs the package uvicorn: pip install uvicorn"):
        open_page(flown.pilot)
