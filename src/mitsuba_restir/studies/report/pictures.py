"""Pictures of a report: what was rendered, where it is wrong, and where errors keep together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from ...analysis.colours import Picture, diverging
from ...analysis.covariance_images import covariance_map
from ...analysis.denoise import denoise
from ...analysis.images import FloatArray, luminance
from ...imageio import to_srgb8
from ..config.study import REFERENCE
from ..measure.biases import BLOCK, LEAST_RUNS, block_scores
from ..measure.frame_errors import CLIP, SIGMA, relative_errors
from ..measure.results import Measured
from ..runs.results import Image, ReferenceImage, Run

# Errors have full colour at one of these, the first above twice the root mean square.
_SCALES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
_SCORE = 4.0
_PERCENTILE = 99.0


@dataclass(frozen=True)
class Gallery:
    """
    Pictures of one kind, one for each variant.

    Fields
    ------
    key, title, about : str
        Name in file names, heading, and what is shown.
    pictures : mapping of str to array, (H, W, 3), uint8
        By variant.
    layer : bool
        Pixel for pixel the frames: the comparison can show them.
    """

    key: str
    title: str
    about: str
    pictures: dict[str, Picture]
    layer: bool = False


@dataclass(frozen=True)
class Shown:
    """
    What the pictures of one size are made of.

    Fields
    ------
    runs : mapping of str to sequence of Run
        Of the variants that have any.
    scale : float
        Exposure.
    frames, denoised : mapping of str to array, (H, W, 3)
        The last frame of the first run; after OIDN (empty where it is missing).
    errors, seen : mapping of str to array, (H, W)
        Relative errors of the frames, and the clipped ones through a Gaussian; empty without a
        reference.
    error_scale, seen_scale : float
        Where these have full colour.
    """

    runs: Mapping[str, Sequence[Run]]
    scale: float
    frames: Mapping[str, Image]
    denoised: Mapping[str, Image]
    errors: Mapping[str, FloatArray] = field(default_factory=dict)
    seen: Mapping[str, FloatArray] = field(default_factory=dict)
    error_scale: float = 1.0
    seen_scale: float = 1.0


def shown_of(data: Measured) -> Shown:
    """Choose what is shown of one size."""
    runs = {name: own for name, own in data.runs.items() if own}
    frames = {name: own[0].last for name, own in runs.items()}
    try:
        clean = {name: denoise(frame).astype(np.float32) for name, frame in frames.items()}
    except ImportError:
        clean = {}
    shown = Shown(runs, exposure(data) if runs else 1.0, frames, clean)
    reference = data.reference
    if reference is None or not runs:
        return shown
    errors = {name: relative_errors(f[None], reference, None)[0] for name, f in frames.items()}
    clipped = {name: np.clip(error, -CLIP, CLIP) for name, error in errors.items()}
    seen = {
        name: np.asarray(ndimage.gaussian_filter(error, SIGMA, mode="reflect"))
        for name, error in clipped.items()
    }
    return replace(
        shown,
        errors=errors,
        seen=seen,
        error_scale=_scale_of(clipped[data.baseline]),
        seen_scale=_scale_of(seen[data.baseline]),
    )


def _scale_of(error: FloatArray) -> float:
    level = 2.0 * float(np.sqrt(np.mean(error**2)))
    return next((scale for scale in _SCALES if scale >= level), _SCALES[-1])


def exposure(data: Measured) -> float:
    """Factor that brings the 90th percentile of the luminance to 0.8."""
    first = next(own[0] for own in data.runs.values() if own)
    image = first.mean if data.reference is None else data.reference.image
    return 0.8 / max(float(np.percentile(luminance(image), 90.0)), 1e-6)


def galleries(data: Measured, shown: Shown) -> list[Gallery]:
    """Make the pictures in the frames' own pixels; those that need what is missing are left out."""
    if not shown.runs:
        return []
    found = [_images(data, shown), _denoised(shown)]
    if data.reference is not None:
        found += [
            _errors(shown),
            _seen_errors(shown),
            _bias(shown, data.reference),
            _covariances(shown, data.reference),
        ]
    return [gallery for gallery in found if gallery.pictures]


