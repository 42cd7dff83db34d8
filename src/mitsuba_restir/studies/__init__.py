"""Studies: an experiment as data, run so that it can be stopped and gone on with, and its table."""

from .config import Reference, Study, Variant, View
from .files import load_study, packaged_studies
from .runner import run_study
from .table import Table

__all__ = [
    "Reference",
    "Study",
    "Table",
    "Variant",
    "View",
    "load_study",
    "packaged_studies",
    "run_study",
]
