#!/usr/bin/env python3
"""Writes meshes/partition.obj: the dividing wall with its door opening (metres).

usage: python3 scenes/door-ajar/make.py

The wall's two faces and the opening's reveal share their corner values exactly and have no T-junctions. The faces go
2 mm past floor, ceiling and side walls, so that no slit of zero width is left along them.
"""
import os

X = 0.075                               # half the wall's thickness
Y = [-0.002, 2.05, 2.502]               # below the floor, top of the opening, above the ceiling
Z = [-0.002, 1.0, 1.9, 3.602]           # beyond one side wall, hinge side, lock side, beyond the other

quads = []
for j in range(2):
    for k in range(3):
        if (j, k) == (0, 1):
            continue                    # the opening
        y0, y1, z0, z1 = Y[j], Y[j + 1], Z[k], Z[k + 1]
        quads.append([(X, y0, z0), (X, y1, z0), (X, y1, z1), (X, y0, z1)])
        quads.append([(-X, y0, z0), (-X, y0, z1), (-X, y1, z1), (-X, y1, z0)])
quads.append([(-X, Y[0], Z[1]), (-X, Y[1], Z[1]), (X, Y[1], Z[1]), (X, Y[0], Z[1])])   # hinge side, facing +z
quads.append([(-X, Y[0], Z[2]), (X, Y[0], Z[2]), (X, Y[1], Z[2]), (-X, Y[1], Z[2])])   # lock side, facing -z
quads.append([(-X, Y[1], Z[1]), (-X, Y[1], Z[2]), (X, Y[1], Z[2]), (X, Y[1], Z[1])])   # lintel, facing down

folder = os.path.join(os.path.dirname(os.path.abspath(__file__)), "meshes")
os.makedirs(folder, exist_ok=True)
with open(os.path.join(folder, "partition.obj"), "w", encoding="ascii", newline="\n") as out:
    out.write("# dividing wall, metres, made by scenes/door-ajar/make.py\n")
    for quad in quads:
        for corner in quad:
            out.write("v " + " ".join(f"{c:.4f}" for c in corner) + "\n")
    for i in range(len(quads)):
        a = 4 * i + 1
        out.write(f"f {a} {a + 1} {a + 2}\nf {a} {a + 2} {a + 3}\n")
