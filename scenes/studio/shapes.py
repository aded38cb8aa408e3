"""Curved solids of the studio as triangle meshes: (points, triangles, normals, texture coordinates), numpy only.

Texture coordinates are lengths along the surface in metres, unless a function says otherwise, so that a texture's scale is 1 / its
size in metres on every mesh.
"""
import numpy as np

TAU = 2 * np.pi


def smooth(points, tris, uv):
    """Area-weighted vertex normals, shared by vertices at the same place; drops triangles without area."""
    p = points[tris]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    keep = np.linalg.norm(n, axis=1) > 1e-11
    tris, n = tris[keep], n[keep]
    _, place = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((place.max() + 1, 3))
    for corner in range(3):
        np.add.at(total, place[tris[:, corner]], n)
    normals = total[place]
    return points, tris, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30), uv


def cells(nu, nv):
    index = np.arange(nu * nv).reshape(nu, nv)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)


def grid(points, wrap_u=False, wrap_v=False, unit=False):
    """Two triangles per cell of a (nu, nv, 3) net; uv is the mean length along the net, or with `unit` from 0 to 1."""
    if wrap_u:
        points = np.concatenate([points, points[:1]], 0)
    if wrap_v:
        points = np.concatenate([points, points[:, :1]], 1)
    steps = [np.linalg.norm(np.diff(points, axis=a), axis=2).mean(1 - a) for a in (0, 1)]
    u, v = [np.concatenate([[0], np.cumsum(s)]) for s in steps]
    if unit:
        u, v = u / max(u[-1], 1e-9), v / max(v[-1], 1e-9)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)
    return smooth(points.reshape(-1, 3), cells(*points.shape[:2]), uv)


def join(*meshes):
    base = np.cumsum([0] + [len(m[0]) for m in meshes])
    tris = np.concatenate([m[1] + b for m, b in zip(meshes, base)])
    return np.concatenate([m[0] for m in meshes]), tris, np.concatenate([m[2] for m in meshes]), np.concatenate([m[3] for m in meshes])


def outward(mesh):
    """Turns a closed mesh inside out if its signed volume is negative."""
    p, t, n, uv = mesh
    q = p[t]
    if np.einsum("ij,ij->i", q[:, 0], np.cross(q[:, 1], q[:, 2])).sum() < 0:
        return p, t[:, ::-1].copy(), -n, uv
    return mesh


def curve(control, n):
    """n points along a Catmull-Rom spline through the control points."""
    c = np.asarray(control, float)
    c = np.concatenate([[2 * c[0] - c[1]], c, [2 * c[-1] - c[-2]]])
    t = np.linspace(0, len(c) - 3 - 1e-9, n)
    i = t.astype(int)
    f = (t - i)[:, None]
    a, b, d, e = c[i], c[i + 1], c[i + 2], c[i + 3]
    return 0.5 * (2 * b + (d - a) * f + (2 * a - 5 * b + 4 * d - e) * f**2 + (3 * b - a - 3 * d + e) * f**3)


def lathe(control, around=48, along=40, ripple=0.0, waves=0, raw=False, unit=False):
    """Turns a profile of (radius, height) about y; with `ripple`, the radius swells and shrinks `waves` times around."""
    profile = np.asarray(control, float) if raw else curve(control, along)
    r, y = np.maximum(profile[:, 0], 0)[:, None], profile[:, 1][:, None]
    w = np.linspace(0, TAU, around, endpoint=False)[None, :]
    r = r * (1 + ripple * np.cos(waves * w))
    return outward(grid(np.stack([r * np.cos(w), y + 0 * w, r * np.sin(w)], -1), wrap_v=True, unit=unit))


def ball(n=20, m=32):
    v = np.linspace(-np.pi / 2, np.pi / 2, n)[:, None]
    w = np.linspace(0, TAU, m, endpoint=False)[None, :]
    c = np.cos(v)
    return outward(grid(np.stack([c * np.cos(w), np.sin(v) + 0 * w, c * np.sin(w)], -1), wrap_v=True))


def slab(half, radius, n=2, round_steps=4, bulge=(0, 0, 0), wave=0.0, seed=0):
    """A box with rounded edges, six nets of texture coordinates in metres (u along the longest edge, as the grain runs).

    bulge: how far the middle of the x, y and z faces stands out; wave: height of soft folds, n: cells of a face's flat part.
    """
    h, rng = np.asarray(half, float), np.random.default_rng(seed)
    radius = min(radius, .98 * h.min())
    turn = radius * np.tan(np.linspace(0, np.pi / 4, round_steps + 1))[1:]
    lines = [np.concatenate([-(k + turn[::-1]), np.linspace(-k, k, n + 1), k + turn]) for k in h - radius]
    freq, phase = rng.uniform(2, 7, (4, 3)), rng.uniform(0, TAU, 4)
    longest = int(np.argmax(h))
    faces = []
    for axis in range(3):
        i, j = [a for a in range(3) if a != axis]
        if j == longest:
            i, j = j, i
        for sign in (-1, 1):
            s, t = np.meshgrid(lines[i], lines[j], indexing="ij")
            p = np.zeros(s.shape + (3,))
            p[..., i], p[..., j], p[..., axis] = s, t, sign * h[axis]
            inner = np.clip(p, -(h - radius), h - radius)
            d = p - inner
            d /= np.linalg.norm(d, axis=-1, keepdims=True)
            q = inner + radius * d
            a = 1 - np.clip(q / h, -1, 1) ** 2
            push = [bulge[k] * q[..., k] / h[k] * a[..., (k + 1) % 3] * a[..., (k + 2) % 3] for k in range(3)]
            if wave:
                q = q + d * wave * sum(np.sin(q @ f + o) for f, o in zip(freq * 2.2, phase))[..., None]
            q = q + np.stack(push, -1)
            tris = cells(*s.shape)
            corner = q.reshape(-1, 3)[tris]
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(0)
            tris = tris if normal[axis] * sign > 0 else tris[:, ::-1].copy()
            # Boards of one kind differ in where they were cut from the same picture.
            uv = np.stack([s, t], -1).reshape(-1, 2) + rng.uniform(0, 3, 2) * (not wave)
            faces.append((q.reshape(-1, 3), tris, np.zeros((s.size, 3)), uv))
    p, t, _, uv = join(*faces)
    return smooth(p, t, uv)


