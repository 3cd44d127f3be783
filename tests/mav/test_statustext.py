"""What ground stations are told, and how often."""

import pytest

from circnav_mav.mav.statustext import Announcer, plain_text


@pytest.fixture
def announcer():
    return Announcer()


def texts(announcer, now):
    return [message.text for message in announcer.texts(now)]


def test_a_text_goes_out_at_once_with_our_name(announcer):
    announcer.say("engage", "engaged")
    (message,) = announcer.texts(0.0)
    assert message.text == "circnav: engaged"
    assert message.severity == 5  # MAV_SEVERITY_NOTICE
    assert announcer.texts(0.1) == []


def test_a_kind_of_text_goes_out_once_in_two_seconds_and_the_newest_is_kept(announcer):
    announcer.say("range", "range lost")
    assert texts(announcer, 0.0) == ["circnav: range lost"]
    announcer.say("range", "range regained")
    announcer.say("range", "range lost again")
    announcer.say("end", "ended")
    assert texts(announcer, 1.99) == ["circnav: ended"], "another kind does not wait"
    assert texts(announcer, 2.0) == ["circnav: range lost again"]
    assert texts(announcer, 10.0) == []


def test_a_flood_of_texts_is_one_every_two_seconds(announcer):
    sent = 0
    for i in range(2000):
        announcer.say("range", f"text {i}")
        sent += len(announcer.texts(0.01 * i))
    assert sent == 10


@pytest.mark.parametrize("text", ["x" * 200, "é" * 200, "Zürich → Genève " * 20, "x" * 41])
def test_a_text_fits_in_fifty_bytes(announcer, text):
    announcer.say("end", text)
    (message,) = announcer.texts(0.0)
    raw = message.text if isinstance(message.text, bytes) else message.text.encode()
    assert len(raw) == 50
    assert raw.startswith(b"circnav: ")
    raw.decode("ascii")


def test_numbers_to_plot_come_at_four_hertz_with_their_names_and_our_clock(announcer):
    values = {"CN_RNG": 101.5, "CN_RRATE": -2.0}
    sent = [(now, messages) for i in range(200) if (messages := announcer.plots(values, now := i / 20))]
    assert len(sent) == 40
    now, messages = sent[1]
    assert now == pytest.approx(0.25)
    assert [(one.name, one.value, one.time_boot_ms) for one in messages] == [
        ("CN_RNG", 101.5, 250),
        ("CN_RRATE", -2.0, 250),
    ]


def test_nothing_to_plot_is_nothing_sent_and_a_number_that_is_none_is_left_out(announcer):
    assert announcer.plots({}, 0.0) == []
    wild = {"CN_RNG": 3.5e38, "CN_RRATE": 1.0, "CN_ERR": float("nan"), "CN_YRATE": float("inf")}
    assert [message.name for message in announcer.plots(wild, 0.01)] == ["CN_RRATE"]


def test_a_text_of_others_obeys_no_terminal():
    """ESC, BEL and the C1 controls command one; U+202E turns what follows round; C ends a text at its zero."""
    assert plain_text(b"PreArm: \x1b[2J\x07ok\0\x1b") == "PreArm: ?[2J?ok"
    assert plain_text("a\x9b31m\u202eb\r\n") == "a?31m?b??"
