"""Sphinx: what the code of the pages prints and draws.

The directive ``{drawing}`` shows the figure that a page's own code draws, light and dark; what a block marked
``python`` prints is shown below it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import pages


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
        text = "\n".join(self.content)
        code = nodes.literal_block(text, text, language="python", classes=["drawing-code"])
        return [figure, opening, code, nodes.raw("", "</details>", format="html")]


#: What the blocks of each document printed.
_printed: dict[str, list[str]] = {}


def draw(app: Sphinx) -> None:
    """Run the code of all pages, before the first of them is read."""
    source = Path(app.srcdir)
    for lesson in pages.lessons(source):
        with tempfile.TemporaryDirectory() as work:
            for page, outputs in pages.run(lesson, Path(work), source / pages.DRAWINGS).items():
                _printed[page.relative_to(source).with_suffix("").as_posix()] = outputs


def show_output(app: Sphinx, doctree: nodes.document) -> None:
    """Put what each block printed below it."""
    code = [
        node
        for node in doctree.findall(nodes.literal_block)
        if node.get("language") == "python" and "source" not in node and "drawing-code" not in node["classes"]
    ]
    for node, text in zip(code, _printed.get(app.env.docname, []), strict=False):
        if text.strip():
            shown = nodes.literal_block(text.rstrip(), text.rstrip(), language="text", classes=["output"])
            node.parent.insert(node.parent.index(node) + 1, shown)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("drawing", Drawing)
    app.connect("builder-inited", draw)
    app.connect("doctree-read", show_output)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
