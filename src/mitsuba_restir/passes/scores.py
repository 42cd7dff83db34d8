"""Neighbours picked by a score of the G-buffer (compatibility-guided neighbour selection, CGNS).

Junkins et al. 2026: candidates y on a disk around x are scored by

    h = exp(-|x - y| / s) max(n_x . n_y, 0)^beta,    s = sqrt(Omega / pi) |x - camera|,

and picked by weighted reservoir sampling. Every pick is reused without bias, so the choice may
favour whom it likes, as long as it does not look at the paths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import exists
from ..sampling.streams import Stream, path_stream, uniform, uniform2

CANDIDATES = 32
"""Candidates of a pixel, shared out among its neighbours."""

SOLID_ANGLE = 0.05
"""Omega [sr], which sets the length over which compatibility fades."""

NORMAL_EXPONENT = 8
"""beta."""


@dataclass
class Disk:
    """Where candidates come from: a disk of ``radius`` (float) pixels."""

    radius: float


@dr.syntax
def pick_by_score(
    disk: Disk,
    hits: PrimaryHit,
    size: tuple[Any, Any],
    index: Any,
    neighbors: int,
    choices: Stream,
) -> tuple[Any, Any]:
    """Pick every pixel's ``index``-th neighbour among its share of the candidates.

    Parameters
    ----------
    size : (UInt32, UInt32)
        Width and height of the image.
    choices : Stream
        Of the round.

    Returns
    -------
    other : UInt32
        Row-major index of the neighbour (the pixel itself where there is none).
    found : Bool
        Whether there is one.
    """
    width, height = mi.Int32(size[0]), mi.Int32(size[1])
    pixel = dr.arange(mi.UInt32, dr.width(hits.vertex.p))
    y = mi.Int32(pixel // size[0])
    x = mi.Int32(pixel) - y * width
    random = path_stream(pixel, choices.x + index, choices.y)
    reach = dr.norm(hits.vertex.p - hits.origin) * (SOLID_ANGLE / dr.pi) ** 0.5
    other = mi.UInt32(pixel)
    total = mi.Float(0)
    share = -(-CANDIDATES // neighbors)
    i = mi.UInt32(0)

    while dr.hint(i < share, label="Scores"):
        u, angle = uniform2(random, i, 0)
        sin, cos = dr.sincos(dr.two_pi * angle)
        length = disk.radius * dr.sqrt(u)
        nx, ny = x + mi.Int32(dr.round(length * cos)), y + mi.Int32(dr.round(length * sin))
        inside = (nx >= 0) & (ny >= 0) & (nx < width) & (ny < height)
        candidate = dr.select(inside, mi.UInt32(ny * width + nx), pixel)
        there = dr.gather(PrimaryHit, hits, candidate)
        distance = dr.norm(there.vertex.p - hits.vertex.p)
        alike = dr.maximum(dr.dot(there.normal, hits.normal), 0) ** NORMAL_EXPONENT
        score = dr.exp(-distance / reach) * alike
        score = dr.select((candidate != pixel) & exists(there.vertex), score, 0)
        total += score
        take = (score > 0) & (uniform(random, i, 1) * total < score)
        other = dr.select(take, candidate, other)
        i += 1
    return other, exists(hits.vertex) & (total > 0)
