"""Sums over frames in constant memory: the mean, its variance, and what weights are made of.

All is on the device, one lane per pixel. The mean of values x and the products of their deviations
are updated frame by frame (Welford 1962): d = x - m, m' = m + d / n, S' = S + d (x - m').
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
Size = tuple[int, int]


@dataclass(frozen=True)
class Layout:
    """
    Where a frame's channels are in a film.

    Attributes
    ----------
    channels : int
        How many the film has.
    estimates : tuple of three int each
        Red, green and blue of each estimate of the picture; the frame's own colour is the last.
    extra : tuple of int
        Channels of which only the mean is wanted.
    """

    channels: int
    estimates: tuple[tuple[int, int, int], ...]
    extra: tuple[int, ...]

    @property
    def mixed(self) -> int:
        """How many estimates are mixed; 0 where there is only one."""
        return len(self.estimates) if len(self.estimates) > 1 else 0


@dataclass
class Moments:
    """Fields: ``mean`` of some values, ``products`` of the deviations of some pairs of them."""

    mean: list[mi.Float]
    products: list[mi.Float]


@dataclass
class Sums:
    """What frames add up to.

    Fields: ``picture`` (red, green and blue, each paired with itself), ``estimates`` (luminances of
    the estimates that are mixed, in all pairs), ``extra`` (means).
    """

    picture: Moments
    estimates: Moments
    extra: list[mi.Float]


def pairs(count: int) -> list[tuple[int, int]]:
    """All pairs of some estimates, each once, with themselves as well."""
    return [(i, j) for i in range(count) for j in range(i, count)]


def nothing(layout: Layout, size: Size) -> Sums:
    """The sums before the first frame; the size is height and width [pixels]."""

    def zeros(count: int) -> list[mi.Float]:
        return [dr.zeros(mi.Float, size[0] * size[1]) for _ in range(count)]

    mixed = layout.mixed
    sums = Sums(
        Moments(zeros(3), zeros(3)),
        Moments(zeros(mixed), zeros(len(pairs(mixed)))),
        zeros(len(layout.extra)),
    )
    dr.make_opaque(sums)
    return sums


def own_colour(layout: Layout, size: Size) -> list[mi.Float]:
    """Weights before anything is known: all on the frame's own colour."""
    lanes, mixed = size[0] * size[1], layout.mixed
    return [dr.opaque(mi.Float, float(k == mixed - 1), lanes) for k in range(mixed)]


def add(
    layout: Layout, sums: Sums, weights: list[mi.Float], image: mi.Float, frames: mi.Float
) -> Sums:
    """
    The sums with one more frame.

    Parameters
    ----------
    weights : list of Float
        Of the estimates, by earlier frames than this one, or the mean would be biased; empty where
        nothing is mixed.
    image : Float
        The frame's film, its channels interleaved.
    frames : Float
        How many frames there are with this one.
    """
    estimates = estimates_of(layout, image)
    color = mixed(weights, estimates)
    luminances = [mi.luminance(estimate) for estimate in estimates[: layout.mixed]]
    result = Sums(
        _updated(sums.picture, list(color), [(i, i) for i in range(3)], frames),
        _updated(sums.estimates, luminances, pairs(layout.mixed), frames),
        [
            mean + (extra - mean) / frames
            for mean, extra in zip(sums.extra, _channels(layout, image, layout.extra), strict=True)
        ],
    )
    dr.eval(result)
    return result


def _channels(layout: Layout, image: mi.Float, places: Sequence[int]) -> list[mi.Float]:
    lane = dr.arange(mi.UInt32, dr.width(image) // layout.channels)
    return [dr.gather(mi.Float, image, lane * layout.channels + place) for place in places]


def estimates_of(layout: Layout, image: mi.Float) -> list[mi.Color3f]:
    """A frame's estimates of the picture, of its film."""
    return [mi.Color3f(*_channels(layout, image, place)) for place in layout.estimates]


def mixed(weights: list[mi.Float], estimates: list[mi.Color3f]) -> mi.Color3f:
    """The mixture of a frame's estimates; the last of them where nothing is mixed."""
    if not weights:
        return estimates[-1]
    color = mi.Color3f(0)
    for weight, estimate in zip(weights, estimates, strict=True):
        color = color + weight * estimate
    return color


def _updated(
    moments: Moments, values: list[mi.Float], which: list[tuple[int, int]], frames: mi.Float
) -> Moments:
    steps = [value - mean for value, mean in zip(values, moments.mean, strict=True)]
    means = [mean + step / frames for mean, step in zip(moments.mean, steps, strict=True)]
    products = [
        product + steps[i] * (values[j] - means[j])
        for product, (i, j) in zip(moments.products, which, strict=True)
    ]
    return Moments(means, products)


def image_of(channels: list[mi.Float], size: Size) -> Array:
    """Channels as one image, (H, W, C)."""
    return np.stack([np.array(channel).reshape(size) for channel in channels], axis=-1)


def standard_error(sums: Sums, size: Size, frames: int) -> Array:
    """The standard error of the picture's mean, (H, W, 3); infinite where it is of one frame."""
    if frames < 2:
        return np.full((*size, 3), np.inf, dtype=np.float32)
    squares = image_of(sums.picture.products, size)
    return np.sqrt(squares / (float(frames) * (frames - 1.0)), dtype=np.float32)


def covariance(sums: Sums, size: Size, frames: int) -> npt.NDArray[np.float64]:
    """The unbiased sample covariance of one frame's estimates, (K, K, H, W)."""
    count = len(sums.estimates.mean)
    result = np.empty((count, count, *size))
    for (i, j), product in zip(pairs(count), sums.estimates.products, strict=True):
        result[i, j] = result[j, i] = np.array(product).reshape(size) / (frames - 1.0)
    return result
