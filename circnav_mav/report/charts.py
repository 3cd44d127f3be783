"""The style and the charts that the report and the live page share."""

from pathlib import Path

CHARTS = Path(__file__).with_name("charts.js")


def with_charts(page: Path) -> str:
    """A page with the style and the charts that all pages share, in one text."""
    text = page.read_text(encoding="utf-8")
    for place, part in (("@CHARTS.CSS@", CHARTS.with_suffix(".css")), ("@CHARTS.JS@", CHARTS)):
        text = text.replace(place, part.read_text(encoding="utf-8"))
    return text
