"""Figures: what is thinned keeps its shape, scales are round, every figure is sound SVG."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.views import figure
from gms_mujoco.views.figure import Band, Curve


def test_thinning_keeps_the_peaks_and_the_order() -> None:
    y = np.random.default_rng(0).standard_normal(100_000)
    i = figure.thin(y, 1000)
    assert len(i) <= 1000 and (np.diff(i) > 0).all() and y[i].max() == y.max() and y[i].min() == y.min()


def test_spreading_is_even() -> None:
    for n in (0, 1, 1500, 1501, 100_000):
        i = figure.spread(n)
        assert len(i) <= 1500 and len(set(np.diff(i))) <= 1 and len(i) >= min(n, 750)


def test_worst_stretch_is_where_the_residual_is() -> None:
    r = np.zeros(5000)
    r[3000:3200] = 1.0
    s = figure.worst_stretch(r)
    assert s.start <= 3000 and s.stop >= 3200 and s.stop - s.start == 500
    assert figure.worst_stretch(np.zeros(10)) == slice(0, 10)


def test_a_constant_curve_has_axes() -> None:
    flat = figure.Curve("flat", np.arange(5.0), np.zeros(5), "#000")
    svg = figure.plot([flat], "x", "", "y", "")
    assert "nan" not in svg and figure.ticks(-1.0, 1.0) == [-1.0, -0.5, 0.0, 0.5, 1.0]


@pytest.mark.parametrize("style", figure.STYLES)
@pytest.mark.parametrize("log", [(False, False), (True, True)])
def test_every_style_is_sound_svg(style: str, log: tuple[bool, bool]) -> None:
    x = np.linspace(0.5, 5, 40)
    svg = figure.plot([Curve("a <b>", x, x**2, "#123456", style)], "x & y", "rad", "y", "N m",
                      bands=[Band(x, x, 2 * x**2)], log=log)  # fmt: skip
    root = ET.fromstring(svg)
    assert "nan" not in svg and root.get("viewBox") and "#123456" in svg and "band" in svg


@pytest.mark.parametrize(
    ("size", "unit", "expected"),
    [(4e-4, "N m", (1e-6, "µN m")), (0.02, "N m", (1e-3, "mN m")), (30.0, "rad", (1.0, "rad")),
     (2e4, "N", (1e3, "kN")), (2e4, "rad/s", (1.0, "rad/s")), (1e-4, "rad/s^2", (1.0, "rad/s^2")),
     (0.0, "N m", (1.0, "N m")), (1e-12, "s", (1e-6, "µs"))],
)  # fmt: skip
def test_units_take_the_prefix_that_makes_numbers_short(size: float, unit: str, expected: tuple[float, str]) -> None:
    assert figure.prefixed(size, unit) == expected


def test_marks_are_written_out_up_to_a_million() -> None:
    svg = figure.plot([Curve("a", np.geomspace(1, 2e4, 9), np.geomspace(1, 2e4, 9), "#000")], "x", "", "y", "",
                      log=(True, True))  # fmt: skip
    assert ">10000<" in svg and "e+" not in svg


def test_a_step_has_one_colour_wherever_it_is_drawn() -> None:
    colours = [figure.step_colour(k, 4) for k in range(4)]
    svg = figure.bars([(f"step {k}", 1.0) for k in range(4)], None, str)
    assert colours[0] == figure.COLOURS[1] and colours[-1] == figure.COLOURS[2] and len(set(colours)) == 4
    assert [svg.index(f'fill="{c}"') for c in colours] == sorted(svg.index(f'fill="{c}"') for c in colours)
    assert figure.step_colour(0, 1) == figure.COLOURS[1]


@given(st.floats(-6, 6), st.floats(0.2, 8))
def test_marks_of_a_logarithmic_axis_lie_on_it(low: float, width: float) -> None:
    marks = figure.decades(low, low + width)
    assert all(low <= m <= low + width for m in marks) and marks == sorted(marks)
    assert len(marks) >= 1 or width < 0.4
