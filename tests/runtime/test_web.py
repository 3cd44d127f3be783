"""The live page's server over real HTTP, and that nothing about it can hold up a flight."""

import http.client
import importlib.util
import json
import os
import select
import signal
import socket
from math import inf, nan

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runtime.recorder import LoopStep
from circnav_mav.runtime.web import feed
from circnav_mav.runtime.web.__main__ import MOST_BROWSERS
from circnav_mav.runtime.web.feed import LivePage, WebError
from circnav_mav.runtime.web.history import COLUMNS, MOST_POINTS, NEWEST, History
from tests.flight.lockstep import flight
from tests.process import PATIENCE

VERDICT = "COMPLETED: flown to its end"


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A busy machine may start and end the server slowly: neither is judged here."""
    for name in ("START_PATIENCE", "STOP_PATIENCE"):
        monkeypatch.setattr(feed, name, PATIENCE)


def open_page(pilot, port=0, *, truth=False):
    return LivePage(pilot, port, name="small", tolerance=5.0, speed=0.0, truth=truth)  # every tick is told


def telling(page):
    """What the runner does after each step."""
    return lambda flown: page.show(flown.ticks[-1] if flown.ticks else None, LoopStep(flown.now))


def patiently(page):
    """The same at a pace that the server keeps, so that no line is dropped."""

    def tell(flown):
        select.select([], [page._pipe], [])
        telling(page)(flown)

    return tell


@pytest.fixture
def flown():
    return flight("quickstart")


@pytest.fixture
def page(flown):
    page = open_page(flown.pilot)
    yield page
    page.close()


def ask(page, method, path, **headers):
    port = int(page.url.rstrip("/").rpartition(":")[2])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request(method, path, headers=headers)
    return connection.getresponse()


class Stream:
    """A browser that reads the events one by one."""

    def __init__(self, page):
        self.response = ask(page, "GET", "/events")

    def next(self):
        """Kind and content of the next event."""
        kind = self.response.readline().decode().removeprefix("event: ").strip()
        data = self.response.readline().decode().removeprefix("data: ")
        self.response.readline()
        return kind, json.loads(data)

    def until(self, kind, wanted=lambda content: True):
        """The content of the first event of a kind that is wanted."""
        while True:
            found, content = self.next()
            if found == kind and wanted(content):
                return content

    def until_tick(self, time):
        """The tick of a time; a browser that has fallen behind gets it with the history."""
        while True:
            kind, content = self.next()
            tick = content["newest"] if kind == "history" else content
            if kind != "end" and tick is not None and tick["time"] == round(time, 5):
                return tick


# --- HTTP ---


def test_the_page_is_served_whole_and_needs_no_other_host(page):
    answer = ask(page, "GET", "/")
    body = answer.read().decode()
    assert answer.status == 200
    assert answer.headers["Content-Type"].startswith("text/html")
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert not any(word in body for word in ("http://", "https://", "@import", "url(", '<link rel="stylesheet'))


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS"])
@pytest.mark.parametrize("path", ["/", "/events"])
def test_there_is_nothing_that_changes_anything(page, method, path):
    assert ask(page, method, path).status == 405


@pytest.mark.parametrize("path", ["/nothing", "/../history.py", "/stop"])
def test_an_unknown_path_is_not_found(page, path):
    assert ask(page, "GET", path).status == 404
    assert ask(page, "POST", path).status == 404


def test_another_name_for_this_host_is_refused(page):
    assert ask(page, "GET", "/events", Host="elsewhere.example").status == 400


def test_no_other_interface_is_bound(page):
    """The port of the page is free on another of this machine's addresses, and nobody answers there."""
    port = int(page.url.rstrip("/").rpartition(":")[2])
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", port))


# --- the stream ---


def test_a_browser_gets_what_was_what_is_and_the_verdict(flown, page):
    flown.fly(8.0, patiently(page))
    stream = Stream(page)
    begun = stream.until("history")
    assert begun["flight"]["name"] == "small"
    assert begun["flight"]["radius"] == 100.0
    flown.fly(10.0, patiently(page))
    newest = stream.until_tick(flown.ticks[-1].time)
    assert newest["phase"] == "engaged"
    assert newest["r"] == round(flown.ticks[-1].r, 5)
    page.finish(VERDICT)
    page.close()
    assert stream.until("end") == {"verdict": VERDICT}
    assert stream.response.read() == b""


def test_a_late_browser_gets_the_flight_so_far(flown, page):
    early = Stream(page)
    flown.fly(8.0, patiently(page))
    last = flown.ticks[-1].time
    early.until_tick(last)  # the server has it all
    begun = Stream(page).until("history")
    assert {point[0] for point in begun["points"]} == {round(tick.time, 5) for tick in flown.ticks}
    assert begun["newest"]["time"] == round(last, 5)


def test_a_flight_that_just_vanishes_ends_the_stream_without_a_verdict(flown, page):
    flown.fly(2.0, patiently(page))
    stream = Stream(page)
    stream.until("history")
    page.close()
    assert stream.until("end") == {"verdict": None}


# --- nothing holds up the flight ---


def ticks_alone():
    return flight("quickstart").fly(20.0).ticks


