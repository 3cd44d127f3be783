"""Configuration of the site of these pages: pip install '.[docs]', then sphinx-build -c docs .
site. The build needs no network."""

import re

project = "circnav"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/index"
include_patterns = ["*.md", "docs/*.md", "sim/README.md"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
html_theme = "furo"
html_title = "circnav"
html_show_sphinx = False
html_copy_source = False


def list_fields(app, what, name, obj, options, lines):
    """Turn each line "field: meaning" of a docstring, with its continuation, into a list item."""
    found = []
    for line in lines:
        if re.match(r"[a-zA-Z_]\w*(, [a-zA-Z_]\w*)*: ", line):
            if found and found[-1] and not found[-1].startswith(("- ", "  ")):
                found.append("")
            field, _, meaning = line.partition(": ")
            found.append(f"- ``{field}``: {meaning}")
        elif line.startswith("    ") and found and found[-1].startswith(("- ", "  ")):
            found.append(f"  {line.strip()}")
        else:
            if line and found and found[-1].startswith(("- ", "  ")):
                found.append("")
            found.append(line)
    lines[:] = found


def setup(app):
    app.connect("autodoc-process-docstring", list_fields)
