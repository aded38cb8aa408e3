"""Exchanges between the 654 squares of a cube in a cube, for the laws and benches of form factors.

    python3 make.py > transfers.csv

A closed unit cube, its walls in 10 x 10 squares each, around a cube of half its edge, in 3 x 3 each; both are seen from the space
between them. Exchanges of rectangles at right angles and in parallel planes are exact (Ehlert, J. R. and Smith, T. F., "View factors
for perpendicular and parallel rectangular plates", Journal of Thermophysics and Heat Transfer 7(1), 1993, pp. 173-174). What the inner cube
leaves visible between two squares of the walls is the share of 2^20 segments that miss it, weighted by the kernel; their ends are points
of an additive recurrence (Roberts, M., "The unreasonable effectiveness of quasirandom sequences", 2018) shifted at random, so that the share is known to
about 1e-5. Nothing of the program is used.

Pairs that a turn or reflection of the cube maps on each other are one row: centres in units of 1/60 of the edge about the middle, the
least under all 48 maps and both orders; A_i F_ij with nothing between; the visible share.
"""
import itertools
import math
import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np

HALF = 30  # half the edge in units
N = 1 << 20
CHUNK = 1 << 13
MAPS = [(p, s) for p in itertools.permutations(range(3)) for s in itertools.product((1, -1), repeat=3)]


def squares():
    """(centre, axis, sign of the normal, half width) in units about the middle."""
    out = []
    for axis in range(3):
        for side in (-1, 1):
            for half, cells, width in ((HALF, 10, 3), (15, 3, 5)):
                for i in range(cells):
                    for j in range(cells):
                        c = [0, 0, 0]
                        c[axis] = side * half
                        c[(axis + 1) % 3] = -half + width * (2 * i + 1)
                        c[(axis + 2) % 3] = -half + width * (2 * j + 1)
                        out.append((tuple(c), axis, -side if half == HALF else side, width))
    return out


def key(a, b):
    """The least image of two centres."""
    images = []
    for p, s in MAPS:
        x, y = (tuple(s[k] * c[p[k]] for k in range(3)) for c in (a, b))
        images += [x + y, y + x]
    return min(images)


def parallel(x, y, u, v, z):
    """A F between [x0,x1] x [y0,y1] and [u0,u1] x [v0,v1] at distance z."""
    total = 0.0
    for i, j, k, l in itertools.product((0, 1), repeat=4):
        a, b = x[i] - u[k], y[j] - v[l]
        p, q = math.hypot(a, z), math.hypot(b, z)
        g = b * p * math.atan(b / p) + a * q * math.atan(a / q) - 0.5 * z * z * math.log(a * a + b * b + z * z)
        total += (-1) ** (i + j + k + l) * g
    return total / (2 * math.pi)


def perpendicular(x, y, u, v):
    """A F between [x0,x1] x [y0,y1] in one plane, x from the line where the planes meet, y along it, and [u0,u1] x [v0,v1] in the other."""
    total = 0.0
    for i, j, k, l in itertools.product((0, 1), repeat=4):
        r2, d = x[i] ** 2 + u[k] ** 2, y[j] - v[l]
        r = math.sqrt(r2)
        g = d * r * (math.atan(d / r) if r > 0 else 0.0)
        if r2 + d * d > 0:
            g -= 0.25 * (r2 - d * d) * math.log(r2 + d * d)
        total += (-1) ** (i + j + k + l) * g
    return total / (2 * math.pi)


def span(square, axis, scale=1 / 60):
    c, _, _, w = square
    return [(c[axis] - w) * scale, (c[axis] + w) * scale]


def free(p, q):
    """A F with nothing between, each cut at the other's horizon; 0 behind it."""
    (_, a, sa, _), (_, b, sb, _) = p, q
    if a == b:
        gap = (q[0][a] - p[0][a]) / 60
        if gap * sa <= 0 or gap * sb >= 0:
            return 0.0
        k, l = (a + 1) % 3, (a + 2) % 3
        return parallel(span(p, k), span(p, l), span(q, k), span(q, l), abs(gap))
    along = 3 - a - b

    def heights(of, over, axis, sign):
        low, high = sorted((h - over[0][axis] / 60) * sign for h in span(of, axis))
        return [max(low, 0.0), max(high, 0.0)]

    x, u = heights(p, q, b, sb), heights(q, p, a, sa)
    if x[1] <= 0 or u[1] <= 0:
        return 0.0
    return max(perpendicular(x, span(p, along), u, span(q, along)), 0.0)


