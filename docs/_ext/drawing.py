"""Sphinx: the directive ``{drawing}``, which shows the figure that a page's own code draws, light and dark."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, ClassVar

import pages
from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Drawing(SphinxDirective):
    """The figure in both themes, its caption, and the code that draws it, folded away."""

    has_content = True
    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"alt": directives.unchanged_required, "caption": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        figure = nodes.figure()
        for theme in ("light", "dark"):
            uri = f"/{pages.DRAWINGS}/{name}-{theme}.png"
            figure += nodes.image(uri=uri, alt=self.options["alt"], classes=[f"only-{theme}"])
        if "caption" in self.options:
            words, _ = self.state.inline_text(self.options["caption"], self.lineno)
            figure += nodes.caption("", "", *words)
        opening = nodes.raw("", "<details><summary>The code of this figure</summary>", format="html")
        code = nodes.literal_block("\n".join(self.content), "\n".join(self.content), language="python")
        return [figure, opening, code, nodes.raw("", "</details>", format="html")]


def draw(app: Sphinx) -> None:
    """Run the code of all pages, before the first of them is read."""
    for lesson in pages.lessons(Path(app.srcdir)):
        with tempfile.TemporaryDirectory() as work:
            pages.run(lesson, Path(work), Path(app.srcdir) / pages.DRAWINGS)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("drawing", Drawing)
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
