"""How Sphinx builds the site: ``make docs``, then open build/site/index.html; nothing needs a network."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import clew

project = "clew"
author = "the clew developers"
copyright = author
release = version = clew.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "drawing", "offline"]
exclude_patterns = ["_build", "_ext", "drawings"]
source_suffix = {".md": "markdown"}
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
default_role = "code"  # docstrings write `name`
highlight_language = "python"
pygments_style, pygments_dark_style = "friendly", "monokai"

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = {
    name: name for name in ("Array", "Floats", "Index", "Indices", "Ints", "Keys", "Names", "Pairs")
}
autodoc_class_signature = "mixed"
napoleon_google_docstring, napoleon_numpy_docstring = True, False
napoleon_use_ivar = True

suppress_warnings = ["ref.python"]  # a word in a docstring that is the name of two attributes

html_theme = "furo"
html_title = f"clew {version}"
html_static_path = ["_static"]
html_css_files = ["clew.css"]
html_math_renderer = "mathml"
html_show_search_summary = False  # would be fetched, which browsers refuse to pages from a disk
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
