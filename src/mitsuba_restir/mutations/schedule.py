"""Mutations of the n-th part of the pixels: each frame another set, all of them within n frames.

Which pixels have their turn depends on the frame's number alone. To decide it by what the
reservoirs hold, such as how often a path is duplicated, would be biased.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.grid import BAND, Grid
from ..paths.primary_hit import PrimaryHit
from ..resampling.reservoir import Reservoir
from ..shifts.scope import Scope
from .chain import Mutated, metropolis_hastings, run_chain
from .kind import Mutation, MutationPlan
from .pivot import MutationClass


def stride(interval: int) -> int:
    """The s that spreads the points with x + s y = 0 mod ``interval`` most evenly over the plane.

    It maximises the distance of the closest two of them (a good lattice), found by trying all.
    """

    def closest(s: int) -> int:
        rows = range(1, interval + 1)
        steps = [((-s * y) % interval, y) for y in rows]
        return min(interval**2, *(min(x, interval - x) ** 2 + y**2 for x, y in steps))

    return max(range(interval), key=closest)


def pixels_of_set(grid: Grid, interval: int, turn: mi.UInt32) -> tuple[mi.UInt32, mi.Bool]:
    """The pixels whose turn it is: blocks (x, y) with y + s x + turn = 0 mod ``interval``.

    A block's pixels have their turn together, since they are stored together: what is not mutated
    is not read either.

    Parameters
    ----------
    turn : UInt32
        Number of the frame.

    Returns
    -------
    pixel : UInt32
        Indices in the grid; the number of lanes does not depend on the turn.
    inside : Bool
        Lanes that have a pixel; all, where the interval divides the number of bands.
    """
    bands = -(-grid.rows // (BAND * interval))
    group, within = grid.band.divmod(dr.arange(mi.UInt32, BAND * grid.columns * bands))
    x = within // BAND
    across = stride(interval) * (x // BAND)
    first = interval - 1 - (across + turn + (interval - 1)) % interval
    y = (group * interval + first) * BAND + within % BAND
    return grid.index(x, y), y < grid.height


def mutate_in_turns(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    plan: MutationPlan,
    turn: mi.UInt32,
) -> tuple[Reservoir, Mutated]:
    """Mutate the paths of the pixels whose turn it is, and leave the others alone.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    turn : UInt32
        Number of the frame.

    Returns
    -------
    reservoirs : Reservoir
        One lane per pixel.
    mutated : Mutated
        One lane per pixel of the set; ``kind`` is the number of classes in a lane without pixel.
    """
    if plan.interval == 1:
        pixels = scope.grid.pixels()
        return run_chain(scope, reservoirs, hits, pixels, plan, metropolis_hastings)
    pixel, inside = pixels_of_set(scope.grid, plan.interval, turn)
    own = dr.gather(Reservoir, reservoirs, pixel, inside)
    there = hits.at(pixel, inside)
    after, mutated = run_chain(scope, own, there, pixel, plan, metropolis_hastings)
    mutated.kind = dr.select(inside, mutated.kind, len(MutationClass.names()))
    result = dr.copy(_changed(reservoirs, plan.kind))
    dr.scatter(result, _changed(after, plan.kind), pixel, inside & (mutated.accepted > 0))
    path, own_fields = result
    moved = replace(reservoirs, path=replace(reservoirs.path, **path), **own_fields)
    return moved, mutated


def _changed(reservoirs: Reservoir, mutation: Mutation) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a mutation may change of paths, and of their reservoirs."""
    path = {name: getattr(reservoirs.path, name) for name in mutation.changes}
    return path, {"color": reservoirs.color, "weight": reservoirs.weight}
