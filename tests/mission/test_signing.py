"""[signing] in a mission file: where its key is told from, what it accepts, and the one line for each mistake."""

import tomllib
from pathlib import Path

import pytest

from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.pilot import RANGING, VEHICLE


def test_a_key_is_told_from_the_folder_of_the_mission_and_written_down_whole(text, tmp_path):
    """So that the mission as flown can be flown again out of its run folder."""
    path = tmp_path / "small.toml"
    path.write_text(f'{text}[signing]\nkey_file = "keys/drone.key"\n[sim.signing]\nkey_file = "keys/sim.key"\n')
    flown = load_mission(path)
    assert flown.file.signing.key_file == str(tmp_path / "keys" / "drone.key")
    again = tomllib.loads(flown.text)
    assert again["signing"]["key_file"] == str(tmp_path / "keys" / "drone.key")
    assert again["sim"]["signing"]["key_file"] == str(tmp_path / "keys" / "sim.key")


def test_a_key_may_be_told_from_home_or_from_the_root(text, tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(text)
    for told, meant in (("~/drone.key", Path.home() / "drone.key"), ("/etc/drone.key", Path("/etc/drone.key"))):
        assert load_mission(path, [f"signing.key_file={told}"]).file.signing.key_file == str(meant)


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["signing.link_id=3"], "signing.key_file: missing"),
        (["signing.key_file=k", "signing.link_id=256"], "signing.link_id: must be at most 255"),
        (["signing.key_file=k", "signing.accept_unsigned=maybe"], "signing.accept_unsigned: 'maybe' is not one of"),
        (["signing.key_file=k", "signing.key=00"], "signing.key: unknown key, known here: key_file, link_id"),
        (["signing.key_file="], "signing.key_file: "),  # not taken for the folder of the mission
        (["signing=drone.key"], "signing: must be a table"),
    ],
)
def test_mistakes_are_told_in_one_line(text, tmp_path, overrides, told):
    path = tmp_path / "small.toml"
    path.write_text(text)
    with pytest.raises(MissionError) as caught:
        load_mission(path, overrides)
    assert f"small.toml: {told}" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("accepted", "links"), [("false", set()), ("true", {VEHICLE, RANGING}), ('"ranging"', {RANGING})]
)
def test_links_on_which_unsigned_frames_are_believed(mission, accepted, links):
    table = ('signing.key_file="k"', f"signing.accept_unsigned={accepted}", 'ranging.endpoint="udpin:0.0.0.0:14560"')
    assert mission(*table).pilot_settings().unsigned_links == links
    (line,) = [line for line in check_mission(mission(*table)) if line.subject == "signing"]
    assert line.grade is (Grade.WARN if accepted == "true" else Grade.PASS)
