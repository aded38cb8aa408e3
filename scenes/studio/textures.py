"""The studio's pictures, all computed: wood, weaves, a rug, a painting, plaster, a sky. Noise is filtered around the edge, so each
tile joins itself. Needs numpy and Pillow."""
import os

import numpy as np
from PIL import Image

HERE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "textures")
TAU = 2 * np.pi
SUN = (1, -.8, .2)                                     # the way its light goes


def noise(width, height, along_x, along_y, seed):
    """Gaussian noise of mean 0 and deviation 1, smoothed over so many pixels, periodic."""
    white = np.random.default_rng(seed).standard_normal((height, width))
    fx, fy = np.fft.fftfreq(width), np.fft.fftfreq(height)[:, None]
    out = np.fft.ifft2(np.fft.fft2(white) * np.exp(-2 * np.pi**2 * ((fx * along_x) ** 2 + (fy * along_y) ** 2))).real
    return (out - out.mean()) / out.std()


def mix(a, b, t):
    t = np.clip(t, 0, 1)[..., None]
    return np.asarray(a) * (1 - t) + np.asarray(b) * t


def save(name, picture, quality=88):
    """`picture` holds linear values in [0, 1]: colours are written with the sRGB curve, single channels (heights) as they are."""
    os.makedirs(HERE, exist_ok=True)
    p = np.clip(picture, 0, 1)
    if p.ndim == 3:
        p = np.where(p < .0031308, 12.92 * p, 1.055 * p ** (1 / 2.4) - .055)
    bytes_ = (p * 255 + .5).astype(np.uint8)
    extra = dict(quality=quality, subsampling=0) if name.endswith("jpg") else dict(optimize=True)
    Image.fromarray(bytes_).save(os.path.join(HERE, name), **extra)


def save_hdr(name, picture):
    """Radiance RGBE, one scan line after the other, not compressed."""
    top = np.maximum(picture.max(-1), 1e-9)
    e = np.floor(np.log2(top)).astype(int) + 1
    mantissa = np.clip(picture / np.exp2(e)[..., None] * 256, 0, 255).astype(np.uint8)
    data = np.concatenate([mantissa, (e + 128)[..., None].astype(np.uint8)], -1)
    os.makedirs(HERE, exist_ok=True)
    with open(os.path.join(HERE, name), "wb") as file:
        file.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {picture.shape[0]} +X {picture.shape[1]}\n".encode() + data.tobytes())


def wood(width, height, light, dark, seed, rings=5, contrast=1.0):
    """Grain along x. Growth rings are cut at a slant, so they run as long flames; pores are short dark dashes."""
    y = np.arange(height)[:, None] / height
    warp = noise(width, height, width * .09, height * .08, seed) * .55 + noise(width, height, width * .03, height * .02, seed + 1) * .08
    phase = rings * y + warp
    ring = np.abs(phase - np.floor(phase) - .5) * 2
    fibre = noise(width, height, 45, .9, seed + 2)
    fine = noise(width, height, 14, .5, seed + 3)
    pores = np.clip(noise(width, height, 11, .55, seed + 4) - 1.35, 0, 1.2)
    tone = .42 + contrast * (.34 * (ring**1.6 - .4) + .075 * fibre + .04 * fine + .3 * pores) + .05 * noise(width, height, 300, 60, seed + 5)
    return mix(light, dark, tone)


