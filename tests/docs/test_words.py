"""The language of docstrings and pages, as far as a few lines can check it: style rules are in CONTRIBUTING.md."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process import ROOT

CODE = sorted([*(ROOT / "circnav_mav").rglob("*.py"), *(ROOT / "sim").rglob("*.py")])
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "sim").glob("*.md")])
FRAGMENT = re.compile(r"(Of|What|Whose|Who|How|Where|Whether|By)\b")
ODD_NUMBER = re.compile(r"(?<![\w.])\.\d|\d \.\. \d")
"""A decimal without a leading zero, or a range written with dots."""


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of the docstrings of a file, those of constants and attributes included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for part in node.body if isinstance(getattr(node, "body", None), list) else ():
            if (
                isinstance(part, ast.Expr)
                and isinstance(part.value, ast.Constant)
                and isinstance(part.value.value, str)
            ):
                yield part.lineno, part.value.value.strip()


@pytest.mark.parametrize("path", CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_docstrings_are_no_fragments_and_write_numbers_with_zeros_and_to(path: Path) -> None:
    wrong = [
        (line, text.split("\n")[0])
        for line, text in docstrings(path)
        if FRAGMENT.match(text) or ODD_NUMBER.search(re.sub(r"`[^`]*`|\{[^}]*\}", "", text))
    ]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_write_numbers_with_zeros_and_to(page: Path) -> None:
    text = re.sub(
        r"^```.*?^```|^    .*?$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    assert [line for line in text.splitlines() if ODD_NUMBER.search(line)] == []
