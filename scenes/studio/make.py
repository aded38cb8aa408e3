#!/usr/bin/env python3
"""Makes the studio: textures/* (textures.py), meshes/*.ply (shapes.py, kit.py) and scene.xml (metres, y up, back wall z = 0, window
wall x = 0).

usage: python3 scenes/studio/make.py          (needs numpy and Pillow; the result is the same every time)

Prints what it made: objects, materials, lights, triangles, and the share of triangles on flat faces.
"""
import glob
import os

import numpy as np

for old in glob.glob(os.path.join(os.path.dirname(os.path.abspath(__file__)), "meshes", "*.ply")):
    os.remove(old)

import kit
import shapes as sh
import textures
from kit import ball, mesh, note, num, plane, put, rng, slab

WIDE, HIGH, DEEP = 5.4, 2.75, 6.2
UP, DOWN, EAST, WEST, NORTH, SOUTH = (("x", -90),), (("x", 90),), (("y", 90),), (("y", -90),), (("y", 180),), ()
WARM = (1, .7, .41)                                    # colour of incandescent light


def warm(radiance):
    return ", ".join(num(radiance * c) for c in WARM)


def board(name, bsdf, lo, hi, radius=.004, **more):
    slab(name, bsdf, [(a + b) / 2 for a, b in zip(lo, hi)], [(b - a) / 2 for a, b in zip(lo, hi)], radius, **more)


