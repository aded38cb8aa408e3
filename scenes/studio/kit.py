"""The studio's means: its meshes (written when this is imported), its materials, and what adds a shape to the scene."""
import os

import numpy as np

import shapes as sh

HERE = os.path.dirname(os.path.abspath(__file__))
rng = np.random.default_rng(20)
meshes, flats = {}, {}                                  # triangles of each mesh, and how many of them lie on flat faces
counts = {"cube": 12, "rectangle": 2, "disk": 0, "sphere": 0}
out = []
flat = total = objects = lamps = 0


def num(v):
    return f"{v:.5g}" if abs(v) > 1e-9 else "0"


def xyz(v):
    return f'x="{num(v[0])}" y="{num(v[1])}" z="{num(v[2])}"'


def put(kind, name, bsdf, at=(0, 0, 0), scale=(1, 1, 1), turn=(), light=None):
    """Adds one shape. kind: mesh name or cube, rectangle, disk; turn: (axis, degrees) in order, after the scaling."""
    global flat, total, objects, lamps
    mesh = kind in meshes
    out.append(f'\t<shape type="{"ply" if mesh else kind}" id="{name}">')
    if mesh:
        out.append(f'\t\t<string name="filename" value="meshes/{kind}.ply"/>')
    out.append('\t\t<transform name="to_world">')
    if np.isscalar(scale):
        scale = (scale,) * 3
    if tuple(scale) != (1, 1, 1):
        out.append(f"\t\t\t<scale {xyz(scale)}/>")
    for axis, angle in turn:
        out.append(f'\t\t\t<rotate {axis}="1" angle="{num(angle)}"/>')
    out.append(f"\t\t\t<translate {xyz(at)}/>\n\t\t</transform>\n\t\t<ref id=\"mat-{bsdf}\"/>")
    if light:
        out.append(f'\t\t<emitter type="area">\n\t\t\t<rgb name="radiance" value="{light}"/>\n\t\t</emitter>')
        lamps += 1
    out.append("\t</shape>")
    n = meshes[kind] if mesh else counts[kind]
    total, objects, flat = total + n, objects + 1, flat + (flats[kind] if mesh else n)


def bulb(name, at, radius, light):
    global objects, lamps
    out.append(f'\t<shape type="sphere" id="{name}">\n\t\t<point name="center" {xyz(at)}/>\n\t\t<float name="radius" value="{num(radius)}"/>'
               f'\n\t\t<ref id="mat-lamp-face"/>\n\t\t<emitter type="area">\n\t\t\t<rgb name="radiance" value="{light}"/>\n\t\t</emitter>\n\t</shape>')
    objects, lamps = objects + 1, lamps + 1


def ball(name, bsdf, at, radius):
    global objects
    out.append(f'\t<shape type="sphere" id="{name}">\n\t\t<point name="center" {xyz(at)}/>\n\t\t<float name="radius" value="{num(radius)}"/>'
               f'\n\t\t<ref id="mat-{bsdf}"/>\n\t</shape>')
    objects += 1


def box(name, bsdf, lo, hi):
    put("cube", name, bsdf, [(a + b) / 2 for a, b in zip(lo, hi)], [(b - a) / 2 for a, b in zip(lo, hi)])


def plane(name, bsdf, at, half, turn, light=None):
    put("rectangle", name, bsdf, at, (half[0], half[1], 1), turn, light)


def mesh(name, m):
    os.makedirs(os.path.join(HERE, "meshes"), exist_ok=True)
    meshes[name] = sh.write_ply(os.path.join(HERE, "meshes", name + ".ply"), m)
    flats[name] = sh.level(m)


def note(text):
    out.append(f"\n\t<!-- {text} -->")


