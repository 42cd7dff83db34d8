"""From plain geometry to Mitsuba meshes: the only file that touches the Mesh interface."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from .geometry import Geometry


def mesh(
    name: str, geometry: Geometry, bsdf: Any, *, facet: bool = False, emitter: Any = None
) -> Any:
    """
    Make a ``mi.Mesh`` in the current variant.

    Parameters
    ----------
    name : identifier of the shape
    geometry : the triangles
    bsdf : a BSDF object, or the dict of one
    facet : leave out the vertex normals. Needed on area lights: Mitsuba's ``path`` is biased on
        emitting meshes with interpolated normals (mitsuba3#1952).
    emitter : the area emitter the mesh carries, object or dict
    """
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    if emitter is not None:
        props["emitter"] = mi.load_dict(emitter) if isinstance(emitter, dict) else emitter
    if facet:
        props["face_normals"] = True
    shape = mi.Mesh(
        name,
        len(geometry.positions),
        len(geometry.faces),
        props=props,
        has_vertex_normals=not facet,
        has_vertex_texcoords=True,
    )
    values = mi.traverse(shape)
    values["vertex_positions"] = np.ravel(geometry.positions).astype(np.float32)
    if not facet:
        values["vertex_normals"] = np.ravel(geometry.normals).astype(np.float32)
    values["vertex_texcoords"] = np.ravel(geometry.uv).astype(np.float32)
    values["faces"] = np.ravel(geometry.faces).astype(np.uint32)
    values.update()
    return shape
