"""``mitsuba-restir scenes``: list the embedded scenes."""

from __future__ import annotations

import argparse
from typing import Any

from .. import scenes


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "scenes", help="list the embedded scenes", description="List the embedded scenes."
    )
    parser.set_defaults(run=run)


def run(_: argparse.Namespace) -> int:
    """Print each scene's name and what it is."""
    names = scenes.names()
    width = max(map(len, names))
    for name in names:
        print(f"{name:<{width}}  {scenes.describe(name)}")
    return 0
