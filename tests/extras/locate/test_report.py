"""Lines of the locator in the verdict and the report of a flight, also without a result."""

import json

import pytest

from circnav_mav.extras.locate.report import verdict_lines

PLACE = {
    "latitude_deg": 47.5,
    "longitude_deg": 8.25,
    "sigma_m": 1.44,
    "altitude_m": None,
    "moves": False,
    "speed_mps": 2.0,
    "course_deg": 45.0,
    "time_s": 60.0,
}
NOTHING = {"place": None}


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"place": PLACE}, "  target     47.5000000 8.2500000 ±1.4 m, height not observable"),
        (
            {"place": PLACE | {"moves": True, "altitude_m": 7.0}},
            ", moves 2.0 m/s towards 045 deg, altitude 7.0 m",
        ),
        (
            {"radius_alarm": "ranges 7 % too long", "radius_remedy": "Calibrate the radio"},
            "  WARNING    ranges 7 % too long. Calibrate the radio",
        ),
        (
            {"true_radius_m": 93.46},
            "  positions  radius 93.5 m over the newest lap, by GPS",
        ),
    ],
)
def test_verdict_contains_target_place_and_warnings(found, words):
    (line,) = verdict_lines(NOTHING | found)
    assert words in line


def test_verdict_omits_missing_results_of_locator():
    assert verdict_lines(NOTHING | {"radius_alarm": None}) == []


@pytest.mark.usefixtures("no_pictures")
def test_report_contains_map_of_the_target(circnav, run):
    place = PLACE | {
        "latitude_deg": -35.36,
        "longitude_deg": 149.16,
        "ellipse_95": {"semi_major_m": 3.7},
    }
    (run / "summary.json").write_text(json.dumps({"place": place}))
    point = {"type": "Point", "coordinates": [149.16, -35.36]}
    features = [
        {"geometry": point, "properties": {"name": "target", "ellipse_95": place["ellipse_95"]}}
    ]
    (run / "target.geojson").write_text(json.dumps({"features": features}))
    assert circnav("report", run).done
    page = (run / "report.html").read_text()
    target = page.partition("<h2>Target on the map</h2>")[2].partition("</table>")[0]
    assert (run / "target.png").read_bytes().startswith(b"\x89PNG")
    assert "data:image/png;base64," in target
    assert "<td>latitude_deg</td><td>-35.36</td>" in target
    assert "ellipse_95" not in target


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("changed", [{}, {"place": None}], ids=str)
def test_report_without_place_has_no_map(circnav, run, changed):
    (run / "summary.json").write_text(json.dumps(changed))
    (run / "target.geojson").write_text("{}")
    assert "left out" not in circnav("report", run).done
    assert "<h2>Target on the map</h2>" not in (run / "report.html").read_text()


@pytest.mark.usefixtures("undrawn")
def test_unwritable_map_file_is_reported(circnav, tmp_path):
    (tmp_path / "run" / "target.geojson").mkdir(parents=True)
    locating_flight = (
        "--set",
        "locate.enabled=true",
        "--set",
        'guidance.law="smooth"',
        "--duration",
        36,
    )
    ran = circnav("fly", "quickstart", *locating_flight, "--out", tmp_path / "run")
    assert (ran.code, ran.err) == (5, "")
    assert "WARNING    target.geojson cannot be written: Is a directory\n" in ran.out
    assert (tmp_path / "run" / "target.kml").is_file()
