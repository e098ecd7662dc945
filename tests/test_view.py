"""A diagnosis can be looked at: the recording reads back, the page stands alone."""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from gms_mujoco import effects, figure, report, view
from gms_mujoco.compare import Comparison, compare
from gms_mujoco.dataset import load
from gms_mujoco.errors import GmsError
from gms_mujoco.plant import Plant


@dataclass(frozen=True)
class Told:
    """What a diagnosis tells, without the search for it."""

    baseline: Plant
    plant: Plant
    comparisons: tuple[Comparison, ...]
    table: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        return self.table


@pytest.fixture(scope="module")
def told(small_set: Path) -> Told:
    """The small set under a plant without and with its viscous friction."""
    runs = load(small_set)
    poor = Plant.axis(2.4e-5) + effects.find("coulomb")(coulomb=4e-3)
    rich = poor + effects.find("viscous")(coefficient=2e-5)
    comparisons = tuple(compare(p, runs.validate) for p in (poor, rich))
    errors = [c.torque_error for c in comparisons]
    table = {
        "schema": 1,
        "verdict": "partly_explained",
        "noise_floor": comparisons[0].noise_floor,
        "steps": [
            {"effect": None, "fit_error": errors[0], "validate_error": errors[0]},
            {
                "effect": "viscous",
                "fit_error": errors[1],
                "validate_error": errors[1],
                "confusable_with": ["quadratic_drag"],
                "parameters": {},
                "evidence": "The error <grows> with speed.",
            },
        ],
        "candidates": [{"effect": "gravity", "validate_error": None, "p_value": 0.4}],
        "next_experiment": "Run faster & longer.",
    }
    return Told(poor, rich, comparisons, table)


def test_recording_reads_back_with_its_signals(told: Told, tmp_path: Path) -> None:
    view.write_recording(tmp_path / "recording.rrd", told)
    assert [p.name for p in tmp_path.iterdir()] == ["recording.rrd"]
    store = RrdReader(tmp_path / "recording.rrd").stream().collect()
    rows: dict[str, int] = {}
    for chunk in store.stream():
        rows[chunk.entity_path] = max(rows.get(chunk.entity_path, 0), chunk.num_rows)
    samples = len(told.comparisons[0].records[0].time)
    root = "/records/validate.csv"
    for entity in ("torque/measured", "torque/baseline", "torque/viscous", "residual/viscous"):
        assert rows[f"{root}/{entity}"] == min(samples, len(figure.thin(np.zeros(samples), 4000)))
    assert {"/verdict", "/errors/0", "/errors/1", "/errors/floor", f"{root}/loop/measured"} <= set(rows)
    assert {f"{root}/over_position/baseline", f"{root}/over_velocity/viscous"} <= set(rows)


def test_recording_without_a_place_leaves_nothing(told: Told, tmp_path: Path) -> None:
    with pytest.raises(GmsError, match="nowhere"):
        view.write_recording(tmp_path / "nowhere" / "recording.rrd", told)


def test_page_stands_alone_and_tells_everything(told: Told) -> None:
    page = report.render(told)
    assert not re.search(r'(src|href)\s*=|url\(|@import|<script', page)
    for text in ("partly explained", "+ viscous", "quadratic_drag", "&lt;grows&gt;", "faster &amp; longer"):
        assert text in page
    for svg in re.findall(r"<svg.*?</svg>", page, re.S):
        assert ET.fromstring(svg) is not None and "nan" not in svg


def test_parameters_show_their_interval_and_unit() -> None:
    plant = Plant.axis(2.0, "slide") + effects.find("coulomb")(coulomb=20.0)
    intervals = {"coulomb.coulomb": (19.0, 21.0), "inertia": (1e-300, 1e300)}
    rows = report.parameter_rows(replace(plant, uncertainty=intervals))
    assert rows == [("inertia", "2", "not seen by this data", "kg"), ("coulomb.coulomb", "20", "[19, 21]", "N")]


def test_an_effect_with_one_element_shows_its_interval() -> None:
    plant = Plant.axis(1.0) + effects.find("cogging")(harmonics=[5], amplitude=[0.2], phase=[0.1])
    rows = report.parameter_rows(replace(plant, uncertainty={"cogging.amplitude": (0.1, 0.3)}))
    assert ("cogging.amplitude", "0.2", "[0.1, 0.3]", "N m") in rows


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
    svg = figure.plot([flat], "x", "y")
    assert "nan" not in svg and figure.ticks(-1.0, 1.0) == [-1.0, -0.5, 0.0, 0.5, 1.0]
