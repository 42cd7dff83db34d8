"""Measuring images: errors, tests of bias, covariance and spectra. NumPy in, numbers out."""

from .bias import MeanTest, mean_test
from .covariance import run_products, temporal_covariance
from .covariance_images import covariance_map, lag_products
from .denoise import denoise
from .images import luminance, smoothed_reference
from .intervals import Interval, Jackknife, mean_interval, ratio_interval, sign_flip_p_value
from .metrics import filtered_mse, hdr_flip, mean_ratio, relmse, rmse, smape, trimmed_relmse
from .pixel_bias import mean_bias, squared_pixel_bias
from .spectrum import FINE_BANDS, TABLE_BANDS, band_power, power_spectrum, radial_spectrum

__all__ = [
    "FINE_BANDS",
    "TABLE_BANDS",
    "Interval",
    "Jackknife",
    "MeanTest",
    "band_power",
    "covariance_map",
    "denoise",
    "filtered_mse",
    "hdr_flip",
    "lag_products",
    "luminance",
    "mean_bias",
    "mean_interval",
    "mean_ratio",
    "mean_test",
    "power_spectrum",
    "radial_spectrum",
    "ratio_interval",
    "relmse",
    "rmse",
    "run_products",
    "sign_flip_p_value",
    "smape",
    "smoothed_reference",
    "squared_pixel_bias",
    "temporal_covariance",
    "trimmed_relmse",
]