# ---- materials -----------------------------------------------------------------------------------------------------
DIFFUSE = {
    "plaster": "0.78, 0.75, 0.69", "accent": "0.3, 0.42, 0.43", "ceiling": "0.86, 0.86, 0.84", "floor": "0.42, 0.27, 0.16",
    "trim": "0.82, 0.81, 0.78", "sofa": "0.2, 0.31, 0.42", "seat": "0.24, 0.36, 0.48", "mustard": "0.72, 0.46, 0.1",
    "coral": "0.72, 0.27, 0.19", "linen": "0.8, 0.74, 0.62", "armchair": "0.55, 0.3, 0.18", "walnut": "0.26, 0.15, 0.085",
    "oak": "0.56, 0.39, 0.22", "rug": "0.66, 0.58, 0.48", "curtain": "0.7, 0.66, 0.58", "leaf": "0.13, 0.34, 0.1",
    "soil": "0.09, 0.06, 0.04", "terracotta": "0.6, 0.28, 0.16", "celadon": "0.42, 0.6, 0.5", "porcelain": "0.85, 0.84, 0.8",
    "ink": "0.06, 0.08, 0.16", "apple": "0.62, 0.09, 0.06", "lime": "0.4, 0.55, 0.1", "orange": "0.82, 0.37, 0.05",
    "banana": "0.83, 0.66, 0.12", "paper": "0.83, 0.8, 0.72", "shade": "0.86, 0.8, 0.68", "lamp-face": "0.5, 0.5, 0.5",
    "plum": "0.3, 0.1, 0.2", "straw": "0.62, 0.47, 0.28",
}
METAL = {  # eta and k at red, green, blue (rounded)
    "brass": ("0.444, 0.527, 1.094", "3.695, 2.765, 1.829"), "copper": ("0.271, 0.677, 1.316", "3.609, 2.625, 2.292"),
    "chrome": ("3.11, 3.18, 2.32", "3.31, 3.33, 3.14"),
}
for name, value in DIFFUSE.items():
    out.append(f'\t<bsdf type="twosided" id="mat-{name}">\n\t\t<bsdf type="diffuse">\n\t\t\t<rgb name="reflectance" value="{value}"/>\n\t\t</bsdf>\n\t</bsdf>')
for name, (eta, k) in METAL.items():
    out.append(f'\t<bsdf type="twosided" id="mat-{name}">\n\t\t<bsdf type="conductor">\n\t\t\t<rgb name="eta" value="{eta}"/>\n\t\t\t<rgb name="k" value="{k}"/>\n\t\t</bsdf>\n\t</bsdf>')
out.append('\t<bsdf type="twosided" id="mat-mirror">\n\t\t<bsdf type="conductor">\n\t\t\t<string name="material" value="none"/>\n\t\t\t<rgb name="specular_reflectance" value="0.92, 0.93, 0.92"/>\n\t\t</bsdf>\n\t</bsdf>')
out.append('\t<bsdf type="dielectric" id="mat-glass">\n\t\t<float name="int_ior" value="1.5"/>\n\t\t<float name="ext_ior" value="1.0"/>\n\t</bsdf>')
out.append('\t<bsdf type="thindielectric" id="mat-pane">\n\t\t<float name="int_ior" value="1.5"/>\n\t\t<float name="ext_ior" value="1.0"/>\n\t</bsdf>')
materials = len(DIFFUSE) + len(METAL) + 3

# ---- meshes --------------------------------------------------------------------------------------------------------
mesh("soft-box", sh.ball_box(0.22, 44, 72))
mesh("crisp-box", sh.ball_box(0.07, 24, 40))
mesh("pillow", sh.pillow(32))
mesh("turned-leg", sh.lathe([(0, 0), (.016, .0005), (.019, .02), (.014, .07), (.02, .12), (.026, .2), (.03, .32), (.026, .42), (.018, .5),
                             (.028, .53), (.018, .56), (.031, .6), (.024, .64), (.034, .7), (.034, .8), (.03, .995), (0, 1)], 24, 56))
mesh("stub-leg", sh.lathe([(0, 0), (.02, .0005), (.024, .03), (.038, .09), (.032, .12), (0, .125)], 24, 20))
mesh("table-top", sh.lathe([(0, 0), (.44, 0), (.5, .008), (.51, .02), (.5, .032), (.44, .04), (0, .04)], 96, 40))
mesh("vase-tall", sh.lathe([(0, 0), (.055, 0), (.075, .03), (.1, .12), (.085, .22), (.045, .3), (.04, .34), (.06, .38), (.056, .38), (.036, .34),
                            (.04, .3), (.08, .22), (.094, .12), (.07, .035), (0, .03)], 56, 64))
