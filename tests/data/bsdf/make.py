#!/usr/bin/env python3
"""Values of Mitsuba's BSDFs that tests/laws/material_laws.rs holds the materials to.

Provenance: Mitsuba 3.9.1 (the wheel of PyPI), variant scalar_rgb, which computes in single precision: the wheel has no
double-precision variant. Directions come from Python's random numbers with the seed below. Writes materials.f32 beside this
file: a text header, one line a parameter set (JSON: name, count, Mitsuba XML), an empty line, then little-endian f32 records

    wo (3)  wi (3)  eval (3)  pdf (1)

where wo points to the viewer and wi to the light (Mitsuba names them the other way round), eval is f |cos theta_i| and pdf the
density of sample(). Ideal directions (sets marked "delta") store in place of eval the factor on radiance, weight times
probability, and in place of pdf the probability; wi is the direction that was drawn.

Half of the light directions of a set are drawn by the BSDF itself, where its lobes are, half uniformly over the sphere. Pairs are
left out where single precision cannot say the value to 2e-5: one rounding of either direction, tried in all coordinates, moves
it by more.

Run: python3 make.py
"""
import json
import os
import random
import struct

import mitsuba as mi

mi.set_variant("scalar_rgb")
PAIRS = 500
SEED = 20240611

RGB = "<rgb name='%s' value='%s'/>"
FLOAT = "<float name='%s' value='%s'/>"
STRING = "<string name='%s' value='%s'/>"
BOOLEAN = "<boolean name='%s' value='%s'/>"


def bsdf(plugin, *parts):
    return f"<bsdf type='{plugin}'>{''.join(parts)}</bsdf>"


def coat(rho, eta, nonlinear, *more):
    return (
        RGB % ("diffuse_reflectance", rho),
        FLOAT % ("int_ior", eta),
        FLOAT % ("ext_ior", 1),
        BOOLEAN % ("nonlinear", nonlinear),
        *more,
    )


def rough(distribution, u, v=None):
    alpha = FLOAT % ("alpha", u) if v is None else FLOAT % ("alpha_u", u) + FLOAT % ("alpha_v", v)
    return STRING % ("distribution", distribution) + alpha


def metal(eta, k):
    return RGB % ("eta", eta) + RGB % ("k", k)


def indices(inside, outside=1):
    return FLOAT % ("int_ior", inside) + FLOAT % ("ext_ior", outside)


CU = metal("0.2004, 0.924, 1.1022", "3.9129, 2.4528, 2.1421")
AL = metal("1.6575, 0.8804, 0.5212", "9.2238, 6.2695, 4.837")
TINT = RGB % ("specular_reflectance", "0.9, 0.7, 0.4")
KT = RGB % ("specular_transmittance", "0.3, 0.8, 0.9")
DIFFUSE = bsdf("diffuse", RGB % ("reflectance", "0.2, 0.5, 0.8"))

def principled(color, **numbers):
    return bsdf("principled", RGB % ("base_color", color), *(FLOAT % pair for pair in numbers.items()))


