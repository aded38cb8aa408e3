#!/usr/bin/env python3
"""Prints what the tests of src/metrics expect: the formulas of `twopass compare` in numpy (2.4.6), in f64 on pictures rounded to f32.

    pip install numpy
    python metrics.py
"""
import numpy as np

y, x = np.mgrid[0:19, 0:23]
pictures = lambda value: np.stack([value(c) for c in range(3)], -1).astype(np.float32).astype(np.float64)
r = lambda c: 0.05 + ((7 * x + 11 * y + 5 * c) % 23) / 10.0
wave = lambda v, n: (v % n) / (n // 2) - 1.0
image = pictures(lambda c: r(c) * (1.0 + 0.2 * wave(2 * x + 7 * y + c, 13)) + 0.01)
a = pictures(lambda c: r(c) * (1.0 + 0.1 * wave(3 * x + 5 * y + c, 7)))
b = pictures(lambda c: r(c) * (1.0 + 0.1 * wave(5 * x + 2 * y + 3 * c, 11)))


def report(name, b, out=np.zeros((19, 23), bool)):
    ref = (a + b) / 2
    window = lambda i, j: ref[max(0, i - 2):i + 3, max(0, j - 2):j + 3].mean((0, 1))
    local = np.array([[window(i, j) for j in range(23)] for i in range(19)])
    squared = (image - a) * (image - b)
    relative = squared / (local**2 + 0.01)
    doubt = ((a - b) ** 2 / (local**2 + 0.01)).sum(-1).ravel()
    kept = ~out
    certain = kept.copy().ravel()
    certain[np.argsort(-doubt, kind="stable")[:4]] = False
    blocks = []
    for i in range(0, 19, 9):
        for j in range(0, 23, 9):
            k = kept[i:i + 9, j:j + 9]
            if k.any():
                mean = lambda p: p[i:i + 9, j:j + 9][k].mean(0)
                blocks.append((mean(image) - mean(a)) * (mean(image) - mean(b)) / (mean(ref) ** 2 + 1e-4))
    block = np.mean(blocks)
    print(name, "mse", squared[kept].mean(), "relmse", relative[kept].mean())
    print("  trimmed", relative.reshape(-1, 3)[certain].mean(), "block9", np.sign(block) * np.sqrt(abs(block)))
    print("  mean ratio", image[kept].mean(0) / ref[kept].mean(0))


report("two references", b)
report("one reference", a)
hole = (x >= 5) & (x < 12) & (y >= 3) & (y < 9)
report("without a block", b, hole)
