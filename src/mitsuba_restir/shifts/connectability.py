"""Where a path may be reconnected: the first vertex pair that passes a lobe-free test.

A pair (x_{k-1}, x_k) is tested in two steps, because the direction leaving x_k is not known on
arrival: :func:`Criterion.link` says whether x_k can be reached, and up to which pdf of the outgoing
direction it may be the reconnection vertex. Both steps depend on the path alone, so that a shift is
invertible if and only if they are evaluated again on the shifted path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi

from ..paths.scattering import Scattered


@dataclass
class Departure:
    """How a path left its last vertex: point ``p``, ``pdf``, ``delta``, ``cos`` to the face normal.

    ``limit`` is the largest pdf for which that vertex counts as rough.
    """

    p: Any
    pdf: Any
    delta: Any
    cos: Any
    limit: Any


@dataclass
class Link:
    """The pair (x_{k-1}, x_k) on arrival at x_k.

    ``reaches``: x_k may be the reconnection vertex if it is a light. ``limit``: it may be one if
    the pdf of the direction that leaves it is at most this (negative: never). ``jacobian`` is
    p_{k-1} G(x_{k-1} -> x_k), or p_{k-1} alone for the environment.
    """

    reaches: Any
    limit: Any
    jacobian: Any


class Criterion(Protocol):
    """What a connectability criterion must answer."""

    def vertex_limit(self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: Any) -> Any:
        """Largest pdf [1/sr] of an outgoing direction for which the vertex counts as rough."""

    def is_far(self, distance2: Any, start: Departure, cos_end: Any, footprint: Any) -> Any:
        """Lanes whose vertices are far enough apart for x_k to be the end of the path."""

    def leaving_limit(
        self, distance2: Any, start: Departure, footprint: Any, end_limit: Any
    ) -> Any:
        """Largest pdf of the direction leaving x_k for which x_k may be reconnected to."""


@dataclass(frozen=True)
class Footprint:
    """Two-sided footprint test (Lin, Kettunen and Wyman 2026), on pdfs of the whole BSDF.

    The path footprint d^2/(p cos) at either end of the pair must be at least ``tau`` times that of
    the pixel, 4 pi d_1^2 / cos_1, and the direction leaving x_{k-1} must not be sharper than a lobe
    of roughness ``alpha``: p <= 1/alpha^2.
    """

    tau: float = 2e-4
    alpha: float = 0.2

    def vertex_limit(self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: Any) -> Any:
        """See :class:`Criterion`."""
        return mi.Float(1 / self.alpha**2)

    def is_far(self, distance2: Any, start: Departure, cos_end: Any, footprint: Any) -> Any:
        """See :class:`Criterion`."""
        return distance2 >= self.tau * footprint * start.pdf * cos_end

    def leaving_limit(
        self, distance2: Any, start: Departure, footprint: Any, end_limit: Any
    ) -> Any:
        """See :class:`Criterion`."""
        return distance2 / (self.tau * footprint * start.cos)


@dataclass(frozen=True)
class DistanceRoughness:
    """Distance and roughness thresholds (Lin et al. 2022).

    The vertices must be ``distance`` apart [scene units] and both rough: the BSDF attribute
    ``alpha`` (or the square of ``roughness``) above ``alpha``, and for a BSDF that has neither, the
    direction's pdf at most 1/``alpha``^2.
    """

    distance: float
    alpha: float = 0.2

    def vertex_limit(self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: Any) -> Any:
        """See :class:`Criterion`."""
        has_alpha = active & bsdf.has_attribute("alpha", active)
        has_roughness = active & bsdf.has_attribute("roughness", active)
        alpha = bsdf.eval_attribute_1("alpha", si, has_alpha)
        roughness = bsdf.eval_attribute_1("roughness", si, has_roughness)
        alpha = dr.select(has_alpha, alpha, dr.square(roughness))
        by_attribute = dr.select(alpha > self.alpha, dr.inf, -1.0)
        return dr.select(has_alpha | has_roughness, by_attribute, 1 / self.alpha**2)

    def is_far(self, distance2: Any, start: Departure, cos_end: Any, footprint: Any) -> Any:
        """See :class:`Criterion`."""
        return distance2 >= self.distance**2

    def leaving_limit(
        self, distance2: Any, start: Departure, footprint: Any, end_limit: Any
    ) -> Any:
        """See :class:`Criterion`."""
        return end_limit


def pixel_footprint(origin: Any, si: mi.SurfaceInteraction3f) -> Any:
    """Footprint 4 pi |x_0 - x_1|^2 / |cos theta_1| that the criterion measures others against."""
    to_eye = origin - si.p
    distance2 = dr.squared_norm(to_eye)
    cosine = dr.abs(dr.dot(si.n, to_eye)) * dr.rsqrt(distance2)
    return 4 * dr.pi * distance2 / cosine


def depart(
    si: mi.SurfaceInteraction3f, direction: Any, pdf: Any, delta: Any, limit: Any
) -> Departure:
    """The departure from ``si`` along a world-space ``direction``."""
    return Departure(mi.Point3f(si.p), pdf, delta, dr.abs(dr.dot(si.n, direction)), limit)


def depart_scattered(si: mi.SurfaceInteraction3f, bounce: Scattered, limit: Any) -> Departure:
    """The departure of a sampled bounce."""
    return depart(si, bounce.wo, bounce.pdf, bounce.delta, limit)


def link(
    criterion: Criterion,
    start: Departure,
    si: mi.SurfaceInteraction3f,
    end_limit: Any,
    index: Any,
    last_index: int | None,
    footprint: Any,
) -> Link:
    """Test the pair that ends at ``si``, the path's ``index``-th vertex.

    Parameters
    ----------
    start : Departure
        How the path left x_{k-1}.
    end_limit : Float
        The criterion's ``vertex_limit`` at ``si``.
    last_index : int or None
        Largest index that may be a reconnection vertex (None: any), which makes the pure
        reconnection shift (2) and pure random replay (0) special cases of the hybrid shift.
    footprint : Float
        The pixel's :func:`pixel_footprint`.
    """
    valid = si.is_valid()
    span = si.p - start.p
    distance2 = dr.squared_norm(span)
    cos_end = dr.abs(dr.dot(si.n, span)) * dr.rsqrt(distance2)
    rough = ~start.delta & (start.pdf <= start.limit) & (start.pdf > 0)
    if last_index is not None:
        rough &= index <= last_index
    jacobian = start.pdf * dr.select(valid, cos_end / distance2, 1.0)
    far = ~valid | criterion.is_far(distance2, start, cos_end, footprint)
    reaches = rough & far & (jacobian > 0)
    limit = criterion.leaving_limit(distance2, start, footprint, end_limit)
    return Link(reaches, dr.select(reaches & valid, limit, -1.0), jacobian)
