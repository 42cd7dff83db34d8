"""Progress bars of what is rendered, with the time left; silent where there is no terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from ..still import Progress as Now
from ..studies.runner import Progress as Report


def bar(state: str, *left: ProgressColumn) -> Progress:
    """A bar with its description before it, and after it how far it is, and what time is left.

    Parameters
    ----------
    state : str
        How far it is, in terms of its ``task``.
    *left : ProgressColumn
        The time left; by the pace so far where none is given.
    """
    screen = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(state),
        TimeElapsedColumn(),
        *(left or (TextColumn("left"), TimeRemainingColumn())),
    )
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


@contextmanager
def progress_bar(name: str) -> Iterator[Report]:
    """Show a bar for the time of a context; yields what a study reports its progress to."""
    with bar("{task.percentage:.0f} %") as progress:
        task = progress.add_task(name, total=None)

        def report(done: int, total: int, text: str) -> None:
            progress.update(task, completed=done, total=total, description=text)

        yield report


@contextmanager
def still_bar() -> Iterator[Callable[[Now], None]]:
    """Show how far a still is, for the time of a context; yields what is told of its progress."""
    left = TextColumn("{task.fields[left]}")
    with bar("{task.fields[frames]} frames", left) as progress:
        task = progress.add_task("rendering", total=1.0, frames=0, left="")

        def report(now: Now) -> None:
            known = now.left is not None
            whole = now.seconds + (now.left or 0.0)
            progress.update(
                task,
                description=f"error {now.error:.3g}" if math.isfinite(now.error) else "rendering",
                completed=now.seconds / whole if known and whole > 0.0 else 0.0,
                frames=now.frames,
                left=f"about {now.left:.0f} s left" if known else "",
            )

        yield report
