"""Simple checks of the language of docstrings, names, messages and pages.

The rules are in CONTRIBUTING.md.
"""

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
TALK = (
    "hear hears heard hearing tell tells told telling says said feel feels believe believes"
    " believed deaf anew nobody"
)
TALKS = re.compile(
    rf"\b({TALK.replace(' ', '|')}|say|thinks?|knows?|whoever|stands? still)\b|\+-$", re.IGNORECASE
)
"""Patterns that must not occur in messages: verbs of speech and belief, and "+-" before a
number."""
NAMED = {
    *TALK.split(),
    "greet",
    "guess",
    "guesses",
    "guessed",
    "favourite",
    "culprit",
    "stranger",
    "strangers",
}
"""Words that must not occur in names."""


def docstrings(nodes: list[ast.AST]) -> Iterator[tuple[int, str]]:
    """Yield line number and text of each docstring, also of constants and attributes."""
    for node in nodes:
        for part in node.body if isinstance(getattr(node, "body", None), list) else ():
            if (
                isinstance(part, ast.Expr)
                and isinstance(part.value, ast.Constant)
                and isinstance(part.value.value, str)
            ):
                yield part.lineno, part.value.value.strip()


def names(nodes: list[ast.AST]) -> Iterator[tuple[int, str]]:
    """Yield line and name of each class, function, argument, variable and attribute that a file
    defines."""
    for node in nodes:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id if isinstance(node, ast.Name) else node.attr


def messages(nodes: list[ast.AST]) -> Iterator[tuple[int, str]]:
    """Yield line and text of the strings that may be displayed: all with a space, except
    docstrings."""
    forms = {
        id(part)
        for node in nodes
        if isinstance(node, ast.FormattedValue) and node.format_spec
        for part in ast.walk(node.format_spec)
    }
    shown = {line for line, _ in docstrings(nodes)}
    for node in nodes:
        text = isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value
        if text and id(node) not in forms and node.lineno not in shown:
            yield node.lineno, re.sub(r"\{[^}]*\}", "", node.value)


@pytest.mark.parametrize("path", CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_docstrings_names_and_messages_are_plain(path: Path) -> None:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    assert [
        (line, text.split("\n")[0])
        for line, text in docstrings(nodes)
        if FRAGMENT.match(text) or ODD_NUMBER.search(re.sub(r"`[^`]*`|\{[^}]*\}", "", text))
    ] == []
    split = [
        (line, name, re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower().split("_"))
        for line, name in names(nodes)
    ]
    assert [(line, name) for line, name, words in split if NAMED & set(words)] == []
    assert [
        (line, text)
        for line, text in messages(nodes)
        if TALKS.search(text) or ODD_NUMBER.search(text)
    ] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_contain_no_odd_number_formats(page: Path) -> None:
    text = re.sub(
        r"^```.*?^```|^    .*?$|`[^`\n]*`",
        "",
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    assert [line for line in text.splitlines() if ODD_NUMBER.search(line)] == []