def turned(point, turn):
    p = np.asarray(point, float)
    for axis, angle in turn:
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        p = {"x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
             "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])}[axis] @ p
    return p


# ---- the shell -----------------------------------------------------------------------------------------------------
WINDOWS = (("far", .6, 2.1), ("near", 3.3, 4.8))
SILL, HEAD = .32, 2.42
note("Shell; the window wall (x = 0) has two holes")
plane("floor", "floor", (WIDE / 2, 0, DEEP / 2), (WIDE / 2, DEEP / 2), UP)
plane("ceiling", "ceiling", (WIDE / 2, HIGH, DEEP / 2), (WIDE / 2, DEEP / 2), DOWN)
plane("wall-back", "back-wall", (WIDE / 2, HIGH / 2, 0), (WIDE / 2, HIGH / 2), SOUTH)
plane("wall-front", "plaster", (WIDE / 2, HIGH / 2, DEEP), (WIDE / 2, HIGH / 2), NORTH)
plane("wall-right", "plaster", (WIDE, HIGH / 2, DEEP / 2), (DEEP / 2, HIGH / 2), WEST)
strips = [("a", 0, .6, 0, HIGH), ("b", 2.1, 3.3, 0, HIGH), ("c", 4.8, DEEP, 0, HIGH)]
for name, z0, z1 in WINDOWS:
    strips += [(name + "-low", z0, z1, 0, SILL), (name + "-high", z0, z1, HEAD, HIGH)]
for name, z0, z1, y0, y1 in strips:
    plane("wall-window-" + name, "plaster", (0, (y0 + y1) / 2, (z0 + z1) / 2), ((z1 - z0) / 2, (y1 - y0) / 2), EAST)
board("skirting-back", "wall-trim", (0, .0008, -.01), (WIDE, .13, .016), .005)
board("skirting-left", "trim", (-.01, .0008, .0165), (.016, .13, DEEP), .005)
board("skirting-right", "trim", (WIDE - .016, .0008, .0165), (WIDE + .01, .13, DEEP), .005)
board("cornice-back", "trim", (0, HIGH - .09, -.01), (WIDE, HIGH + .01, .05), .02)
board("cornice-left", "trim", (-.01, HIGH - .0895, .0505), (.05, HIGH + .01, DEEP), .02)
board("rail-back", "wall-trim", (0, .86, -.01), (WIDE, .9, .022), .006)
for name, x0, x1 in (("left", .2, .98), ("middle", 1.12, 3.48), ("right", 3.62, 5.2)):
    for part, lo, hi in (("low", (x0, 1.0, -.004), (x1, 1.03, .014)), ("high", (x0, 2.47, -.004), (x1, 2.5, .014)),
                         ("west", (x0, 1.0305, -.004), (x0 + .03, 2.4695, .0138)), ("east", (x1 - .03, 1.0305, -.004), (x1, 2.4695, .0138))):
        board(f"moulding-{name}-{part}", "wall-trim", lo, hi, .006)

note("Windows, open to the sky: lining, architrave, sashes")
for name, z0, z1 in WINDOWS:
    mid = (z0 + z1) / 2
    for part, lo, hi in (("sill", (-.2, SILL - .02, z0 - .03), (.06, SILL + .02, z1 + .03)), ("head", (-.2, HEAD - .001, z0), (.001, HEAD + .03, z1)),
                         ("jamb-far", (-.2, SILL + .0205, z0 - .03), (.001, HEAD - .0015, z0 + .001)),
                         ("jamb-near", (-.2, SILL + .0205, z1 - .001), (.001, HEAD - .0015, z1 + .03)),
                         ("casing-far", (-.005, SILL + .021, z0 - .085), (.02, HEAD + .0795, z0 - .005)),
                         ("casing-near", (-.005, SILL + .021, z1 + .005), (.02, HEAD + .0795, z1 + .085)),
                         ("casing-head", (-.005, HEAD + .08, z0 - .1), (.026, HEAD + .17, z1 + .1))):
        board(f"window-{name}-{part}", "trim", lo, hi, .004)
    for part, a, b in (("far", z0 + .0015, mid - .002), ("near", mid + .002, z1 - .0015)):
        for side, lo, hi in (("hinge", (-.1, SILL + .021, a), (-.05, HEAD - .002, a + .055)), ("lock", (-.1, SILL + .021, b - .055), (-.05, HEAD - .002, b)),
                             ("low", (-.099, SILL + .0215, a + .0555), (-.051, SILL + .1, b - .0555)), ("high", (-.099, HEAD - .06, a + .0555), (-.051, HEAD - .0025, b - .0555)),
                             ("bar", (-.09, 1.7, a + .0555), (-.06, 1.728, b - .0555))):
            board(f"sash-{name}-{part}-{side}", "trim", lo, hi, .004)
    for end, at in (("far", z0 - .42), ("near", z1 - .1)):
        put("curtain", f"curtain-{name}-{end}", "curtain", (.11, .03, at))
    put("post", f"rod-{name}", "brass", (.11, 2.53, max(z0 - .55, .03)), (1.1, z1 - z0 + 1.1, 1.1), (("x", 90),))
    ball(f"rod-{name}-knob", "brass", (.11, 2.53, z1 + .57), .026)

note("Lights in the ceiling")
for i, (x, z) in enumerate(((4.3, 2.6), (2.7, 3.6))):
    put("disk", f"downlight-{i}", "lamp-face", (x, HIGH - .001, z), (.09, .09, 1), DOWN, warm(34))

# ---- along the back wall ---------------------------------------------------------------------------------------------
note("Sofa")
SX = 2.3
slab("sofa-base", "sofa", (SX, .215, .55), (1.13, .095, .44), .03, n=6)
slab("sofa-back", "sofa", (SX, .47, .155), (1.13, .33, .085), .05, n=10, bulge=(0, .004, .01))
for side, name in ((-1, "left"), (1, "right")):
    slab(f"sofa-arm-{name}", "sofa", (SX + side * 1.05, .36, .57), (.105, .245, .475), .06, n=14, bulge=(.012, .01, .006), wave=.0018)
    slab(f"sofa-seat-{name}", "sofa", (SX + side * .472, .385, .63), (.468, .085, .425), .05, n=26, bulge=(0, .032, .012), wave=.003)
    slab(f"sofa-cushion-{name}", "sofa", (SX + side * .472, .67, .315), (.462, .235, .095), .075, (("x", -11),), n=26, bulge=(.01, .012, .05), wave=.004)
mesh("piping-seat", sh.seam(.468, .425, .05, .0055, 180), False)
for side, name in ((-1, "left"), (1, "right")):
    for y, place in ((.437, "top"), (.333, "low")):
        put("piping-seat", f"sofa-piping-{name}-{place}", "piping", (SX + side * .472, y, .63))
for i, (x, z) in enumerate(((-1.02, .17), (1.02, .17), (-1.02, .93), (1.02, .93))):
    put("leg", f"sofa-leg-{i}", "walnut-matt", (SX + x, .0005, z), (1, .125, 1))
for i, (kind, cloth, x, y, z, lean, yaw, size) in enumerate((("pillow", "rust", -.74, .665, .5, -20, 20, .235), ("pillow-soft", "striped", -.42, .645, .56, -26, 4, .21),
                                                             ("pillow-soft", "ochre", .74, .665, .5, -20, -20, .235))):
    put(kind, f"pillow-{i}", cloth, (SX + x, y, z), (size, size, .085), (("x", lean), ("y", yaw)))
# A throw over the right arm, from the seat up over it and down its outer side.
path = sh.curve([(-.3, .485), (-.19, .497), (-.13, .56), (-.11, .617), (0, .632), (.105, .62), (.132, .54), (.14, .4), (.15, .22)], 60)
v = np.linspace(-1, 1, 44)[None, :]
s = np.linspace(0, 1, 60)[:, None]
swell = .006 * (np.sin(9 * v + 2.5 * s) + .6 * np.sin(17 * v - 4 * s)) * (.3 + s)
mesh("throw", sh.grid(np.stack(np.broadcast_arrays(path[:, :1] + swell, path[:, 1:] + .004 + .003 * np.sin(11 * v) * (1 - s), .235 * v * (1 - .05 * np.sin(3 * s)) + .02 * s), -1)))
put("throw", "throw", "throw", (SX + 1.05, .004, .66))

note("Painting with its lamp")
for part, lo, hi in (("low", (-.66, -.46, 0), (.66, -.425, .035)), ("high", (-.66, .425, 0), (.66, .46, .035)), ("west", (-.66, -.4248, 0), (-.625, .4248, .0348)),
                     ("east", (.625, -.4248, 0), (.66, .4248, .0348))):
    board("frame-" + part, "oak", np.add(lo, (2.3, 1.7, .012)), np.add(hi, (2.3, 1.7, .012)), .003)
plane("painting-mat", "sheet", (2.3, 1.7, .024), (.63, .43), SOUTH)
plane("painting", "painting", (2.3, 1.7, .026), (.5, .32), SOUTH)
board("picture-lamp", "brass", (2.08, 2.238, .12), (2.52, 2.262, .165), .008)
plane("picture-lamp-face", "lamp-face", (2.3, 2.2372, .1425), (.2, .015), DOWN, warm(60))
put("post", "picture-lamp-arm", "brass", (2.3, 2.255, .01), (.5, .13, .5), (("x", 90),))

note("Floor lamp")
put("lamp-foot", "floor-lamp-foot", "steel", (.88, .0005, .4))
put("lamp-shade", "floor-lamp-shade", "shade", (.88, 1.34, .4), (1.05, 1.05, 1.05), (), "shade.hdr")
put("disk", "floor-lamp-up", "lamp-face", (.88, 1.6, .4), (.15, .15, 1), UP, warm(9))
put("disk", "floor-lamp-down", "lamp-face", (.88, 1.38, .4), (.18, .18, 1), DOWN, warm(9))

note("Plant")
PX, PZ = 3.72, .5
put("pot", "plant-pot", "pot", (PX, .0005, PZ), (1.05, 1, 1.05))
put("disk", "plant-soil", "soil", (PX, .3, PZ), (.166, .166, 1), UP)
stalks = [[(0, .29, 0), (.02, .6, .01), (-.03, 1.0, .03), (.02, 1.45, .02)], [(.03, .29, .03), (.09, .6, .06), (.12, .95, .1), (.2, 1.2, .12)],
          [(-.03, .29, .02), (-.08, .55, .07), (-.15, .85, .1), (-.17, 1.08, .14)]]
stems, leaves = [], []
for k, stalk in enumerate(stalks):
    line = sh.curve(stalk, 40)
    stems.append(sh.tube(line, np.linspace(.011, .005, 40), 10))
    for i in range((26, 18, 16)[k]):
        t = .25 + .75 * i / (25, 17, 15)[k]
        foot = line[min(int(t * 39), 39)]
        heading = 137.5 * i + 60 * k + rng.uniform(-15, 15)
        rise = 6 + 58 * t**2 + rng.uniform(-8, 8)
        reach = .035 + .04 * (1 - t)
        h, r = np.radians(heading), np.radians(rise + 12)
        # Turning by +heading about y takes +x to (cos, ., -sin).
        tip = foot + reach * np.array([np.cos(h) * np.cos(r), np.sin(r), -np.sin(h) * np.cos(r)])
        if tip[2] < -.2:
            continue
        stems.append(sh.tube(sh.curve([foot, (foot + tip) / 2 + [0, .006, 0], tip], 5), .0032, 6))
        leaves.append((i % 3, tip, rng.uniform(.2, .29) * (1.1 - .35 * t), rng.uniform(-16, 16), rise, heading))
mesh("stems", sh.join(*stems), False)
put("stems", "plant-stems", "stem", (PX, 0, PZ))
for i, (kind, tip, size, roll, rise, heading) in enumerate(leaves):
    back = np.sin(np.radians(heading))                  # how far it points at the wall behind
    size *= 1 - .45 * max(back, 0)
    put(f"leaf-{kind}", f"plant-leaf-{i}", "leaf", np.add(tip, (PX, 0, PZ)), size, (("x", roll), ("z", rise), ("y", heading)))

note("Sideboard with slats, lamp, vase, books; round mirror above")
BX0, BX1, BZ = 4.02, 5.28, .46
board("sideboard-top", "oak", (BX0 - .01, .755, .02), (BX1 + .01, .785, BZ + .02), .005)
board("sideboard-bottom", "oak", (BX0, .15, .025), (BX1, .175, BZ + .005), .004)
for name, x in (("west", BX0), ("east", BX1 - .025)):
    board("sideboard-" + name, "oak", (x, .1755, .025), (x + .025, .7545, BZ + .005), .004)
board("sideboard-inside", "oak", (BX0 + .0255, .1755, .03), (BX1 - .0255, .7545, BZ - .03), .002)
slats = np.linspace(BX0 + .03, BX1 - .03, 41)
for i, x in enumerate(slats[:-1]):
    board(f"sideboard-slat-{i}", "oak", (x + .003, .18, BZ - .0295), (slats[i + 1] - .003, .75, BZ - .008), .009)
for i, x in enumerate((4.6, 4.7)):
    put("knob", f"sideboard-knob-{i}", "brass", (x, .5, BZ - .009), 1, (("x", 90),))
for i, (x, z) in enumerate(((BX0 + .1, .08), (BX1 - .1, .08), (BX0 + .1, BZ - .05), (BX1 - .1, BZ - .05))):
    put("leg", f"sideboard-leg-{i}", "walnut-matt", (x, .0005, z), (.9, .15, .9))
put("disk", "mirror-face", "mirror", (4.62, 1.6, .028), (.405, .405, 1))
put("ring", "mirror-frame", "brass", (4.62, 1.6, .03), .41, (("x", 90),))
put("vase-ribbed", "table-lamp-foot", "ceramic", (4.93, .7858, .24), (1.15, 1.1, 1.15))
put("post", "table-lamp-stem", "brass", (4.93, 1.03, .24), (.6, .22, .6))
put("lamp-shade", "table-lamp-shade", "shade", (4.93, 1.1, .24), (.82, .82, .82), (), "shade.hdr")
put("disk", "table-lamp-up", "lamp-face", (4.93, 1.29, .24), (.12, .12, 1), UP, warm(9))
put("disk", "table-lamp-down", "lamp-face", (4.93, 1.135, .24), (.145, .145, 1), DOWN, warm(9))
put("vase-tall", "vase-tall", "ink", (4.2, .7858, .22), .95)
twigs = []
for k in range(7):
    a, tall = k * 2.4, rng.uniform(.33, .55)
    lean = .05 + .16 * rng.random()
    twig = sh.curve([(0, .02, 0), (.02 * np.cos(a), .33, .02 * np.sin(a)), (lean * .55 * np.cos(a + .2), .33 + tall * .5, lean * .5 * np.sin(a)),
                     (lean * np.cos(a), .33 + tall, lean * np.sin(a) * .7)], 22)
    twigs.append(sh.tube(twig, np.linspace(.0022, .001, 22), 6))
    for q in twig[10:]:
        side = rng.normal(0, .012, 3)
        twigs.append(sh.shift((lambda b: (b[0] * rng.uniform(.005, .009),) + b[1:])(sh.ball(7, 9)), *(q + side)))
mesh("twigs", sh.join(*twigs), False)
put("twigs", "twigs", "straw", (4.2, .786, .22))


def book(name, cover, at, width, height, thick, turn):
    """`at` is the cover's corner on the spine; the cover lies in x (width), y (height), z (thickness, centred)."""
    put("book", name, f"book-{cover}", at, (width, height, thick), turn)
    put("cube", name + "-pages", "paper", np.add(at, turned((.52 * width, .5 * height, 0), turn)), (.44 * width, .485 * height, .4195 * thick), turn)


y = .7862
for i, (cover, w, h, t, yaw) in enumerate(((3, .17, .24, .032, 82), (0, .165, .235, .026, 96), (6, .15, .21, .03, 88))):
    book(f"book-pile-{i}", cover, (4.42, y + t / 2, .14 + .06), w, h, t, (("x", -90), ("y", yaw)))
    y += t + .0006
put("orange", "ornament", "bronze", (4.53, y + .0425, .13), .042)

# ---- in the room -----------------------------------------------------------------------------------------------------
note("Leather armchair by the window")
TURN, BASE = (("y", 66),), (1.02, 0, 2.3)


def chair(kind, name, bsdf, at, half, first=(), **more):
    place = np.add(BASE, turned(at, TURN))
    turn = tuple(first) + TURN
    slab(name, bsdf, place, half, kind, turn, **more) if isinstance(kind, float) else put(kind, name, bsdf, place, half, turn)


chair(.03, "armchair-frame", "leather", (0, .235, 0), (.37, .075, .36), n=8)
chair(.055, "armchair-seat", "leather", (0, .385, .05), (.275, .08, .335), n=22, bulge=(0, .03, .012), wave=.003)
chair(.06, "armchair-back", "leather", (0, .56, -.315), (.37, .27, .075), (("x", -9),), n=20, bulge=(0, .012, .02), wave=.003)
chair(.07, "armchair-cushion", "leather", (0, .62, -.17), (.27, .19, .075), (("x", -13),), n=22, bulge=(.006, .01, .04), wave=.004)
for side in (-1, 1):
    chair(.05, f"armchair-arm-{side + 1}", "leather", (.325 * side, .38, .02), (.055, .19, .36), n=16, bulge=(.008, .008, .004), wave=.002)
    for end in (-1, 1):
        chair("leg", f"armchair-leg-{side + 1}{end + 1}", "walnut-matt", (.31 * side, .0005, .29 * end), (.95, .165, .95))
chair("pillow", "armchair-pillow", "striped", (.03, .6, -.02), (.19, .19, .07), (("x", -24),))

note("Rug, coffee table and what stands on it")
RX, RZ = 2.45, 2.0
put("rug", "rug", "rug", (RX, .0005, RZ))
for name, x, turn in (("east", 1.395, ()), ("west", -1.395, (("y", 180),))):
    put("fringe", "rug-fringe-" + name, "sheet", (RX + x, .001, RZ), 1, turn)
TX, TZ, TOP = 2.5, 2.05, .41
slab("table-top", "walnut", (TX, TOP - .016, TZ), (.62, .016, .34), .009, n=4, round_steps=5)
slab("table-shelf", "walnut", (TX, .17, TZ), (.55, .01, .27), .006, n=2)
for i, (a, b) in enumerate(((-1, -1), (1, -1), (-1, 1), (1, 1))):
    put("post", f"table-leg-{i}", "steel", (TX + .555 * a, .0125, TZ + .275 * b), (1.1, TOP - .0445, 1.1))
put("bowl", "fruit-bowl", "ceramic", (TX - .3, TOP + .0005, TZ + .02), 1.0)
for i, (kind, bsdf, at, size) in enumerate((("apple", "apple", (-.36, .04, .0), .95), ("apple", "lime", (-.27, .04, .08), .95), ("orange", "orange", (-.27, .077, -.02), .039),
                                            ("apple", "apple", (-.34, .038, .075), .9), ("orange", "orange", (-.31, .125, .035), .036))):
    put(kind, f"fruit-{i}", bsdf, (TX + at[0], TOP + at[1], TZ + at[2]), size, (("z", 18 * (i % 3 - 1)),) if kind == "apple" else ())
book("book-flat-0", 1, (TX - .04, TOP + .0205, TZ + .28), .2, .28, .04, (("x", -90), ("y", 6)))
book("book-flat-1", 4, (TX - .02, TOP + .0565, TZ + .25), .17, .23, .03, (("x", -90), ("y", -9)))
put("mug", "mug", "celadon", (TX + .07, TOP + .0722, TZ + .14), .95, (("y", -50),))
slab("tray", "oak", (TX + .38, TOP + .0085, TZ + .02), (.17, .008, .24), .007)
put("carafe", "carafe", "glass", (TX + .36, TOP + .0172, TZ - .1))
put("tumbler", "tumbler-0", "glass", (TX + .43, TOP + .0172, TZ + .05))
put("tumbler", "tumbler-1", "glass", (TX + .34, TOP + .0172, TZ + .14))
book("book-shelf-0", 5, (TX + .05, .1965, TZ + .16), .21, .29, .032, (("x", -90), ("y", -4)))
book("book-shelf-1", 7, (TX + .06, .2265, TZ + .14), .19, .26, .026, (("x", -90), ("y", 7)))

note("Basket with a blanket; door and prints that the mirror sees")
put("basket", "basket", "straw", (3.62, .0005, 1.32), (1.0, 1.0, 1.0))
put("pillow-soft", "basket-blanket", "throw", (3.62, .29, 1.32), (.19, .19, .1), (("x", 80), ("y", 25)))
board("door", "trim", (3.1, .005, DEEP - .03), (3.95, 2.1, DEEP + .01), .004)
for i, (y0, y1) in enumerate(((.2, .9), (1.05, 1.95))):
    board(f"door-panel-{i}", "trim", (3.24, y0, DEEP - .042), (3.81, y1, DEEP - .025), .01)
for i, (x, y) in enumerate(((4.55, 1.9), (4.55, 1.3), (5.05, 1.9), (5.05, 1.3))):
    board(f"print-frame-{i}", "walnut-matt", (x - .2, y - .26, DEEP - .025), (x + .2, y + .26, DEEP + .005), .004)
    plane(f"print-{i}", "sheet", (x, y, DEEP - .026), (.175, .235), NORTH)
    put("disk", f"print-spot-{i}", ("terracotta", "ink", "celadon", "terracotta")[i], (x, y + .03, DEEP - .027), (.09 + .02 * (i % 2), .1, 1), NORTH)

textures.make()
body = "\n".join(kit.out)
with open(os.path.join(kit.HERE, "scene.xml"), "w", encoding="utf-8", newline="\n") as file:
    file.write(f"""<?xml version="1.0" encoding="utf-8"?>
<!-- Written by make.py: change that, not this. -->
<scene version="3.0.0">
	<default name="spp" value="64"/>
	<default name="width" value="256"/>
	<default name="height" value="144"/>
	<integrator type="path">
		<integer name="max_depth" value="-1"/>
	</integrator>
	<!-- At eye height of one who sits; level, with the picture shifted down, so that what is upright stands upright. -->
	<sensor type="perspective">
		<float name="fov" value="61"/>
		<string name="fov_axis" value="x"/>
		<float name="principal_point_offset_y" value="0.13"/>
		<float name="near_clip" value="0.01"/>
		<float name="far_clip" value="100"/>
		<transform name="to_world">
			<lookat origin="4.5, 1.28, 5.55" target="2.47, 1.28, 0.6" up="0, 1, 0"/>
		</transform>
		<sampler type="multijitter">
			<integer name="sample_count" value="$spp"/>
		</sampler>
		<film type="hdrfilm">
			<integer name="width" value="$width"/>
			<integer name="height" value="$height"/>
			<string name="pixel_format" value="rgb"/>
			<string name="component_format" value="float32"/>
			<rfilter type="box"/>
		</film>
	</sensor>
	<emitter type="envmap" id="sky">
		<string name="filename" value="textures/sky.hdr"/>
	</emitter>
	<emitter type="directional" id="sun">
		<vector name="direction" {kit.xyz(textures.SUN)}/>
		<rgb name="irradiance" value="50, 45, 37"/>
	</emitter>

{body}
</scene>
""")
size = sum(os.path.getsize(f) for kind in ("meshes", "textures") for f in glob.glob(os.path.join(kit.HERE, kind, "*")))
print(f"{kit.objects} objects, {kit.materials} materials, {kit.lamps} area lights and a sky, {kit.total} triangles, "
      f"{100 * kit.flat / kit.total:.2f} % on flat faces; {len(kit.meshes)} meshes, {sum(kit.meshes.values())} triangles, {size / 1e6:.2f} MB with textures")
