"""The documentation: it builds without a warning, and what it promises runs as printed."""

import contextlib
import io
import re
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from gms_mujoco import formats, servo_run
from gms_mujoco.cli import main
from gms_mujoco.dataset import load
from gms_mujoco.logs import columns, measured_axis, record_files, units
from gms_mujoco.responses import frf_files, frf_table

DOCS = Path(__file__).resolve().parent.parent / "docs"
SETS = (DOCS / "pages" / "measurement_sets.md").read_text(encoding="utf-8")
OWN_LOG = (DOCS / "pages" / "your_own_log.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", OWN_LOG, re.S)
    assert found, f"no {language} block"
    return found.group(1)


@pytest.fixture
def foreign_log(small_set: Path, tmp_path: Path) -> Path:
    """A folder with the page's dataset.toml beside logs in the page's layout."""
    header = block("text").splitlines()[0]
    runs = load(small_set)
    for name, r in zip(("bench_17.csv", "bench_18.csv"), (runs.fit[0], runs.validate[0]), strict=True):
        columns = np.column_stack([1e3 * (r.time - r.time[0]), 1e3 * r.torque / 0.02, np.degrees(r.position)])
        rows = (";".join(f"{x:.9f}".replace(".", ",") for x in row) for row in columns)
        (tmp_path / name).write_text("\n".join([header, *rows]), encoding="latin-1")
    (tmp_path / "dataset.toml").write_text(block("toml"))
    return tmp_path


def test_a_log_in_a_foreign_layout_leads_to_a_verdict(foreign_log, monkeypatch, capsys):
    monkeypatch.chdir(foreign_log)
    command = shlex.split(block("sh"))
    assert command[0] == "gms-mujoco"
    assert main(command[1:]) == 0
    assert "verdict:" in capsys.readouterr().out
    assert {"report.html", "model.toml", "diagnosis.json", "recording.rrd"} <= {
        p.name for p in (foreign_log / "diagnosis").iterdir()
    }


def test_the_foreign_layout_is_read_into_si(foreign_log, small_set):
    for read, meant in zip(load(foreign_log).fit, load(small_set).fit[:1], strict=True):
        np.testing.assert_allclose(read.position, meant.position, atol=1e-8)
        np.testing.assert_allclose(read.torque, meant.torque, atol=1e-8)


@pytest.mark.parametrize(
    "names", [measured_axis._KEYS, record_files._KEYS, servo_run._KEYS, frf_files._KEYS, columns.COLUMNS,
              frf_table.COLUMNS, formats.suffixes(), ("controller",)],
    ids=["axis", "record", "servo", "frf", "columns", "columns of frf", "formats", "drive"],
)  # fmt: skip
def test_the_reference_of_measurement_sets_has_every_key_and_format(names):
    assert [n for n in names if f"`{n}`" not in SETS] == []


@pytest.mark.parametrize("column", ["time", "position", "torque", "current", "temperature"])
@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_the_reference_of_measurement_sets_has_every_unit(column, kind):
    section = SETS.split("## Units")[1]
    row = next(line for line in section.splitlines() if re.match(rf"\| `{column}`( of a {kind})? \|", line))
    told = re.split(r"[,|] *", row)
    assert [u for u in units.units_of(column, kind) if u not in map(str.strip, told)] == []


def test_the_pages_build_without_a_warning(tmp_path, monkeypatch):
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    pytest.importorskip("mkdocstrings", reason="needs the extra docs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    config = load_config(str(DOCS / "mkdocs.yml"), strict=True, site_dir=str(tmp_path / "site"))
    build(config)  # raises Abort where anything was warned of
    pages = {p.name for p in (tmp_path / "site" / "effects").glob("*.html")}
    from gms_mujoco.effects import CATALOGUE

    assert pages == {f"{name}.html" for name in CATALOGUE}
    for page in (tmp_path / "site").rglob("*.html"):
        assert not re.search(r'(src|href)="https?://(?!www\.mkdocs\.org)', page.read_text(encoding="utf-8")), page

    page = (tmp_path / "site" / "effects" / "cogging.html").read_text(encoding="utf-8")
    assert page.count('<figure class="signature"') == 1 and "<svg" in page


@pytest.mark.parametrize("name", ["cogging", "coulomb", "viscous", "torque_saturation", "encoder_eccentricity", "gms"])
def test_the_picture_of_an_effect_shows_what_a_model_without_it_misses(name, monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import effect_pictures

    p, motion = effect_pictures.PICTURES[name], effect_pictures.MOTION
    here = motion.parts[p.part]
    x, y = motion.quantities[p.over][0][here], motion.missed(p)[0][here]
    e = p.effect
    moving = np.abs(motion.velocity[here]) > 1e-3
    if name == "cogging":
        assert np.ptp(y) == pytest.approx(2 * e.amplitude[0], rel=0.01)
        assert len(np.flatnonzero(np.diff(np.sign(y[: len(y) // 2])))) == 2 * e.harmonics[0]
    elif name in ("coulomb", "viscous"):
        level = e.coulomb * np.sign(x) if name == "coulomb" else e.coefficient * x
        np.testing.assert_allclose(y[moving], level[moving], rtol=0.02, atol=1e-5)
    elif name == "torque_saturation":
        np.testing.assert_allclose(y, x - np.clip(x, -e.limit, e.limit), atol=1e-12)
    elif name == "encoder_eccentricity":
        assert np.max(np.abs(y)) == pytest.approx(e.amplitude, rel=0.01)
    else:  # a loop: more friction the farther it went, and never more than the static level
        assert 0.8 * e.coulomb < np.max(np.abs(y)) <= e.static


def test_most_effects_have_a_picture(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import effect_pictures

    from gms_mujoco.effects import CATALOGUE

    drawn = [name for name, e in CATALOGUE.items() if "<svg" in effect_pictures.picture(e)]
    assert len(drawn) >= 21
    for p in effect_pictures.PICTURES.values():
        y = effect_pictures.MOTION.missed(p)[0]
        assert np.isfinite(y).all() and np.ptp(y) + abs(y).max() > 0


NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def test_the_page_of_frequency_responses_runs_and_says_what_it_prints(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    monkeypatch.chdir(tmp_path)
    import response_picture

    names = {}
    page = response_picture.PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```)?", page, re.S)
    for code, printed in blocks:
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(code, names)
        assert NUMBER.sub("", said.getvalue()).split() == NUMBER.sub("", printed).split()
        for found, shown in zip(NUMBER.findall(said.getvalue()), NUMBER.findall(printed), strict=True):
            assert float(found) == pytest.approx(float(shown), rel=0.3), printed
    for name, (low, high) in names["fit"].plant.uncertainty.items():
        if name in ("inertia", "gms.coulomb", "gms.static", "viscous.coefficient"):
            assert low <= names["axis"].numbers()[name][0] <= high, name
    assert ET.fromstring(response_picture.picture(names)).tag.endswith("svg")
    assert (DOCS / "pages" / "dahl_resonance.svg").is_file()
