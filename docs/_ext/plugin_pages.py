"""Directives of Mitsuba's own reference pages, so that a plugin's docstring is its page.

``plugin-page`` shows that docstring. In it, ``pluginparameters`` is a list of name, type and
meaning, drawn as a table; ``tabs`` with ``code-tab`` shows the same in several languages, here one
below the other; ``:monosp:`` is code.
"""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.parsers.rst.roles import register_generic_role
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

MANUAL = "https://mitsuba.readthedocs.io/en/stable/src/"

ELSEWHERE = {
    "integrator-path": MANUAL + "generated/plugins_integrators.html#path-tracer-path",
    "mitsuba.render": MANUAL + "api_reference.html#mitsuba.render",
}
"""What docstrings refer to in Mitsuba's manual."""

TYPES = re.compile(r"\|(bool|int|float|string|true|false)\|")
"""Substitutions that Mitsuba's pages define."""

LANGUAGES = {"xml": "In a scene file", "python": "In Python"}


class PluginParameters(SphinxDirective):
    """A table of parameters from a list of (name, type, meaning)."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Turn each entry of the outer list into a row."""
        parsed = nodes.Element()
        for number, line in enumerate(self.content.data):
            self.content.data[number] = TYPES.sub(r"``\1``", line)
        self.state.nested_parse(self.content, self.content_offset, parsed)
        outer = parsed.next_node(nodes.bullet_list)
        if outer is None:
            raise self.error("a list of parameters is needed")
        table = nodes.table(classes=["plugin-parameters"])
        group = nodes.tgroup(cols=3)
        group += [nodes.colspec(colwidth=width) for width in (20, 8, 72)]
        head, body = nodes.thead(), nodes.tbody()
        head += _row([nodes.paragraph(text=word) for word in ("Parameter", "Type", "Meaning")])
        for item in outer:
            name, kind, meaning = (
                entry.next_node(nodes.paragraph) for entry in item.next_node(nodes.bullet_list)
            )
            target = nodes.target(ids=[f"parameter-{name.astext()}"])
            code = nodes.paragraph("", "", target, nodes.literal(text=name.astext()))
            body += _row([code, kind, meaning])
        group += [head, body]
        table += group
        return [nodes.container("", table, classes=["table-wrapper"])]


def _row(cells: list[nodes.Node]) -> nodes.row:
    row = nodes.row()
    row += [nodes.entry("", cell) for cell in cells]
    return row


class Tabs(SphinxDirective):
    """The same in several languages."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Nothing but what is in it."""
        found = nodes.container(classes=["code-tabs"])
        self.state.nested_parse(self.content, self.content_offset, found)
        return [found]


class CodeTab(Directive):
    """Code in one language, with a heading."""

    has_content = True
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """A heading and a block."""
        language = self.arguments[0]
        text = "\n".join(self.content)
        heading = nodes.paragraph("", "", nodes.strong(text=LANGUAGES[language]))
        return [heading, nodes.literal_block(text, text, language=language)]


class PluginPage(SphinxDirective):
    """The docstring of a plugin's class, which is its page."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Parse it, headings included."""
        module, _, name = self.arguments[0].rpartition(".")
        plugin = getattr(importlib.import_module(module), name)
        self.env.note_dependency(inspect.getsourcefile(plugin))
        text = StringList(inspect.getdoc(plugin).splitlines(), source=f"docstring of {name}")
        found = nodes.Element()
        found.document = self.state.document
        nested_parse_with_titles(self.state, text, found)
        return found.children


def elsewhere(app: Sphinx, env: Any, node: Any, content: nodes.Node) -> nodes.Node | None:
    """Link what is in Mitsuba's manual."""
    address = ELSEWHERE.get(node["reftarget"])
    return address and nodes.reference("", "", content, refuri=address, internal=False)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register all of it."""
    app.add_directive("plugin-page", PluginPage)
    app.add_directive("pluginparameters", PluginParameters)
    app.add_directive("tabs", Tabs)
    app.add_directive("code-tab", CodeTab)
    register_generic_role("monosp", nodes.literal)
    app.connect("missing-reference", elsewhere)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
