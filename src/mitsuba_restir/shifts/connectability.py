"""Where a path may be reconnected: the first vertex pair that passes a lobe-free test.

A pair (x_{k-1}, x_k) is tested in two steps, because the direction leaving x_k is not known on
arrival: :meth:`.mapping.ShiftMapping.link` says whether x_k can be reached, and up to which pdf of
the outgoing direction it may be the reconnection vertex. Both steps depend on the path alone, so
that a shift is invertible if and only if they are evaluated again on the shifted path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi

from ..paths.scattering import Scattered


@dataclass
class Departure:
    """How a path left its last vertex ``p``: ``pdf``, ``delta``, ``cos`` to the face normal.

    ``limit`` is the largest pdf for which that vertex counts as rough.
    """

    p: mi.Point3f
    pdf: mi.Float
    delta: mi.Bool
    cos: mi.Float
    limit: mi.Float


@dataclass
class Link:
    """The pair (x_{k-1}, x_k) on arrival at x_k.

    ``reaches``: x_k may be the reconnection vertex if it is a light. ``limit``: it may be one if
    the pdf of the direction that leaves it is at most this (negative: never). ``area_pdf`` is
    p_{k-1} G(x_{k-1} -> x_k), the density of x_k by area, or p_{k-1} alone for the environment.
    """

    reaches: mi.Bool
    limit: mi.Float
    area_pdf: mi.Float


class Criterion(Protocol):
    """What a connectability criterion must answer."""

    def vertex_limit(
        self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: mi.Bool
    ) -> mi.Float:
        """Largest pdf [1/sr] of an outgoing direction for which the vertex counts as rough."""

    def is_far(
        self, distance2: mi.Float, start: Departure, cos_end: mi.Float, footprint: mi.Float
    ) -> mi.Bool:
        """Lanes whose vertices are far enough apart for x_k to be the end of the path."""

    def leaving_limit(
        self, distance2: mi.Float, start: Departure, footprint: mi.Float, end_limit: mi.Float
    ) -> mi.Float:
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

    def vertex_limit(
        self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: mi.Bool
    ) -> mi.Float:
        """See :class:`Criterion`."""
        return mi.Float(1 / self.alpha**2)

    def is_far(
        self, distance2: mi.Float, start: Departure, cos_end: mi.Float, footprint: mi.Float
    ) -> mi.Bool:
        """See :class:`Criterion`."""
        return distance2 >= self.tau * footprint * start.pdf * cos_end

    def leaving_limit(
        self, distance2: mi.Float, start: Departure, footprint: mi.Float, end_limit: mi.Float
    ) -> mi.Float:
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

    def vertex_limit(
        self, si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, active: mi.Bool
    ) -> mi.Float:
        """See :class:`Criterion`."""
        has_alpha = active & bsdf.has_attribute("alpha", active)
        has_roughness = active & bsdf.has_attribute("roughness", active)
        alpha = bsdf.eval_attribute_1("alpha", si, has_alpha)
        roughness = bsdf.eval_attribute_1("roughness", si, has_roughness)
        alpha = dr.select(has_alpha, alpha, dr.square(roughness))
        by_attribute = dr.select(alpha > self.alpha, dr.inf, -1.0)
        return dr.select(has_alpha | has_roughness, by_attribute, 1 / self.alpha**2)

    def is_far(
        self, distance2: mi.Float, start: Departure, cos_end: mi.Float, footprint: mi.Float
    ) -> mi.Bool:
        """See :class:`Criterion`."""
        return distance2 >= self.distance**2

    def leaving_limit(
        self, distance2: mi.Float, start: Departure, footprint: mi.Float, end_limit: mi.Float
    ) -> mi.Float:
        """See :class:`Criterion`."""
        return end_limit


def pixel_footprint(origin: mi.Point3f, si: mi.SurfaceInteraction3f) -> mi.Float:
    """Footprint 4 pi |x_0 - x_1|^2 / |cos theta_1| that the criterion measures others against."""
    to_eye = origin - si.p
    distance2 = dr.squared_norm(to_eye)
    cosine = dr.abs(dr.dot(si.n, to_eye)) * dr.rsqrt(distance2)
    return 4 * dr.pi * distance2 / cosine


def depart(
    si: mi.SurfaceInteraction3f,
    direction: mi.Vector3f,
    pdf: mi.Float,
    delta: mi.Bool,
    limit: mi.Float,
) -> Departure:
    """The departure from ``si`` along a world-space ``direction``."""
    return Departure(mi.Point3f(si.p), pdf, delta, dr.abs(dr.dot(si.n, direction)), limit)


def depart_scattered(si: mi.SurfaceInteraction3f, bounce: Scattered, limit: mi.Float) -> Departure:
    """The departure of a sampled bounce."""
    return depart(si, bounce.wo, bounce.pdf, bounce.delta, limit)