def _images(data: Measured, shown: Shown) -> Gallery:
    pictures = {name: to_srgb8(shown.scale * frame) for name, frame in shown.frames.items()}
    if data.reference is not None:
        pictures[REFERENCE] = to_srgb8(shown.scale * data.reference.image)
    about = f"The last frame of the first run, {shown.scale:.2g} times as bright as rendered, sRGB."
    return Gallery("images", "Images", about, pictures, layer=True)


def _denoised(shown: Shown) -> Gallery:
    pictures = {name: to_srgb8(shown.scale * frame) for name, frame in shown.denoised.items()}
    about = "The same frames after Intel Open Image Denoise, without guides."
    return Gallery("denoised", "Denoised", about, pictures, layer=True)


def error_pictures(shown: Shown) -> dict[str, Picture]:
    """Colour the relative errors of the frames."""
    return {name: diverging(error / shown.error_scale) for name, error in shown.errors.items()}


def seen_pictures(shown: Shown) -> dict[str, Picture]:
    """Colour the errors as they are seen from a distance."""
    return {name: diverging(error / shown.seen_scale) for name, error in shown.seen.items()}


def _errors(shown: Shown) -> Gallery:
    about = (
        "Error of the luminance of these frames over the smoothed reference: blue is too dark, red "
        f"too bright, full colour at ±{100 * shown.error_scale:.0f} %."
    )
    return Gallery("errors", "Errors", about, error_pictures(shown), layer=True)


def _seen_errors(shown: Shown) -> Gallery:
    about = (
        f"The same errors, clipped at ±{CLIP:.0f}, through a Gaussian of {SIGMA} pixels, as an eye "
        f"at a distance sees them; full colour at ±{100 * shown.seen_scale:.0f} %. What blue noise "
        "is for: its errors cancel here."
    )
    return Gallery("seen", "Errors from a distance", about, seen_pictures(shown), layer=True)


def _bias(shown: Shown, reference: ReferenceImage) -> Gallery:
    """Means of blocks, whose noise is nearly normal, against the reference's."""
    pictures = {
        name: np.kron(
            diverging(block_scores(runs, reference) / _SCORE), np.ones((4, 4, 1), dtype=np.uint8)
        )
        for name, runs in shown.runs.items()
        if len(runs) >= LEAST_RUNS
    }
    about = (
        f"Mean of all frames and runs against the reference in blocks of {BLOCK} pixels, as normal "
        f"scores of Student's t: full colour at ±{_SCORE:.0f}. Without a bias one block in 20 is "
        "beyond 2; colours that keep together are a bias, or a distribution with a heavy tail."
    )
    return Gallery("bias", "Bias", about, pictures)


def _covariances(shown: Shown, reference: ReferenceImage) -> Gallery:
    """One scale for all variants: that of the middle one."""
    ceiling = (1.0 + CLIP) * reference.scale
    maps = {}
    for name, runs in shown.runs.items():
        if len(runs) < 2:
            continue
        clipped = np.stack([np.minimum(luminance(run.last), ceiling) for run in runs])
        maps[name] = covariance_map(clipped, reference.luminance)
    levels = [float(np.percentile(np.abs(image), _PERCENTILE)) for image in maps.values()]
    peak = float(np.median(levels)) if levels else 1.0
    pictures = {name: diverging(image / max(peak, 1e-30)) for name, image in maps.items()}
    about = (
        "Mean relative covariance of each pixel with those within 8 pixels, over independent runs "
        f"(luminance clipped at {1 + CLIP:.0f} times the smoothed reference): red pixels err "
        "together with their neighbours, blue ones against them; full colour at "
        f"±{peak:.2g}."
    )
    return Gallery("covariance", "Covariance maps", about, pictures, layer=True)
