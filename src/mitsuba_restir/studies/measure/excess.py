"""Large-scale error over the least that a history of the same candidates could have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...analysis.intervals import Interval, Jackknife
from ...analysis.reuse import Reuse, reach
from ...integrators.parameters import Parameters, resolve
from ...passes.temporal import YOUNG
from ..config.study import Study, Variant
from .frame_errors import BLOTCHES, SIGMA, frames_of, relative_errors
from .results import Measured, Number, Refused, Row, Sharing
from .rows import make_row, reference_of, row_of_jackknife

SIGMAS = (SIGMA, *BLOTCHES)
"""Of the Gaussians through which errors are seen, in pixels."""

TRIM = 0.1
"""Share of every frame's pixels, those that err most, that the trimmed values leave out."""

NUMBERS = [
    number
    for sigma in SIGMAS
    for number in (
        Number(f"variance through {sigma:g} px"),
        Number(f"variance through {sigma:g} px, trimmed"),
        Number(f"excess, {sigma:g} px", chart=sigma == max(SIGMAS)),
        Number(f"excess, {sigma:g} px, trimmed", heading=f"Excess, {sigma:g} px", chart=True),
        Number(f"reach at {sigma:g} px", "px", better=""),
    )
] + [Number("effective frames", better="more")]
"""What `excesses` gives."""

_OF_CANDIDATES = (
    "max_depth",
    "rr_depth",
    "roulette",
    "hide_emitters",
    "guiding",
    "blue_noise_seeds",
)


def shows_candidates(variant: Variant) -> bool:
    """Whether the frames of a variant are candidates alone, in any parameters."""
    given = variant.parameters
    alone = given.get("temporal") is False and given.get("spatial") is False
    return variant.type == "path" or (variant.type == "restir_pt" and alone)


def sharing_of(study: Study) -> dict[str, Sharing]:
    """Say how each variant of a study shares paths, and which one shows its candidates alone."""
    known = {
        name: _parameters(study, variant)
        for name, variant in study.variants.items()
        if variant.type in ("path", "restir_pt")
    }
    alone = {
        _candidates(found): name
        for name, found in reversed(known.items())
        if shows_candidates(study.variants[name])
    }
    return {
        name: Sharing(
            Reuse()
            if shows_candidates(study.variants[name])
            else Reuse(
                _history(study) if found.temporal else 1,
                found.confidence_cap,
                found.spatial_neighbors,
                found.radii,
                found.spatial_feedback,
                YOUNG,
            ),
            study.variants[name].spp,
            alone.get(_candidates(found), ""),
        )
        for name, found in known.items()
    }


def _parameters(study: Study, variant: Variant) -> Parameters:
    own = variant.type == "restir_pt"
    names = variant.parameters if own else set(_OF_CANDIDATES) & set(variant.parameters)
    given = {name: variant.parameters[name] for name in names}
    return resolve({"max_depth": study.max_depth, **given})


def _candidates(parameters: Parameters) -> tuple[object, ...]:
    return tuple(getattr(parameters, name) for name in _OF_CANDIDATES)


def _history(study: Study) -> int:
    """Frames of history behind those that are measured, in the mean."""
    kept = study.keep == "all" and study.warmup > 0
    first = study.warmup + 1 if kept else study.length
    return round((first + study.length) / 2)


Runs = npt.NDArray[np.float64]
"""Relative errors of the frames of every run of a variant, (K, F, H, W)."""


@dataclass(frozen=True)
class _Variance:
    """Variance between runs of what is seen through a Gaussian: of all pixels, and trimmed."""

    whole: Jackknife
    trimmed: Jackknife

    def over(self, floor: _Variance, factor: float) -> _Variance:
        """Return the ratio to another variance that counts `factor` times."""
        return _Variance(
            _ratio(self.whole, floor.whole, factor), _ratio(self.trimmed, floor.trimmed, factor)
        )


def _ratio(own: Jackknife, floor: Jackknife, factor: float) -> Jackknife:
    return Jackknife(own.value / (factor * floor.value), own.left_out / (factor * floor.left_out))


