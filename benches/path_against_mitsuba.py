#!/usr/bin/env python3
"""Compares `twopass render --method path` with Mitsuba's path tracer: relmse x CPU seconds, in turn, in one run.

usage: path_against_mitsuba.py TWOPASS SCENE.xml REFERENCE_FOLDER [--spp 64] [--rounds 5] [--threads 2] [--sampler independent]

Both use the same number of samples, Russian roulette from depth 5, and the sampler named (Mitsuba's plugin of that name; our
`sobol` beside Mitsuba's `multijitter`). Seconds are user and system time of the process: of ours the stage "render" of the run report,
of Mitsuba's the render call alone, after a warm-up with the same settings that compiles its kernel. Neither counts loading and trees.
The squared error is the cross product of both reference halves, relative to S^2 + 0.01 (S: 5x5-pixel mean of the reference). Needs
Mitsuba 3 (variant llvm_ad_rgb) and numpy.
"""
import argparse
import json
import os
import statistics
import subprocess
import tempfile
import time

import mitsuba as mi
import numpy as np

args = argparse.ArgumentParser()
args.add_argument("twopass")
args.add_argument("scene")
args.add_argument("reference")
args.add_argument("--spp", type=int, default=64)
args.add_argument("--rounds", type=int, default=5)
args.add_argument("--threads", type=int, default=2)
args.add_argument("--sampler", choices=["independent", "sobol"], default="independent")
args = args.parse_args()

mi.set_variant("llvm_ad_rgb")
import drjit as dr  # noqa: E402 (after the variant, which chooses its library)

dr.set_thread_count(args.threads)
OTHERS = {"independent": "independent", "sobol": "multijitter"}


def read(path):
    """The picture itself, without the layers beside it."""
    layers = dict(mi.Bitmap(path).split())
    picture = layers["<root>"].convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(picture, dtype=np.float64)


def window_mean(image, radius=2):
    for axis in (0, 1):
        n = image.shape[axis]
        total = np.cumsum(np.insert(image, 0, 0.0, axis=axis), axis=axis)
        lo, hi = np.maximum(np.arange(n) - radius, 0), np.minimum(np.arange(n) + radius + 1, n)
        count = (hi - lo).reshape([-1 if a == axis else 1 for a in range(image.ndim)])
        image = (np.take(total, hi, axis) - np.take(total, lo, axis)) / count
    return image


a, b = (read(os.path.join(args.reference, half + ".exr")) for half in "AB")
scale = window_mean((a + b) / 2) ** 2 + 0.01


def relmse(image):
    return float(((image - a) * (image - b) / scale).mean())


def ours(seed, folder):
    out, report = os.path.join(folder, "out"), os.path.join(folder, "report.json")
    command = [args.twopass, "render", args.scene, "--method", "path", "--sampler", args.sampler, "--spp", str(args.spp)]
    subprocess.run(command + ["--threads", str(args.threads), "--seed", str(seed), "-q", "-o", out, "--report", report], check=True)
    with open(report, encoding="utf-8") as file:
        stages = json.load(file)["stages"]
    return relmse(read(out + ".exr")), next(s["cpu_s"] for s in stages if s["name"] == "render")


def mitsubas(scene, integrator, sensor, seed):
    start = time.process_time()
    image = np.array(mi.render(scene, integrator=integrator, sensor=sensor, spp=args.spp, seed=seed), dtype=np.float64)[..., :3]
    return relmse(image), time.process_time() - start


def sampled(path):
    """The scene with the sampler asked for: the plugin is chosen in the file."""
    with open(path, encoding="utf-8") as file:
        text = file.read()
    for kind in ("independent", "multijitter", "stratified", "orthogonal", "ldsampler"):
        text = text.replace(f'sampler type="{kind}"', f'sampler type="{OTHERS[args.sampler]}"')
    return text


# Relative file names count from the scene's folder, which may not be writable.
os_folder = os.path.dirname(os.path.abspath(args.scene))
mi.file_resolver().append(os_folder)
scene = mi.load_string(sampled(args.scene))
text = sampled(args.scene)
at = text.find('name="max_depth" value="')
limit = int(text[at:].split('"')[3]) if at >= 0 else -1
integrator = mi.load_dict({"type": "path", "max_depth": limit, "rr_depth": 5})
sensor = scene.sensors()[0]
mitsubas(scene, integrator, sensor, 1000)
rows = []
with tempfile.TemporaryDirectory() as folder:
    for round in range(args.rounds):
        rows.append((ours(round + 1, folder), mitsubas(scene, integrator, sensor, round + 1)))
        (e1, t1), (e2, t2) = rows[-1]
        print(f"round {round}: ours relmse {e1:.4e} in {t1:.2f} s, Mitsuba {e2:.4e} in {t2:.2f} s; ratio {e1 * t1 / (e2 * t2):.3f}", flush=True)
median = lambda values: statistics.median(list(values))  # noqa: E731
print(f"medians: ours {median(r[0][0] for r in rows):.4e} x {median(r[0][1] for r in rows):.3f} s, "
      f"Mitsuba {median(r[1][0] for r in rows):.4e} x {median(r[1][1] for r in rows):.3f} s")
print(f"median ratio of relmse x CPU s: {median(o[0] * o[1] / (m[0] * m[1]) for o, m in rows):.3f}")
