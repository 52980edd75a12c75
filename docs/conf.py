"""The documentation site: ``make docs``. Offline: nothing is asked of the network."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]

from stiction_envs.version import __version__  # noqa: E402

project = "stiction-envs"
author = "the stiction-envs developers"
copyright = author
version = release = __version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_pages",
    "code_in_docstrings",
    "mathml",
]
myst_enable_extensions = ["deflist", "dollarmath"]
# "%" at the start of a line would hide it, and "87\n% less" is wrapped so by chance
myst_disable_syntax = ["myst_line_comment"]
myst_heading_anchors = 4
# benchmarks' pages are written for a repository: their first heading is not always of level one
suppress_warnings = ["myst.header"]
math_renderer = "mathml"
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "stiction-envs"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