def floor():
    """Oak planks along y, 16 across a tile of 2.6 m; returns nothing, writes the colours and the heights of the joints."""
    size, rows = 2048, 16
    rng = np.random.default_rng(4)
    stock = [wood(2048, 512, (.56, .42, .29), (.27, .17, .1), 40 + 7 * k, 3 + k, .85) for k in range(4)]
    wide = size // rows
    picture, height = np.zeros((size, size, 3)), np.ones((size, size))
    for row in range(rows):
        first = int(rng.uniform(.1, .5) * size)
        for start, length in ((first, size // 2 + int(rng.uniform(-180, 180))), (None, None)):
            if start is None:
                start, length = end, size - used
            end, used = start + length, length
            board = stock[rng.integers(4)]
            y0, x0 = rng.integers(0, 512 - wide), rng.integers(0, 2048)
            cut = np.take(board[y0:y0 + wide], (x0 + np.arange(length)) % 2048, axis=1)
            if rng.random() < .5:
                cut = cut[::-1, ::-1]
            cut = cut * (rng.uniform(.8, 1.14) * (1 + rng.uniform(-.035, .035, 3) * [1, .2, -1.2]))
            where = (start + np.arange(length)) % size
            picture[where, row * wide:(row + 1) * wide] = cut.transpose(1, 0, 2)
            for k, depth in ((0, 0), (1, .45), (2, .8)):
                for line in (where[k], where[-1 - k]):
                    band = height[line, row * wide:(row + 1) * wide]
                    np.minimum(band, depth, out=band)
        for k, depth in ((0, 0), (1, .45), (2, .8)):
            for line in (row * wide + k, (row + 1) * wide - 1 - k):
                height[:, line] = np.minimum(height[:, line], depth)
    picture *= (.3 + .7 * np.clip(height * 1.6, 0, 1))[..., None]
    save("floor.jpg", picture, 86)
    grain = noise(1024, 1024, .7, 16, 9) * .02 + noise(1024, 1024, 40, 160, 10) * .05
    half = height.reshape(1024, 2, 1024, 2).mean((1, 3))
    save("floor-height.png", .15 + .6 * half + grain)


def weave(name, size, threads, warp_colour, weft_colour, seed, rough=.12):
    """Plain weave: `threads` each way over the tile, warp over weft in turn."""
    x, y = np.meshgrid(np.arange(size) / size * threads, np.arange(size) / size * threads)
    wobble = noise(size, size, 25, 3, seed) * .1
    wobble_y = noise(size, size, 3, 25, seed + 1) * .1
    over = (np.floor(x) + np.floor(y)) % 2
    fx, fy = (x + wobble_y) % 1 - .5, (y + wobble) % 1 - .5
    hump = np.where(over > 0, np.cos(np.pi * fx) * (.55 + .45 * np.cos(np.pi * fy)), np.cos(np.pi * fy) * (.55 + .45 * np.cos(np.pi * fx)))
    thick_x, thick_y = noise(size, size, .8, 60, seed + 2), noise(size, size, 60, .8, seed + 3)
    tone = np.where(over > 0, thick_x, thick_y) * rough + noise(size, size, 1, 1, seed + 4) * rough * .4
    shade = (.5 + .5 * hump) * (1 + tone)
    base = np.where((over > 0)[..., None], np.asarray(warp_colour), np.asarray(weft_colour))
    save(name + ".jpg", base * shade[..., None], 85)
    return hump


def rug():
    """Cream wool with a lattice of diamonds in charcoal and rust between two borders, 2.8 x 1.9 m."""
    w, h = 1792, 1216
    x, y = np.meshgrid((np.arange(w) + .5) / w * 2.8, (np.arange(h) + .5) / h * 1.9)
    x = x + .0035 * noise(w, h, 14, 14, 1)
    y = y + .0035 * noise(w, h, 14, 14, 2)
    out = np.broadcast_to(np.array([.62, .55, .44]), (h, w, 3)).copy()
    edge = np.minimum(np.minimum(x, 2.8 - x), np.minimum(y, 1.9 - y))
    a, b = (x / .4 + y / .38) % 1, (x / .4 - y / .38) % 1
    da, db = np.minimum(a, 1 - a), np.minimum(b, 1 - b)
    field = edge > .23
    out[field & (np.minimum(da, db) < .045)] = (.07, .075, .09)
    middle = np.abs(a - .5) + np.abs(b - .5)
    out[field & (middle < .16)] = (.42, .12, .055)
    out[field & (middle < .08)] = (.62, .55, .44)
    out[(edge > .06) & (edge < .075)] = (.07, .075, .09)
    out[(edge > .19) & (edge < .215)] = (.07, .075, .09)
    band = (edge > .075) & (edge < .19)
    along = np.where(np.minimum(x, 2.8 - x) < np.minimum(y, 1.9 - y), y, x)
    zig = np.abs((along / .12) % 1 - .5) * .17 + .09
    out[band & (np.abs(edge - zig) < .014)] = (.42, .12, .055)
    pile = 1 + .13 * noise(w, h, 1.1, .8, 5) + .05 * noise(w, h, 60, 6, 6) + .04 * noise(w, h, 120, 120, 7)
    rows = .92 + .08 * np.cos(TAU * np.arange(h) / 5)[:, None]
    save("rug.jpg", out * (pile * rows)[..., None], 84)


def painting():
    """An evening landscape in broad horizontal strokes."""
    w, h = 960, 720
    y = np.linspace(0, 1, h)[:, None] + .035 * noise(w, h, 150, 10, 1) + .012 * noise(w, h, 30, 5, 2)
    stops = [0, .22, .42, .5, .56, .68, .85, 1.05]
    tones = np.array([(.3, .4, .48), (.55, .58, .56), (.83, .66, .46), (.72, .4, .22), (.12, .17, .2), (.2, .26, .22), (.42, .36, .2), (.14, .12, .08)])
    out = np.stack([np.interp(y.ravel(), stops, tones[:, k]).reshape(h, w) for k in range(3)], -1)
    gx, gy = np.linspace(0, 1, w)[None, :], np.linspace(0, 1, h)[:, None]
    sun = np.exp(-(((gx - .66) / .055) ** 2 + ((gy - .37) / .073) ** 2) ** 2)
    out = mix(out, (.95, .78, .5), .9 * sun)
    hill = .5 + .05 * np.sin(5 * gx + 1) + .02 * np.sin(17 * gx) + .006 * noise(w, h, 30, 400, 3)
    out = mix(out, (.1, .14, .17), .85 * ((gy > hill) & (gy < hill + .075)))
    stroke = 1 + .12 * noise(w, h, 26, 2.2, 4) + .06 * noise(w, h, 3, 8, 5)
    save("painting.jpg", out * stroke[..., None], 88)


def leaf():
    """A broad leaf, its tip at u = 1: middle and side veins, paler than the blade."""
    w, h = 256, 160
    u, v = np.meshgrid(np.linspace(0, 1, w), np.abs(np.linspace(-1, 1, h)))
    side = np.abs(((u * 9 - v * 2.2) % 1) - .5)
    vein = np.maximum(np.exp(-(v / .05) ** 2), .65 * np.exp(-((.5 - side) / .06) ** 2) * (1 - .6 * v))
    tone = mix((.045, .12, .035), (.09, .2, .06), .5 + .25 * noise(w, h, 12, 12, 3))
    save("leaf.jpg", mix(tone, (.2, .32, .11), vein * .75), 88)


def stripes(name, base, line, seed):
    w = 512
    y = np.arange(w)[:, None] / w
    out = np.broadcast_to(np.asarray(base, float), (w, w, 3)).copy()
    for centre in (.2, .26, .32, .68, .74, .8):
        out[(np.abs(y - centre) < .011)[:, 0]] = line
    t = np.arange(w) % 6 / 5.
    bump = .86 + .14 * np.sin(np.pi * t)[None, :] * np.sin(np.pi * t)[:, None]
    save(name, out * (bump * (1 + .06 * noise(w, w, 1, 8, seed)))[..., None], 85)


def book_covers():
    """Linen-bound covers: u around the cover from one fore edge over the spine to the other, v down; one strip of eight."""
    rng = np.random.default_rng(3)
    cloth = [(.32, .07, .05), (.05, .09, .14), (.42, .3, .1), (.2, .28, .23), (.55, .5, .42), (.1, .06, .09), (.33, .17, .09), (.07, .12, .08)]
    w, h = 256, 256
    for k, colour in enumerate(cloth):
        out = np.asarray(colour) * (1 + .08 * noise(w, h, .7, .7, 70 + k))[..., None]
        gold = np.array((.62, .5, .26)) if sum(colour) < .8 else np.array((.12, .1, .09))
        for y in (22, 28, 226, 232):
            out[y:y + 2, 112:144] = gold
        x = 60
        while x < 190:
            long = int(rng.uniform(5, 16))
            out[x:x + long, 122:134] = gold * rng.uniform(.8, 1)
            x += long + 4
        save(f"book-{k}.jpg", out, 84)


def plaster():
    z = noise(512, 512, 2.2, 2.2, 1) * .35 + noise(512, 512, 9, 9, 2) * .65
    save("plaster.png", .5 + .13 * z)


def leather():
    """Creased grain: cells around scattered points, and wider folds."""
    n = 512
    rng = np.random.default_rng(8)
    point = rng.uniform(0, n, (1400, 2))
    y, x = np.mgrid[0:n, 0:n]
    best, second = np.full((n, n), 1e9), np.full((n, n), 1e9)
    for px, py in point:
        ox, oy = [((np.arange(-26, 27) + int(c)) % n) for c in (px, py)]
        dx, dy = (np.arange(-26, 27) + int(px) - px)[None, :], (np.arange(-26, 27) + int(py) - py)[:, None]
        d = np.hypot(dx, dy)
        ix = np.ix_(oy, ox)
        b, s = best[ix], second[ix]
        second[ix] = np.minimum(s, np.maximum(b, d))
        best[ix] = np.minimum(b, d)
    gap = np.clip((second - best) / 5, 0, 1)
    z = .55 * gap**.7 + .25 + .06 * noise(n, n, 20, 20, 4)
    save("leather-height.png", z)
    tone = .8 + .2 * gap + .09 * noise(n, n, 40, 40, 5) + .03 * noise(n, n, 2, 2, 6)
    save("leather.jpg", np.array((.33, .125, .045)) * tone[..., None], 86)


def shade():
    """Radiance of a linen lamp shade [W m-2 sr-1], v (rows) from rim to rim: brightest at the height of the bulb."""
    w, h = 128, 64
    y = np.linspace(0, 1, h)[:, None]
    glow = .45 + .75 * np.exp(-((y - .55) / .3) ** 2)
    thread = 1 + .1 * noise(w, h, .6, 12, 1) + .08 * noise(w, h, 20, .6, 2)
    edge = np.where((y < .05) | (y > .95), .55, 1)
    save_hdr("shade.hdr", (glow * thread * edge)[..., None] * np.array((3.4, 2.35, 1.38)))


def sky():
    """What the windows face (towards -x): a hazy sky, bright around the sun (which is a light of its own), trees below, W m-2 sr-1.

    Only the half of the sky that the windows see shines; light from elsewhere could not come in.
    """
    w, h = 512, 256
    u = (np.arange(w) + .5) / w
    theta = np.arange(h) / (h - 1) * np.pi
    d = np.stack(np.broadcast_arrays(np.sin(theta)[:, None] * np.sin(TAU * u), np.cos(theta)[:, None], -np.sin(theta)[:, None] * np.cos(TAU * u)), -1)
    up = d[..., 1]
    cloud = noise(w, h, 12, 4, 1) * .5 + noise(w, h, 30, 7, 2) * .6
    blue, haze = np.array((10, 14, 21.)), np.array((20, 22, 25.))
    out = mix(blue, haze, np.clip(1 - up / .65, 0, 1) ** 1.5 + .16 * cloud)
    sun = -np.array(SUN) / np.linalg.norm(SUN)
    angle = np.degrees(np.arccos(np.clip(d @ sun, -1, 1)))
    out = out + np.array((24, 22, 19)) * np.exp(-angle / 13)[..., None]
    # Trees: a ragged line a little above the horizon, darker below, out of focus.
    line = .17 + .05 * noise(w, 1, 11, 1, 5) + .02 * noise(w, 1, 2, 1, 6)
    tree = 1 / (1 + np.exp((up - line) / .008))
    crown = np.exp(.42 * noise(w, h, 2.5, 1.8, 7) + .2 * noise(w, h, .8, .7, 8))
    green = np.array((1.3, 1.7, .75)) * crown[..., None]
    lawn = np.array((3, 3.5, 1.7)) * np.ones((h, w, 1))
    ground = mix(green, lawn, 1 / (1 + np.exp((up + .12) / .02)))
    out = out * (1 - tree)[..., None] + ground * tree[..., None]
    facing = np.clip((-d[..., 0] + .05) / .12, 0, 1) * np.clip((.86 - up) / .08, 0, 1) * np.clip((up + .75) / .1, 0, 1)
    save_hdr("sky.hdr", out * facing[..., None] + 1e-4)


def make():
    floor()
    rug()
    painting()
    leaf()
    plaster()
    leather()
    shade()
    sky()
    book_covers()
    save("walnut.jpg", wood(1024, 512, (.34, .19, .105), (.09, .042, .021), 11, 4), 86)
    save("oak.jpg", wood(1024, 512, (.47, .31, .18), (.24, .13, .065), 12, 5), 84)
    hump = weave("linen", 512, 64, (.66, .62, .55), (.6, .55, .47), 21)
    save("weave-height.png", .5 + .4 * hump)
    weave("rust", 512, 48, (.5, .16, .06), (.4, .11, .04), 22)
    weave("ochre", 512, 48, (.6, .37, .09), (.5, .29, .06), 23)
    weave("curtain", 512, 80, (.78, .74, .67), (.74, .7, .62), 24, .1)
    weave("throw", 512, 36, (.16, .23, .22), (.12, .18, .18), 25, .16)
    stripes("striped.jpg", (.72, .67, .57), (.09, .12, .16), 26)


if __name__ == "__main__":
    make()
