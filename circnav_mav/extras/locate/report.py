"""The locator's lines in the verdict of a flight, and the locator's section in the report."""

from typing import Any

from circnav_mav.runlog.run_folder import Run

SHOWN = (
    "latitude_deg",
    "longitude_deg",
    "altitude_m",
    "sigma_m",
    "time_s",
    "moves",
    "speed_mps",
    "course_deg",
)
"""Fields of the place in summary.json that the report shows."""


def verdict_lines(found: dict[str, Any]) -> list[str]:
    """Return the verdict lines: target place, true radius, alarm. found: the locator's fields of
    summary.json."""
    lines = []
    place = found["place"]
    if place:
        height = place["altitude_m"]
        moves = ""
        if place["moves"]:
            moves = f", moves {place['speed_mps']:.1f} m/s towards {place['course_deg']:03.0f} deg"
        tall = "height not observable" if height is None else f"altitude {height:.1f} m"
        where = (
            f"{place['latitude_deg']:.7f} {place['longitude_deg']:.7f} ±{place['sigma_m']:.1f} m"
        )
        lines.append(f"  target     {where}{moves}, {tall}")
    if found.get("true_radius_m"):
        lines.append(
            f"  positions  radius {found['true_radius_m']:.1f} m over the newest lap, by GPS"
        )
    if found.get("radius_alarm"):
        lines.append(f"  WARNING    {found['radius_alarm']}. {found['radius_remedy']}")
    return lines


def report_section(run: Run) -> str:
    """Return the report section "Target on the map" and draw its target.png. Empty if there is no
    place."""
    from circnav_mav.extras.locate.map_picture import plot_map
    from circnav_mav.report.page import picture, rows

    table = run.folder / "target.geojson"
    place = run.summary.get("place")
    if not place or not table.is_file():
        return ""
    plot_map(
        run.folder / "target.png", table.read_text(encoding="utf-8"), f"{run.name}: the target"
    )
    image = picture(run.folder / "target.png", "map of the target", ' style="max-width:100%"')
    known = {name: str(place[name]) for name in SHOWN if place[name] is not None}
    return f"<h2>Target on the map</h2>{image}<table>{rows(known)}</table>"
