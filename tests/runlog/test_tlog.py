"""The reader of complete, truncated and damaged tlogs."""

import random
import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runlog import tlog
from circnav_mav.runlog.tlog import STAMP, find_damage, read_tlog, read_unbroken
from tests.runlog.conftest import EPOCH_US, truth_frame

RECORDS = 200


def heartbeat(number, v1=False):
    """Return a tlog record of a short frame."""
    sender = mavlink.MAVLink(None, srcSystem=1)
    sender.seq = number % 256
    frame = mavlink.MAVLink_heartbeat_message(2, 3, 0, number, 4, 3).pack(sender, force_mavlink1=v1)
    return struct.pack(">Q", EPOCH_US + 1000 * number) + bytes(frame)


@pytest.fixture
def records():
    """Return tlog records of MAVLink 1, MAVLink 2 and long frames."""
    kinds = (
        heartbeat,
        lambda number: heartbeat(number, v1=True),
        lambda number: truth_frame(number / 1e3, 1.0, 2.0),
    )
    return [kinds[number % 3](number) for number in range(RECORDS)]


@pytest.fixture
def log(tmp_path):
    """Return a function that reads a log of some bytes."""

    def read(data, read=read_tlog):
        path = tmp_path / "some.tlog"
        path.write_bytes(data)
        return [struct.pack(">Q", stamp) + frame for stamp, frame in read(path)]

    return read


def test_truncated_tlog_is_read_to_its_end(log, records, tmp_path):
    data = b"".join(records)
    one = len(records[-1])
    two = len(records[0])
    ends = [sum(map(len, records[: n + 1])) for n in range(RECORDS)]
    for kept in (len(data) - 1, len(data) - one, len(data) - one - 1, two + 9, two - 1, 7):
        fits = [record for record, end in zip(records, ends, strict=True) if end <= kept]
        assert log(data[:kept]) == fits
        damage = find_damage(tmp_path / "some.tlog")
        whole = sum(map(len, fits))
        if whole == kept:
            assert damage is None
        else:
            assert str(damage) == f"cut off or damaged at byte {whole} of {kept}"


def test_file_of_other_format_contains_no_tlog_records(log, records):
    bare = b"".join(record[STAMP:] for record in records)
    for data in (b"", b"this is no log at all", bytes(3000), b"\xfd" * 3000, bare):
        assert log(data) == [], data[:9]


@pytest.mark.parametrize("chunk", [600, 1 << 20], ids=["small window", "large window"])
def test_tlog_reader_continues_after_damage(log, records, tmp_path, monkeypatch, chunk):
    monkeypatch.setattr(tlog, "CHUNK", chunk)
    rng = random.Random(3)
    for at in (0, 50, RECORDS - 1):
        for torn in (
            b"",
            b"\0" * 64,
            b"\xff" * 5000,
            rng.randbytes(3000),
            records[at][:20],
            records[at][9:],
        ):
            kept = [*records[:at], *records[at + 1 :]]
            data = b"".join([*records[:at], torn, *records[at + 1 :]])
            assert log(data) == kept, (at, torn[:20])
            damage = find_damage(tmp_path / "some.tlog")
            assert (damage.lost if damage else 0) == len(torn)


@pytest.mark.parametrize("at", range(11), ids=lambda at: f"byte {at}")
def test_flipped_bit_damages_only_one_tlog_record(log, records, at):
    """The flipped bit is in the stamp, the magic byte, the length or the flags."""
    for bit in range(8):
        torn = bytearray(records[60])
        torn[at] ^= 1 << bit
        read = log(b"".join([*records[:60], torn, *records[61:]]))
        assert read[:60] + read[-(RECORDS - 61) :] == [*records[:60], *records[61:]]
        assert len(read) <= RECORDS


def test_tlog_damage_is_counted_and_located(log, records, tmp_path):
    data = b"".join([*records[:50], b"torn", *records[50:90], bytes(40), *records[90:], b"end"])
    assert log(data) == records
    damage = find_damage(tmp_path / "some.tlog")
    size = len(data)
    assert (damage.places, damage.lost, damage.cut) == (3, 47, False)
    assert (damage.until, damage.newest) == (EPOCH_US + 49_000, EPOCH_US + 1000 * (RECORDS - 1))
    first = sum(map(len, records[:50]))
    assert (
        str(damage) == f"damaged at byte {first} of {size} and in 2 more places, 47 bytes left out"
    )
    assert log(data, read_unbroken) == records[:50]
