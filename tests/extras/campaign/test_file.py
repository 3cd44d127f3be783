"""Wrong campaign files are refused before the first flight, in one line that names the file."""

import re

import pytest

from circnav_mav.extras.campaign.plan import CampaignError, load_campaign, unflyable_value
from tests.extras.campaign.conftest import CONFIG

SHIPPED = f'mission = "{CONFIG / "campaign_mission.toml"}"\nruns = 3\n[vary]\n'
RADIUS = SHIPPED + "orbit.radius_m = "


def refusal(path):
    with pytest.raises(CampaignError, match=f"^{re.escape(str(path))}: .*$") as caught:
        load_campaign(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ('mission = "m.toml"\nruns = 3\nrunz = 4\n[vary]', "runz: unknown key, did you mean runs?"),
        ('mission = "m.toml"\n[vary]', "runs: missing, add it"),
        ('mission = "m.toml"\nruns = 3\n[vary]', "m.toml: cannot be read"),
        ("runs = ", "not valid TOML"),
        (SHIPPED, "vary: is empty"),
        (RADIUS + "{unifrom = [1, 2]}", "radius_m: unifrom: unknown key, did"),
        (RADIUS + "{uniform = [2, 1]}", "radius_m: uniform: [2, 1] is empty"),
        (RADIUS + "{normal = [2, -1]}", "standard deviation"),
        (RADIUS + "[]", "is an empty list"),
        (RADIUS + "5", "vary.orbit.radius_m: write a list"),
    ],
    ids=lambda value: value[-40:],
)
def test_wrong_campaign_file_is_refused_in_one_line(tmp_path, text, error):
    (tmp_path / "wrong.toml").write_text(text)
    assert error in refusal(tmp_path / "wrong.toml")


@pytest.mark.parametrize(
    ("first", "second", "error"),
    [
        ('"sim.wind.speed_mps" = [1.0]', '"sim.wind" = [{from_deg = 5.0}]', "set the same key"),
        ('"start.range_m" = [80]', '"sim.start.random.range_m" = [[1, 2]]', "set the same key"),
        ('"guidance.law" = ["smooth"]', 'guidance.law = ["auto"]', "in two spellings"),
    ],
)
def test_campaign_keys_that_set_same_value_are_refused(write, first, second, error):
    assert error in refusal(write(f"{first}\n{second}", starts=""))


@pytest.mark.parametrize("values", ["uniform = [-1.7e308, 1.7e308]", "log_uniform = [0, inf]",
                                    "normal = [true, 1]", "uniform = [1, 2, 3]"])  # fmt: skip
def test_impossible_bounds_of_drawn_values_are_refused(write, values):
    path = write(f'"orbit.radius_m" = {{{values}}}', starts="")
    assert f"vary.orbit.radius_m: {values.split()[0]}: must be two numbers" in refusal(path)


@pytest.mark.parametrize(
    ("vary", "error"),
    [
        ('"guidance.law" = ["smooth", "smoth"]', "guidance.law: 'smoth' is not one of"),
        (
            '"guidance.law" = ["smooth"]\n"sim.ranging.preset" = ["gaussian", "gausian"]',
            "not 'gausian', did you mean \"gaussian\"?",
        ),
        ('"orbit.radius_m" = [80.0, -1.0]', "orbit.radius_m: must be above 0, not -1"),
        ('"orbit.radius_m.x" = [80]', "vary: orbit.radius_m.x: radius_m is a value, not a table"),
    ],
)
def test_unflyable_listed_value_is_refused_before_flight(write, vary, error):
    path = write(vary)
    reason = unflyable_value(load_campaign(path))
    assert reason.startswith(f"{path}: ")
    assert error in reason


@pytest.mark.parametrize(
    "vary",
    [
        '"sim.wind.speed_mps" = [0.0, 1.0]\n"orbit.radius_m" = {uniform = [-50, 200]}',
        (
            '"guidance.law" = ["smooth", "switching", "feedforward", "auto",'
            ' "switching"]\n"sim.wind.speed_mps" = [0.0, 1.0, 2.0, 3.0, 4.0]\n"sim.ranging.message"'
            ' = ["named_value_float", "distance_sensor", "ranging_beacon"]\n"sim.ranging.via" ='
            ' ["direct", "autopilot"]'
        ),
    ],
    ids=[
        "drawn radii below 0",
        "240 points with one unflyable message",
    ],
)
def test_values_flyable_in_some_combinations_are_accepted(write, vary):
    assert unflyable_value(load_campaign(write(vary))) is None


def test_error_names_command_for_mission_given_as_campaign():
    path = CONFIG / "campaign_mission.toml"
    assert refusal(path) == f"{path}: is a mission file, fly it with: circnav fly {path}"


@pytest.mark.parametrize(
    ("command", "error"),
    [
        (
            "campaigns/wind.toml",
            "campaigns/wind.toml: no such file; give the bundled one by its name: wind",
        ),
        ("LONG", "LONG: File name too long"),
        ("wind --resume", "--resume: name the folder of the campaign to continue: --out DIR"),
        ("wind --out=", "--out: is empty, give it a name"),
    ],
)
def test_wrong_usage_prints_one_error_line_without_writing(circnav, tmp_path, command, error):
    command, error = (text.replace("LONG", 300 * "x") for text in (command, error))
    assert circnav("campaign", *command.split()).refused.startswith(error)
    assert list(tmp_path.iterdir()) == []