mesh("vase-ribbed", sh.lathe([(0, 0), (.06, 0), (.09, .04), (.115, .1), (.1, .17), (.06, .21), (.055, .23), (.065, .245), (.06, .245), (.05, .23),
                              (.055, .21), (.09, .17), (.1, .1), (.08, .045), (0, .04)], 96, 48, 0.035, 16))
mesh("bowl", sh.lathe([(0, 0), (.07, 0), (.075, .012), (.07, .02), (.12, .045), (.165, .095), (.17, .1), (.164, .1), (.11, .052), (.05, .032), (0, .03)], 64, 44))
mesh("apple", sh.lathe([(0, .006), (.018, 0), (.034, .014), (.041, .04), (.038, .062), (.022, .075), (.008, .068), (0, .062)], 32, 28))
mesh("orange", sh.ball_box(1.0, 20, 32))
s = np.linspace(-0.75, 0.75, 26)
mesh("banana", sh.tube(np.stack([.1 * np.sin(s), .1 * (1 - np.cos(s)), 0 * s], -1), .019 * np.sqrt(np.maximum(1 - (s / .78) ** 4, .02)), 14))
w = np.linspace(-1.9, 1.9, 24)
handle = sh.tube(np.stack([.038 + .026 * np.cos(w), .05 + .03 * np.sin(w), 0 * w], -1), .0055, 12)
cup = sh.lathe([(0, 0), (.03, 0), (.038, .006), (.041, .05), (.042, .095), (.04, .097), (.038, .095), (.037, .05), (.033, .01), (0, .008)], 48, 36)
mesh("mug", sh.join(cup, handle))
mesh("carafe", sh.lathe([(0, 0), (.055, 0), (.07, .015), (.075, .06), (.055, .13), (.03, .18), (.028, .21), (.038, .25), (.034, .25), (.024, .21),
                         (.026, .18), (.05, .13), (.069, .06), (.064, .018), (.05, .008), (0, .008)], 56, 60))
mesh("tumbler", sh.lathe([(0, 0), (.03, 0), (.033, .004), (.037, .05), (.039, .092), (.038, .094), (.036, .092), (.033, .05), (.028, .014), (0, .012)], 48, 36))
mesh("pouf", sh.lathe([(0, 0), (.2, 0), (.27, .03), (.31, .12), (.31, .22), (.27, .32), (.18, .365), (.05, .37), (0, .362)], 96, 40, 0.022, 24))
mesh("lamp-foot", sh.join(sh.lathe([(0, 0), (.15, 0), (.155, .01), (.14, .022), (.05, .032), (.02, .06), (.012, .1), (.01, .7), (.016, .74), (.01, .78),
                                    (.009, 1.42), (0, 1.425)], 40, 70),
                          sh.tube([(0, 1.42, 0), (.03, 1.45, 0), (.055, 1.5, 0), (.05, 1.56, 0), (0, 1.6, 0)], .004, 8)))
mesh("lamp-shade", sh.lathe([(.24, 0), (.22, .09), (.19, .2), (.15, .3), (.147, .3), (.187, .2), (.217, .09), (.237, 0), (.24, 0)], 72, 33, raw=False))
mesh("lamp-vase", sh.lathe([(0, 0), (.07, 0), (.075, .012), (.05, .03), (.075, .09), (.095, .16), (.075, .23), (.03, .27), (.018, .29), (.014, .34), (0, .342)], 56, 50))
mesh("pendant", sh.lathe([(.014, .3), (.03, .27), (.035, .2), (.08, .16), (.17, .1), (.23, 0), (.227, 0), (.166, .096), (.078, .152), (.03, .19), (.012, .26)], 72, 44))
mesh("cord", sh.tube([(0, 0, 0), (0, .3, 0), (0, 1, 0)], .005, 10))
mesh("sconce", sh.join(sh.lathe([(0, 0), (.02, .004), (.06, .03), (.075, .07), (.072, .07), (.057, .034), (.018, .008), (0, .006)], 40, 24),
                       sh.tube([(0, .004, 0), (0, -.03, -.01), (0, -.04, -.05), (0, -.02, -.09)], .008, 12)))
