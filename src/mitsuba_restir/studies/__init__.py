"""Studies: an experiment as data, run so that it can be interrupted, and reported."""

from .config import Motion, Reference, Study, Variant, View
from .files import load_study, packaged_studies
from .notebook import Results, run
from .report import write_report
from .runner import run_study
from .table import Table

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
