#!/usr/bin/env python3
"""Makes the studio: meshes/*.ply (shapes.py, kit.py) and scene.xml (metres, y up, back wall z = 0, window wall x = 0).

usage: python3 scenes/studio/make.py          (needs numpy; the result is the same every time)

Prints what it made: objects, materials, area lights, triangles, and the share of triangles on flat faces.
"""
import os

import numpy as np

import kit
from kit import ball, box, bulb, note, plane, put

WIDE, HIGH, DEEP = 5.4, 2.7, 5.0
UP, DOWN, EAST, WEST, NORTH, SOUTH = (("x", -90),), (("x", 90),), (("y", 90),), (("y", -90),), (("y", 180),), ()


def soft(name, bsdf, at, half, turn=()):
    put("soft-box", name, bsdf, at, half, turn)


def crisp(name, bsdf, at, half, turn=()):
    put("crisp-box", name, bsdf, at, half, turn)


note("Shell; the window wall (x = 0) has a hole of z 1.1 to 2.5, y 0.85 to 2.25")
plane("floor", "floor", (WIDE / 2, 0, DEEP / 2), (WIDE / 2, DEEP / 2), UP)
plane("ceiling", "ceiling", (WIDE / 2, HIGH, DEEP / 2), (WIDE / 2, DEEP / 2), DOWN)
plane("wall-back", "accent", (WIDE / 2, HIGH / 2, 0), (WIDE / 2, HIGH / 2), SOUTH)
plane("wall-front", "plaster", (WIDE / 2, HIGH / 2, DEEP), (WIDE / 2, HIGH / 2), NORTH)
plane("wall-right", "plaster", (WIDE, HIGH / 2, DEEP / 2), (DEEP / 2, HIGH / 2), WEST)
for name, z0, z1, y0, y1 in (("a", 0, 1.1, 0, HIGH), ("b", 2.5, DEEP, 0, HIGH), ("low", 1.1, 2.5, 0, .85), ("high", 1.1, 2.5, 2.25, HIGH)):
    plane("wall-window-" + name, "plaster", (0, (y0 + y1) / 2, (z0 + z1) / 2), ((z1 - z0) / 2, (y1 - y0) / 2), EAST)
box("skirting-back", "trim", (0, .001, -.001), (WIDE, .09, .015))
box("skirting-left", "trim", (-.001, .001, .015), (.015, .09, DEEP))

note("Window: frame, pane, sky panel outside")
for name, lo, hi in (("low", (-.14, .82, 1.06), (.03, .87, 2.54)), ("high", (-.14, 2.23, 1.06), (.02, 2.28, 2.54)),
                     ("near", (-.14, .869, 2.48), (.02, 2.231, 2.53)), ("far", (-.14, .869, 1.07), (.02, 2.231, 1.12)),
                     ("middle", (-.08, .869, 1.785), (-.03, 2.231, 1.815)), ("bar", (-.079, 1.535, 1.119), (-.031, 1.565, 2.481))):
    box("window-" + name, "trim", lo, hi)
plane("window-pane", "pane", (-.055, 1.55, 1.8), (.69, .69), EAST)
plane("sky-panel", "lamp-face", (-.4, 1.6, 1.8), (1.3, 1.1), EAST, "7.5, 8.6, 10")
for name, z in (("far", .62), ("near", 2.42)):
    put("curtain", "curtain-" + name, "curtain", (.1, .04, z))
put("cord", "curtain-rod", "brass", (.1, 2.395, .5), (2.2, 2.55, 2.2), (("x", 90),))
ball("curtain-knob", "brass", (.1, 2.395, .485), .028)

note("Ceiling")
for name, x in (("left", 1.5), ("right", 3.9)):
    box(f"panel-{name}-body", "trim", (x - .52, 2.672, 1.93), (x + .52, 2.701, 2.27))
    plane(f"panel-{name}", "lamp-face", (x, 2.671, 2.1), (.5, .15), DOWN, "7, 6.6, 6")
put("cord", "pendant-cord", "ink", (2.55, 2.16, 2.2), (1, .545, 1))
put("pendant", "pendant-shade", "copper", (2.55, 1.86, 2.2))
bulb("pendant-bulb", (2.55, 1.95, 2.2), .055, "46, 33, 18")

note("Sofa against the back wall")
soft("sofa-base", "sofa", (2.2, .265, .56), (1.08, .14, .45))
soft("sofa-back", "sofa", (2.2, .6, .19), (.98, .31, .11))
soft("sofa-arm-left", "sofa", (1.19, .42, .56), (.115, .26, .46))
soft("sofa-arm-right", "sofa", (3.21, .42, .56), (.115, .26, .46))
for i, x in enumerate((1.755, 2.645)):
    soft(f"sofa-seat-{i}", "seat", (x, .487, .66), (.443, .085, .35))
    soft(f"sofa-cushion-{i}", "seat", (x, .775, .385), (.43, .215, .1), (("x", -10),))
