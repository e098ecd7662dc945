"""The pages stand alone and tell everything."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest
from told import Told, tell

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
    assert "above the noise floor" in text and page.percent(c.torque_error) in text


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
