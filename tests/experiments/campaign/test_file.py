"""Campaign files that contradict themselves are refused before the first flight, in one line that names the file."""

import pytest

from circnav_mav.experiments.campaign.file import CampaignError, load_campaign
from circnav_mav.experiments.campaign.plan import hopeless
from tests.experiments.campaign.conftest import CONFIG


def refusal(path):
    with pytest.raises(CampaignError) as told:
        load_campaign(path)
    assert str(told.value).startswith(f"{path}: ")
    assert "\n" not in str(told.value)
    return str(told.value)


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        (
            '"guidance.law" = ["smooth"]\nguidance.law = ["pi"]',
            "guidance.law is there twice, in two spellings: keep one",
        ),
        (
            '"sim.wind.speed_mps" = [1.0]\n"sim.wind" = [{from_deg = 5.0}]',
            "sim.wind.speed_mps and sim.wind set the same key: keep one",
        ),
        (
            '"sim.wind" = [{from_deg = 5.0}]\n"sim.wind.speed_mps" = [1.0]',
            "sim.wind and sim.wind.speed_mps set the same key: keep one",
        ),
        (
            '"start.range_m" = [80]\n"sim.start.random.range_m" = [[1, 2]]',
            "start.range_m and sim.start.random.range_m set the same key: keep one",
        ),
        ('"sim.start" = [{}]\n"start.range_m" = [80]', "sim.start and start.range_m set the same key: keep one"),
    ],
)
def test_two_keys_that_set_the_same_are_refused(write, vary, says):
    assert refusal(write(vary, starts="")).endswith(f"vary: {says}")


def test_keys_that_only_begin_alike_are_not_the_same(write):
    vary = '"sim.ranging.noise_m" = [1.0]\n"sim.ranging.noise" = [1.0]'
    assert len(load_campaign(write(vary, starts="")).specs) == 2


@pytest.mark.parametrize(
    "numbers", ["[-1.7e308, 1.7e308]", "[0, 1" + "0" * 400 + "]", "[0, inf]", "[nan, 1]", "[true, 1]", "[1, 2, 3]"]
)
@pytest.mark.parametrize("kind", ["uniform", "log_uniform", "normal"])
def test_bounds_that_leave_no_number_to_draw_are_refused(write, kind, numbers):
    assert f"vary.orbit.radius_m: {kind}: must be two numbers" in refusal(
        write(f'"orbit.radius_m" = {{{kind} = {numbers}}}', starts="")
    )


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ('"guidance.law" = ["smooth", "smoth"]', "guidance.law: 'smoth' is not one of"),
        (
            '"guidance.law" = ["smooth", "pi"]\n"sim.ranging.preset" = ["gaussian", "gausian"]',
            '"gausian" is not one of',
        ),
        ('"orbit.radius_m" = [80.0, -1.0]', "orbit.radius_m: must be above 0, not -1"),
        ('"orbit.radius_m.x" = [80]', "vary: orbit.radius_m.x: radius_m is a value, not a table"),
    ],
)
def test_a_listed_value_that_can_never_be_flown_is_refused_before_the_first_flight(write, vary, says):
    path = write(vary)
    reason = hopeless(load_campaign(path))
    assert reason.startswith(f"{path}: ")
    assert says in reason


def test_a_listed_value_that_can_be_flown_with_some_of_the_others_is_no_mistake(write):
    """Drawn radii below 0 and listed ones: neither is the fault of the wind's."""
    vary = '"sim.wind.speed_mps" = [0.0, 1.0]\n"orbit.radius_m" = {uniform = [-50, 200]}'
    assert hopeless(load_campaign(write(vary))) is None


def test_a_listed_value_that_fits_one_of_many_others_only_is_no_mistake(write):
    """Of the messages only one can be sent again by the autopilot, in a grid of 240 points."""
    vary = (
        '"guidance.law" = ["smooth", "pi", "pd", "relay", "bounded", "feedforward", "auto", "switching"]\n'
        '"sim.wind.speed_mps" = [0.0, 1.0, 2.0, 3.0, 4.0]\n'
        '"sim.ranging.message" = ["named_value_float", "distance_sensor", "ranging_beacon"]\n'
        '"sim.ranging.via" = ["direct", "autopilot"]'
    )
    assert hopeless(load_campaign(write(vary))) is None


def test_a_file_without_end_is_not_valid(write):
    path = write("")
    path.write_text("a = " + "[" * 100_000)
    assert refusal(path).endswith("not valid TOML: nested too deeply")


def test_a_mission_file_is_known_as_one():
    path = CONFIG / "campaign_mission.toml"
    assert refusal(path) == f"{path}: is a mission file, fly it with: circnav fly {path}"
