"""``code-cell``: a cell of a notebook, with what ``make figures`` has kept of its output.

The outputs of the cells of ``notebooks/NAME.md`` are ``figures/NAME-CELL.png`` and ``.txt``, where
CELL is the cell's ``:name:``, or its number.
"""

from __future__ import annotations

from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class CodeCell(SphinxDirective):
    """Code, and what came of it."""

    has_content = True
    optional_arguments = 1
    option_spec: ClassVar = {"name": directives.unchanged, "tags": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """The code, its text and its picture."""
        number = self.env.temp_data["cell"] = self.env.temp_data.get("cell", -1) + 1
        name = self.options.get("name", str(number))
        text = "\n".join(self.content)
        found: list[nodes.Node] = [nodes.literal_block(text, text, language="python")]
        stem = f"{self.env.docname.rpartition('/')[2]}-{name}"
        folder = self.env.srcdir / "figures"
        printed, drawn = folder / f"{stem}.txt", folder / f"{stem}.png"
        if printed.is_file():
            self.env.note_dependency(str(printed))
            said = printed.read_text("utf-8").rstrip()
            found.append(nodes.literal_block(said, said, language="text", classes=["output"]))
        if drawn.is_file():
            about = f"What the cell {name} draws"
            found.append(nodes.image(uri=f"/figures/{drawn.name}", alt=about))
        return found


def setup(app: Sphinx) -> dict[str, bool]:
    """Register it."""
    app.add_directive("code-cell", CodeCell)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
