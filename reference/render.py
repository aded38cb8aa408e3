#!/usr/bin/env python3
"""Renders the reference images of a scene with Mitsuba 3's path tracer.

usage: python reference/render.py NAME [--own-relmse 1e-3] [--cpu-seconds 1200] [--per-pass 64] [--define key=value ...]

Run it from the project's root; reference/README.md says how to set Mitsuba up. It reads scenes/NAME/scene.xml and writes
into reference/NAME/ (all linear RGB, float32, film size of the scene):

    A.exr, B.exr     two independent halves: means over disjoint sets of samples, each unbiased
    var.exr          variance of the pixel values of (A + B) / 2, estimated from the spread of the passes
    PROVENANCE.toml  what made them, and how good they are

The two halves take passes of --per-pass samples in turn, each pass with a seed of its own, until at least 16 passes lie in
each half and the halves' own relMSE is no more than --own-relmse, or --cpu-seconds of processor time are spent in all.
Own relMSE: mean over pixels and channels of ((A - B) / 2)^2 / (S^2 + 0.01), where S is the mean of (A + B) / 2 over the
5 x 5 pixels around (fewer at the image's edge). It estimates the relative squared error of (A + B) / 2 itself.

Sums are kept in reference/.state/NAME.npz (ignored by git), written every minute. Run again to go on from there, with a
smaller --own-relmse or more --cpu-seconds. A scene that changed is refused: delete its state to start anew.

To judge an image I without the reference's noise counting against it, use mean((I - A) * (I - B)): the two halves' errors
are independent, so they cancel in the mean.
"""
import argparse
import hashlib
import os
import time

import mitsuba as mi
import numpy as np

VARIANT = "llvm_ad_rgb"
ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
MIN_PASSES = 16


def window_mean(image, radius=2):
    """Mean over the (2 radius + 1)^2 pixels around each pixel that lie inside the image."""
    for axis in (0, 1):
        n = image.shape[axis]
        total = np.cumsum(np.insert(image, 0, 0.0, axis=axis), axis=axis)
        lo = np.maximum(np.arange(n) - radius, 0)
        hi = np.minimum(np.arange(n) + radius + 1, n)
        count = (hi - lo).reshape([-1 if a == axis else 1 for a in range(image.ndim)])
        image = (np.take(total, hi, axis) - np.take(total, lo, axis)) / count
    return image


def own_relmse(a, b):
    s = window_mean((a + b) / 2)
    return float(((((a - b) / 2) ** 2) / (s * s + 0.01)).mean())


def scene_hash(folder):
    """Of every file that Mitsuba can read in the scene's folder, in a fixed order."""
    digest = hashlib.sha256()
    for where, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            if not name.endswith((".md", ".py", ".pyc")) and name != "picture.png":
                path = os.path.join(where, name)
                digest.update(os.path.relpath(path, folder).encode())
                with open(path, "rb") as file:
                    digest.update(file.read())
    return digest.hexdigest()


