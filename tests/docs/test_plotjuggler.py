"""docs/plotjuggler.xml against the columns that a flight records."""

from pathlib import Path
from xml.etree import ElementTree

from circnav_mav.runtime.recorder import TICK_COLUMNS, write_ticks

LAYOUT = ElementTree.parse(Path(__file__).parents[2] / "docs" / "plotjuggler.xml").getroot()


def test_every_curve_of_the_layout_is_a_column_of_numbers(tmp_path):
    write_ticks(tmp_path / "ticks.csv", [])
    columns = set((tmp_path / "ticks.csv").read_text().strip().split(",")) - {"phase", "law", "mode"}
    curves = list(LAYOUT.iter("curve"))
    named = {name for curve in curves for name in (curve.get("curve_x"), curve.get("curve_y")) if name}
    named |= {curve.get("name") for curve in curves if curve.get("curve_x") is None}
    assert len(curves) > 20
    assert named <= columns
    assert {"r", "measured", "turn_rate", "yaw_rate_sent", "range_age", "x", "y"} <= named
    assert LAYOUT.find(".//plugin[@ID='DataLoad CSV']/parameters").get("time_axis") == TICK_COLUMNS[0]
