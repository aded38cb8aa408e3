"""The studio's means: its materials, the meshes that stand in it more than once, and what adds a shape to the scene."""
import os

import numpy as np

import shapes as sh

HERE = os.path.dirname(os.path.abspath(__file__))
rng = np.random.default_rng(20)
meshes, flats = {}, {}                                  # triangles of each mesh, and how many of them lie on flat faces
counts = {"cube": 12, "rectangle": 2, "disk": 0, "sphere": 0}
out = []
flat = total = objects = lamps = materials = 0


def num(v):
    return f"{v:.5g}" if abs(v) > 1e-9 else "0"


def xyz(v):
    return f'x="{num(v[0])}" y="{num(v[1])}" z="{num(v[2])}"'


def put(kind, name, bsdf, at=(0, 0, 0), scale=(1, 1, 1), turn=(), light=None):
    """Adds one shape. kind: mesh name or cube, rectangle, disk; turn: (axis, degrees) in order, after the scaling; light: radiance
    as three numbers, or a picture of it."""
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
        radiance = picture("radiance", light) if light.endswith(".hdr") else f'<rgb name="radiance" value="{light}"/>'
        out.append(f'\t\t<emitter type="area">{radiance}</emitter>')
        lamps += 1
    out.append("\t</shape>")
    n = meshes[kind] if mesh else counts[kind]
    total, objects, flat = total + n, objects + 1, flat + (flats[kind] if mesh else n)


def ball(name, bsdf, at, radius, light=None):
    global objects, lamps
    out.append(f'\t<shape type="sphere" id="{name}">\n\t\t<point name="center" {xyz(at)}/>\n\t\t<float name="radius" value="{num(radius)}"/>'
               f'\n\t\t<ref id="mat-{bsdf}"/>')
    if light:
        out.append(f'\t\t<emitter type="area"><rgb name="radiance" value="{light}"/></emitter>')
        lamps += 1
    out.append("\t</shape>")
    objects += 1


def plane(name, bsdf, at, half, turn, light=None):
    put("rectangle", name, bsdf, at, (half[0], half[1], 1), turn, light)


def mesh(name, m, textured=True):
    os.makedirs(os.path.join(HERE, "meshes"), exist_ok=True)
    meshes[name] = sh.write_ply(os.path.join(HERE, "meshes", name + ".ply"), m, textured)
    flats[name] = sh.level(m)


def slab(name, bsdf, at, half, radius=.004, turn=(), n=1, round_steps=3, bulge=(0, 0, 0), wave=0.0, light=None):
    """A board or cushion of its own size, so that its picture is not stretched; the mesh is named after the size and shared."""
    key = "slab-" + "-".join(f"{1000 * v:.0f}" for v in (*half, radius)) + ("" if n == 1 else f"-{n}")
    if key not in meshes:
        mesh(key, sh.slab(half, radius, n, round_steps, bulge, wave, len(meshes)))
    put(key, name, bsdf, at, 1, turn, light)


def note(text):
    out.append(f"\n\t<!-- {text} -->")


# ---- materials -----------------------------------------------------------------------------------------------------
def picture(name, file, scale=(1, 1), raw=False):
    """A bitmap whose tile is repeated `scale` times per unit of u and v."""
    turn = f'<transform name="to_uv"><scale x="{num(scale[0])}" y="{num(scale[1])}"/></transform>' if tuple(scale) != (1, 1) else ""
    raw = '<boolean name="raw" value="true"/>' if raw else ""
    return f'<texture type="bitmap" name="{name}"><string name="filename" value="textures/{file}"/>{raw}{turn}</texture>'


def colour(name, value):
    """`value`: three numbers, or (picture, size of its tile in m)."""
    if isinstance(value[0], str):
        size = value[1]
        return picture(name, value[0], (1 / size[0], 1 / size[1]) if isinstance(size, tuple) else (1 / size, 1 / size))
    return f'<rgb name="{name}" value="{value[0]}, {value[1]}, {value[2]}"/>'


def material(name, body, two_sided=True):
    global materials
    materials += 1
    out.append(f'\t<bsdf type="twosided" id="mat-{name}">\n\t\t{body}\n\t</bsdf>' if two_sided else body.replace(">", f' id="mat-{name}">', 1))


