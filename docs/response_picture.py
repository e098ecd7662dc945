"""The picture on the page of frequency responses, from what the blocks of that page measure and identify.

Run: python docs/response_picture.py      writes pages/dahl_resonance.svg
"""

from __future__ import annotations

import html
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import gms_mujoco as gms
from gms_mujoco.frf import FRF
from gms_mujoco.identification.motion import virgin_curve
from gms_mujoco.plant import Plant
from gms_mujoco.views.figure import COLOURS, Curve, plot

PAGES = Path(__file__).resolve().parent / "pages"
PAGE = PAGES / "frequency_responses.md"
WIDTH, HEIGHT, HEAD = 450, 270, 24  # of a panel, and of the line above it [px]
STYLE = """svg { font: 12px sans-serif; color: #222 } .grid { stroke: #222; opacity: .15 }
.cloud { stroke-width: 5; stroke-linecap: round; opacity: .6 } text { fill: #222 }"""


def blocks() -> list[str]:
    """The code of the page, block by block."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)


def magnitudes(plant: Plant, frfs: list[FRF]) -> str:
    """Measured and of the plant, one curve for each torque."""
    curves = []
    for i, r in enumerate(gms.compare(plant, frfs).frfs):
        colour = COLOURS[i % len(COLOURS)]
        curves.append(Curve(r.name, r.frequency, abs(r.response), colour, "points"))
        curves.append(Curve(r.name, r.frequency, abs(r.model), colour))
    return plot(curves, "frequency", "Hz", "position / torque", "rad/(N m)", log=(True, True), width=WIDTH,
                height=HEIGHT)  # fmt: skip


def readings(axis: Plant, found: Plant, dahl: gms.DahlReading) -> tuple[str, list[tuple[str, str]]]:
    """The curve from rest: true, identified, and as the resonances alone are read; and its legend."""
    x, _, _, secant, slope = (np.array(c) for c in zip(*dahl.readings(), strict=True))
    fine = np.geomspace(0.5 * x[0], x[-1], 300)
    true, own = (np.interp(fine, *virgin_curve(p, float(x[-1]), 4000)) for p in (axis, found))
    curves = [
        Curve("true", fine, true, "#555555", "under"),
        Curve("identified", fine, own, COLOURS[3]),
        Curve("describing function", fine, dahl.virgin_curve(fine), COLOURS[0]),
        Curve("secant", x, secant, COLOURS[1]),
        Curve("slope", x, slope, COLOURS[2]),
    ]
    drawn = plot(curves, "distance from rest", "rad", "friction", "N m", log=(True, False), width=WIDTH, height=HEIGHT)
    return drawn, [(c.name, c.colour) for c in curves]


def panel(svg: str, x: int) -> str:
    return svg.replace("<svg ", f'<svg x="{x}" y="{HEAD}" width="{WIDTH}" height="{HEIGHT}" ', 1)


def picture(names: dict[str, Any]) -> str:
    """SVG of both panels, from what the blocks of the page leave behind."""
    drawn, legend = readings(names["axis"], names["fit"].plant, names["dahl"])
    head = [f'<text x="62" y="16">{len(names["frfs"])} torques, {1e3 * names["torques"][0]:.2g} to '
            f'{1e3 * names["torques"][-1]:.2g} mN m: points measured, lines identified</text>']  # fmt: skip
    at = WIDTH + 20.0
    for name, colour in legend:
        head.append(f'<rect x="{at:.0f}" y="7" width="10" height="10" fill="{colour}"/>')
        head.append(f'<text x="{at + 14:.0f}" y="16">{html.escape(name)}</text>')
        at += 26 + 6.2 * len(name)
    size = f"0 0 {2 * WIDTH} {HEAD + HEIGHT}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}" role="img"><style>{STYLE}</style>'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(head)}'
        f'{panel(magnitudes(names["fit"].plant, names["frfs"]), 0)}{panel(drawn, WIDTH)}</svg>\n'
    )


def main() -> None:
    names: dict[str, Any] = {}
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for code in blocks():
                exec(code, names)  # the page itself
        finally:
            os.chdir(here)
    (PAGES / "dahl_resonance.svg").write_text(picture(names), encoding="utf-8")


if __name__ == "__main__":
    main()
