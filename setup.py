"""The text of the package on an index page; everything else is in pyproject.toml.

An index page shows the README, where relative links lead nowhere. They become links into the
repository once [project.urls] names it as Source, and plain text until then.
"""

import re
import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
SOURCE = (
    tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    .get("urls", {})
    .get("Source")
)


def link(found: re.Match[str]) -> str:
    """Return a Markdown link or image for the index page."""
    mark, words, path = found.groups()
    if SOURCE:
        return f"{mark}[{words}]({SOURCE}/{'raw' if mark else 'blob'}/main/{path})"
    return "" if mark else f"{words} ({path})"


readme = (HERE / "README.md").read_text(encoding="utf-8")
readme = re.sub(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)", link, readme)
setup(long_description=readme, long_description_content_type="text/markdown")