def excesses(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Variance of the relative error seen through Gaussians, and that over its floor.

    The floor is the variance of candidates alone, divided by the effective frames of a history and
    seen through a Gaussian as wide as reuse spreads them (`analysis.reuse.reach`). It is a variance
    over runs that stands in both, so nothing of the reference's own error does. Variants whose
    candidates are not there have their variances alone.
    """
    named = {number.name: number for number in numbers}
    cached = _Cache(data)
    found: dict[tuple[str, str], Jackknife] = {}
    for name, sharing in data.sharing.items():
        if len(data.runs.get(name, ())) < 2:
            continue
        seen = {sigma: cached.variance(name, sigma) for sigma in SIGMAS}
        for sigma, own in seen.items():
            found[name, f"variance through {sigma:g} px"] = own.whole
            found[name, f"variance through {sigma:g} px, trimmed"] = own.trimmed
        if lack := _lack(data, name, sharing):
            yield Refused(f"excess at {data.size} is not given for '{name}': {lack}")
            continue
        for sigma, own in seen.items():
            reached = reach(sharing.reuse, _shape(data), sigma)
            floor = cached.variance(sharing.candidates, reached.sigma)
            if not (floor.whole.is_positive and floor.trimmed.is_positive):
                yield Refused(
                    f"excess at {data.size} is not given for '{name}': its candidates have no error"
                )
                break
            share = data.sharing[sharing.candidates].trees / (sharing.trees * reached.frames)
            above = own.over(floor, share)
            found[name, f"excess, {sigma:g} px"] = above.whole
            found[name, f"excess, {sigma:g} px, trimmed"] = above.trimmed
            yield make_row(data, name, named[f"reach at {sigma:g} px"], _exact(reached.sigma))
        else:
            frames = sharing.trees * reached.frames
            yield make_row(data, name, named["effective frames"], _exact(frames))
    for (name, title), own_value in found.items():
        base = found.get((data.partner(name) or "", title))
        yield row_of_jackknife(data, name, named[title], own_value, base)


def _lack(data: Measured, name: str, sharing: Sharing) -> str:
    """Say what its floor lacks; empty where nothing."""
    if not sharing.candidates:
        return (
            "no variant shows its candidates alone (temporal = false, spatial = false, and the "
            "same depths, roulette and guiding)"
        )
    own, others = len(data.runs[name]), len(data.runs.get(sharing.candidates, ()))
    if own != others:
        return f"it has {own} finished runs, and '{sharing.candidates}' has {others}"
    return ""


class _Cache:
    """Errors of the variants that others are compared with, and their variances."""

    def __init__(self, data: Measured) -> None:
        self._data = data
        self._floors = {sharing.candidates for sharing in data.sharing.values()}
        self._errors: dict[str, Runs] = {}
        self._variances: dict[tuple[str, float], _Variance] = {}

    def variance(self, name: str, sigma: float) -> _Variance:
        """Return the variance of a variant through a Gaussian of so many pixels."""
        key = name, round(sigma, 3)
        if key not in self._variances:
            self._variances[key] = variance_through(self._of(name), sigma)
        return self._variances[key]

    def _of(self, name: str) -> Runs:
        if name in self._errors:
            return self._errors[name]
        # Of the others one at a time: frames are large.
        self._errors = {kept: own for kept, own in self._errors.items() if kept in self._floors}
        reference = reference_of(self._data)
        self._errors[name] = np.stack(
            [
                relative_errors(frames_of(self._data, run), reference, None)
                for run in self._data.runs[name]
            ]
        )
        return self._errors[name]


def variance_through(errors: Runs, sigma: float) -> _Variance:
    """Variance over runs, mean over frames and pixels, through a Gaussian of so many pixels."""
    view = ndimage.gaussian_filter(errors, (0.0, 0.0, sigma, sigma), mode="reflect")
    everyone = np.arange(len(view))
    values = [_moments(view)] + [_moments(np.delete(view, k, axis=0)) for k in everyone]
    whole, trimmed = np.array(values).T
    return _Variance(Jackknife(whole[0], whole[1:]), Jackknife(trimmed[0], trimmed[1:]))


def _moments(view: Runs) -> tuple[float, float]:
    """Return the mean of all squares, and that of all but the largest of every frame."""
    squares = (view - view.mean(axis=0)) ** 2 * (len(view) / max(len(view) - 1, 1))
    pixels = squares.reshape(-1, squares.shape[2] * squares.shape[3])
    kept = pixels.shape[1] - int(TRIM * pixels.shape[1])
    calm = np.partition(pixels, kept - 1, axis=1)[:, :kept]
    return float(pixels.mean()), float(calm.mean())


def _exact(value: float) -> Interval:
    return Interval(value, value, value, 0.0)


def _shape(data: Measured) -> tuple[int, int]:
    height, width = reference_of(data).image.shape[:2]
    return height, width
