"""Render all 16 elements of T over travel time with Mitsuba 3 (which itself renders only the first column, without time).

A path tracer from the camera with connections to one point light or projector, vectorized with Dr.Jit, requires an llvm variant.
Frames are Sunstone's: camera right, and the light's horizontal axis, projected perpendicular to rays. A light consists of its
position, its radiant intensity (a number, or a function of the direction to the light), and its horizontal axis.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from frames import camera_axes

LIGHT_M_PER_PS = 299_792_458e-12


def project(axis, d):
    """Return the unit vector along `axis`, made perpendicular to `d`."""
    return dr.normalize(axis - d * dr.dot(axis, d))


def strength(intensity, d):
    """Return the radiant intensity toward a point that sees the light in direction `d`."""
    return intensity(d) if callable(intensity) else intensity


def projector(irradiance, fov_x_deg, aspect, forward, right, down):
    """Return the radiant intensity of a projector by direction; the irradiance holds on the plane 1 m in front."""
    slope = np.tan(np.radians(fov_x_deg) / 2)

    def intensity(d):
        x, y, z = (-dr.dot(mi.Vector3f(*map(float, axis)), d) for axis in (right, down, forward))
        inside = (z > 0) & (dr.abs(x) < float(slope) * z) & (dr.abs(y) < float(slope / aspect) * z)
        return dr.select(inside, irradiance / dr.power(z, 3), 0)

    return intensity


@dr.syntax
def trace(scene, sampler, ray, length, beta, pixel, film, time, max_depth, light):
    start, width, bins = time
    position, intensity, horizontal = light
    context = mi.BSDFContext()
    ray, beta = mi.Ray3f(ray), mi.Spectrum(beta)
    length, depth, eta, active = mi.Float(length), mi.UInt32(1), mi.Float(1), mi.Bool(True)
    while active:
        si = scene.ray_intersect(ray, active)
        active &= si.is_valid()
        length += dr.select(active, si.t * eta, 0)
        bsdf = si.bsdf(ray)
        # Connection to the light; d points to it, so light travels along -d.
        v = position - si.p
        distance = dr.norm(v)
        d = v / distance
        lit = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        lit &= ~scene.ray_test(si.spawn_ray_to(position), active)
        wo = si.to_local(d)
        value = si.to_world_mueller(bsdf.eval(context, si, wo, lit), -wo, si.wi)
        turn = mi.Spectrum(mi.mueller.rotate_stokes_basis(-d, project(horizontal, -d), mi.mueller.stokes_basis(-d)))
        mueller = beta * value * turn * mi.Spectrum(strength(intensity, d) / dr.square(distance))
        bin = dr.floor(((length + distance * eta) / LIGHT_M_PER_PS - start) / width)
        lit &= (bin >= 0) & (bin < bins)
        base = (pixel * bins + mi.UInt32(dr.maximum(bin, 0))) * 16
        for i in range(4):
            for j in range(4):
                dr.scatter_add(film, mueller[i, j, 0], base + (4 * i + j), lit)
        sample, weight = bsdf.sample(context, si, sampler.next_1d(), sampler.next_2d(), active)
        beta = beta * si.to_world_mueller(weight, -sample.wo, si.wi)
        eta *= sample.eta
        ray = si.spawn_ray(si.to_world(sample.wo))
        depth += 1
        active &= (beta[0, 0, 0] != 0) & (depth < max_depth)


def render(scene, light, max_depth, spp, seed, time=None):
    """Return the mean T of one seed, [y, x, t, out, in]; `time` is start, width and number of bins in picoseconds, or None for
    all light.
    """
    start, width, bins = time or (0, 1e12, 1)
    position, intensity, horizontal = light
    sensor = scene.sensors()[0]
    w, h = (int(n) for n in sensor.film().size())
    sampler = sensor.sampler().clone()
    count = w * h * spp
    sampler.set_sample_count(spp)
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, count)
    pixel = dr.arange(mi.UInt32, count) // spp
    corner = mi.Point2f(mi.Float(pixel % w), mi.Float(pixel // w))
    place = (corner + sampler.next_2d()) / mi.Point2f(w, h)
    ray, _ = sensor.sample_ray(0.0, sampler.next_1d(), place, mi.Point2f(0.5))
    right, _, _, origin = camera_axes(sensor)
    right = mi.Vector3f(*right.tolist())
    to_camera = mi.mueller.rotate_stokes_basis(-ray.d, mi.mueller.stokes_basis(-ray.d), project(right, -ray.d))
    film = dr.zeros(mi.Float, w * h * bins * 16)
    light = mi.Point3f(*position), intensity if callable(intensity) else mi.Float(intensity), mi.Vector3f(*horizontal)
    # Mitsuba's rays start on the near clipping plane; the distance to it counts (1 mm, or 3.3 ps, is visible in the comparison).
    length = dr.norm(ray.o - mi.Point3f(*origin.tolist()))
    trace(scene, sampler, ray, length, mi.Spectrum(to_camera), pixel, film, (start, width, bins), max_depth, light)
    return np.array(film).reshape(h, w, bins, 4, 4) / spp
