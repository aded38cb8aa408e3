#!/usr/bin/env python3
"""Renders a scene with Mitsuba 3 for `twopass experiment`, and says what the render call itself cost.

usage: mitsuba.py SCENE.xml OUT.exr --spp N [--seed N] [--size WxH] [--variant llvm_ad_rgb] [--sampler independent]
                  [--rr-depth N] [--max-depth N] [-D NAME=VALUE] [--denoise]

Writes OUT.exr (linear RGB, float32) and OUT.exr.json: `wall_s` and `cpu_s` of the render call, CPU seconds being user and system time of
all threads. Not in them: start-up, loading the scene and its tree (`load_cpu_s`), and one render at 1 sample per pixel before, in which
the LLVM variants compile their kernels. Samples beyond what one launch takes are rendered in passes of other seeds and averaged.

With --denoise the picture goes through Intel's Open Image Denoise (pip package pyoidn) with Mitsuba's albedo and shading normal as layers
(aov integrator, same samples); rendering the layers and denoising are in the times.
"""
import argparse
import json
import os
import re
import resource
import sys
import tempfile
import time

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("scene")
parser.add_argument("out")
parser.add_argument("--spp", type=int, required=True)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--size", default="")
parser.add_argument("--variant", default="llvm_ad_rgb")
parser.add_argument("--sampler", default="independent", choices=["independent", "multijitter", "stratified", "orthogonal", "ldsampler"])
parser.add_argument("--rr-depth", type=int, default=5)
parser.add_argument("--max-depth", type=int)
parser.add_argument("--threads", type=int, default=0)
parser.add_argument("-D", action="append", default=[], metavar="NAME=VALUE")
parser.add_argument("--denoise", action="store_true")
args = parser.parse_args()

# This file has the name of the module it needs.
here = os.path.dirname(os.path.realpath(__file__))
sys.path = [p for p in sys.path if os.path.realpath(p or ".") != here]

import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402

mi.set_variant(args.variant)
import drjit as dr  # noqa: E402

if args.threads > 0:
    dr.set_thread_count(args.threads)


def cpu():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def spent(before):
    return time.perf_counter() - before[0], cpu() - before[1]


def now():
    return time.perf_counter(), cpu()


def with_sampler(path):
    """The scene file with the sampler asked for, beside the first so that its relative names still hold."""
    text = open(path, encoding="utf-8").read()
    changed, found = re.subn(r'(<sampler\s[^>]*?type=)(["\'])\w+\2', rf'\1"{args.sampler}"', text)
    if not found:
        raise SystemExit(f"{path}: no <sampler> whose type could be {args.sampler}")
    handle, name = tempfile.mkstemp(suffix=".xml", prefix=".mitsuba-", dir=os.path.dirname(os.path.abspath(path)))
    os.write(handle, changed.encode())
    os.close(handle)
    return name


def load():
    defines = dict(pair.split("=", 1) for pair in args.D)
    # Scenes name samplers of their own, so each run says which it means.
    name = with_sampler(args.scene)
    try:
        return mi.load_file(name, **defines)
    finally:
        os.remove(name)


before = now()
scene = load()
if args.size:
    width, height = (int(side) for side in args.size.split("x"))
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("film.size"))
    parameters[key] = [width, height]
    parameters.update()
load_cpu = spent(before)[1]

own = scene.integrator()
max_depth = args.max_depth
if max_depth is None:
    # The integrator tells its depth only in its description.
    words = str(own).replace(",", " ").split()
    max_depth = int(words[words.index("max_depth") + 2]) if "max_depth" in words else -1
    # Unlimited is printed as the largest number of 32 bits.
    max_depth = -1 if max_depth >= 2**31 - 1 else max_depth
path = {"type": "path", "max_depth": max_depth, "rr_depth": args.rr_depth}
if args.denoise:
    integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "image": path})
else:
    integrator = mi.load_dict(path)

film = scene.sensors()[0].film()
pixels = int(film.crop_size()[0]) * int(film.crop_size()[1])
# A launch of the wavefront variants holds all its samples in memory; 2^26 take some gigabytes less than the 2^32 that are the limit.
per_pass = args.spp if args.variant.startswith("scalar") else max(1, min(args.spp, (1 << 26) // pixels))


def render(spp, seed):
    return np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed))


def passes():
    sizes = [per_pass] * (args.spp // per_pass)
    if args.spp % per_pass:
        sizes.append(args.spp % per_pass)
    return sizes


def take(sizes):
    total, done = None, 0
    for i, n in enumerate(sizes):
        # Seeds of one run differ from those of others by more than its passes.
        part = render(n, (args.seed * 4096 + i + 1) % 2**31).astype(np.float64) * n
        total, done = (part if total is None else total + part), done + n
    return total / done


render(1, 1_234_567)
if args.denoise:
    import pyoidn

before = now()
image = take(passes())
if args.denoise:
    layer = lambda first, last: np.ascontiguousarray(image[..., first:last], dtype=np.float32)
    # The layers follow the picture's own channels: albedo, then normal.
    image = pyoidn.denoise(layer(0, 3), albedo=layer(-6, -3), normal=layer(-3, None), hdr=True)
image = np.ascontiguousarray(image[..., :3], dtype=np.float32)
wall, cpu_s = spent(before)

mi.Bitmap(image).write(args.out)
with open(args.out + ".json", "w", encoding="utf-8") as file:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    said = {"wall_s": wall, "cpu_s": cpu_s, "load_cpu_s": load_cpu, "pass_two_cpu_s": cpu_s, "spp": args.spp, "peak_memory_bytes": peak}
    json.dump(said, file)
