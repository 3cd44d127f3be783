"""What preflight says of signatures, with and without a key on either side."""

import hashlib
import itertools
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.check_result import Grade
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.preflight import judge
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.survey import Survey
from tests.flight.signed import KEY, OTHER, key_file
from tests.pilot.test_preflight import Bench, one


def said(folder: Path, ours: bytes | None, theirs: bytes | None) -> list[tuple[Grade, str]]:
    """The lines about signing and vehicle, of a survey of an emulated copter."""
    overrides = ["link.wait_s=3.0"]
    if ours is not None:
        overrides.append(f"signing.key_file={key_file(folder, ours)}")
    if theirs is not None:
        overrides.append(f"sim.signing.key_file={key_file(folder, theirs, 'vehicle.key')}")
    bench = Bench("arducopter", *overrides, seconds=1.0)
    if ours is not None:
        settings = bench.mission.pilot_settings()
        bench.survey = Survey(settings, seconds=1.0, signing=Signing(ours))
    lines = judge(bench.mission, bench.run())
    return [(line.grade, line.says) for line in lines if line.subject == "signing" or "none that" in line.says]


@pytest.mark.parametrize(
    ("ours", "theirs", "expected"),
    [
        (None, None, []),
        (KEY, KEY, [(Grade.PASS, "frames signed, all with our key")]),
        (None, KEY, [(Grade.WARN, "we have no key: what we send may be rejected; give it with [signing] key_file")]),
        (KEY, None, [(Grade.FAIL, "every frame heard is unsigned or wrongly signed")]),
        (KEY, OTHER, [(Grade.FAIL, "every frame heard is unsigned or wrongly signed")]),
    ],
    ids=["nobody signs", "both sign", "we have no key", "it does not sign", "it has another key"],
)
def test_a_vehicle_that_signs_otherwise_than_we_do_is_named(
    tmp_path: Path, ours: bytes | None, theirs: bytes | None, expected: list[tuple[Grade, str]]
) -> None:
    for (grade, says), (meant, words) in zip(said(tmp_path, ours, theirs), expected, strict=True):
        assert (grade, words in says) == (meant, True), says


def frames_of_a_stock_px4(bench: Bench) -> None:
    """The vehicle's frames, each signed by hand with 32 zero bytes."""
    said, clock = bench.survey.receive, itertools.count(10**12)

    def signed(frame: bytes, *rest: Any) -> None:
        head = frame[:2] + b"\x01" + frame[3:-2]
        crc = mavlink.x25crc(head[1:] + bytes((mavlink.mavlink_map[frame[7] | frame[8] << 8].crc_extra,))).crc
        body = head + crc.to_bytes(2, "little") + b"\x00" + next(clock).to_bytes(6, "little")
        said(body + hashlib.sha256(bytes(32) + body).digest()[:6], *rest)

    bench.survey.receive = signed  # type: ignore[method-assign]


def test_a_vehicle_that_signs_with_the_all_zero_key_is_as_good_as_unsigned() -> None:
    bench = Bench("px4_copter", seconds=1.0)
    frames_of_a_stock_px4(bench)
    seen = bench.run()
    heard = seen.links[VEHICLE]
    assert (heard.signed, heard.zero_key, heard.refused) == (0, heard.frames, {})
    line = one(judge(bench.mission, seen), "signing")
    assert (line.grade, "all-zero key" in line.says) == (Grade.PASS, True)
