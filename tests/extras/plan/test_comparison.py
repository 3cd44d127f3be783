"""tests/tools/bench/bench_plan.py, which compares the plan with random flights. Each drawn mission
passes its checks and depends only on its number."""

import pytest

from circnav_mav.mav.check_result import FAIL
from circnav_mav.mission.checks import check_mission
from tests.tools.bench.bench_plan import draw, planned


@pytest.mark.parametrize("number", range(4))
def test_random_mission_of_comparison_passes_its_checks(number):
    drawn = draw(number)
    assert drawn == draw(number)
    assert not [line for line in check_mission(drawn.mission()) if line.grade is FAIL]
    rms, sigma = planned(drawn)
    assert 0 < rms < 0.05 * drawn.radius and sigma is not None and 0.5 < sigma < 3.0
