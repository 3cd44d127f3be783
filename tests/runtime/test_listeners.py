"""Listeners: a failure in any call is reported, and neither ends the flight nor affects other
listeners."""

from pathlib import Path

import pytest

from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listener, Listeners


class Sound(Listener):
    """A listener without a failure, which records the steps that it receives."""

    name = "sound"

    def __init__(self):
        self.steps = []
        self.closed = False

    def on_step(self, newest, step, recording_problem):
        self.steps.append(step.time)
        return [b"frame"]

    def facts(self, now):
        return {"place": "known"}

    def alarms(self, now):
        return {"sound": "SOUND: loud"}

    def finish(self, summary):
        summary["notes"].append("  sound")
        return {"sound.txt": "loud"}

    def close(self):
        self.closed = True


def fails(*given):
    raise ValueError("Out of range float values are not JSON compliant")


def flown(one, other):
    """Return the results of a short flight with two listeners."""
    listeners = Listeners([one, other])
    summary = {"notes": []}
    listeners.start(1)
    frames = []
    for moment in (1.0, 2.0, 3.0):
        if listeners.busy:
            frames += listeners.on_step(None, LoopStep(moment), None)
            listeners.take_exchanged(moment)
        seen = listeners.facts(moment), listeners.alarms(moment)
    files = listeners.finish(summary)
    listeners.show_verdict("COMPLETED", Path())
    listeners.close()
    return frames, seen, files, summary["notes"], list(listeners.all_problems())


@pytest.mark.parametrize(
    ("what", "when"),
    [
        ("start", " at 0.0 s"),
        ("on_step", " at 1.0 s"),
        ("take_exchanged", " at 1.0 s"),
        ("facts", " at 1.0 s"),
        ("alarms", " at 1.0 s"),
        ("busy", ""),
        ("finish", " at the end"),
        ("show_verdict", " at the end"),
        ("close", " at the end"),
    ],
)
def test_failing_listener_is_reported_once_and_detached(what, when):
    class Broken(Listener):
        name = "broken"
        busy = property(fails) if what == "busy" else True

    broken = Broken()
    sound = Sound()
    sound.busy = True
    if what != "busy":
        setattr(broken, what, fails)
    frames, seen, files, notes, problems = flown(broken, sound)
    assert (sound.steps, frames, sound.closed) == ([1.0, 2.0, 3.0], [b"frame"] * 3, True)
    assert (files, notes) == ({"sound.txt": "loud"}, ["  sound"])
    assert problems == [
        f"broken: stopped{when}: ValueError('Out of range float values are not JSON compliant')"
    ]
    assert seen[0] == {"place": "known"} and seen[1]["sound"] == "SOUND: loud"


def test_failed_listener_raises_alarm():
    tries = []

    class Broken(Listener):
        name = "live page"

        def on_step(self, newest, step, recording_problem):
            tries.append(step.time)
            return fails() if step.time > 1.0 else ()

    listeners = Listeners([Broken()])
    for moment in (1.0, 2.0, 3.0):
        assert listeners.on_step(None, LoopStep(moment), None) == []
        assert bool(listeners.alarms(moment)) == (moment > 1.0)
    assert tries == [1.0, 2.0]
    assert list(listeners.alarms(3.0).values()) == listeners.problems


def test_run_uses_smallest_speed_requested_by_listeners():
    slow = Listener()
    slower = Listener()
    assert Listeners([Listener()]).pace is None
    slow.pace = 6.0
    slower.pace = 2.0
    assert Listeners([Listener(), slow, slower]).pace == 2.0
