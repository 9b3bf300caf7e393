"""Sphinx: a page that would fetch anything from a network is a warning, and so is one without its formulas."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

_log = logging.getLogger(__name__)
# Links may lead anywhere; scripts, styles, fonts and pictures have to be here.
_FETCHED = re.compile(r"""(?:\bsrc=|<link\b[^>]*\bhref=)["'](?:https?:)?//[^"']*""")
_FETCHED_BY_STYLE = re.compile(r"""(?:@import\s+|url\()["']?(?:https?:)?//[^"')]*""")


def check(app: Sphinx, error: Exception | None) -> None:
    """Look through what was built."""
    if error is not None or app.builder.format != "html":
        return
    out = Path(app.outdir)
    for ending, pattern in (("html", _FETCHED), ("css", _FETCHED_BY_STYLE)):
        for page in sorted(out.rglob(f"*.{ending}")):
            for found in pattern.finditer(page.read_text(encoding="utf-8")):
                _log.warning("%s would fetch from a network: %s", page.relative_to(out), found.group())
    for name in sorted(app.env.all_docs):
        formulas = app.env.doc2path(name).read_text(encoding="utf-8").count("\n$$\n") // 2
        if (out / f"{name}.html").read_text(encoding="utf-8").count('class="formula"') < formulas:
            _log.warning("%s has formulas that are not on its page", name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
