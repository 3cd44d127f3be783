"""Texts and values for ground stations, and their rates."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.statustext import Announcer, TextReader, plain_text


@pytest.fixture
def announcer():
    return Announcer()


def test_statustext_rate_is_limited_per_kind_of_text(announcer):
    announcer.say("range", "range lost")
    (message,) = announcer.texts(0.0)
    assert (message.text, message.severity) == ("circnav: range lost", 5)  # MAV_SEVERITY_NOTICE
    for kind, text in (
        ("range", "range regained"),
        ("range", "range lost again"),
        ("end", "ended"),
    ):
        announcer.say(kind, text)
    sent = {now: [message.text for message in announcer.texts(now)] for now in (1.99, 2.0, 10.0)}
    assert sent == {1.99: ["circnav: ended"], 2.0: ["circnav: range lost again"], 10.0: []}


def on_the_wire(messages, system=1, component=191):
    """Return the messages as a receiver decodes them."""
    sender = mavlink.MAVLink(None, system, component)
    receiver = mavlink.MAVLink(None)
    return [receiver.decode(bytearray(message.pack(sender))) for message in messages]


@pytest.mark.parametrize(
    ("text", "chunks"),
    [
        ("x" * 41, [50]),
        ("x" * 42, [50, 1]),
        ("x" * 91, [50, 50, 0]),
        ("é" * 300, [50, 50, 50, 50, 0]),
        ("Zürich → Genève " * 4, [50, 23]),
    ],
)
def test_long_statustext_is_sent_in_chunks(announcer, text, chunks):
    """Definition of STATUSTEXT in common.xml: the chunks of a text have one id and are numbered
    from zero; "any null character in the text field is taken to mean this was the last chunk"; a
    text of id 0 is complete."""
    announcer.say("end", text)
    received = on_the_wire(announcer.texts(0.0))
    assert [len(one.text) for one in received] == chunks
    assert [one.chunk_seq for one in received] == list(range(len(chunks)))
    assert {one.id for one in received} == ({0} if len(chunks) == 1 else {1})
    whole = "".join(one.text for one in received)
    assert whole == f"circnav: {text}".encode("ascii", "replace").decode()[:200]


def test_statustext_chunks_are_joined_by_sender(announcer):
    reader = TextReader()
    announcer.say("end", "a" * 41 + "b" * 50 + "c" * 9)
    announcer.say("law", "d" * 60)
    chunks = announcer.texts(0.0)
    assert [(one.id, one.chunk_seq) for one in chunks] == [(1, 0), (1, 1), (1, 2), (2, 0), (2, 1)]
    ours = on_the_wire(chunks[:3])
    theirs = on_the_wire(chunks[:3], component=192)
    a = "circnav: " + "a" * 41
    b = "b" * 50
    c = "c" * 9
    read = [(a, None), (a + b, a), (a + b + c, a + b)]
    for pair, expected in zip(zip(ours, theirs, strict=True), read, strict=True):
        assert [reader.read(one) for one in pair] == [expected] * 2
    assert [reader.read(ours[0]), reader.read(ours[2])] == [(a, None), (c, None)]
    short = on_the_wire([mavlink.MAVLink_statustext_message(6, b"short")] * 2)
    assert [reader.read(one) for one in short] == [("short", None)] * 2


def test_plotted_values_are_sent_at_four_hertz(announcer):
    """Values that are not finite as 32-bit floats are not sent."""
    assert announcer.plots({}, 0.0) == []
    wild = {"CN_RNG": 101.5, "CN_RRATE": 3.5e38, "CN_ERR": float("nan"), "CN_YRATE": float("inf")}
    sent = [
        (now, messages) for i in range(200) if (messages := announcer.plots(wild, now := i / 20))
    ]
    assert len(sent) == 40
    now, (message,) = sent[1]
    assert now == pytest.approx(0.25)
    assert (message.name, message.value, message.time_boot_ms) == ("CN_RNG", 101.5, 250)


def test_received_statustext_contains_no_control_characters():
    """ESC, BEL and the C1 codes control a terminal, and U+202E reverses the following text. The
    text ends at its first zero byte."""
    assert plain_text("PreArm: \x1b[2J\x07ok\0\x1b") == r"PreArm: \x1b[2J\x07ok"
    assert plain_text("a\x9b31m\u202eb\r\n") == r"a\x9b31m\u202eb\r\n"
