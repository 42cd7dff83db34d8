"""Measuring images: errors, tests of bias, covariance and spectra. NumPy in, numbers out."""

from .bias import BiasReport, BiasTest, batch_means, mean_test, unbiasedness_test
from .covariance import (
    RelativeCovariance,
    covariance_ratio,
    relative_covariance,
    temporal_covariance,
)
from .covariance_images import covariance_map, lag_covariance, pixel_covariance
from .denoise import denoise
from .images import luminance, smoothed_reference
from .intervals import (
    Interval,
    PairedDifference,
    mean_interval,
    paired_difference,
    ratio_interval,
)
from .metrics import hdr_flip, mean_ratio, relmse, rmse, smape, trimmed_relmse
from .perceptual import filtered_mse, filtered_share
from .pixel_bias import mean_bias, squared_pixel_bias
from .spectrum import (
    FINE_BANDS,
    TABLE_BANDS,
    band_power,
    compare_bands,
    power_spectrum,
    radial_spectrum,
    relative_error,
)

__all__ = [
    "FINE_BANDS",
    "TABLE_BANDS",
    "BiasReport",
    "BiasTest",
    "Interval",
    "PairedDifference",
    "RelativeCovariance",
    "band_power",
    "batch_means",
    "compare_bands",
    "covariance_map",
    "covariance_ratio",
    "denoise",
    "filtered_mse",
    "filtered_share",
    "hdr_flip",
    "lag_covariance",
    "luminance",
    "mean_bias",
    "mean_interval",
    "mean_ratio",
    "mean_test",
    "paired_difference",
    "pixel_covariance",
    "power_spectrum",
    "radial_spectrum",
    "ratio_interval",
    "relative_covariance",
    "relative_error",
    "relmse",
    "rmse",
    "smape",
    "smoothed_reference",
    "squared_pixel_bias",
    "temporal_covariance",
    "trimmed_relmse",
    "unbiasedness_test",
]
