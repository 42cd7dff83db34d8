"""From a frame's pixels to the developed film."""

from __future__ import annotations

from collections.abc import Sequence

import mitsuba as mi

from ..paths.grid import grid_of
from .frame_data import Frame


def developed(film: mi.Film, names: Sequence[str], frame: Frame) -> mi.TensorXf:
    """The film with every pixel's colour and auxiliary channels at its centre.

    Parameters
    ----------
    names : sequence of str
        Of the auxiliary channels.

    Returns
    -------
    TensorXf
        Shape (height, width, channels).
    """
    film.prepare(list(names))
    block = film.create_block()
    block.set_coalesce(False)
    grid = grid_of(*film.crop_size())
    x, y = grid.place(grid.pixels())
    center = mi.Point2f(x, y) + 0.5 + mi.Vector2f(film.crop_offset())
    alpha = [frame.beside.alpha] if mi.has_flag(film.flags(), mi.FilmFlags.Alpha) else []
    block.put(center, [*frame.color, *alpha, mi.Float(1), *frame.auxiliary])
    film.put_block(block)
    return film.develop()