SETS = {
    "diffuse 1": DIFFUSE,
    "diffuse 2": bsdf("diffuse"),
    "diffuse 3": bsdf("diffuse", RGB % ("reflectance", "1, 0, 0.18")),
    "plastic linear": bsdf("plastic", *coat("0.2, 0.5, 0.8", 1.5, "false")),
    "plastic nonlinear": bsdf("plastic", *coat("0.2, 0.5, 0.9", 1.5, "true")),
    "plastic dense": bsdf("plastic", *coat("0.9, 0.1, 0.3", 1.9, "true", TINT)),
    **{
        f"roughplastic {d} {a}": bsdf("roughplastic", *coat("0.1, 0.5, 0.9", 1.5, n, rough(d, a)))
        for d in ("ggx", "beckmann")
        for a, n in ((0.05, "true"), (0.1, "false"), (0.3, "true"))
    },
    "roughplastic defaults": bsdf("roughplastic"),
    "roughplastic tinted": bsdf("roughplastic", *coat("0.3, 0.4, 0.7", 1.3, "true", rough("ggx", 0.6), TINT)),
    "roughconductor ggx Cu": bsdf("roughconductor", rough("ggx", 0.1), CU),
    "roughconductor beckmann Cu": bsdf("roughconductor", rough("beckmann", 0.2), CU, TINT),
    "roughconductor ggx Al aniso": bsdf("roughconductor", rough("ggx", 0.1, 0.4), AL),
    "roughconductor beckmann Al aniso": bsdf("roughconductor", rough("beckmann", 0.3, 0.08), AL),
    "roughconductor white": bsdf("roughconductor", rough("ggx", 0.5)),
    "roughconductor eta k": bsdf("roughconductor", rough("beckmann", 0.4), metal("2.1, 1.2, 0.6", "1, 2, 3")),
    "roughdielectric ggx": bsdf("roughdielectric", rough("ggx", 0.3), indices(1.5)),
    "roughdielectric beckmann": bsdf("roughdielectric", rough("beckmann", 0.15), indices(1.33), TINT, KT),
    "roughdielectric ggx aniso": bsdf("roughdielectric", rough("ggx", 0.2, 0.5), indices(1, 1.7), KT),
    "roughdielectric beckmann aniso": bsdf("roughdielectric", rough("beckmann", 0.5, 0.2), indices(1.8)),
    "mask diffuse": bsdf("mask", FLOAT % ("opacity", 0.3), DIFFUSE),
    "mask coated": bsdf("mask", FLOAT % ("opacity", 0.75), bsdf("roughplastic", *coat("0.5", 1.5, "true", rough("ggx", 0.2)))),
    "mask two-sided": bsdf("mask", RGB % ("opacity", "0.5"), bsdf("twosided", DIFFUSE)),
    "blend diffuse metal": bsdf("blendbsdf", FLOAT % ("weight", 0.3), DIFFUSE, bsdf("roughconductor", rough("ggx", 0.2), CU)),
    "blend metals": bsdf(
        "blendbsdf",
        FLOAT % ("weight", 0.6),
        bsdf("roughconductor", rough("beckmann", 0.4), AL),
        bsdf("roughconductor", rough("ggx", 0.15), CU),
    ),
    "blend sides": bsdf(
        "blendbsdf",
        FLOAT % ("weight", 0.5),
        bsdf("twosided", DIFFUSE),
        bsdf("roughdielectric", rough("ggx", 0.3), indices(1.5)),
    ),
    "principled plain": principled("0.2, 0.5, 0.8", roughness=0.6),
    "principled metal": principled("0.9, 0.6, 0.2", roughness=0.5, metallic=0.7, spec_tint=0.4, anisotropic=0.5),
    "principled cloth": principled("0.3, 0.2, 0.6", roughness=0.8, sheen=0.7, sheen_tint=0.6, flatness=0.5, eta=1.4),
    "principled coated": principled("0.7, 0.1, 0.1", roughness=0.6, specular=0.8, clearcoat=0.9, clearcoat_gloss=0.2),
    "principled glass": principled("0.9, 0.8, 0.6", roughness=0.5, spec_trans=1, eta=1.5),
    "principled all": principled(
        "0.8, 0.7, 0.3",
        roughness=0.6,
        metallic=0.2,
        spec_trans=0.4,
        spec_tint=0.3,
        anisotropic=0.3,
        sheen=0.3,
        sheen_tint=0.2,
        flatness=0.3,
        clearcoat=0.6,
        clearcoat_gloss=0.3,
        specular=0.6,
    ),
    "delta conductor white": bsdf("conductor", TINT),
    "delta conductor Cu": bsdf("conductor", CU),
    "delta conductor Al": bsdf("conductor", AL, TINT),
    "delta dielectric": bsdf("dielectric", indices(1.5)),
    "delta dielectric tinted": bsdf("dielectric", indices(1.33), TINT, KT),
    "delta dielectric inverse": bsdf("dielectric", indices(1, 1.8)),
    "delta thindielectric": bsdf("thindielectric", indices(1.5)),
    "delta thindielectric tinted": bsdf("thindielectric", indices(1.9), TINT, KT),
    "delta thindielectric thin": bsdf("thindielectric", indices(1.1)),
    "delta plastic": bsdf("plastic", *coat("0.2, 0.5, 0.9", 1.5, "true", TINT)),
    "delta mask": bsdf("mask", FLOAT % ("opacity", 0.4), bsdf("dielectric", indices(1.5))),
    "delta null": bsdf("null"),
}