mesh("ring", sh.torus(1, .07, 120, 28))
mesh("rail", sh.tube(np.stack([np.linspace(-1, 1, 24), 0 * s[:24], .12 * np.cos(np.linspace(-1.5, 1.5, 24))], -1), .05, 14))
w = np.linspace(0, sh.TAU, 260, endpoint=False)
mesh("knot", sh.tube(np.stack([np.sin(w) + 2 * np.sin(2 * w), np.cos(w) - 2 * np.cos(2 * w), -np.sin(3 * w)], -1), .42, 24, closed=True))
mesh("basket", sh.lathe([(0, .004), (.15, 0), (.19, .03), (.21, .15), (.2, .28), (.21, .3), (.2, .305), (.19, .28), (.2, .15), (.18, .035), (0, .015)], 120, 40, .02, 30))
mesh("pot", sh.lathe([(0, 0), (.12, 0), (.13, .01), (.17, .26), (.185, .27), (.185, .31), (.172, .31), (.165, .28), (.16, .27)], 64, 44))

u, v = np.meshgrid(np.linspace(-1.3, 1.3, 150), np.linspace(-.95, .95, 110), indexing="ij")
edge = np.clip(np.minimum(1.3 - abs(u), .95 - abs(v)) / .03, 0, 1)
pile = .012 * np.sqrt(edge) + edge * (.0025 * np.sin(40 * u) * np.sin(38 * v) + .0015 * np.sin(11 * u + 7 * np.sin(5 * v)))
mesh("rug", sh.grid(np.stack([u, pile, v], -1)[:, ::-1]))

u, v = np.meshgrid(np.linspace(0, 1, 170), np.linspace(0, 1, 22), indexing="ij")
fold = np.sin(sh.TAU * 8 * u) * (.022 + .02 * v) + .012 * np.sin(sh.TAU * 3 * u + 2 * v)
mesh("curtain", sh.grid(np.stack([fold, 2.32 * (1 - v), .48 * u + .006 * np.sin(sh.TAU * 16 * u) * v], -1)))

# Book: a cover with rounded spine (an extruded U) of 1 x 1 x 1; the block of pages is a cube of its own.
w = np.linspace(np.pi / 2, 3 * np.pi / 2, 14)
outer = np.concatenate([[(1, .5)], np.stack([.12 + .12 * np.cos(w), .5 * np.sin(w)], -1), [(1, -.5)]])
inner = np.concatenate([[(1, -.42)], np.stack([.12 + .06 * np.cos(w[::-1]), .42 * np.sin(w[::-1])], -1), [(1, .42)]])
loop = np.concatenate([outer, inner])
mesh("book", sh.outward(sh.grid(np.stack([np.stack([loop[:, 0], 0 * loop[:, 0] + h, loop[:, 1]], -1) for h in (0, .004, .5, .996, 1)]), wrap_v=True)))


def leaf(length, width, rise, droop, heading, start):
    t = np.linspace(0, 1, 14)[:, None]
    a = np.linspace(-1, 1, 9)[None, :]
    half = width * np.sin(np.pi * np.clip(t, 0, 1) ** .75) ** .8
    along = length * (t + 0 * a)
    up = rise * t - droop * t * t + .35 * half * a * a + .006 * np.sin(9 * t + 3 * a)
    across = half * a
    c, d = np.cos(heading), np.sin(heading)
    return sh.grid(np.stack([start[0] + along * c - across * d, start[1] + up, start[2] + along * d + across * c], -1))


parts, stems = [], []
for i in range(34):
    heading = i * 2.39996
    level = i / 33
    foot = np.array([.03 * np.cos(heading), .29, .03 * np.sin(heading)])
    reach = .1 + .12 * (1 - level) + .02 * rng.random()
    tip = foot + [reach * np.cos(heading), .12 + .75 * level, reach * np.sin(heading)]
    stems.append(sh.tube(sh.curve([foot, (foot + tip) / 2 + [0, .1, 0], tip], 10), .005, 7))
    parts.append(leaf(.24 + .07 * rng.random(), .055 + .02 * rng.random(), .22 - .1 * (1 - level), .22 + .1 * rng.random(), heading, tip))
p, t, _ = sh.join(*parts, *stems)
for axis in (0, 2):                                     # leaves bend up where they meet the walls in the corner
    over = p[:, axis] < -.36
    p[over, 1] += .4 * (-.36 - p[over, axis])
    p[over, axis] = -.36 + .08 * np.tanh((p[over, axis] + .36) / .08)
mesh("plant", sh.smooth(p, t))
