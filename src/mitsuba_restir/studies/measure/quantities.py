"""The quantities that a study can measure, and the numbers that each gives, in their order.

Tables, charts and captions read names, units and order from here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..config.study import Study
from . import (
    biases,
    cold_start,
    correlations,
    errors,
    excess,
    noise,
    previews,
    probed,
    stills,
    times,
    variances,
)
from .errors import after_denoising, of_frames, of_mean, one_by_one
from .frame_errors import BLOTCHES, SIGMA, every_frame, last_frame_of
from .probes import GUIDED, GUIDED_TRIMMED
from .results import Measured, Number, Refused, Row, Rows


@dataclass(frozen=True)
class Quantity:
    """
    How one quantity is measured. What it is, ``docs/studies.md`` says.

    Fields
    ------
    measure : callable
        Measures the numbers of every variant, or refuses to with a reference that is too noisy.
    numbers : sequence of Number
        What it gives; empty where that is known only when it is measured.
    needs_reference : bool
    cold : bool
        Only meaningful for runs without warm-up.
    sequences : bool
        Needs every frame of a run, and more than one.
    least_runs : int
        Independent runs that it needs.
    needs_candidates : bool
        Needs a variant of candidates alone.
    probe : str
        Name of the probe that measures it; empty for what is measured from images and times.
    package : str
        Module without which its probe cannot run; empty where there is none.
    lacks : callable
        Says what else of a study it needs and that one has not; empty where it has all.
    """

    measure: Rows
    numbers: Sequence[Number] = ()
    needs_reference: bool = False
    cold: bool = False
    sequences: bool = False
    least_runs: int = 1
    needs_candidates: bool = False
    probe: str = ""
    package: str = ""
    lacks: Callable[[Study], str] = lambda _: ""

    def rows(self, data: Measured) -> Iterator[Row | Refused]:
        """Measure."""
        return self.measure(data, self.numbers)


_CLIPPED = Number(
    "relative RMSE, clipped",
    heading="Relative RMSE, clipped",
    chart=True,
    caption="clipped RMSE",
)
_TRIMMED = Number(
    "relMSE, trimmed",
    heading="relMSE, trimmed",
    # Two errors that fireflies do not decide say the same.
    yields_to=_CLIPPED.name,
    chart=True,
    caption="relMSE, trimmed",
    keeps_part=True,
)

QUANTITIES: Mapping[str, Quantity] = {
    "time": Quantity(
        times.frame_time,
        [Number("time of a frame", "ms", heading="Time of a frame", chart=True, caption="time")],
    ),
    "speed": Quantity(times.speed, [Number("frames per second"), Number("time of a pixel", "ns")]),
    "rmse": Quantity(
        of_frames(errors.rmse, noise.absolute),
        [Number("RMSE", heading="RMSE", chart=True, caption="RMSE")],
        needs_reference=True,
    ),
    "rmse_displayed": Quantity(
        of_frames(errors.rmse_displayed, noise.displayed),
        [Number("RMSE, displayed", heading="RMSE, displayed", chart=True)],
        needs_reference=True,
    ),
    "relmse": Quantity(
        of_frames(errors.whole_relmse, noise.relmse),
        [Number("relMSE")],
        needs_reference=True,
    ),
    "relmse_trimmed": Quantity(
        of_frames(errors.trimmed_relmse, noise.trimmed),
        [_TRIMMED],
        needs_reference=True,
    ),
    "rmse_relative": Quantity(
        one_by_one(
            of_frames(errors.rmse_clipped, noise.clipped),
            of_frames(errors.rmse_relative, noise.relative),
        ),
        [_CLIPPED, Number("relative RMSE")],
        needs_reference=True,
    ),
    "relmse_average": Quantity(
        of_mean(errors.whole_relmse, noise.relmse),
        [Number("relMSE of the average", heading="relMSE of the average")],
        needs_reference=True,
    ),
    "average": Quantity(
        errors.averages,
        [
            Number("relMSE of the average, trimmed"),
            Number("relMSE of the average after OIDN", chart=True),
        ],
        needs_reference=True,
    ),
    "error_time": Quantity(
        times.errors_and_times,
        [
            Number("relMSE, trimmed, x time", "ms", heading="relMSE, trimmed, x time"),
            *(Number(f"filtered MSE, {sigma:g} px, x time", "ms") for sigma in BLOTCHES),
        ],
        needs_reference=True,
        least_runs=2,
    ),
    "variance": Quantity(
        variances.variances,
        [
            Number("relative variance"),
            Number("relative variance, trimmed", heading="Variance, trimmed", chart=True),
            Number("relative variance x time", "ms"),
            Number("relative variance x time, trimmed", "ms", heading="Variance x time, trimmed"),
        ],
        needs_reference=True,
        least_runs=2,
    ),
    "cold_start": Quantity(
        cold_start.half_gains,
        [Number("frames until half of the gain")],
        needs_reference=True,
        cold=True,
        sequences=True,
        least_runs=2,
    ),
    "equal_time": Quantity(
        times.equal_time,
        [
            Number(f"equal time: {reading}{label}", "x", heading, better="more")
            for label in ("", ", trimmed")
            for reading, heading in (
                ("last frame at its own time", "" if label else "Equal time, last frame"),
                ("last frame charged with all", "" if label else "Equal time, charged with all"),
                ("average of all frames", "" if label else "Equal time, average"),
            )
        ],
        needs_reference=True,
        cold=True,
        least_runs=2,
    ),
    "efficiency": Quantity(
        stills.efficiencies,
        [
            Number(f"efficiency{of}", "x", heading, better="more")
            for of, heading in (
                ("", "Efficiency"),
                (", trimmed", "Efficiency, trimmed"),
                (", median pixel", "Efficiency, median pixel"),
            )
        ],
        needs_reference=True,
        least_runs=3,
    ),
    "as_long": Quantity(
        stills.as_long_as,
        [
            Number(f"path takes as long, by {error}", "x", f"As long, by {error}", better="more")
            for error in ("relMSE, trimmed", "HDR-FLIP")
        ],
        needs_reference=True,
        least_runs=2,
        lacks=stills.lacks_rivals,
    ),
    "stated": Quantity(
        stills.stated_over_true,
        [
            Number("stated over true error", heading="Stated error over true", better=""),
            Number("stated over true error, untrimmed", better=""),
        ],
        least_runs=3,
        lacks=stills.lacks_stills,
    ),
    "covariance": Quantity(
        correlations.covariance,
        [
            Number("relative covariance r=8", heading="Relative covariance", chart=True),
            Number("relative covariance r=8, with j=i"),
            Number("mean correlation r=8"),
        ],
        needs_reference=True,
        least_runs=2,
    ),
    "covariance_clipped": Quantity(
        correlations.clipped_covariance,
        [
            Number("relative covariance r=8, clipped", heading="Covariance, clipped", chart=True),
            Number("relative covariance r=8, clipped, with j=i"),
            Number("mean correlation r=8, clipped"),
        ],
        needs_reference=True,
        least_runs=2,
    ),
    "covariance_in_sequence": Quantity(
        correlations.covariance_in_sequence,
        [Number("covariance r=8 within a sequence", heading="Covariance in a sequence")],
        needs_reference=True,
        sequences=True,
    ),
    "temporal_covariance": Quantity(
        correlations.covariance_of_frames,
        [Number("covariance of consecutive frames")],
        needs_reference=True,
        sequences=True,
        least_runs=2,
    ),
    "flicker": Quantity(
        after_denoising(
            one_by_one(correlations.change_of_frames, correlations.covariance_of_frames),
            every_frame,
        ),
        [
            Number("flicker after OIDN", chart=True),
            Number("covariance of consecutive frames after OIDN"),
        ],
        needs_reference=True,
        sequences=True,
        least_runs=2,
    ),
    "duplication": Quantity(
        probed.of_probe("statistics", compared=True),
        [
            Number("duplicated paths r=8, before mutations"),
            Number("duplicated paths r=8, after mutations", heading="Duplicated paths", better=""),
            Number("duplicated paths r=8, after spatial reuse"),
        ],
        probe="statistics",
    ),
    "guiding": Quantity(
        probed.of_probe("statistics", compared=True),
        [
            Number("light", heading="Candidates with light", better="more"),
            Number("guiding: cells", better=""),
            Number("guiding: alpha", better=""),
        ],
        probe="statistics",
    ),
    "statistics": Quantity(probed.of_probe("statistics"), probe="statistics"),
    "previews": Quantity(
        previews.gains,
        [number for numbers in previews.NUMBERS.values() for number in numbers],
        needs_reference=True,
        probe=previews.PROBE,
        package="flip_evaluator",
        lacks=stills.lacks_stills,
    ),
    "mutation_spectra": Quantity(
        probed.mutation_spectra, needs_reference=True, probe="mutation_spectra"
    ),
    "bands": Quantity(
        correlations.bands,
        [
            Number("power 0.02-0.06", heading="Power .02–.06 c/px", chart=True),
            Number("power 0.06-0.17", heading="Power .06–.17 c/px", chart=True),
            *(Number(f"power {low:g}-{high:g}") for low, high in correlations.BANDS[2:]),
        ],
        needs_reference=True,
        least_runs=2,
    ),
    "radial_spectrum": Quantity(
        correlations.low_frequencies,
        [Number("power 0-0.125"), Number("low-frequency share, white = 1")],
        needs_reference=True,
        least_runs=2,
    ),
    "filtered_mse": Quantity(
        errors.seen_through(SIGMA),
        [Number("filtered MSE, 1.5 px", heading="Filtered MSE", chart=True)],
        needs_reference=True,
    ),
    "blotches": Quantity(
        one_by_one(*map(errors.seen_through, BLOTCHES)),
        [Number(f"filtered MSE, {sigma:g} px") for sigma in BLOTCHES],
        needs_reference=True,
    ),
    "excess": Quantity(
        excess.excesses,
        excess.NUMBERS,
        needs_reference=True,
        least_runs=3,
        needs_candidates=True,
    ),
    "smape": Quantity(
        of_frames(errors.smape, noise.clipped),
        [Number("SMAPE", keeps_all=errors.smape)],
        needs_reference=True,
    ),
    "flip": Quantity(
        of_frames(errors.hdr_flip, noise.clipped, last_frame_of),
        [Number("HDR-FLIP", heading="FLIP", chart=True, keeps_all=errors.hdr_flip)],
        needs_reference=True,
    ),
    "denoised": Quantity(
        errors.denoised,
        [
            Number("RMSE after OIDN", heading="RMSE after OIDN"),
            Number("relMSE after OIDN"),
            Number("HDR-FLIP after OIDN", chart=True, keeps_all=errors.hdr_flip),
        ],
        needs_reference=True,
    ),
    "denoised_guided": Quantity(
        probed.of_probe("guided_denoising", compared=True),
        [Number(GUIDED, chart=True), Number(GUIDED_TRIMMED)],
        needs_reference=True,
        probe="guided_denoising",
        package="mitsuba_oidn",
    ),
    "mean_ratio": Quantity(biases.mean_ratios, [Number("mean ratio")], needs_reference=True),
    "mean_bias": Quantity(
        biases.paired_mean,
        [Number("mean against the baseline, minus 1", heading="Mean, against baseline", better="")],
        least_runs=2,
    ),
    "block_bias": Quantity(
        biases.block_biases,
        [
            Number(f"blocks of {biases.BLOCK} pixels off the reference, {what}")
            for what in ("5 % by chance", "p of no bias")
        ],
        needs_reference=True,
        least_runs=4,
    ),
    "pixel_bias": Quantity(
        biases.pixel_biases,
        [
            Number("rms pixel bias"),
            Number("rms pixel bias against the baseline", heading="Pixel bias, rms", better=""),
        ],
        needs_reference=True,
        least_runs=2,
    ),
}

NUMBERS: Mapping[str, Number] = {
    number.name: number for quantity in QUANTITIES.values() for number in quantity.numbers
}
"""Every number that is known beforehand, by name."""
