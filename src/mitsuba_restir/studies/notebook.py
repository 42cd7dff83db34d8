"""Studies from Python: run one, and look at its numbers as data frames and figures."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.colours import line_colours
from ..errors import UsageError
from .config.files import load_study
from .config.study import Size, Study
from .measure.frame_errors import chain_spectra
from .measure.loading import load_size
from .measure.results import Measured, Refused
from .measure.table import Table
from .report import curves as report_curves
from .report import figures
from .report.write import write_report
from .runner import Progress, run_study
from .store.folder import StudyFolder

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-not-found, import-untyped, unused-ignore]
    from matplotlib.figure import Figure  # type: ignore[import-not-found, unused-ignore]


@dataclass(frozen=True)
class Results:
    """
    A finished study.

    Fields
    ------
    study : Study
    path : Path
        Its folder.
    table : Table
        All numbers.
    """

    study: Study
    path: Path
    table: Table

    def frame(self) -> pd.DataFrame:
        """Return all numbers as a pandas data frame, one row for each."""
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError("Data frames need pandas: pip install pandas") from error
        return pd.DataFrame(self.table.records())

    def figure(self, quantity: str, size: str | None = None) -> Figure:
        """
        Draw one quantity of all variants.

        Raises
        ------
        UsageError
            The study does not have it.
        """
        size = size or _label(self.study.sizes[0])
        rows = [r for r in self.table.rows if r.quantity == quantity and r.size == size]
        if not rows:
            known = dict.fromkeys(row.quantity for row in self.table.rows)
            raise UsageError(f"no '{quantity}' at {size}: there are {', '.join(known)}")
        return figures.quantity(rows, quantity)

    def convergence(self, over: str = "frames") -> Figure:
        """
        Draw the error over "frames" or "seconds", at the first size.

        Raises
        ------
        UsageError
            The study did not keep its frames, or has no reference that is sure enough.
        """
        found = report_curves.convergence(self._first)
        if isinstance(found, Refused):
            raise UsageError(f"{self.study.name}: {found.reason}")
        if not found:
            raise UsageError(f"{self.study.name}: convergence needs keep = 'all' and a [reference]")
        return figures.convergence(found, over, line_colours(self._first.runs))

    def spectra(self) -> Figure:
        """
        Draw the power of the relative error by frequency, at the first size.

        Raises
        ------
        UsageError
            The study has no reference.
        """
        reference = self._first.reference
        if reference is None:
            raise UsageError(f"{self.study.name}: spectra of errors need a [reference]")
        powers = chain_spectra(self._first, reference)
        found = report_curves.radial_powers(self._first, powers)
        return figures.radial(found, line_colours(self._first.runs))

    def report(self) -> Path:
        """Write the HTML report and return its path."""
        words = ["mitsuba-restir", "evaluate", self.path / "config.toml", "-o", self.path]
        with StudyFolder(self.path, self.study) as folder:
            folder.claim()
            return write_report(folder, self.table, shlex.join(map(str, words)))

    @cached_property
    def _first(self) -> Measured:
        return load_size(StudyFolder(self.path, self.study), self.study.sizes[0])


def run(
    study: Study | str, path: str | Path | None = None, progress: Progress | None = None
) -> Results:
    """
    Run a study, or go on with one, in a folder.

    Parameters
    ----------
    study : Study or str
        A study, the name of a packaged one, or the path of a TOML file.
    path : path, optional
        Folder of the results, ``out/evaluate-NAME`` by default.
    progress : callable, optional
        As of `run_study`.

    Raises
    ------
    UsageError, RenderError
        As `run_study`.
    """
    chosen = load_study(study) if isinstance(study, str) else study
    folder = Path("out") / f"evaluate-{chosen.name}" if path is None else Path(path)
    return Results(chosen, folder, run_study(chosen, folder, progress))


def _label(size: Size) -> str:
    return f"{size[0]}x{size[1]}"
