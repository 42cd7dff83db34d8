"""The report of a study: one self-contained HTML page, and its figures and curves beside it."""

from .write import write_report

__all__ = ["write_report"]
