#!/usr/bin/env python3
"""Makes reference/cornell-glass/caustic-mask.png: where the lamp's light reaches diffuse surfaces by way of mirror or glass.

usage: python reference/caustic_mask.py [NAME] [--share 0.05] [--photons 32]

8-bit grey, the size of the reference: white (255) = leave this pixel out, black (0) = compare it. Needs the reference
itself (A.exr, B.exr) and Mitsuba as reference/README.md sets it up; takes a minute or two. In three steps:

1. Photons leave the lamp (uniform place, cosine direction; --photons millions). Those that meet mirror or glass first, and
   nothing else, are followed to the first diffuse surface, and their power is summed there in square cells of 8 mm on
   each wall: the irradiance E of paths lamp - specular (one or more) - diffuse.
2. 64 camera rays per pixel go through mirror and glass to the first diffuse surface (what a sphere shows of a caustic
   counts as well). Their mean of throughput * reflectance / pi * E is the pixel's caustic radiance C.
3. A pixel is white where C is more than --share of its whole radiance (luminance, mean of A and B over 3 x 3 pixels), and
   so are the pixels next to such a pixel; single white pixels without two white neighbours are dropped before that.

Not counted as caustic: light that a wall sent out before it went through mirror or glass, and what further bounces make
of a caustic. Both are smooth and weak in this scene.
"""
import argparse
import os

import drjit as dr
import mitsuba as mi
import numpy as np

CELL = 0.008
RAYS = 64
BATCH = 1_000_000
GREY = np.array([0.2126, 0.7152, 0.0722])
ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def follow(scene, ray, weight, active, sampler):
    """Follows rays through mirror and glass: the first other surface, the weight up to it, and whether a bounce was specular."""
    bent = dr.zeros(mi.Bool, dr.width(active))
    hit = scene.ray_intersect(ray, active=active)
    for _ in range(24):
        flags = hit.bsdf().flags()
        delta = active & hit.is_valid() & mi.has_flag(flags, mi.BSDFFlags.Delta) & ~mi.has_flag(flags, mi.BSDFFlags.DiffuseReflection)
        sample, value = hit.bsdf().sample(mi.BSDFContext(), hit, sampler.next_1d(), sampler.next_2d(), delta)
        weight = dr.select(delta, weight * value, weight)
        bent |= delta
        onward = hit.spawn_ray(hit.to_world(sample.wo))
        new = scene.ray_intersect(onward, active=delta)
        hit = dr.select(delta, new, hit)
        dr.eval(hit, weight, bent)
        if not dr.any(delta):
            break
    flags = hit.bsdf().flags()
    good = active & hit.is_valid() & mi.has_flag(flags, mi.BSDFFlags.DiffuseReflection)
    return hit, weight, good, bent


def cells(hit):
    """A number for the cell of each hit: axis and side of the wall, then the cell along the two other axes."""
    p, n = np.array(hit.p).T, np.array(hit.n).T
    axis = np.abs(n).argmax(1)
    rows = np.arange(len(p))
    # Place along the axis tells opposite walls apart, whatever way their normals point.
    side = (p[rows, axis] > 0.27).astype(np.int64)
    u = np.floor(p[rows, (axis + 1) % 3] / CELL).astype(np.int64) + 32
    v = np.floor(p[rows, (axis + 2) % 3] / CELL).astype(np.int64) + 32
    return (((axis * 2 + side) * 256) + np.clip(u, 0, 255)) * 256 + np.clip(v, 0, 255)


def caustic_irradiance(scene, millions):
    table = np.zeros((6 * 256 * 256, 3))
    lamp = [s for s in scene.shapes() if s.is_emitter()][0]
    area = float(lamp.surface_area()[0])
    sampler = mi.load_dict({"type": "independent"})
    for batch in range(millions):
        sampler.seed(1 + batch, BATCH)
        spot = lamp.sample_position(0.0, sampler.next_2d())
        way = mi.Frame3f(spot.n).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        si = dr.zeros(mi.SurfaceInteraction3f, BATCH)
        si.p, si.n, si.sh_frame, si.wi = spot.p, spot.n, mi.Frame3f(spot.n), mi.Vector3f(0, 0, 1)
        power = lamp.emitter().eval(si) * (dr.pi * area / BATCH)
        hit, weight, good, bent = follow(scene, mi.Ray3f(spot.p + 1e-5 * spot.n, way), power, dr.full(mi.Bool, True, BATCH), sampler)
        keep = np.array(good & bent)
        key, value = cells(hit)[keep], np.array(weight).T[keep]
        for channel in range(3):
            table[:, channel] += np.bincount(key, value[:, channel], len(table))
    return table / millions / CELL**2


def caustic_image(scene, table):
    width, height = scene.sensors()[0].film().size()
    count = width * height
    sampler = mi.load_dict({"type": "independent"})
    total = np.zeros((count, 3))
    index = dr.arange(mi.UInt32, count)
    for i in range(RAYS):
        sampler.seed(1001 + i, count)
        place = (mi.Point2f(index % width, index // width) + sampler.next_2d()) / mi.Point2f(width, height)
        ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
        hit, weight, good, _ = follow(scene, mi.Ray3f(ray), mi.Color3f(1.0), dr.full(mi.Bool, True, count), sampler)
        albedo = hit.bsdf().eval_diffuse_reflectance(hit, good)
        value = np.array(dr.select(good, weight * albedo / dr.pi, 0)).T * table[cells(hit)]
        total += value / RAYS
    return total.reshape(height, width, 3)


def neighbours(mask):
    """Number of white pixels among the eight around each."""
    p = np.pad(mask.astype(int), 1)
    h, w = mask.shape
    return sum(p[1 + a:1 + a + h, 1 + b:1 + b + w] for a in (-1, 0, 1) for b in (-1, 0, 1)) - mask


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="?", default="cornell-glass")
    parser.add_argument("--share", type=float, default=0.05)
    parser.add_argument("--photons", type=int, default=32, help="millions")
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    folder = os.path.join(ROOT, "reference", args.name)
    scene = mi.load_file(os.path.join(ROOT, "scenes", args.name, "scene.xml"), optimize=False)
    caustic = caustic_image(scene, caustic_irradiance(scene, args.photons)) @ GREY
    whole = sum(np.array(mi.Bitmap(os.path.join(folder, f + ".exr")), dtype=np.float64)[..., :3] for f in "AB") / 2 @ GREY
    padded = np.pad(whole, 1, mode="edge")
    h, w = whole.shape
    whole = sum(padded[a:a + h, b:b + w] for a in range(3) for b in range(3)) / 9
    ratio = caustic / np.maximum(whole, 1e-6)
    for share in (0.02, 0.03, 0.05, 0.1, 0.2, 0.5):
        print(f"caustic share above {share:4.2f}: {100 * (ratio > share).mean():5.2f} % of the pixels")
    mask = ratio > args.share
    mask &= neighbours(mask) >= 2
    mask |= neighbours(mask) > 0
    mi.Bitmap((mask * 255).astype(np.uint8)).write(os.path.join(folder, "caustic-mask.png"))
    print(f"mask: {100 * mask.mean():.2f} % of the pixels; {100 * caustic[mask].sum() / caustic.sum():.1f} % of the caustic light")
    left = np.where(mask, 0, caustic) ** 2 / (whole**2 + 0.01)
    print(f"an image without any caustic has a relMSE of {left[~mask].mean():.2g} from it outside the mask (luminance)")


main()
