"""Measuring images: errors, tests of bias, covariance and spectra. NumPy in, numbers out."""
