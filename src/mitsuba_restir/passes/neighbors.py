"""Which pixels a pixel may reuse: uniformly random neighbours in a disk."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..sampling.streams import Stream, uniform2


def disk_neighbor(
    choices: Stream, index: Any, pixel: Any, size: tuple[Any, Any], radius: float
) -> tuple[Any, Any]:
    """A neighbour drawn uniformly from a disk around each pixel.

    Parameters
    ----------
    choices : Stream
        The pass's own stream.
    index : UInt32
        Number of the neighbour.
    pixel : UInt32
        Row-major pixel index.
    size : (UInt32, UInt32)
        Width and height.
    radius : float
        Radius of the disk [pixels].

    Returns
    -------
    other : UInt32
        Row-major index of the neighbour.
    inside : Bool
        Whether it lies in the image and is another pixel.
    """
    width, height = size
    y = pixel // width
    x = pixel - y * width
    offset = radius * mi.warp.square_to_uniform_disk(mi.Point2f(*uniform2(choices, index, 1)))
    nx = mi.Int32(x) + mi.Int32(dr.round(offset.x))
    ny = mi.Int32(y) + mi.Int32(dr.round(offset.y))
    inside = (nx >= 0) & (ny >= 0) & (nx < mi.Int32(width)) & (ny < mi.Int32(height))
    other = mi.UInt32(ny * mi.Int32(width) + nx)
    return dr.select(inside, other, pixel), inside & (other != pixel)
