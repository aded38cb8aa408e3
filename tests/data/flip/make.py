#!/usr/bin/env python3
"""Makes the pairs of small pictures in this folder and what an independent program says of them.

    pip install flip-evaluator==1.7 numpy
    python make.py

Each NAME.f32 holds little-endian f32: width, height, start exposure, stop exposure, number of exposures, mean LDR-FLIP, mean
HDR-FLIP; then the reference and the picture (rows of linear R, G, B), the LDR-FLIP map and the HDR-FLIP map. LDR-FLIP judges the
linear pictures cut to [0, 1]; HDR-FLIP chooses its exposures itself. 67.02 pixels per degree (0.7 m away from a screen 0.7 m and
3840 pixels wide) and the ACES tone mapper: the package's defaults.
"""
import flip_evaluator as flip
import numpy as np


def interior(rng):
    """Light falling off from a lamp that is seen, coloured walls; the picture is noisy with a few bright pixels."""
    y, x = np.mgrid[0:36, 0:44].astype(np.float64)
    wall = np.stack([np.where(x < 15, 0.6, 0.4), np.where(x < 30, 0.5, 0.2), np.where(x < 30, 0.2, 0.45)], -1)
    reference = wall * (300.0 / ((x - 20) ** 2 + (y - 2) ** 2 + 150.0))[..., None]
    reference[1:4, 17:25] = [17.0, 12.0, 4.0]
    picture = reference * rng.gamma(12.0, 1 / 12.0, reference.shape)
    picture[rng.random((36, 44)) < 0.004] *= 30.0
    return reference, picture


def edges(_):
    """Lines, dots and saturated squares on black; the picture is shifted by one pixel, dimmed and tinted."""
    reference = np.zeros((31, 37, 3))
    reference[4:12, 4:12] = [1.0, 0.0, 0.0]
    reference[4:12, 15:23] = [0.0, 1.0, 0.0]
    reference[4:12, 26:34] = [0.0, 0.0, 1.0]
    reference[15:29:3, 3:17] = 0.8
    reference[15:29, 19:36:2] = 0.5
    reference += 0.003
    picture = np.roll(reference, 1, 1) * [0.9, 0.8, 0.85]
    picture[20:24, 24:30] = [2.5, 1.5, 0.2]
    return reference, picture


for number, scene in enumerate([interior, edges]):
    reference, picture = (np.ascontiguousarray(p, np.float32) for p in scene(np.random.default_rng(number)))
    cut = [np.clip(p, 0, 1) for p in (reference, picture)]
    ldr, mean_ldr, _ = flip.evaluate(*cut, "LDR", inputsRGB=False, applyMagma=False)
    hdr, mean_hdr, used = flip.evaluate(reference, picture, "HDR", applyMagma=False)
    head = [*reference.shape[1::-1], used["startExposure"], used["stopExposure"], used["numExposures"], mean_ldr, mean_hdr]
    print(scene.__name__, head, used)
    parts = [np.array(head), reference, picture, ldr, hdr]
    np.concatenate([np.asarray(p, "<f4").ravel() for p in parts]).tofile(f"{scene.__name__}.f32")
