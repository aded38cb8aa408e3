#!/usr/bin/env python3
"""Writes the OBJ meshes of cornell-box and cornell-glass from the published measurements (millimetres).

usage: python3 scenes/cornell-box/make.py

Every quad is split into two triangles that share no vertex with another quad, so no reader can smooth its edges away.
The ceiling has the published hole, which the lamp fills exactly.
"""
import os

HERE = os.path.dirname(os.path.abspath(__file__))

FLOOR = [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]
BACK = [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556.0, 548.8, 559.2)]
RIGHT = [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]
LEFT = [(552.8, 0, 0), (549.6, 0, 559.2), (556.0, 548.8, 559.2), (556.0, 548.8, 0)]
CEILING = [(556.0, 548.8, 0), (556.0, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]
LAMP = [(343.0, 548.8, 227.0), (343.0, 548.8, 332.0), (213.0, 548.8, 332.0), (213.0, 548.8, 227.0)]
SHORT = ([(130, 65), (82, 225), (240, 272), (290, 114)], 165)
TALL = ([(423, 247), (265, 296), (314, 456), (472, 406)], 330)


def frame(outer, inner):
    """The ring between two quads whose corners correspond."""
    return [[outer[i], outer[(i + 1) % 4], inner[(i + 1) % 4], inner[i]] for i in range(4)]


def block(base, height):
    """Top and four sides of an upright prism, normals outward (the bottom stands on the floor and is left out)."""
    top = [(x, height, z) for x, z in base]
    foot = [(x, 0, z) for x, z in base]
    return [top] + [[foot[(i + 1) % 4], top[(i + 1) % 4], top[i], foot[i]] for i in range(4)]


def write(folder, name, quads):
    path = os.path.join(HERE, "..", folder, "meshes", name + ".obj")
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="ascii", newline="\n") as out:
        out.write(f"# {name}: metres, made by scenes/cornell-box/make.py\n")
        for quad in quads:
            for corner in quad:
                out.write("v " + " ".join(f"{c / 1000:.4f}" for c in corner) + "\n")
        for i in range(len(quads)):
            a = 4 * i + 1
            out.write(f"f {a} {a + 1} {a + 2}\nf {a} {a + 2} {a + 3}\n")


for folder in ("cornell-box", "cornell-glass"):
    write(folder, "white", [FLOOR, BACK] + frame(CEILING, LAMP))
    write(folder, "red", [LEFT])
    write(folder, "green", [RIGHT])
    write(folder, "lamp", [LAMP])
write("cornell-box", "short-block", block(*SHORT))
write("cornell-box", "tall-block", block(*TALL))