def bsdf(kind, *inside):
    return f'<bsdf type="{kind}">{"".join(inside)}</bsdf>'


def number(name, value):
    return f'<float name="{name}" value="{num(value)}"/>'


def bump(body, file, size, height):
    """Relief of `height` metres between black and white, on a surface whose uv are metres."""
    sizes = size if isinstance(size, tuple) else (size, size)
    return bsdf("bumpmap", picture("height", file, (1 / sizes[0], 1 / sizes[1]), raw=True), number("scale", height), body)


def matt(value):
    return bsdf("diffuse", colour("reflectance", value))


def coat(value, alpha, ior=1.5):
    return bsdf("roughplastic", '<string name="distribution" value="ggx"/>', number("alpha", alpha), number("int_ior", ior),
                '<boolean name="nonlinear" value="true"/>', colour("diffuse_reflectance", value))


def metal(eta, k, alpha):
    return bsdf("roughconductor", '<string name="distribution" value="ggx"/>', number("alpha", alpha),
                f'<rgb name="eta" value="{eta}"/><rgb name="k" value="{k}"/>')


FLOOR_SIZE = (2.6 / 5.4, 2.6 / 6.2)                     # the floor is one rectangle of uv in [0, 1]
material("floor", bump(coat(("floor.jpg", FLOOR_SIZE), .17), "floor-height.png", FLOOR_SIZE, .0011))
material("plaster", matt((.8, .79, .77)))
material("back-wall", bump(matt((.34, .385, .35)), "plaster.png", (.1, .2), .0006))
material("ceiling", matt((.86, .86, .855)))
material("trim", coat((.84, .83, .81), .2))
material("wall-trim", coat((.34, .385, .35), .3))
material("rug", matt(("rug.jpg", 1)))
material("sofa", bump(matt(("linen.jpg", .14)), "weave-height.png", .14, .0006))
material("piping", matt((.5, .46, .4)))
material("leather", bump(coat(("leather.jpg", .28), .28), "leather-height.png", .28, .0007))
material("walnut", coat(("walnut.jpg", (1.1, .55)), .14))
material("walnut-matt", coat(("walnut.jpg", (1.1, .55)), .3))
material("oak", coat(("oak.jpg", (1.0, .5)), .25))
material("rust", matt(("rust.jpg", .33)))
material("ochre", matt(("ochre.jpg", .33)))
material("striped", matt(("striped.jpg", 1)))
material("curtain", matt(("curtain.jpg", .2)))
material("throw", matt(("throw.jpg", .2)))
material("painting", matt(("painting.jpg", (1, -1))))
material("sheet", matt((.8, .79, .75)))
material("paper", matt((.78, .73, .63)))
for i in range(8):
    material(f"book-{i}", coat((f"book-{i}.jpg", 1), .35))
material("leaf", coat(("leaf.jpg", 1), .22))
material("stem", matt((.16, .15, .07)))
material("soil", matt((.05, .035, .025)))
material("pot", coat((.62, .6, .56), .35))
material("straw", matt((.45, .32, .18)))
material("ceramic", bsdf("plastic", number("int_ior", 1.5), '<boolean name="nonlinear" value="true"/>', colour("diffuse_reflectance", (.72, .7, .65))))
material("celadon", coat((.16, .27, .25), .08))
material("ink", coat((.03, .035, .045), .12))
material("terracotta", matt((.42, .19, .1)))
material("apple", coat((.45, .06, .035), .12))
material("lime", coat((.28, .36, .06), .15))
material("orange", coat((.75, .3, .035), .3))
material("shade", matt((.6, .54, .42)))
material("lamp-face", matt((0, 0, 0)))
# eta and k: rounded values of tabulated constants at red, green and blue (steel by chromium's).
material("steel", metal("3.2, 3.15, 2.3", "3.3, 3.32, 3.13", .18))
material("brass", metal("0.44, 0.53, 1.1", "3.7, 2.77, 1.83", .13))
material("bronze", metal("0.27, 0.68, 1.3", "3.6, 2.62, 2.29", .28))
material("mirror", bsdf("conductor", '<string name="material" value="none"/><rgb name="specular_reflectance" value="0.9, 0.91, 0.9"/>'))
material("glass", '\t<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1.0"/></bsdf>', two_sided=False)