def test_a_server_that_hangs_costs_no_tick(flown, page):
    os.kill(page._process.pid, signal.SIGSTOP)
    flown.fly(20.0, telling(page))  # some 600 ticks, far more than the pipe holds
    assert flown.ticks == ticks_alone()
    os.kill(page._process.pid, signal.SIGCONT)
    page.finish(VERDICT)
    page.close()
    assert page._process.returncode == 0


def test_a_server_that_was_killed_costs_no_tick(flown, page):
    flown.fly(5.0, telling(page))
    os.kill(page._process.pid, signal.SIGKILL)
    page._process.wait()
    flown.fly(20.0, telling(page))
    assert flown.ticks == ticks_alone()
    page.finish(VERDICT)


def test_a_browser_that_never_reads_holds_up_nobody(flown, page):
    port = int(page.url.rstrip("/").rpartition(":")[2])
    stuck = []
    for _ in range(5):
        browser = socket.create_connection(("127.0.0.1", port))
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        browser.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        stuck.append(browser)
    stream = Stream(page)
    flown.fly(20.0, telling(page))
    page.finish(VERDICT)
    page.close()
    assert flown.ticks == ticks_alone()
    assert stream.until("end")["verdict"] == VERDICT
    for browser in stuck:
        browser.close()


def test_a_number_that_json_does_not_know_is_told_as_unknown(flown):
    assert feed._plain(float("nan")) is None
    assert feed._plain(float("inf")) is None


# --- frames that anybody may send ---


def truth_frame(north, east):
    """The vehicle so far from the target, as the bundled vehicle tells its truth."""
    numbers = [north, east] + [0.0] * 56
    message = mavlink.MAVLink_debug_float_array_message(0, b"SIM_TRUTH", 0, numbers)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=7)))


def places(page, flown, monkeypatch, *frames):
    """East and north as they are told after each of these frames."""
    told = []
    monkeypatch.setattr(page, "_tell", told.append)
    flown.fly(8.0)
    for frame in frames:
        page.show(flown.ticks[-1], LoopStep(flown.now, heard=[("main", "anybody", [frame])]))
    return [(what["east"], what["north"]) for what in told]


@pytest.mark.parametrize("wrong", [nan, inf, -inf])
def test_a_truth_that_is_no_number_is_passed_over(flown, monkeypatch, wrong):
    page = open_page(flown.pilot, truth=True)
    try:
        frames = [truth_frame(wrong, 2.0), truth_frame(30.0, 4.0), truth_frame(1.0, wrong)]
        assert places(page, flown, monkeypatch, *frames) == [(None, None), (4.0, 30.0), (4.0, 30.0)]
    finally:
        page.close()


def test_nobody_can_tell_the_truth_of_a_vehicle_that_is_not_the_bundled_one(flown, page, monkeypatch):
    assert places(page, flown, monkeypatch, truth_frame(30.0, 4.0)) == [(None, None)]


# --- bounded ---


def tick(number):
    return json.dumps({"kind": "tick", **dict.fromkeys(COLUMNS), "time": number}).encode()


def test_the_history_of_a_long_flight_is_bounded_and_spans_it_evenly():
    history, many = History(), 50_000
    for number in range(many):
        history.take(tick(number))
    (event,) = history.since(None)
    begun = json.loads(event.partition("data: ")[2])
    times = [point[0] for point in begun["points"]]
    assert MOST_POINTS / 2 <= len(times) <= MOST_POINTS
    assert times == [number * begun["every"] for number in range(len(times))]
    assert times[-1] > many - begun["every"] - 1
    assert begun["newest"]["time"] == many - 1


def test_a_browser_that_is_a_little_behind_gets_what_it_missed_and_else_all():
    history = History()
    for number in range(500):
        history.take(tick(number))
    assert [json.loads(event.partition("data: ")[2])["time"] for event in history.since(497)] == [497, 498, 499]
    assert history.since(500) == []
    assert len(history.since(500 - NEWEST)) == NEWEST
    assert [event.partition("\n")[0] for event in history.since(500 - NEWEST - 1)] == ["event: history"]


# --- refusals ---


def test_a_port_in_use_is_one_line_with_a_remedy(flown, page):
    port = int(page.url.rstrip("/").rpartition(":")[2])
    with pytest.raises(WebError, match=f"--web {port}: 127.0.0.1:{port} cannot be had: Address already in use; choose"):
        open_page(flown.pilot, port)


def test_without_the_packages_the_command_that_brings_them_is_named(flown, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "uvicorn" else find(name))
    with pytest.raises(WebError, match=r"--web needs the package uvicorn: pip install uvicorn"):
        open_page(flown.pilot)


def test_connections_that_ask_for_nothing_keep_nobody_from_the_page(page):
    port = int(page.url.rstrip("/").rpartition(":")[2])
    idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(60)]
    try:
        assert ask(page, "GET", "/").status == 200
        assert Stream(page).response.status == 200
    finally:
        for connection in idle:
            connection.close()


def test_more_browsers_than_the_flight_can_spare_time_for_are_refused(page):
    streams = [Stream(page) for _ in range(MOST_BROWSERS)]
    for stream in streams:
        stream.next()
    assert ask(page, "GET", "/events").status == 503
    assert ask(page, "GET", "/").status == 200
