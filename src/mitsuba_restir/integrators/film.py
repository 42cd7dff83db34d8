"""From a frame's pixels to the developed film."""

from __future__ import annotations

from collections.abc import Sequence

import mitsuba as mi

from ..paths.grid import grid_of
from .frame_data import Frame


def settle(sensor: mi.Sensor, names: Sequence[str]) -> None:
    """Empty the film, and seed the sampler as ``mi.render`` leaves it.

    The scene holds both. Were they not the same before every frame, the stages of the second frame
    would be recorded anew.

    Parameters
    ----------
    names : sequence of str
        Of the film's auxiliary channels.
    """
    sensor.film().prepare(list(names))
    sensor.sampler().seed(0, 1)


def developed(film: mi.Film, frame: Frame) -> mi.TensorXf:
    """The prepared film with every pixel's colour and auxiliary channels at its centre.

    Returns
    -------
    TensorXf
        Shape (height, width, channels).
    """
    block = film.create_block()
    block.set_coalesce(False)
    grid = grid_of(*film.crop_size())
    x, y = grid.place(grid.pixels())
    center = mi.Point2f(x, y) + 0.5 + mi.Vector2f(film.crop_offset())
    alpha = [frame.beside.alpha] if mi.has_flag(film.flags(), mi.FilmFlags.Alpha) else []
    block.put(center, [*frame.color, *alpha, mi.Float(1), *frame.auxiliary])
    film.put_block(block)
    return film.develop()