# ---- meshes that stand in more than one place, or are no slabs -------------------------------------------------------
mesh("leg", sh.lathe([(.011, 0), (.012, .002), (.016, .25), (.021, .6), (.024, .9), (.024, 1), (0, 1.001)], 24, 24))
mesh("post", sh.lathe([(0, 0), (.0115, .0002), (.012, .004), (.012, .5), (.012, .996), (.0115, 1), (0, 1)], 24, 24), False)
mesh("vase-tall", sh.lathe([(0, 0), (.055, 0), (.075, .03), (.1, .12), (.085, .22), (.045, .3), (.04, .34), (.06, .38), (.056, .38), (.036, .34),
                            (.04, .3), (.08, .22), (.094, .12), (.07, .035), (0, .03)], 64, 72), False)
mesh("vase-ribbed", sh.lathe([(0, 0), (.06, 0), (.09, .04), (.115, .1), (.1, .17), (.06, .21), (.055, .23), (.065, .245), (.06, .245), (.05, .23),
                              (.055, .21), (.09, .17), (.1, .1), (.08, .045), (0, .04)], 128, 60, 0.03, 24), False)
mesh("bowl", sh.lathe([(0, 0), (.07, 0), (.075, .012), (.07, .02), (.12, .045), (.165, .095), (.17, .1), (.164, .1), (.11, .052), (.05, .032), (0, .03)], 72, 48), False)
mesh("apple", sh.lathe([(0, .006), (.018, 0), (.034, .014), (.041, .04), (.038, .062), (.022, .075), (.008, .068), (0, .062)], 32, 28), False)
mesh("orange", sh.ball(24, 36), False)
w = np.linspace(-1.9, 1.9, 24)
handle = sh.tube(np.stack([.038 + .026 * np.cos(w), .05 + .03 * np.sin(w), 0 * w], -1), .0055, 12)
cup = sh.lathe([(0, 0), (.03, 0), (.038, .006), (.041, .05), (.042, .095), (.04, .097), (.038, .095), (.037, .05), (.033, .01), (0, .008)], 48, 36)
mesh("mug", sh.join(cup, handle), False)
mesh("carafe", sh.lathe([(0, 0), (.055, 0), (.07, .015), (.075, .06), (.055, .13), (.03, .18), (.028, .21), (.038, .25), (.034, .25), (.024, .21),
                         (.026, .18), (.05, .13), (.069, .06), (.064, .018), (.05, .008), (0, .008)], 64, 72), False)
mesh("tumbler", sh.lathe([(0, 0), (.03, 0), (.033, .004), (.037, .05), (.039, .092), (.038, .094), (.036, .092), (.033, .05), (.028, .014), (0, .012)], 56, 40), False)
mesh("lamp-foot", sh.lathe([(0, 0), (.13, 0), (.137, .004), (.137, .016), (.13, .021), (.03, .024), (.0125, .03), (.0115, .06), (.0115, .75), (.0115, 1.42),
                            (.011, 1.425), (0, 1.426)], 56, 60), False)
mesh("lamp-shade", sh.lathe(np.stack([np.linspace(.21, .165, 5), np.linspace(0, .29, 5)], -1), 48, raw=True, unit=True))
mesh("ring", sh.torus(1, .028, 144, 20), False)
mesh("basket", sh.lathe([(0, .004), (.15, 0), (.185, .02), (.2, .15), (.19, .28), (.195, .3), (.187, .3), (.18, .28), (.19, .15), (.17, .03), (0, .015)], 160, 64, .018, 40), False)
mesh("pot", sh.lathe([(0, 0), (.13, 0), (.14, .01), (.17, .3), (.175, .34), (.166, .34), (.16, .3), (.158, .28)], 72, 48), False)
mesh("knob", sh.lathe([(0, 0), (.007, 0), (.0065, .008), (.008, .014), (.014, .019), (.0145, .024), (.011, .0275), (0, .028)], 28, 24), False)
mesh("pillow", sh.pillow(44, .25, 1))
mesh("pillow-soft", sh.pillow(44, .5, 5))

