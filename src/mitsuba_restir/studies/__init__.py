"""Studies: an experiment as data, run so that it can be interrupted, and reported."""

from .config.files import load_study, packaged_studies
from .config.study import Motion, Reference, Study, Variant, View
from .measure.table import Table
from .notebook import Results, run
from .report import write_report
from .runner import run_study

__all__ = [
    "Motion",
    "Reference",
    "Results",
    "Study",
    "Table",
    "Variant",
    "View",
    "load_study",
    "packaged_studies",
    "run",
    "run_study",
    "write_report",
]
