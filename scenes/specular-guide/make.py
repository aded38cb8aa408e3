"""Writes the meshes of this scene: a tube whose inside mirrors, and a black shell around it with a rim at the entry.

The tube is cut along its length as well: rays leave slivers by a wider margin, which would show after some dozen mirrors.

python3 make.py
"""

import math
import struct
from pathlib import Path

SIDES = 360
PIECES = 24
FOLDER = Path(__file__).resolve().parent / "meshes"


def ring(radius, z):
    # A polygon of the circle's area.
    step = 2 * math.pi / SIDES
    corner = radius * math.sqrt(step / math.sin(step))
    return [(corner * math.cos(k * step), corner * math.sin(k * step), z) for k in range(SIDES)]


def band(first, second):
    """Triangles between two rings, given the numbers of their first corners."""
    faces = []
    for k in range(SIDES):
        a, b = first + k, first + (k + 1) % SIDES
        c, d = second + (k + 1) % SIDES, second + k
        faces += [(a, b, c), (a, c, d)]
    return faces


def write(name, rings):
    vertices = [corner for radius, z in rings for corner in ring(radius, z)]
    faces = [face for k in range(len(rings) - 1) for face in band(k * SIDES, (k + 1) * SIDES)]
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with open(FOLDER / name, "wb") as f:
        f.write(header.encode())
        f.writelines(struct.pack("<3f", *v) for v in vertices)
        f.writelines(struct.pack("<B3i", 3, *face) for face in faces)


FOLDER.mkdir(exist_ok=True)
write("tube.ply", [(0.5, k / PIECES) for k in range(PIECES + 1)])
write("shell.ply", [(0.5, 0), (0.52, 0), (0.52, 1)])
