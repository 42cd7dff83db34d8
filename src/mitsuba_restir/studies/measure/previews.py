"""Previews of stills: how much bluer than the mean so far is what is shown in its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...analysis import metrics, spectrum
from ...analysis.images import FloatArray
from ...imageio import Image
from ..runs.results import ReferenceImage
from .frame_errors import CLIP, reference_noise, relative_errors
from .probed import of_probe
from .results import Measured, Number, Refused, Row
from .rows import unless_noisy

PROBE = "previews"

COUNTS = (1, 4, 16)
"""Numbers of frames after which previews are measured."""

_SHARE = "largest share of the reference's noise in a power"


def named(what: str, count: int) -> str:
    """Name of a number after so many frames."""
    return f"preview over mean, {what}, {count} frame{'s' if count > 1 else ''}"


POWERS = [f"power {low:g}-{high:g}" for low, high in spectrum.TABLE_BANDS]

NUMBERS = {
    count: [
        *(
            Number(named(what, count), heading=f"{what}, {count} fr.")
            for what in (*POWERS, "HDR-FLIP")
        ),
        Number(named("mean", count)),
    ]
    for count in COUNTS
}
"""What is measured after each number of frames."""


def ratios(mean: Image, shown: Image, reference: ReferenceImage, count: int) -> Mapping[str, float]:
    """
    Measure a still after so many frames.

    Parameters
    ----------
    mean, shown : array, (H, W, 3)
        The mean of its frames, and its preview.

    Returns
    -------
    dict
        Ratios of the preview's to the mean's: power of the relative error by band, without the
        reference's own noise, HDR-FLIP, and brightness. And what share of a power was the
        reference's noise at most.
    """
    known = _powers(reference_noise(reference, CLIP, "hann"))
    plain, own = (
        _powers(spectrum.power_spectrum(relative_errors(image[None], reference, CLIP)))
        for image in (mean, shown)
    )
    found = {
        named(power, count): value
        for power, value in zip(POWERS, (own - known) / (plain - known), strict=True)
    }
    flips = [metrics.hdr_flip(image, reference.image) for image in (mean, shown)]
    return {
        **found,
        named("HDR-FLIP", count): flips[1] / flips[0],
        named("mean", count): float(np.mean(shown) / np.mean(mean)),
        named(_SHARE, count): float((known / plain).max()),
    }


def _powers(power: FloatArray) -> FloatArray:
    return np.asarray(spectrum.band_power(power, spectrum.TABLE_BANDS))


def gains(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """Ratios, where the reference is sure enough for the powers of that many frames."""
    for count in COUNTS:
        own = [number for number in NUMBERS[count] if number in numbers]
        if not own:
            continue
        share = named(_SHARE, count)
        shares = {
            variant: max((a.get(share, 0.0) for a in data.probed(variant, PROBE)), default=0.0)
            for variant in data.variants
        }
        rows = of_probe(PROBE)(data, own)
        yield from unless_noisy(data, f"previews, {count} frames", shares, rows)
