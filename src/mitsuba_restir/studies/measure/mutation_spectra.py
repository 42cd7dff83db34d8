"""What mutations do before spatial reuse: spectra of what a pixel would show, and of what it mixes.

The auxiliary image ``mutation`` has the luminance of F W before and after the mutations, which are
equal, and of the new F with the old W: the value that the source document's rule compares with the
neighbours', and that is never shown.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ...analysis.images import FloatArray, luminance
from ...sampling.georgiev import image_energy
from ..runs.results import ReferenceImage
from .frame_errors import CLIP, reference_noise, relative_errors

SHARE = "largest share of the reference's noise in a power"

CHANNELS = "mutation"
"""Type of the auxiliary image that is measured."""


def numbers(tensor: npt.ArrayLike, reference: ReferenceImage) -> dict[str, float]:
    """
    Measure one frame.

    Parameters
    ----------
    tensor : array_like, (H, W, 6)
        Colour, and the three luminances of the auxiliary image.
    reference : ReferenceImage

    Returns
    -------
    dict
        Of the luminance before spatial reuse, of the mixed one and of the frame: power of the
        relative error by band, without the reference's own noise; mean against the reference
        (relative errors clipped); mean Georgiev-Fajardo energy of a pixel. And the largest relative
        change of the luminance of a pixel by its mutations, and what share of a power was the
        reference's noise at most.
    """
    frame = np.asarray(tensor, dtype=np.float64)
    before, after, mixed = np.moveaxis(frame[..., 3:6], -1, 0)
    images = {
        "before spatial reuse": before,
        "mixed": mixed,
        "shown": luminance(frame[..., :3]),
    }
    known = _bands(reference_noise(reference, CLIP, "hann"))
    found: dict[str, float] = {SHARE: 0.0}
    for name, image in images.items():
        (error,) = relative_errors(image[None], reference, CLIP)
        powers = _bands(spectrum.power_spectrum(error))
        found |= {f"{key}, {name}": value - known[key] for key, value in powers.items()}
        shares = (known[key] / max(value, 1e-30) for key, value in powers.items())
        found[SHARE] = max(found[SHARE], *shares)
        found[f"mean of the clipped error, {name}"] = float(error.mean())
        found[f"energy, {name}"] = _energy(image, float(before.mean()))
    lit = before > 0.0
    change = np.abs(after[lit] / before[lit] - 1.0)
    found["largest change of luminance by mutations"] = float(change.max(initial=0.0))
    return found


def _bands(power: FloatArray) -> Mapping[str, float]:
    f = spectrum.frequencies(power.shape)
    bands = [
        (low, high) for low, high in spectrum.TABLE_BANDS if np.any((f >= low) & (f < high))
    ] + [spectrum.FINE_BANDS[-1]]
    powers = spectrum.band_power(power, bands)
    return {
        f"power {low:g}-{high:g}": float(value)
        for (low, high), value in zip(bands, powers, strict=True)
    }


def _energy(image: FloatArray, mean: float) -> float:
    total = image + mean
    values = np.divide(image, total, out=np.zeros_like(total), where=total > 0.0)
    return float(image_energy(values).mean())
