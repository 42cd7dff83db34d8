"""Studies from Python: run one, and look at its numbers as data frames and figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UsageError
from .config import Study
from .report import write_report
from .report.figures import bars
from .runner import Progress, run_study
from .store import StudyFolder
from .table import Table

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
        size = size or "{}x{}".format(*self.study.sizes[0])
        rows = [r for r in self.table.rows if r.quantity == quantity and r.size == size]
        if not rows:
            known = dict.fromkeys(row.quantity for row in self.table.rows)
            raise UsageError(f"no '{quantity}' at {size}: there are {', '.join(known)}")
        return bars(rows, quantity)

    def report(self) -> Path:
        """Write the HTML report and return its path."""
        command = f"python -m mitsuba_restir.studies {self.path / 'config.toml'} -o {self.path}"
        return write_report(StudyFolder(self.path, self.study), self.table, command)


def run(study: Study, path: str | Path, progress: Progress | None = None) -> Results:
    """
    Run a study, or go on with one, in a folder.

    Raises
    ------
    UsageError, RenderError
        As `run_study`.
    """
    folder = Path(path)
    return Results(study, folder, run_study(study, folder, progress))