for i, (x, z) in enumerate(((1.22, .2), (3.18, .2), (1.22, .93), (3.18, .93))):
    put("stub-leg", f"sofa-leg-{i}", "walnut", (x, .0005, z), (1, 1.1, 1))
for i, (colour, x, y, z, lean, yaw, size) in enumerate((("mustard", 1.53, .765, .58, -22, 24, .22), ("coral", 2.88, .755, .585, -24, -20, .21),
                                                       ("linen", 2.58, .74, .64, -30, -6, .19))):
    put("pillow", f"pillow-{i}", colour, (x, y, z), (size, size, .075), (("x", lean), ("y", yaw)))

note("Round mirror and sconces above it")
put("disk", "mirror-face", "mirror", (2.2, 1.62, .03), (.385, .385, 1))
put("ring", "mirror-frame", "brass", (2.2, 1.62, .031), (.4, .4, .4), (("x", 90),))
for i, x in enumerate((1.42, 2.98)):
    put("sconce", f"sconce-{i}", "brass", (x, 1.62, .098))
    bulb(f"sconce-bulb-{i}", (x, 1.683, .098), .045, "40, 28, 15")

note("Sideboard on the right with lamp, books, knot and pictures")
crisp("sideboard-body", "walnut", (4.35, .46, .3), (.75, .29, .24))
crisp("sideboard-top", "oak", (4.35, .765, .3), (.78, .015, .26))
for i, x in enumerate((3.98, 4.35, 4.72)):
    crisp(f"sideboard-door-{i}", "oak", (x, .46, .541), (.175, .25, .012))
    ball(f"sideboard-knob-{i}", "brass", (x + .13, .5, .563), .014)
for i, (x, z) in enumerate(((3.67, .12), (5.03, .12), (3.67, .48), (5.03, .48))):
    put("stub-leg", f"sideboard-leg-{i}", "brass", (x, .0005, z), (.9, 1.45, .9))
put("lamp-vase", "table-lamp-foot", "celadon", (3.82, .7805, .3))
put("lamp-shade", "table-lamp-shade", "shade", (3.82, 1.06, .3), (.8, .75, .8))
bulb("table-lamp-bulb", (3.82, 1.165, .3), .05, "52, 36, 19")
put("knot", "copper-knot", "copper", (4.62, .925, .32), .042, (("y", 35),))
BOOKS = [("coral", .165, .24, .032), ("ink", .17, .255, .04), ("mustard", .15, .22, .028), ("celadon", .16, .235, .036), ("linen", .165, .245, .03),
         ("plum", .155, .23, .042), ("terracotta", .16, .25, .03)]