# A rug's pile is uneven; its uv is its picture. The fringe are twisted ends of the warp.
u, v = np.meshgrid(np.linspace(-1.4, 1.4, 170), np.linspace(-.95, .95, 118), indexing="ij")
edge = np.clip(np.minimum(1.4 - abs(u), .95 - abs(v)) / .02, 0, 1)
pile = .0005 + .011 * np.sqrt(edge) + edge * (.0012 * np.sin(61 * u) * np.sin(57 * v) + .0014 * np.sin(7 * u + 3 * np.sin(4 * v)) + .0008 * rng.standard_normal(u.shape))
p, t, n, _ = sh.grid(np.stack([u, pile, v], -1)[:, ::-1])
mesh("rug", (p, t, n, np.stack([p[:, 0] / 2.8 + .5, p[:, 2] / 1.9 + .5], -1)))
strands = []
for z in np.arange(-.93, .935, .021):
    s, end = np.linspace(0, 1, 5)[:, None], rng.uniform(-.012, .012)
    strands.append(sh.tube(np.concatenate([s * rng.uniform(.055, .07), .004 - .0005 * s, z + end * s**2], 1), [.0035, .0028, .0028, .0034, .004], 6))
mesh("fringe", sh.join(*strands), False)

# Curtains: gathered above, wider and looser folds below.
u, v = np.meshgrid(np.linspace(0, 1, 240), np.linspace(0, 1, 40), indexing="ij")
bend = u + .012 * np.sin(sh.TAU * 3 * u + 1.3) + .006 * np.sin(5 * v + 9 * u)
fold = np.sin(sh.TAU * 9 * bend) * (.018 + .024 * v) + .014 * np.sin(sh.TAU * 4 * bend + 1.6 * v) * v
mesh("curtain", sh.grid(np.stack([fold, 2.46 * (1 - v), .52 * u + .01 * np.sin(sh.TAU * 18 * bend) * (.5 + v)], -1)))

# Book: a cover with rounded spine (an extruded U) of 1 x 1 x 1; the block of pages is a cube of its own.
w = np.linspace(np.pi / 2, 3 * np.pi / 2, 14)
outer = np.concatenate([[(1, .5)], np.stack([.12 + .12 * np.cos(w), .5 * np.sin(w)], -1), [(1, -.5)]])
inner = np.concatenate([[(1, -.42)], np.stack([.12 + .06 * np.cos(w[::-1]), .42 * np.sin(w[::-1])], -1), [(1, .42)]])
loop = np.concatenate([outer, inner])
p, t, n, uv = sh.outward(sh.grid(np.stack([np.stack([loop[:, 0], 0 * loop[:, 0] + h, loop[:, 1]], -1) for h in (0, .004, .5, .996, 1)]), wrap_v=True))
across = np.where(p[:, 0] < .125, .5 + .06 * np.sin(np.arctan2(p[:, 2], .12 - p[:, 0] + 1e-9)), .5 + np.sign(p[:, 2]) * (.06 + .44 * p[:, 0]))
mesh("book", (p, t, n, np.stack([across, 1 - p[:, 1]], -1)))

# A leaf of length 1 along x, its blade folded along the middle and drooping; three kinds.
for kind, (droop, wide, roll) in enumerate(((.32, .27, .3), (.55, .3, .22), (.16, .25, .42))):
    s, a = np.linspace(0, 1, 26)[:, None], np.linspace(-1, 1, 15)[None, :]
    half = wide * np.sin(np.pi * s**.8) ** .75 * (1 - .18 * s) + .002
    rise = .12 * s - droop * s * s + roll * half * np.abs(a) ** 1.5 + .012 * np.sin(19 * s + 2.2 * np.abs(a)) * np.abs(a)
    p, t, n, _ = sh.grid(np.stack(np.broadcast_arrays(s + 0 * a, rise, half * a), -1))
    uv = np.stack(np.broadcast_arrays(s + 0 * a, .5 + .5 * a), -1).reshape(-1, 2)
    mesh(f"leaf-{kind}", (p, t, n, uv))