def is_clear(p, q):
    """True if a plane of the inner cube's faces has both squares on its outer side."""
    return any(
        max(sign * h for of in (p, q) for h in span(of, axis, 1)) <= -15 for axis in range(3) for sign in (1, -1)
    )


def visible(task):
    """Share of the exchange of two squares of the walls that misses the inner cube."""
    p, q, seed = task
    if is_clear(p, q):
        return 1.0
    phi = 1.0
    for _ in range(40):
        phi = (1 + phi) ** 0.2
    shift = np.random.default_rng(seed).random(4)

    def points(square, a, b):
        c, axis, _, w = square
        out = [None] * 3
        out[axis] = np.full(1, c[axis] / 60)
        out[(axis + 1) % 3] = (c[(axis + 1) % 3] + w * (2 * a - 1)) / 60
        out[(axis + 2) % 3] = (c[(axis + 2) % 3] + w * (2 * b - 1)) / 60
        return out

    whole = seen = 0.0
    for start in range(0, N, CHUNK):
        n = np.arange(start + 1, start + CHUNK + 1, dtype=np.float64)
        t = [(shift[k] + n * phi ** -(k + 1)) % 1.0 for k in range(4)]
        x, y = points(p, t[0], t[1]), points(q, t[2], t[3])
        d = [y[k] - x[k] for k in range(3)]
        r2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
        weight = np.maximum(d[p[1]] * p[2], 0) * np.maximum(-d[q[1]] * q[2], 0) / r2**2
        enter, leave = np.zeros(CHUNK), np.ones(CHUNK)
        for k in range(3):
            with np.errstate(divide="ignore", invalid="ignore"):
                s, e = (-0.25 - x[k]) / d[k], (0.25 - x[k]) / d[k]
            enter = np.maximum(enter, np.minimum(s, e))
            leave = np.minimum(leave, np.maximum(s, e))
        whole += float(weight.sum())
        seen += float(weight[~(enter < leave)].sum())
    return seen / whole


def main():
    assert abs(parallel([0, 1], [0, 1], [0, 1], [0, 1], 1) - 0.199824895698387) < 1e-12
    assert abs(perpendicular([0, 1], [0, 1], [0, 1], [0, 1]) - 0.200043776075403) < 1e-12
    all_squares = squares()
    assert len(all_squares) == 654
    first = {}
    for i, p in enumerate(all_squares):
        # Any pair has an image whose first square is in the first wall of its cube.
        if p[1] != 0 or p[0][0] >= 0:
            continue
        for q in all_squares:
            if free(p, q) > 1e-13:
                first.setdefault(key(p[0], q[0]), (p, q))
    rows = sorted(first.items())
    walls = [(k, p, q) for k, (p, q) in rows if p[3] == q[3] == 3]
    print(f"{sum(not is_clear(p, q) for _, p, q in walls)} of {len(rows)} classes to be sampled", file=sys.stderr, flush=True)
    with ProcessPoolExecutor() as pool:
        shares = dict(zip((k for k, _, _ in walls), pool.map(visible, ((p, q, n) for n, (_, p, q) in enumerate(walls)), chunksize=16)))
    print("x1,y1,z1,x2,y2,z2,transfer,visible")
    for k, (p, q) in rows:
        print(",".join(map(str, k)) + f",{free(p, q):.12e},{shares.get(k, 1.0):.7g}")
    # Closure: what a square exchanges with all others is its area.
    worst = 0.0
    for p in all_squares:
        if p[1] == 0 and p[0][0] < 0:
            total = sum(free(p, q) * shares.get(key(p[0], q[0]), 1.0) for q in all_squares)
            worst = max(worst, abs(total / (p[3] / 30) ** 2 - 1))
    print(f"{len(rows)} classes; worst row sum {worst:.2e}", file=sys.stderr)


if __name__ == "__main__":
    main()
