"""Measuring images: errors, tests of bias, covariance and spectra. NumPy in, numbers out."""

from .bias import BiasReport, BiasTest, batch_means, mean_test, unbiasedness_test
from .images import luminance, smoothed_reference
from .intervals import (
    Interval,
    PairedDifference,
    bootstrap_interval,
    mean_interval,
    paired_difference,
    ratio_interval,
)
from .metrics import hdr_flip, mean_ratio, relmse, rmse, smape, trimmed_relmse

__all__ = [
    "BiasReport",
    "BiasTest",
    "Interval",
    "PairedDifference",
    "batch_means",
    "bootstrap_interval",
    "hdr_flip",
    "luminance",
    "mean_interval",
    "mean_ratio",
    "mean_test",
    "paired_difference",
    "ratio_interval",
    "relmse",
    "rmse",
    "smape",
    "smoothed_reference",
    "trimmed_relmse",
    "unbiasedness_test",
]
