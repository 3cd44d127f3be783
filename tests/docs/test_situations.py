"""The table of the benchmark's situations in docs/measured.md, written from SITUATIONS by

python -m tests.docs.test_situations
"""

from dataclasses import fields, is_dataclass

from circnav_mav.extras.bench.situations import SITUATIONS, Situation
from tests.process import ROOT

PAGE = ROOT / "docs" / "measured.md"
MARKS = "<!-- situations -->\n", "<!-- end of situations -->\n"


def differences(value, default):
    """Yield the fields that differ from the default, as text."""
    for field in fields(value):
        mine = getattr(value, field.name)
        other = None if default is None else getattr(default, field.name)
        if field.name in ("name", "required") or mine == other:
            continue
        if is_dataclass(mine):
            inner = ", ".join(differences(mine, other)) or "default"
            yield f"{field.name} ({inner})"
        else:
            yield f"{field.name} {mine:.3g}"


def table():
    lines = ["| situation | required RMS, m | differs by |", "|---|---|---|"]
    for one in SITUATIONS.values():
        need = "-" if one.required is None else f"{one.required:g}"
        lines.append(
            f"| {one.name} | {need} | {', '.join(differences(one, Situation('calm'))) or '-'} |"
        )
    return "\n".join(lines) + "\n"


def test_page_lists_situations_of_the_benchmark():
    assert f"{MARKS[0]}\n{table()}\n{MARKS[1]}" in PAGE.read_text()


if __name__ == "__main__":
    before, rest = PAGE.read_text().split(MARKS[0])
    PAGE.write_text(f"{before}{MARKS[0]}\n{table()}\n{MARKS[1]}{rest.split(MARKS[1])[1]}")
