"""Conversion of Stokes frames from Mitsuba's `stokes` integrator to Sunstone.

Mitsuba's horizontal axis is cross(ray, camera up); Sunstone's is camera right, projected perpendicular to the ray. They agree on
the optical axis and differ by about x y / z^2 elsewhere.
"""

import mitsuba as mi
import numpy as np


def camera_axes(sensor):
    """Return image right, image up and forward in world coordinates, and the position of the camera."""
    place = np.array(sensor.world_transform().matrix, float).reshape(4, 4)
    return -place[:3, 0], place[:3, 1], place[:3, 2], place[:3, 3]


def angles(sensor):
    """Return the angle from Mitsuba's Stokes frames to Sunstone's at the pixel centres, counter-clockwise looking toward the
    source.
    """
    right, up, *_ = camera_axes(sensor)
    w, h = sensor.film().size()
    rays = [[direction(sensor, (x + 0.5) / w, (y + 0.5) / h) for x in range(w)] for y in range(h)] if scalar() else None
    if rays is None:
        x, y = np.meshgrid((np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h)
        # An orthographic sensor returns a single direction.
        rays = np.broadcast_to(direction(sensor, mi.Float(x.ravel()), mi.Float(y.ravel())).reshape(3, -1), (3, w * h))
        rays = rays.T.reshape(h, w, 3)
    ray = np.array(rays)
    unit = lambda v: v / np.linalg.norm(v, axis=-1, keepdims=True)
    theirs = unit(np.cross(ray, up))
    ours = unit(right - ray * (ray @ right)[..., None])
    return np.arctan2((ours * np.cross(-ray, theirs)).sum(-1), (ours * theirs).sum(-1))


def scalar():
    """Return true for Mitsuba's variants without arrays."""
    return mi.variant().startswith("scalar")


def direction(sensor, x, y):
    """Return the direction of the ray through a point of the film, which is 1 wide and 1 high."""
    return np.array(sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))[0].d, float)


def rotate(stokes, angle):
    """Return Stokes vectors in a basis rotated by `angle`."""
    s0, s1, s2, s3 = np.moveaxis(stokes, -1, 0)
    c, s = np.cos(2 * angle), np.sin(2 * angle)
    return np.stack([s0, c * s1 + s * s2, -s * s1 + c * s2, s3], axis=-1)
