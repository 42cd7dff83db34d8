"""A path carried over an edit of the scene: from the scene before it to the scene after, or back.

Its reconnection vertex goes along with its shape, what follows is traced again with the path's own
numbers, and the whole is shifted to a pixel of the other frame. The map is one to one between the
path spaces of the two scenes, so that each scene's target function can be asked of the other
scene's paths: none has to have been possible in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.moves import Moves, move_of
from ..paths.primary_hit import PrimaryHit
from ..paths.record import Continuation, Kind, PathRecord, kind_of, next_kind_of
from ..paths.scattering import evaluate
from ..paths.vertex import Stored, connected, displaced, exists, sight
from .hybrid import Shifted, shift
from .mapping import Outcome
from .scope import Scope
from .suffix import retrace_suffix


@dataclass
class Source:
    """Paths of the other scene.

    Fields: ``path``, ``kept_pdf`` (see :func:`kept_pdf`), ``active``.
    """

    path: PathRecord
    kept_pdf: mi.Float
    active: mi.Bool


@dataclass
class Carried:
    """A path in the scene as it is now.

    Fields: ``path`` (its record, but for the factor), ``shifted``.
    """

    path: PathRecord
    shifted: Shifted


def kept_pdf(scope: Scope, path: PathRecord, hit: PrimaryHit, active: mi.Bool) -> mi.Float:
    """Density [1/sr] with which x_{k+1} scatters into the direction that a record has kept.

    It is 1 where none is kept, and has to be asked for while the path's own scene is in place.
    """
    following = path.next
    if not isinstance(following, Continuation):
        return mi.Float(1)
    after = next_kind_of(path)
    keeps = active & (kind_of(path) == Kind.FAR) & ((after == Kind.FAR) | (after == Kind.HIT))
    lambdas, _ = scope.wavelengths(scope.stream(path.name))
    si_k = sight(path.vertex, lambda _: hit.vertex.p, lambdas, keeps).si
    si = connected(si_k, following.vertex, keeps)[0].si
    _, pdf = evaluate(si, si.bsdf(), following.wo, keeps)
    return dr.select(keeps, pdf, 1)


def carried_forth(scope: Scope, source: Source, hit: PrimaryHit, moves: Moves) -> Carried:
    """Paths of the scene before, in the scene after, at the primary hits of the new frame."""
    move = move_of(moves, source.path.vertex)
    placed = exists(source.path.vertex)
    vertex = dr.select(placed, displaced(source.path.vertex, move.forth), source.path.vertex)
    return _carried(scope, source, hit, vertex, ~(placed & move.lost))


def carried_back(scope: Scope, source: Source, hit: PrimaryHit, moves: Moves) -> Carried:
    """Paths of the scene after, in the scene before, at the primary hits of the old frame."""
    move = move_of(moves, source.path.vertex)
    placed = exists(source.path.vertex)
    vertex = dr.select(placed, displaced(source.path.vertex, move.back), source.path.vertex)
    return _carried(scope, source, hit, vertex, ~(placed & move.lost))


def _carried(
    scope: Scope, source: Source, hit: PrimaryHit, vertex: Stored, followed: mi.Bool
) -> Carried:
    active = source.active & followed
    there = replace(source.path, vertex=vertex)
    suffix = retrace_suffix(scope, there, hit, active)
    shifted = shift(scope, suffix.path, hit, active)
    jacobian = shifted.jacobian * suffix.kept_pdf / source.kept_pdf
    # Both directions are refused alike, so nothing is lost on one side only.
    sound = (jacobian > 1e-30) & (jacobian < 1e30)
    refused = (shifted.outcome == Outcome.OK) & ~sound
    shifted.outcome = dr.select(refused, Outcome.UNCONNECTABLE, shifted.outcome)
    shifted.color = dr.select(refused, 0, shifted.color)
    shifted.jacobian = dr.select(sound, jacobian, 1)
    return Carried(suffix.path, shifted)