def direction(rng):
    while True:
        v = [rng.uniform(-1, 1) for _ in range(3)]
        n = sum(x * x for x in v)
        if 1e-4 < n < 1:
            return single(x / n**0.5 for x in v)


def single(v):
    return tuple(struct.unpack("<3f", struct.pack("<3f", *v)))


def interaction(wo):
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*wo)
    si.uv = mi.Point2f(0.3, 0.7)
    return si


CONTEXT = mi.BSDFContext()


def value(material, wo, wi):
    si, other = interaction(wo), mi.Vector3f(*wi)
    return [*material.eval(CONTEXT, si, other), material.pdf(CONTEXT, si, other)]


def is_stable(material, wo, wi, v):
    """True if no coordinate's rounding (2^-24) moves a value by more than 2e-5."""
    for k in range(3):
        for which in (0, 1):
            for sign in (-1, 1):
                pair = [list(wo), list(wi)]
                pair[which][k] += sign * 2**-24
                moved = value(material, *pair)
                if any(abs(a - b) > 2e-5 * abs(b) for a, b in zip(moved, v)):
                    return False
    return True


def spread(material, name, xml, rng):
    records, empty = [], 0
    while len(records) < PAIRS:
        wo = direction(rng)
        # Below an opaque principled surface Mitsuba reports a density where there is no value.
        opaque = name.startswith("principled") and "spec_trans" not in xml
        if opaque or rng.random() < 0.75:
            wo = (wo[0], wo[1], abs(wo[2]))
        wi = direction(rng)
        if len(records) % 2:
            sample, weight = material.sample(
                CONTEXT, interaction(wo), rng.random(), mi.Point2f(rng.random(), rng.random())
            )
            if sample.pdf == 0:
                continue
            wi = single(sample.wo)
        if min(abs(wo[2]), abs(wi[2])) < 1e-2:
            continue
        v = value(material, wo, wi)
        empty += not any(v)
        # Some zeros are wanted, on the wrong side of the surface, but few are enough.
        if not any(v) and empty > PAIRS // 10:
            continue
        if is_stable(material, wo, wi, v):
            records.append((*wo, *wi, *v))
    return records


def ideal(material, rng):
    records = []
    while len(records) < PAIRS:
        wo = direction(rng)
        sample, weight = material.sample(CONTEXT, interaction(wo), rng.random(), mi.Point2f(rng.random(), rng.random()))
        is_delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta) or mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
        if sample.pdf == 0 or not is_delta or abs(wo[2]) < 1e-2:
            continue
        records.append((*wo, *single(sample.wo), *(w * sample.pdf for w in weight), sample.pdf))
    return records


def main():
    rng = random.Random(SEED)
    header, body = [], bytearray()
    for name, xml in SETS.items():
        material = mi.load_string(xml.replace("<bsdf", "<bsdf version='3.0.0'", 1))
        records = ideal(material, rng) if name.startswith("delta") else spread(material, name, xml, rng)
        header.append(json.dumps({"name": name, "count": len(records), "xml": xml}))
        for record in records:
            body += struct.pack("<10f", *record)
        print(name, len(records))
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "materials.f32")
    with open(path, "wb") as file:
        file.write("\n".join(header).encode() + b"\n\n" + bytes(body))


if __name__ == "__main__":
    main()