def seed_of(half, index, pixels, per_pass):
    """The seed of a pass. Mitsuba gives pixel number p of a pass the random stream (per_pass * p + seed), so seeds that are a
    multiple of per_pass apart would repeat one pixel's samples in another pixel: per_pass seeds in a row are used, then
    the next per_pass seeds beyond the last pixel's stream."""
    run = per_pass // 2
    return (index % run) * 2 + half + 1 + (index // run) * per_pass * (pixels + 1)


def save(path, state):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    np.savez(path + ".tmp.npz", **state)
    os.replace(path + ".tmp.npz", path)


def halves(state):
    spp = state["per_pass"]
    a = state["sum0"] / state["n"][0]
    b = state["sum1"] / state["n"][1]
    # Each half's passes are independent: variance of the half's mean from the spread around that mean.
    var = 0.0
    for half, mean in ((0, a), (1, b)):
        n = int(state["n"][half])
        spread = (state[f"square{half}"] - n * mean * mean) / max(n - 1, 1)
        var = var + np.maximum(spread, 0.0) / n / 4
    return a, b, var, int(spp)


def write(args, state, folder):
    a, b, var, spp = halves(state)
    os.makedirs(folder, exist_ok=True)
    for name, image in (("A", a), ("B", b), ("var", var)):
        mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32)).write(os.path.join(folder, name + ".exr"))
    mean = ((a + b) / 2).mean((0, 1))
    n = [int(x) for x in state["n"]]
    command = f"python reference/render.py {args.name} --own-relmse {args.own_relmse:g} --cpu-seconds {args.cpu_seconds:g}"
    command += f" --per-pass {spp}" + "".join(f" --define {d}" for d in args.define)
    lines = [
        f'scene = "scenes/{args.name}/scene.xml"',
        f'scene_sha256 = "{state["hash"]}"',
        'renderer = "Mitsuba"',
        f'version = "{mi.__version__}"',
        f'variant = "{VARIANT}"',
        'integrator = "path"',
        "max_depth = -1",
        'sampler = "multijitter"',
        'filter = "box"',
        f'seeds = "pass i of half h (both from 0): 2 (i mod {spp // 2}) + h + 1 + floor(i / {spp // 2}) * {spp * (a.shape[0] * a.shape[1] + 1)}"',
        f"width = {a.shape[1]}",
        f"height = {a.shape[0]}",
        f"samples_per_pass = {spp}",
        f"passes_A = {n[0]}",
        f"passes_B = {n[1]}",
        f"samples_A = {n[0] * spp}",
        f"samples_B = {n[1] * spp}",
        f"defines = [{', '.join(chr(34) + d + chr(34) for d in args.define)}]",
        f'command = "{command}"',
        f"cpu_seconds = {float(state['cpu']):.0f}",
        f"mean = [{', '.join(f'{m:.7g}' for m in mean)}]",
        f"own_relmse = {own_relmse(a, b):.4g}",
        f"own_relmse_from_var = {float((var / (window_mean((a + b) / 2) ** 2 + 0.01)).mean()):.4g}",
    ]
    with open(os.path.join(folder, "PROVENANCE.toml"), "w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(lines) + "\n")
    print(f"{args.name}: {n[0]} + {n[1]} passes of {spp} samples, {float(state['cpu']):.0f} CPU s, own relMSE {own_relmse(a, b):.3g}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name")
    parser.add_argument("--own-relmse", type=float, default=1e-3)
    parser.add_argument("--cpu-seconds", type=float, default=1200)
    parser.add_argument("--per-pass", type=int, default=64)
    parser.add_argument("--define", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()

    mi.set_variant(VARIANT)
    scene_folder = os.path.join(ROOT, "scenes", args.name)
    state_path = os.path.join(ROOT, "reference", ".state", args.name + ".npz")
    digest = scene_hash(scene_folder) + "".join(" " + d for d in args.define)
    if os.path.exists(state_path):
        state = dict(np.load(state_path))
        if str(state["hash"]) != digest or int(state["per_pass"]) != args.per_pass:
            parser.error(f"{os.path.relpath(state_path, ROOT)} belongs to another scene or pass size; delete it to start anew")
    else:
        state = dict(hash=digest, per_pass=args.per_pass, cpu=0.0, n=np.zeros(2, int))
        state.update(sum0=0.0, sum1=0.0, square0=0.0, square1=0.0)

    scene = mi.load_file(os.path.join(scene_folder, "scene.xml"), **dict(d.split("=", 1) for d in args.define))
    width, height = scene.sensors()[0].film().size()
    pixels = int(width) * int(height)
    saved = time.monotonic()
    while True:
        n = state["n"]
        if n[1] >= MIN_PASSES and n[0] == n[1]:
            a, b, _, _ = halves(state)
            if own_relmse(a, b) <= args.own_relmse or state["cpu"] >= args.cpu_seconds:
                break
        half = 0 if n[0] <= n[1] else 1
        start = time.process_time()
        image = np.array(mi.render(scene, spp=args.per_pass, seed=seed_of(half, int(n[half]), pixels, args.per_pass)), dtype=np.float64)[..., :3]
        if not np.isfinite(image).all():
            raise SystemExit("a pass holds values that are not finite")
        state["cpu"] = state["cpu"] + time.process_time() - start
        state[f"sum{half}"] = state[f"sum{half}"] + image
        state[f"square{half}"] = state[f"square{half}"] + image * image
        n[half] += 1
        if time.monotonic() - saved > 60:
            save(state_path, state)
            saved = time.monotonic()
    save(state_path, state)
    write(args, state, os.path.join(ROOT, "reference", args.name))


main()
