"""The tour through a diagnosis reads back: every tab is there, and the drawn numbers are those of the comparison."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from recordings import Rows, last_values
from told import Told, tell

from gms_mujoco.errors import GmsError
from gms_mujoco.views import drawing, figure, page, tour
from gms_mujoco.views.figure import Band, Curve


@pytest.fixture(scope="module")
def told(small_set: Path) -> Told:
    return tell(small_set)


@pytest.fixture(scope="module")
def rows(told: Told, tmp_path_factory: pytest.TempPathFactory) -> Rows:
    folder = tmp_path_factory.mktemp("tour")
    tour.write_recording(folder / "recording.rrd", told)
    assert [p.name for p in folder.iterdir()] == ["recording.rrd"]
    return last_values(folder / "recording.rrd")


def test_the_tour_has_all_its_stations(told: Told, rows: Rows) -> None:
    stations = ("verdict", "baseline", "fails", "candidates", "added/viscous", "final")
    assert {f"/{s}/text" for s in stations} <= set(rows)
    root = "/records/validate.csv"
    samples = len(told.comparisons[0].records[0].time)
    for entity in ("torque/measured", "torque/baseline", "torque/viscous", "residual/viscous"):
        assert rows[f"{root}/{entity}"]["rows"] == len(figure.thin(np.zeros(samples), 4000))
    assert {"/errors/0", "/errors/1", "/errors/floor", f"{root}/loop/measured", "/virgin/baseline"} <= set(rows)


def test_texts_say_verdict_evidence_and_where_it_fails(told: Told, rows: Rows) -> None:
    def text(station: str) -> str:
        return str(rows[f"/{station}/text"]["text"])

    assert "partly explained" in text("verdict") and "Run faster & longer." in text("verdict")
    assert told.comparisons[0].where.splitlines()[0] in text("fails")
    assert "gravity" in text("candidates") and "one sine per revolution" in text("candidates")
    assert "quadratic_drag" in text("added/viscous") and "viscous.coefficient" in text("added/viscous")


def test_drawn_numbers_are_those_of_the_views(told: Told, rows: Rows) -> None:
    c = told.comparisons[0]
    seen = 0
    for m in page.telling(c)[0]:
        data = rows[f"/fails/views/{m.name}/data/baseline"]
        keep = m.centres > 0 if m.log[0] else np.ones(len(m.centres), bool)
        assert np.ravel(data["x"]) == pytest.approx(m.centres[keep])
        assert np.ravel(data["y"]) == pytest.approx(m.mean[keep])
        assert f"/fails/views/{m.name}/band" in rows and f"/fails/views/{m.name}/axes/ticks" in rows
        seen += 1
    assert seen >= 4


def test_drawn_loops_are_those_of_the_record(told: Told, rows: Rows) -> None:
    c = told.comparisons[-1]
    near = figure.worst_stretch(told.comparisons[0].records[0].residual)
    measured, needed = page.friction(c, c.records[0])
    data = rows["/records/validate.csv/loop/data/measured"]
    assert np.ravel(data["x"]) == pytest.approx(c.records[0].position[near])
    assert np.ravel(data["y"]) == pytest.approx(measured[near])
    assert np.ravel(rows["/records/validate.csv/loop/data/viscous"]["y"]) == pytest.approx(needed[near])


def test_a_recording_without_a_place_leaves_nothing(told: Told, tmp_path: Path) -> None:
    with pytest.raises(GmsError, match="nowhere"):
        tour.write_recording(tmp_path / "nowhere" / "recording.rrd", told)


@pytest.mark.parametrize("log", [(False, False), (True, True)])
def test_a_drawing_fills_its_box(tmp_path: Path, log: tuple[bool, bool]) -> None:
    x = np.geomspace(1e-3, 1, 50)
    with rr.RecordingStream("test") as stream:
        stream.save(tmp_path / "a.rrd")
        drawing.draw(stream, "plot", [Curve("a", x, 2e-4 * x, "#ff0000")], "x", "rad", "y", "N m",
                     bands=[Band(x, x * 1e-4, x * 3e-4)], log=log)  # fmt: skip
        stream.flush()
        stream.disconnect()
    rows = last_values(tmp_path / "a.rrd")
    strip = np.array(rows["/plot/a"]["strips"][0][0])
    assert (strip >= -1e-6).all() and (strip <= np.array(drawing.BOX) + 1e-6).all()
    assert np.ptp(strip[:, 0]) > 0.9 * drawing.BOX[0] and strip[0, 1] > strip[-1, 1]  # up is up
    if all(log):  # a power law is a straight line
        assert np.diff(strip[:, 1]) / np.diff(strip[:, 0]) == pytest.approx(np.polyfit(*strip.T, 1)[0], rel=0.02)
    words = str(rows["/plot/axes/labels"])
    assert "y [µN m]" in words and "x [" in words


@pytest.mark.parametrize("names", [["a"], ["a", "b"], ["baseline", "+ load_dependent_friction", "+ thermal_drift"]])
def test_a_legend_leaves_the_title_of_the_axis_readable(names: list[str], tmp_path: Path) -> None:
    x = np.linspace(0, 1, 50)
    curves = [Curve(n, x, x, "#ff0000") for n in names]
    with rr.RecordingStream("test") as stream:
        stream.save(tmp_path / "a.rrd")
        drawing.draw(stream, "plot", curves, "x", "rad", "residual", "N m", bands=[Band(x, x, x)])
        stream.flush()
        stream.disconnect()
    rows = last_values(tmp_path / "a.rrd")
    (_, title), *_ = rows["/plot/axes/labels"]["positions"][0]
    (left, row), *_ = rows["/plot/axes/legend"]["positions"][0]
    assert title < row or left > 0.15 + 0.042 * len("residual [N m]  " + names[0]) / 2
    assert min(title, row) > -0.35  # within the view
