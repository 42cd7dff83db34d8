"""The quantities that a study can measure, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..analysis import metrics
from .biases import block_biases, mean_ratios, paired_mean, pixel_biases
from .correlations import (
    bands,
    clipped_covariance,
    covariance,
    covariance_in_sequence,
    covariance_of_frames,
    low_frequencies,
)
from .denoised import denoised
from .frame_errors import filtered_mse, last_frame_of
from .noise import Checked
from .probed import memory_slopes, of_probe
from .results import Measured, Row
from .scalars import equal_time, frame_time, of_frames, of_mean, relative_rmse, relmse, speed


@dataclass(frozen=True)
class Quantity:
    """
    How one quantity is measured.

    Fields
    ------
    about : str
        One line for the user.
    rows : callable
        Measures every variant.
    needs_reference : bool
    checked : {"last", "mean"} or None
        Of each run, the image in whose error the reference's own must be a small part. None where
        an interval or a test includes the reference's error, however large.
    cold : bool
        Only meaningful for runs without warm-up.
    sequences : bool
        Needs every frame of a run, and more than one.
    least_runs : int
        Independent runs that it needs.
    probe : str
        Name of the probe that measures it; empty for what is measured from images and times.
    across : callable or None
        Measures what follows from all sizes together.
    """

    about: str
    rows: Callable[[Measured], Iterator[Row]]
    needs_reference: bool = False
    checked: Checked | None = "last"
    cold: bool = False
    sequences: bool = False
    least_runs: int = 1
    probe: str = ""
    across: Callable[[Sequence[Measured]], Iterator[Row]] | None = None


QUANTITIES: Mapping[str, Quantity] = {
    "time": Quantity("median time of a frame, and of interleaved pairs", frame_time),
    "speed": Quantity("frames per second and time per pixel", speed),
    "rmse": Quantity(
        "root mean squared error of a frame",
        of_frames(
            "RMSE",
            lambda _, image, r: metrics.rmse(image, r.image, reference_variance=r.variance),
        ),
        needs_reference=True,
    ),
    "rmse_displayed": Quantity(
        "root mean squared error of a frame as a screen shows it: sRGB, clipped to [0, 1]",
        of_frames(
            "RMSE, displayed",
            lambda _, image, r: metrics.rmse(metrics.displayed(image), metrics.displayed(r.image)),
        ),
        needs_reference=True,
    ),
    "rmse_relative": Quantity(
        "root mean squared relative error of the luminance of a frame, clipped at 4 and not",
        relative_rmse,
        needs_reference=True,
    ),
    "relmse": Quantity(
        "relative mean squared error of a frame",
        of_frames("relMSE", lambda data, image, _: relmse(data, image, 0.0)),
        needs_reference=True,
    ),
    "relmse_trimmed": Quantity(
        "relMSE of a frame without the worst pixels",
        of_frames("relMSE, trimmed", lambda data, image, _: relmse(data, image, data.trim)),
        needs_reference=True,
    ),
    "relmse_average": Quantity(
        "relMSE of the average of all frames",
        of_mean("relMSE of the average", lambda data, image, _: relmse(data, image, 0.0)),
        needs_reference=True,
        checked="mean",
    ),
    "smape": Quantity(
        "symmetric mean absolute error of a frame",
        of_frames("SMAPE", lambda _, image, r: metrics.smape(image, r.image)),
        needs_reference=True,
    ),
    "flip": Quantity(
        "HDR-FLIP of the last frame of a run",
        of_frames(
            "HDR-FLIP",
            lambda _, image, r: metrics.hdr_flip(image, r.image).mean,
            frames=last_frame_of,
        ),
        needs_reference=True,
    ),
    "mean_ratio": Quantity(
        "mean luminance of all frames over the reference's",
        mean_ratios,
        needs_reference=True,
        checked=None,
    ),
    "filtered_mse": Quantity(
        "mean squared relative error of a frame, clipped at 4, through a Gaussian of 1.5 pixels",
        of_frames(
            "filtered MSE, 1.5 px",
            lambda _, image, r: filtered_mse(image[None], r),
        ),
        needs_reference=True,
    ),
    "equal_time": Quantity(
        "relMSE at equal time against one frame of the baseline",
        equal_time,
        needs_reference=True,
        checked="mean",
        cold=True,
        least_runs=2,
    ),
    "covariance": Quantity(
        "relative covariance between runs",
        covariance,
        needs_reference=True,
        least_runs=2,
    ),
    "covariance_clipped": Quantity(
        "the same of luminance clipped at 5 times the smoothed reference",
        clipped_covariance,
        needs_reference=True,
        least_runs=2,
    ),
    "covariance_in_sequence": Quantity(
        "relative covariance over consecutive frames, as the source document reads it",
        covariance_in_sequence,
        needs_reference=True,
        sequences=True,
    ),
    "bands": Quantity(
        "power of the relative error by frequency band", bands, needs_reference=True, least_runs=2
    ),
    "radial_spectrum": Quantity(
        "power of the relative error up to 1/8 cycle/pixel, and its share; curves in spectra.csv",
        low_frequencies,
        needs_reference=True,
        least_runs=2,
    ),
    "temporal_covariance": Quantity(
        "relative covariance of consecutive frames",
        covariance_of_frames,
        needs_reference=True,
        sequences=True,
        least_runs=2,
    ),
    "mean_bias": Quantity(
        "mean luminance against the baseline's, run by run", paired_mean, least_runs=2
    ),
    "block_bias": Quantity(
        "share of blocks of pixels whose mean differs from the reference's, and a test of all",
        block_biases,
        needs_reference=True,
        checked=None,
        least_runs=4,
    ),
    "pixel_bias": Quantity(
        "rms bias of single pixels, by products of independent runs",
        pixel_biases,
        needs_reference=True,
        checked="mean",
        least_runs=2,
    ),
    "denoised": Quantity(
        "RMSE, relMSE and HDR-FLIP of a frame after OIDN, without guides",
        denoised,
        needs_reference=True,
    ),
    "kernels": Quantity(
        "kernels compiled and launched per frame after warm-up",
        of_probe("kernels"),
        probe="kernels",
    ),
    "statistics": Quantity(
        "what restir_pt says about its frames: shifts by outcome, history found, acceptance, "
        "duplicated paths",
        of_probe("statistics"),
        probe="statistics",
    ),
    "duplication": Quantity(
        "of the statistics, the share of pixels whose path another one within 8 pixels has as well",
        of_probe("statistics", compared=True, only="duplicated paths"),
        probe="statistics",
    ),
    "mutation_spectra": Quantity(
        "spectra before and after spatial reuse, and of what the source document's rule arranges",
        of_probe("mutation_spectra", compared=True),
        needs_reference=True,
        probe="mutation_spectra",
    ),
    "rays": Quantity("rays per pixel and frame (restir_pt only)", of_probe("rays"), probe="rays"),
    "memory": Quantity(
        "bytes per pixel: kept between frames, and the slope of the peak",
        of_probe("memory", {"peak": "B", "": "B/pixel"}),
        probe="memory",
        across=memory_slopes,
    ),
    "startup": Quantity(
        "seconds of the first frames of a process, kernel cache empty (cold) or filled (warm)",
        of_probe("startup", {"": "s"}),
        probe="startup",
    ),
}
