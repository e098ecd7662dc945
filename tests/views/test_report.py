"""The pages stand alone and tell everything."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import HEALTHY, run
from told import Told, tell

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.comparison.residual_maps import ResidualMap
from gms_mujoco.comparison.score import above_floor
from gms_mujoco.plant import Plant
from gms_mujoco.views import page, report


@pytest.fixture(scope="module")
def told(small_set: Path) -> Told:
    return tell(small_set)


def _sound(text: str) -> list[str]:
    """The figures of a page that asks for nothing outside itself."""
    assert not re.search(r"(src|href)\s*=|url\(|@import|<script", text)
    figures = re.findall(r"<svg.*?</svg>", text, re.S)
    for svg in figures:
        assert ET.fromstring(svg) is not None and "nan" not in svg
    ET.fromstring(re.sub(r"<!doctype html>|<meta[^>]*>|<br>", "", text))  # every tag is closed
    return figures


def test_the_page_of_a_diagnosis_tells_everything(told: Told) -> None:
    text = report.render(told)
    assert len(_sound(text)) > 8
    for said in ("partly explained", "+ viscous", "quadratic_drag", "&lt;grows&gt;", "faster &amp; longer"):
        assert said in text
    for c in told.comparisons:
        assert c.where.splitlines()[0] in text
    for name, *_ in told.plant.rows():
        assert name in text


def test_the_page_of_a_comparison_shows_every_view(told: Told) -> None:
    c = told.comparisons[0]
    text = report.render_comparison(c, "my <model>")
    _sound(text)
    assert "my &lt;model&gt;" in text and "<model>" not in text
    for m in c.views:
        if m.name != "time":  # shown sample by sample
            assert m.title[1:].split(",")[0] in text
    for g in c.regimes:
        assert g.name in text
    assert f"<b>{above_floor(c.error, c.noise_floor)}</b>" in text and page.percent(c.torque_error) in text
    assert "at the noise floor" in report.render_comparison(replace(c, noise_floor=c.error))


def test_a_diagnosis_without_validate_records_has_a_page(told: Told) -> None:
    table = {**told.table, "steps": [{**s, "validate_error": None} for s in told.table["steps"]]}
    text = report.render(replace(told, comparisons=(), table=table))
    assert "none was held out" in text and "Where it fails" not in text


def test_where_numbers_come_from_is_told_with_units() -> None:
    fitted = {"bandwidth": 100.0, "error": 0.0476, "noise_floor": 0.001, "clock_skew": 2e-5}
    fitted["undetermined"] = [f"gms.fraction[{i}]; what would tell it: sines" for i in (0, 2)]
    told = dict(page.origin(Plant(1.0, provenance=fitted)))
    assert told["undetermined"] == "gms.fraction[0, 2]; what would tell it: sines"
    assert [told[k] for k in ("bandwidth", "error", "noise floor")] == ["100 Hz", "4.76 %", "0.1 %"]
    assert told["clock skew"] == "2e-05 s"
    servo = dict(page.origin(Plant(1.0, provenance={"error": 1e-3, "error_of": "position, mean absolute [rad]"})))
    assert servo == {"error": "1 mrad"}


def test_a_page_of_responses_alone_speaks_of_responses() -> None:
    frfs = [gms.stepped_sine(HEALTHY, [10, 20, 40, 80], 1e-3), gms.stepped_sine(HEALTHY, [10, 20, 40, 80], 4e-3)]
    text = report.render_comparison(compare(HEALTHY, frfs))
    assert "magnitude re 1 rad/(N m) [dB]" in text
    assert "of the measured torque, of responses each point weighed by its deviation." in text
    assert "<th class=\"k\">response</th>" in text and "of a response under the same torque" in text
    assert "change of position" not in text


def test_a_page_of_a_slide_joint_speaks_of_force_in_its_units() -> None:
    slide = gms.Plant.axis(1.5, "slide") + effects.Coulomb(coulomb=4.0) + effects.Viscous(coefficient=8.0)
    loaded = slide + effects.LoadDependentFriction(coefficient=0.1)
    record = run(slide, 20 * np.sin(np.arange(0, 2, 1e-3) * 12), resolution=1e-7, torque_noise=1e-2)
    found = compare(loaded, [record])
    text = report.render_comparison(found)
    assert "force error" in text and "torque" not in text.replace("torque less that", "") and "1/N" in text
    assert "force up to" in str(found) and "torque" not in str(found)
    assert found.to_dict()["error_of"] == "torque"  # files have one name for both


def test_what_noise_alone_makes_is_no_finding() -> None:
    edges = np.arange(1.0, 65.0)
    noise = ResidualMap("revolution_harmonic", "harmonic", "1/rev", "N m", edges, np.ones(64), np.zeros(64),
                        np.full(64, 2.0), np.full(64, 9.0), 0.04, "44 per revolution")  # fmt: skip
    assert not noise.stands_out and replace(noise, mean=np.full(64, 3.0), share=0.5).stands_out
    assert not replace(noise, mean=np.full(64, 3.0)).stands_out and not replace(noise, share=0.5).stands_out
