"""Writes the meshes of light-tube: a prism of 16 sides whose cross-section has the area of a circle of diameter 1."""

from math import cos, pi, sin, sqrt
from pathlib import Path

SIDES = 16
FOLDER = Path(__file__).parent / "meshes"


def main() -> None:
    radius = sqrt(0.25 * pi / (0.5 * SIDES * sin(2 * pi / SIDES)))
    rim = [(radius * cos(2 * pi * k / SIDES), radius * sin(2 * pi * k / SIDES)) for k in range(SIDES)]
    FOLDER.mkdir(exist_ok=True)
    # From z = 0 to 1; counter-clockwise as seen from the axis.
    lines = [f"v {x!r} {y!r} {z}" for z in (0, 1) for x, y in rim]
    for k in range(SIDES):
        a, b = k + 1, (k + 1) % SIDES + 1
        lines.append(f"f {b} {a} {a + SIDES} {b + SIDES}")
    (FOLDER / "tube.obj").write_text("\n".join(lines) + "\n")
    # In the plane z = 0, seen from above.
    lines = [f"v {x!r} {y!r} 0" for x, y in rim] + ["v 0 0 0"]
    lines += [f"f {SIDES + 1} {k + 1} {(k + 1) % SIDES + 1}" for k in range(SIDES)]
    (FOLDER / "opening.obj").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
