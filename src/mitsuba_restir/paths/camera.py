"""The previous frame's camera, copied by value: where a world point was on its film."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..transforms import TO_WORLD, world_to_local

REPROJECTABLE = ("PerspectiveCamera", "ThinLensCamera")
"""Sensor classes whose history can be followed."""


@dataclass
class Camera:
    """A pinhole or thin-lens camera as plain data.

    Fields: ``to_camera`` (from the world), ``to_sample`` (from the camera to the crop window's unit
    square), ``offset`` (principal point), ``aperture`` and ``focus`` (aperture 0 is a pinhole).
    """

    to_camera: mi.Matrix4f
    to_sample: mi.Matrix4f
    offset: mi.Vector2f
    aperture: mi.Float
    focus: mi.Float


@dataclass
class Eye:
    """Where all rays of a pinhole camera come from.

    Fields: ``point`` (the pinhole), ``axis`` (unit vector in the direction of the view), ``near``
    (distance of the plane on which rays start); one entry each.
    """

    point: mi.Point3f
    axis: mi.Vector3f
    near: mi.Float

    def origin(self, p: mi.Point3f) -> mi.Point3f:
        """Where the ray to a point starts."""
        to_point = p - self.point
        return self.point + to_point * (self.near / dr.dot(to_point, self.axis))


def eye_of(sensor: mi.Sensor) -> Eye | None:
    """The eye of a pinhole camera; None for all other sensors."""
    if sensor.class_name() != "PerspectiveCamera":
        return None
    parameters = mi.traverse(sensor)
    matrix = mi.Matrix4f(parameters[TO_WORLD].matrix)
    point, axis = matrix @ mi.Vector4f(0, 0, 0, 1), matrix @ mi.Vector4f(0, 0, 1, 0)
    eye = Eye(mi.Point3f(point.xyz), dr.normalize(axis.xyz), mi.Float(parameters["near_clip"]))
    dr.make_opaque(eye)
    return eye


def copy_camera(sensor: mi.Sensor) -> Camera:
    """Copy what :func:`project` needs of a sensor, so that later edits cannot change it."""
    parameters = mi.traverse(sensor)
    film = sensor.film()
    to_sample = mi.perspective_projection(
        film.size(),
        film.crop_size(),
        film.crop_offset(),
        parameters["x_fov"],
        parameters["near_clip"],
        parameters["far_clip"],
    )
    lens = "aperture_radius" in parameters
    camera = Camera(
        world_to_local(parameters),
        mi.Matrix4f(to_sample.matrix),
        mi.Vector2f(
            mi.Float(0 if lens else parameters["principal_point_offset_x"]),
            mi.Float(0 if lens else parameters["principal_point_offset_y"]),
        ),
        mi.Float(parameters["aperture_radius"] if lens else 0),
        mi.Float(parameters["focus_distance"] if lens else 1),
    )
    dr.make_opaque(camera)
    return camera


def project(camera: Camera, p: mi.Point3f, lens: mi.Point2f) -> tuple[mi.Point2f, mi.Bool]:
    """Film position of a world point seen through one point of the lens.

    Parameters
    ----------
    p : Point3f
        World position.
    lens : Point2f
        Uniform lens sample of the ray (ignored by a pinhole).

    Returns
    -------
    uv : Point2f
        Position in the crop window's unit square.
    in_front : Bool
        Whether the point is in front of the camera.
    """
    local = mi.Point3f((camera.to_camera @ mi.Vector4f(p.x, p.y, p.z, 1)).xyz)
    disk = camera.aperture * mi.warp.square_to_uniform_disk_concentric(lens)
    # The ray through this lens point meets the plane of focus where a pinhole ray would.
    scale = camera.focus / local.z
    x = disk.x + (local.x - disk.x) * scale
    y = disk.y + (local.y - disk.y) * scale
    sample = camera.to_sample @ mi.Vector4f(x, y, camera.focus, 1)
    uv = mi.Point2f(sample.x, sample.y) / sample.w
    return uv - camera.offset, local.z > 0
