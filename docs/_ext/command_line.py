"""``command-line``: a section for each command, made from the parsers of ``mitsuba-restir``."""

from __future__ import annotations

import argparse
import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from mitsuba_restir.cli import build_parser

COLUMNS = "76"
"""Width of the usage texts."""


class CommandLine(SphinxDirective):
    """All commands with their options."""

    def run(self) -> list[nodes.Node]:
        """One section for each command."""
        parser = build_parser()
        (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        said = {choice.dest: choice.help for choice in commands._choices_actions}
        found: list[nodes.Node] = [
            self._section(name, said[name], command) for name, command in commands.choices.items()
        ]
        return [*found, nodes.paragraph(text=parser.epilog)]

    def _section(
        self, name: str, said: str | None, command: argparse.ArgumentParser
    ) -> nodes.section:
        section = nodes.section(ids=[f"command-{name}"], names=[name])
        section += nodes.title("", "", nodes.literal(text=name))
        section += nodes.paragraph(text=command.description or said or "")
        usage = command.format_usage().removeprefix("usage: ")
        section += nodes.literal_block(usage, usage, language="text")
        entries = nodes.definition_list(classes=["command-options"])
        for action in command._actions:
            if not isinstance(action, argparse._HelpAction):
                entries += self._entry(action)
        if len(entries):
            section += entries
        if command.epilog:
            section += nodes.paragraph(text=command.epilog)
        return section

    def _entry(self, action: argparse.Action) -> nodes.definition_list_item:
        words = action.option_strings or [str(action.metavar or action.dest)]
        value = _value(action) if action.option_strings and action.nargs != 0 else ""
        term = nodes.term()
        for index, word in enumerate(words):
            term += [nodes.Text(", " if index else ""), nodes.literal(text=word)]
        if value:
            term += [nodes.Text(" "), nodes.emphasis(text=value)]
        text = re.sub("%(?:%|\\((\\w+)\\)s)", lambda m: _filled(m, action), action.help or "")
        return nodes.definition_list_item(
            "", term, nodes.definition("", nodes.paragraph(text=text))
        )


def _value(action: argparse.Action) -> str:
    if action.metavar is not None:
        return str(action.metavar)
    return "|".join(map(str, action.choices)) if action.choices else action.dest.upper()


def _filled(match: re.Match[str], action: argparse.Action) -> str:
    return str(getattr(action, match[1])) if match[1] else "%"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register it."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
