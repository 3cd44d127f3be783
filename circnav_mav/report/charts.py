"""Style and charts shared by the report and the live page."""

from pathlib import Path

CHARTS = Path(__file__).with_name("charts.js")


def with_charts(page: Path) -> str:
    """Return the HTML of a page with the shared style and charts inserted."""
    text = page.read_text(encoding="utf-8")
    for place, part in (("@CHARTS.CSS@", CHARTS.with_suffix(".css")), ("@CHARTS.JS@", CHARTS)):
        text = text.replace(place, part.read_text(encoding="utf-8"))
    return text
