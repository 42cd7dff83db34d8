"""The site: ``make docs``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

# The package brings the LLVM, and comes before mitsuba.
import mitsuba_restir  # isort: skip
import mitsuba as mi
from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))
mi.set_variant("llvm_ad_rgb")

project = "mitsuba-restir"
author = copyright = "mitsuba-restir contributors"
version = release = mitsuba_restir.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "myst_parser",
    "sphinxcontrib.bibtex",
    "sphinx_copybutton",
    "plugin_pages",
    "command_line",
    "notebook_cells",
]
exclude_patterns = ["_build"]
smartquotes = False  # two dashes are an option's
html_theme = "furo"
html_title = "mitsuba-restir"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_use_index = False
html_domain_indices = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "attrs_inline"]
myst_heading_anchors = 3
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "plain"

autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Fields", "params_style")]


def repository() -> str:
    """Address of the repository, which pyproject.toml states."""
    text = (HERE.parent / "pyproject.toml").read_text("utf-8")
    found = re.search(r'^Repository = "(.+)"$', text, re.MULTILINE)
    assert found is not None
    return found[1]


html_theme_options = {
    "source_repository": repository() + "/",
    "source_branch": "main",
    "source_directory": "docs/",
}


OPTIONAL = ("viewer", "animation")
"""Pages of parts of the package that a checkout may do without."""


def without_missing(app: Sphinx, name: str, source: list[str]) -> None:
    """Leave pages out of the table of contents that are not there."""
    if name == "index":
        for page in OPTIONAL:
            if not (HERE / f"{page}.md").is_file():
                source[0] = source[0].replace(f"\n{page}\n", "\n")


def setup(app: Sphinx) -> None:
    """Register it."""
    app.connect("source-read", without_missing)
