"""All 16 elements of T over travel time, on top of Mitsuba 3 (which itself renders only the first column, without time).

A path tracer from the camera with connections to one point light, vectorized with Dr.Jit: it needs an llvm variant.
Sunstone's frames are used throughout: camera right, and the light's horizontal axis, projected perpendicular to rays.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes import RESOLUTION

LIGHT_M_PER_PS = 299_792_458e-12


def project(axis, d):
    """Unit vector along `axis`, made perpendicular to `d`."""
    return dr.normalize(axis - d * dr.dot(axis, d))


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
        lit = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) & ~scene.ray_test(si.spawn_ray_to(position), active)
        wo = si.to_local(d)
        value = si.to_world_mueller(bsdf.eval(context, si, wo, lit), -wo, si.wi)
        turn = mi.Spectrum(mi.mueller.rotate_stokes_basis(-d, project(horizontal, -d), mi.mueller.stokes_basis(-d)))
        mueller = beta * value * turn * mi.Spectrum(intensity / dr.square(distance))
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


def render(description, scene, spp, seed):
    """Mean T of one seed, [y, x, t, out, in]."""
    start, width, bins = description.time
    position, intensity, horizontal = description.light
    sensor = scene.sensors()[0]
    sampler = sensor.sampler().clone()
    count = RESOLUTION**2 * spp
    sampler.set_sample_count(spp)
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, count)
    pixel = dr.arange(mi.UInt32, count) // spp
    corner = mi.Point2f(mi.Float(pixel % RESOLUTION), mi.Float(pixel // RESOLUTION))
    ray, _ = sensor.sample_ray(0.0, sampler.next_1d(), (corner + sampler.next_2d()) / RESOLUTION, mi.Point2f(0.5))
    right = mi.Vector3f(*description.camera_axes()[0].tolist())
    to_camera = mi.mueller.rotate_stokes_basis(-ray.d, mi.mueller.stokes_basis(-ray.d), project(right, -ray.d))
    film = dr.zeros(mi.Float, RESOLUTION**2 * bins * 16)
    light = mi.Point3f(*position), mi.Float(intensity), mi.Vector3f(*horizontal)
    # Mitsuba's rays start on the near clipping plane; the way there counts (1 mm, or 3.3 ps, shows in the comparison).
    length = dr.norm(ray.o - mi.Point3f(*description.origin.tolist()))
    beta, time = mi.Spectrum(to_camera), (start, width, bins)
    trace(scene, sampler, ray, length, beta, pixel, film, time, description.max_depth, light)
    return np.array(film).reshape(RESOLUTION, RESOLUTION, bins, 4, 4) / spp
