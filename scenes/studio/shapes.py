"""Curved solids of the studio as triangle meshes: (points, triangles, normals), numpy only."""
import numpy as np

TAU = 2 * np.pi


def smooth(points, tris):
    """Area-weighted vertex normals, shared by vertices at the same place; drops triangles without area."""
    p = points[tris]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    keep = np.linalg.norm(n, axis=1) > 1e-13
    tris, n = tris[keep], n[keep]
    _, place = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)
    total = np.zeros((place.max() + 1, 3))
    for corner in range(3):
        np.add.at(total, place[tris[:, corner]], n)
    normals = total[place]
    return points, tris, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def grid(points, wrap_u=False, wrap_v=False):
    """Two triangles per cell of a (nu, nv, 3) net."""
    nu, nv = points.shape[:2]
    index = np.arange(nu * nv).reshape(nu, nv)
    if wrap_u:
        index = np.concatenate([index, index[:1]], 0)
    if wrap_v:
        index = np.concatenate([index, index[:, :1]], 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    tris = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    return smooth(points.reshape(-1, 3), tris)


def join(*meshes):
    points, tris, normals, base = [], [], [], 0
    for p, t, n in meshes:
        points.append(p)
        tris.append(t + base)
        normals.append(n)
        base += len(p)
    return np.concatenate(points), np.concatenate(tris), np.concatenate(normals)


def outward(mesh):
    """Turns a closed mesh inside out if its signed volume is negative."""
    p, t, n = mesh
    q = p[t]
    if np.einsum("ij,ij->i", q[:, 0], np.cross(q[:, 1], q[:, 2])).sum() < 0:
        return p, t[:, ::-1].copy(), -n
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


def lathe(control, around=48, along=40, ripple=0.0, waves=0, raw=False):
    """Turns a profile of (radius, height) about y; with `ripple`, the radius swells and shrinks `waves` times around."""
    profile = np.asarray(control, float) if raw else curve(control, along)
    r, y = np.maximum(profile[:, 0], 0)[:, None], profile[:, 1][:, None]
    w = np.linspace(0, TAU, around, endpoint=False)[None, :]
    r = r * (1 + ripple * np.cos(waves * w))
    mesh = grid(np.stack([r * np.cos(w), y + 0 * w, r * np.sin(w)], -1), wrap_v=True)
    return outward(mesh)


def ball_box(e=0.25, n=40, m=64):
    """Superellipsoid in [-1, 1]^3: e near 0 a box with rounded edges, 1 a sphere."""
    def power(x):
        return np.sign(x) * np.abs(x) ** e
    v = np.linspace(-np.pi / 2, np.pi / 2, n)[:, None]
    w = np.linspace(0, TAU, m, endpoint=False)[None, :]
    cv = np.abs(np.cos(v)) ** e
    cv[0] = cv[-1] = 0
    return outward(grid(np.stack([cv * power(np.cos(w)), power(np.sin(v)) + 0 * w, cv * power(np.sin(w))], -1), wrap_v=True))


def pillow(n=36):
    """A stuffed cushion in [-1, 1]^2 with pulled-in sides and pointed corners, thickness along z in [-1, 1]."""
    u, v = np.meshgrid(*[np.sin(np.linspace(-np.pi / 2, np.pi / 2, n))] * 2, indexing="ij")
    x, y = u * (1 - 0.1 * (1 - v * v)), v * (1 - 0.1 * (1 - u * u))
    z = ((1 - u * u) * (1 - v * v)) ** 0.45 * (1 + 0.03 * np.sin(9 * u + 4 * v))
    top, low = np.stack([x, y, z], -1).reshape(-1, 3), np.stack([x, y, -z], -1).reshape(-1, 3)
    _, tris, _ = grid(np.stack([x, y, 0 * z], -1))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    tris = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    return outward(smooth(np.concatenate([top, low]), np.concatenate([tris, tris[:, ::-1] + n * n])))


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
        net = np.concatenate([np.repeat(p[:1, None] - t[:1, None] * r[:1] * 0.6, around, 1), net,
                              np.repeat(p[-1:, None] + t[-1:, None] * r[-1:] * 0.6, around, 1)])
    return outward(grid(net, wrap_u=closed, wrap_v=True))


def torus(big, small, n=96, m=24):
    w = np.linspace(0, TAU, n, endpoint=False)
    return tube(np.stack([big * np.cos(w), 0 * w, big * np.sin(w)], -1), small, m, closed=True)


def shift(mesh, x=0.0, y=0.0, z=0.0):
    return mesh[0] + np.array([x, y, z]), mesh[1], mesh[2]


def level(mesh):
    """Number of triangles on flat faces: those whose three vertex normals are within 1 degree of one another."""
    n = mesh[2][mesh[1]]
    return int(((n * np.roll(n, 1, 1)).sum(2).min(1) > np.cos(np.radians(1))).sum())


def write_ply(path, mesh):
    p, t, n = mesh
    used, t = np.unique(t, return_inverse=True)
    t = t.reshape(-1, 3)
    vertices = np.concatenate([p[used], n[used]], 1).astype("<f4")
    faces = np.zeros(len(t), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, t
    head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(vertices)}\n"
    head += "".join(f"property float {a}\n" for a in ("x", "y", "z", "nx", "ny", "nz"))
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as out:
        out.write(head.encode() + vertices.tobytes() + faces.tobytes())
    return len(faces)