def pillow(n=36, dents=0.0, seed=1):
    """A stuffed cushion in [-1, 1]^2 with pulled-in sides and pointed corners, thickness along z in [-1, 1]; uv in [0, 1]."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(*[np.sin(np.linspace(-np.pi / 2, np.pi / 2, n))] * 2, indexing="ij")
    x, y = u * (1 - 0.09 * (1 - v * v)), v * (1 - 0.09 * (1 - u * u))
    folds = sum(np.sin(a * u + b * v + c) for a, b, c in rng.uniform(2, 6, (5, 3))) / 5
    # Stuffing pulls short creases towards the corners.
    crease = np.cos(9 * np.arctan2(v, u)) * np.clip(np.hypot(u, v) - .55, 0, 1)
    z = ((1 - u * u) * (1 - v * v)) ** 0.42 * (1 + 0.05 * folds + .09 * crease)
    z = z - dents * np.exp(-((u - .05) ** 2 / .06 + (v - .75) ** 2 / .25))
    uv = np.stack([(1 + u) / 2, (1 - v) / 2], -1).reshape(-1, 2)
    top, low = np.stack([x, y, z], -1).reshape(-1, 3), np.stack([x, y, -np.abs(z)], -1).reshape(-1, 3)
    tris = cells(n, n)
    return outward(smooth(np.concatenate([top, low]), np.concatenate([tris, tris[:, ::-1] + n * n]), np.concatenate([uv, uv])))


def tube(path, radius, around=16, closed=False, cap=True):
    """A round tube along a polyline of 3-d points; `radius` is a number or one value per point."""
    p = np.asarray(path, float)
    n = len(p)
    t = np.roll(p, -1, 0) - np.roll(p, 1, 0) if closed else np.gradient(p, axis=0)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    side = np.zeros_like(p)
    s = np.cross(t[0], [0.31, 0.9, 0.28])
    for i in range(n):
        s = s - t[i] * (s @ t[i])
        s = s / np.linalg.norm(s)
        side[i] = s
    other = np.cross(t, side)
    w = np.linspace(0, TAU, around, endpoint=False)
    if closed:                                          # undo the frame's twist along the loop, evenly
        s = side[-1] - t[0] * (side[-1] @ t[0])
        twist = np.arctan2(s @ other[0], s @ side[0])
        w = w[None, :] - twist * np.arange(n)[:, None] / n
    else:
        w = np.broadcast_to(w, (n, around))
    r = np.broadcast_to(radius, (n,))[:, None, None]
    net = p[:, None] + r * (np.cos(w)[..., None] * side[:, None] + np.sin(w)[..., None] * other[:, None])
    if not closed and cap:                              # rounded ends
        ends = [(p[0] - t[0] * r[0, 0, 0] * .6)[None], (p[-1] + t[-1] * r[-1, 0, 0] * .6)[None]]
        net = np.concatenate([np.repeat(ends[0][:, None], around, 1), net, np.repeat(ends[1][:, None], around, 1)])
    return outward(grid(net, wrap_u=closed, wrap_v=True))


def torus(big, small, n=96, m=24):
    w = np.linspace(0, TAU, n, endpoint=False)
    return tube(np.stack([big * np.cos(w), 0 * w, big * np.sin(w)], -1), small, m, closed=True)


def seam(half_x, half_z, corner, radius, n=90):
    """Piping: a closed tube along a rounded rectangle in the plane y = 0."""
    w = np.linspace(0, TAU, n, endpoint=False)
    c, s = np.cos(w), np.sin(w)
    k = 2 / np.clip(half_x / corner, 2, 9)              # superellipse: nearly straight sides, round corners
    return tube(np.stack([half_x * np.sign(c) * np.abs(c) ** k, 0 * w, half_z * np.sign(s) * np.abs(s) ** k], -1), radius, 8, closed=True)


def shift(mesh, x=0.0, y=0.0, z=0.0):
    return (mesh[0] + np.array([x, y, z]),) + mesh[1:]


def level(mesh):
    """Number of triangles on flat faces: those whose three vertex normals are within 1 degree of one another."""
    n = mesh[2][mesh[1]]
    return int(((n * np.roll(n, 1, 1)).sum(2).min(1) > np.cos(np.radians(1))).sum())


def write_ply(path, mesh, textured):
    p, t, n, uv = mesh
    used, t = np.unique(t, return_inverse=True)
    t = t.reshape(-1, 3)
    columns = [p[used], n[used]] + ([uv[used]] if textured else [])
    vertices = np.concatenate(columns, 1).astype("<f4")
    faces = np.zeros(len(t), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, t
    head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(vertices)}\n"
    head += "".join(f"property float {a}\n" for a in ("x", "y", "z", "nx", "ny", "nz", "u", "v")[:vertices.shape[1]])
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as out:
        out.write(head.encode() + vertices.tobytes() + faces.tobytes())
    return len(faces)
