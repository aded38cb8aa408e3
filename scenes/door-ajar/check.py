#!/usr/bin/env python3
"""Measures with Mitsuba how much of the light that arrives in room two comes straight from a lamp.

usage: python scenes/door-ajar/check.py [angle]

Takes points spread by area over all surfaces of room two (and the room's side of the door), and at each of them compares the
irradiance straight from the lamps with the whole irradiance. With the angle 0 it tells whether the camera sees any light.
"""
import os
import sys

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
here = os.path.dirname(os.path.abspath(__file__))
angle = sys.argv[1] if len(sys.argv) > 1 else "30"
scene = mi.load_file(os.path.join(here, "scene.xml"), angle=angle)
image = np.array(mi.render(scene, spp=64, seed=5))
print(f"camera image at {angle} degrees: mean {image.mean():.4g}, largest value {image.max():.4g}")

# Points where uniform rays from uniform places in room two end: every surface is reached, open ones more than hidden ones.
count = 400_000
rng = np.random.default_rng(1)
place = rng.uniform([0.1, 0.02, 0.02], [3.78, 2.48, 3.58], (count, 3)).T
way = rng.normal(size=(3, count))
ray = mi.Ray3f(mi.Point3f(*place.astype(np.float32)), dr.normalize(mi.Vector3f(*way.astype(np.float32))))
hit = scene.ray_intersect(ray)
valid = hit.is_valid() & (hit.p.x > 0.08)
hit.n = dr.select(dr.dot(hit.n, ray.d) > 0, -hit.n, hit.n)
sampler = mi.load_dict({"type": "independent"})
sampler.seed(7, count)
direct = dr.zeros(mi.Float, count)
for _ in range(64):
    ds, weight = scene.sample_emitter_direction(hit, sampler.next_2d(), True, valid)
    direct += dr.select(valid, mi.luminance(weight) * dr.maximum(0, dr.dot(hit.n, ds.d)), 0) / 64
print(f"{int(dr.sum(dr.select(valid, 1, 0))[0])} points in room two; lit straight by a lamp: {int(dr.sum(dr.select(direct > 0, 1, 0))[0])}")

whole = dr.zeros(mi.Float, count)
frame = mi.Frame3f(hit.n)
path = mi.load_dict({"type": "path", "max_depth": -1})
for _ in range(16):
    out = hit.spawn_ray(frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d())))
    radiance, _, _ = path.sample(scene, sampler, mi.RayDifferential3f(out), active=valid)
    whole += dr.select(valid, mi.luminance(radiance), 0) * (dr.pi / 16)
d, w = float(dr.mean(direct)[0]), float(dr.mean(whole)[0])
print(f"irradiance: straight {d:.4g}, in all {w:.4g}; indirect share {100 * (1 - d / w) if w else 0:.3f} %")
