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
    announcer.say("range", "range is back")
    announcer.say("range", "range lost again")
    assert texts(announcer, 1.99) == []
    assert texts(announcer, 2.0) == ["circnav: range lost again"]
    assert texts(announcer, 10.0) == []


def test_kinds_of_text_do_not_wait_for_each_other(announcer):
    announcer.say("range", "range lost")
    announcer.texts(0.0)
    announcer.say("end", "ended")
    assert texts(announcer, 0.1) == ["circnav: ended"]


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


def test_numbers_to_plot_come_at_four_hertz(announcer):
    sent = [now for i in range(200) if announcer.plots({"CN_RNG": 1.0}, now := i / 20)]
    assert len(sent) == 40
    assert sent[1] - sent[0] == pytest.approx(0.25)


def test_numbers_carry_their_names_and_our_clock(announcer):
    messages = announcer.plots({"CN_RNG": 101.5, "CN_RRATE": -2.0}, 3.5)
    assert [(message.name, message.value, message.time_boot_ms) for message in messages] == [
        ("CN_RNG", 101.5, 3500),
        ("CN_RRATE", -2.0, 3500),
    ]


def test_nothing_to_plot_is_nothing_sent_and_delays_nothing(announcer):
    assert announcer.plots({}, 0.0) == []
    assert announcer.plots({"CN_RNG": 1.0}, 0.01) != []


def test_a_number_too_big_for_single_precision_is_left_out_and_stops_nothing(announcer):
    told = announcer.plots({"CN_RNG": 3.5e38, "CN_RRATE": 1.0, "CN_ERR": float("nan"), "CN_YRATE": float("inf")}, 0.0)
    assert [message.name for message in told] == ["CN_RRATE"]


def test_a_text_of_others_obeys_no_terminal():
    """ESC, BEL and the C1 controls command one; U+202E turns what follows round; C ends a text at its zero."""
    assert plain_text(b"PreArm: \x1b[2J\x07ok\0\x1b") == "PreArm: ?[2J?ok"
    assert plain_text("a\x9b31m\u202eb\r\n") == "a?31m?b??"
