"""These pages as a site: pip install '.[docs]', then sphinx-build -c docs . site. Needs no
network."""

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
