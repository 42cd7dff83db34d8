"""The quantities that a study can measure, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...analysis import metrics
from . import noise
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
from .probed import memory_slopes, mutation_spectra, of_probe
from .results import Measured, Refused, Row
from .scalars import (
    equal_time,
    frame_time,
    hdr_flip,
    of_frames,
    of_mean,
    relative_rmse,
    relmse,
    rmse,
    speed,
    whole_relmse,
)


@dataclass(frozen=True)
class Quantity:
    """
    How one quantity is measured. What it is, ``docs/studies.md`` says.

    Fields
    ------
    rows : callable
        Measures every variant, or refuses to with a reference that is too noisy for it.
    needs_reference : bool
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

    rows: Callable[[Measured], Iterator[Row | Refused]]
    needs_reference: bool = False
    cold: bool = False
    sequences: bool = False
    least_runs: int = 1
    probe: str = ""
    across: Callable[[Sequence[Measured]], Iterator[Row]] | None = None


QUANTITIES: Mapping[str, Quantity] = {
    "time": Quantity(frame_time),
    "speed": Quantity(speed),
    "rmse": Quantity(
        of_frames("RMSE", rmse, noise.absolute),
        needs_reference=True,
    ),
    "rmse_displayed": Quantity(
        of_frames(
            "RMSE, displayed",
            lambda _, image, r: metrics.rmse(
                metrics.displayed(image),
                metrics.displayed(r.image),
                reference_variance=metrics.displayed_variance(r.image, r.variance),
            ),
            noise.displayed,
        ),
        needs_reference=True,
    ),
    "rmse_relative": Quantity(relative_rmse, needs_reference=True),
    "relmse": Quantity(
        of_frames("relMSE", whole_relmse, noise.relmse),
        needs_reference=True,
    ),
    "relmse_trimmed": Quantity(
        of_frames(
            "relMSE, trimmed",
            lambda data, image, _: relmse(data, image, data.trim),
            noise.trimmed,
        ),
        needs_reference=True,
    ),
    "relmse_average": Quantity(
        of_mean("relMSE of the average", whole_relmse, noise.relmse),
        needs_reference=True,
    ),
    "smape": Quantity(
        of_frames("SMAPE", lambda _, image, r: metrics.smape(image, r.image), noise.clipped),
        needs_reference=True,
    ),
    "flip": Quantity(
        of_frames("HDR-FLIP", hdr_flip, noise.clipped, frames=last_frame_of),
        needs_reference=True,
    ),
    "mean_ratio": Quantity(mean_ratios, needs_reference=True),
    "filtered_mse": Quantity(
        of_frames(
            "filtered MSE, 1.5 px",
            lambda _, image, r: filtered_mse(image[None], r),
            noise.filtered,
        ),
        needs_reference=True,
    ),
    "equal_time": Quantity(equal_time, needs_reference=True, cold=True, least_runs=2),
    "covariance": Quantity(covariance, needs_reference=True, least_runs=2),
    "covariance_clipped": Quantity(clipped_covariance, needs_reference=True, least_runs=2),
    "covariance_in_sequence": Quantity(
        covariance_in_sequence, needs_reference=True, sequences=True
    ),
    "bands": Quantity(bands, needs_reference=True, least_runs=2),
    "radial_spectrum": Quantity(low_frequencies, needs_reference=True, least_runs=2),
    "temporal_covariance": Quantity(
        covariance_of_frames, needs_reference=True, sequences=True, least_runs=2
    ),
    "mean_bias": Quantity(paired_mean, least_runs=2),
    "block_bias": Quantity(block_biases, needs_reference=True, least_runs=4),
    "pixel_bias": Quantity(pixel_biases, needs_reference=True, least_runs=2),
    "denoised": Quantity(denoised, needs_reference=True),
    "kernels": Quantity(of_probe("kernels"), probe="kernels"),
    "statistics": Quantity(of_probe("statistics"), probe="statistics"),
    "duplication": Quantity(
        of_probe("statistics", compared=True, only="duplicated paths"), probe="statistics"
    ),
    "mutation_spectra": Quantity(mutation_spectra, needs_reference=True, probe="mutation_spectra"),
    "rays": Quantity(of_probe("rays"), probe="rays"),
    "memory": Quantity(
        of_probe("memory", {"peak": "B", "": "B/pixel"}), probe="memory", across=memory_slopes
    ),
    "startup": Quantity(of_probe("startup", {"": "s"}), probe="startup"),
}