def book(name, colour, at, width, height, thick, turn):
    """`at` is the cover's corner on the spine; the cover lies in x (width), y (height), z (thickness, centred)."""
    put("book", name, colour, at, (width, height, thick), turn)
    m = np.eye(3)
    for axis, angle in turn:
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        m = {"x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
             "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])}[axis] @ m
    centre = np.asarray(at) + m @ [.52 * width, .5 * height, 0]
    put("cube", name + "-pages", "paper", centre, (.44 * width, .485 * height, .4195 * thick), turn)


x = 4.06
for i, (colour, w, h, t) in enumerate(BOOKS):
    book(f"book-row-{i}", colour, (x + t / 2, .7808, .42), w, h, t, (("y", 90),))
    x += t + .001
ball("book-end", "chrome", (x + .046, .8265, .34), .045)
crisp("picture-frame", "walnut", (4.4, 1.62, .02), (.4, .3, .018))
plane("picture-sheet", "paper", (4.4, 1.62, .0395), (.36, .26), SOUTH)
put("disk", "picture-sun", "coral", (4.48, 1.68, .041), (.11, .11, 1))
put("disk", "picture-moon", "ink", (4.28, 1.54, .042), (.07, .07, 1))

note("Plant and basket by the window")
put("pot", "plant-pot", "terracotta", (.56, .0005, .52))
put("disk", "plant-soil", "soil", (.56, .2705, .52), (.1645, .1645, 1), UP)
put("plant", "plant-leaves", "leaf", (.56, -.02, .52), (1.05, 1.15, 1.05))
put("basket", "basket", "straw", (.5, .0005, 2.72))
put("pillow", "basket-blanket", "plum", (.5, .29, 2.72), (.19, .19, .09), (("x", 78), ("y", 20)))

note("Armchair with floor lamp")
TURN = (("y", 68),)


def chair_part(kind, name, bsdf, at, half, first=(), base=(.98, 0, 1.72)):
    c, s = np.cos(np.radians(TURN[0][1])), np.sin(np.radians(TURN[0][1]))
    put(kind, name, bsdf, (base[0] + c * at[0] + s * at[2], base[1] + at[1], base[2] - s * at[0] + c * at[2]), half, tuple(first) + TURN)


chair_part("soft-box", "armchair-base", "armchair", (0, .26, 0), (.4, .1, .36))
chair_part("soft-box", "armchair-seat", "armchair", (0, .42, .04), (.3, .075, .33))
chair_part("soft-box", "armchair-back", "armchair", (0, .66, -.32), (.37, .36, .1), (("x", -10),))
for side in (-1, 1):
    chair_part("soft-box", f"armchair-arm-{side + 1}", "armchair", (.36 * side, .42, 0), (.075, .2, .37))
    for end in (-1, 1):
        chair_part("stub-leg", f"armchair-leg-{side + 1}{end + 1}", "walnut", (.32 * side, .0005, .28 * end), (1, 1.35, 1))
chair_part("pillow", "armchair-pillow", "linen", (.02, .66, -.12), (.18, .18, .065), (("x", -20),))
put("lamp-foot", "floor-lamp-foot", "chrome", (.95, .0005, 1.06))
put("lamp-shade", "floor-lamp-shade", "shade", (.95, 1.46, 1.06), (.95, .95, .95))
bulb("floor-lamp-bulb", (.95, 1.635, 1.06), .05, "56, 39, 21")

note("Rug and coffee table")
put("rug", "rug", "rug", (2.65, .001, 2.2))
TX, TZ, TOP = 2.55, 2.2, .44
put("table-top", "table-top", "oak", (TX, .4, TZ), (1.1, 1, 1.1))
for i in range(4):
    a = np.pi / 4 + i * np.pi / 2
    put("turned-leg", f"table-leg-{i}", "oak", (TX + .36 * np.cos(a), .008, TZ + .36 * np.sin(a)), (1.1, .395, 1.1))
put("bowl", "fruit-bowl", "porcelain", (TX - .12, TOP + .0008, TZ + .06), 1.15)
FRUIT = [("apple", "apple", (-.19, .047, .04), 1), ("apple", "lime", (-.09, .045, .12), .95), ("orange", "orange", (-.1, .085, .0), .04),
         ("apple", "apple", (-.17, .052, .125), .9), ("orange", "orange", (-.14, .125, .07), .038)]
for i, (kind, colour, at, size) in enumerate(FRUIT):
    put(kind, f"fruit-{i}", colour, (TX + at[0], TOP + at[1], TZ + at[2]), size, (("z", 18 * (i % 3 - 1)),) if kind == "apple" else ())
put("banana", "banana", "banana", (TX - .06, TOP + .128, TZ + .06), 1, (("z", 6), ("y", 70)))
book("book-flat-0", "ink", (TX + .08, TOP + .022, TZ + .38), .19, .27, .04, (("x", -90), ("y", 8)))
book("book-flat-1", "coral", (TX + .1, TOP + .06, TZ + .36), .165, .23, .034, (("x", -90), ("y", -12)))
put("mug", "mug", "celadon", (TX + .19, TOP + .0778, TZ + .24), 1, (("y", -60),))
put("carafe", "carafe", "glass", (TX + .22, TOP + .0008, TZ - .2))
put("tumbler", "tumbler-0", "glass", (TX + .34, TOP + .0008, TZ - .08))
put("tumbler", "tumbler-1", "glass", (TX + .06, TOP + .0008, TZ - .31))
put("vase-tall", "vase-tall", "ink", (TX - .3, TOP + .0008, TZ - .22), .8)

note("Pouf, wooden chair, vases on the floor")
put("pouf", "pouf", "mustard", (3.55, .016, 1.55), (1, 1, 1))
TURN = (("y", -128),)
BASE = (3.72, 0, 2.72)
chair_part("soft-box", "chair-seat", "linen", (0, .462, 0), (.215, .028, .205), base=BASE)
for side in (-1, 1):
    for end in (-1, 1):
        chair_part("turned-leg", f"chair-leg-{side + 1}{end + 1}", "walnut", (.165 * side, .016 if end > -2 else 0, .155 * end), (.9, .425, .9), base=BASE)
    chair_part("turned-leg", f"chair-post-{side + 1}", "walnut", (.165 * side, .48, -.175), (.75, .48, .75), (("x", -7),), base=BASE)
for i, y in enumerate((.62, .74, .86)):
    chair_part("rail", f"chair-rail-{i}", "walnut", (0, y, -.196 - .12 * (y - .48) + .0), (.155, .26, .16), base=BASE)
put("vase-ribbed", "floor-vase", "porcelain", (3.58, .0005, .3), (1.1, 1.7, 1.1))

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
	<sensor type="perspective">
		<float name="fov" value="66"/>
		<string name="fov_axis" value="x"/>
		<float name="near_clip" value="0.01"/>
		<float name="far_clip" value="100"/>
		<transform name="to_world">
			<lookat origin="4.75, 1.5, 4.75" target="2.2, 0.88, 1.0" up="0, 1, 0"/>
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

{body}
</scene>
""")
size = sum(os.path.getsize(os.path.join(kit.HERE, "meshes", name)) for name in os.listdir(os.path.join(kit.HERE, "meshes")))
print(f"{kit.objects} objects, {kit.materials} materials, {kit.lamps} area lights, {kit.total} triangles, "
      f"{100 * kit.flat / kit.total:.2f} % on flat faces; meshes {sum(kit.meshes.values())} triangles, {size / 1e6:.2f} MB")
