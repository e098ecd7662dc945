"""Fleets: the same numbers wherever they are computed, nothing lost in a kill, and one failure that stops nobody."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import J, run

from gms_mujoco import cli, dataset, effects, fleet, workers
from gms_mujoco.errors import DataError, GmsError
from gms_mujoco.identification.coordinates import Coordinates
from gms_mujoco.plant import Plant
from gms_mujoco.sampling import sample

SIMPLE = Plant.axis(J) + effects.Coulomb(coulomb=4e-3) + effects.Viscous(coefficient=3e-5)
HOW = [{"jobs": 1}, {"jobs": 2}, {"cluster": "local"}]


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four axes whose drag differs, the third without a readable log."""
    folder = tmp_path_factory.mktemp("robots")
    t = 1e-3 * np.arange(700)
    for i in range(4):
        plant = SIMPLE.replace(effects.Viscous(coefficient=2e-5 * (i + 1)))
        record = run(plant, 0.02 * np.sin(2 * np.pi * 3 * t), seed=i)
        records = [replace(record, name="fit"), replace(record, name="more", use="validate")]
        dataset.save(folder / f"axis_{i}", records, inertia=J)
    (folder / "axis_2" / "fit.csv").write_text("time,torque,position\n0,0,\n")
    return folder


@pytest.fixture(scope="module")
def scheduler():
    distributed = pytest.importorskip("distributed")
    where = {"host": "127.0.0.1", "dashboard_address": None, "n_workers": 2, "threads_per_worker": 1}
    with distributed.LocalCluster(**where, processes=True) as cluster:
        assert cluster.scheduler_address.startswith("tcp://127.0.0.1")
        yield cluster.scheduler_address


def numbers(rows) -> list:
    """Results without the time that they took."""
    return [{k: v for k, v in r.items() if k not in ("seconds",)} for r in rows]


def test_the_same_numbers_on_every_backend(robots: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    found = []
    for i, how in enumerate(HOW):
        if "cluster" in how:
            how = {"cluster": request.getfixturevalue("scheduler")}
        seen: list[float] = []
        done = fleet.fit_all(robots, tmp_path / str(i), SIMPLE, progress=lambda x, m, s=seen: s.append(x), **how)
        assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) == 4, "progress never falls"
        found.append(numbers(done.rows))
    assert found[0] == found[1] == found[2], "to the last bit"
    assert [r["status"] for r in found[0]] == ["done", "done", "failed", "done"]
    drags = [r["parameters"]["viscous.coefficient"] for r in found[0] if r["status"] == "done"]
    assert drags == pytest.approx([2e-5, 4e-5, 8e-5], rel=0.1)


def test_one_that_fails_stops_nobody_and_is_told_in_one_line(robots: Path, tmp_path: Path, capsys) -> None:
    SIMPLE.save(tmp_path / "simple.toml")
    argv = ["fleet", str(robots), "-o", str(tmp_path / "out"), "--jobs", "1", "--model", str(tmp_path / "simple.toml")]
    assert cli.main(argv) == 0
    out = capsys.readouterr().out
    assert "3 done, 1 failed" in out and "failed: " in out and "fit.csv" in out
    with open(tmp_path / "out" / "summary.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [r["status"] for r in rows] == ["done", "done", "failed", "done"] and "fit.csv" in rows[2]["error"]
    assert float(rows[0]["fit_error"]) < 0.1 and rows[0]["effects"] == "coulomb viscous"
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["rows"][1]["uncertainty"]["viscous.coefficient"][0] > 0
    assert not list((tmp_path / "out").rglob("*.pkl")) and not list((tmp_path / "out").rglob(".*"))


def test_a_second_run_takes_what_is_there_and_does_what_has_changed(robots: Path, tmp_path: Path) -> None:
    first = fleet.fit_all([robots / "axis_0", robots / "axis_1" / "dataset.toml"], tmp_path, SIMPLE, jobs=1)
    times = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("result.json")}
    again = fleet.fit_all([robots / "axis_1", robots / "axis_0"], tmp_path, SIMPLE, jobs=1)  # in another order
    assert again.rows == first.rows[::-1]
    assert times == {p: p.stat().st_mtime_ns for p in tmp_path.rglob("result.json")}
    assert again.plant(again.rows[0]["name"])["viscous"].coefficient == pytest.approx(4e-5, rel=0.1)
    more = fleet.fit_all(robots / "axis_0", tmp_path, SIMPLE + effects.QuadraticDrag(), jobs=1)
    assert more.rows[0]["effects"] == ["coulomb", "viscous", "quadratic_drag"], "another question, another answer"
    (tmp_path / first.rows[1]["name"] / "result.json").write_text('{"cut')
    assert numbers(fleet.fit_all(robots / "axis_1", tmp_path, SIMPLE, jobs=1).rows) == numbers(first.rows[1:])


def test_nothing_is_lost_in_a_kill(robots: Path, tmp_path: Path) -> None:
    for i in range(10):  # enough for the kill to come in between
        shutil.copytree(robots / "axis_0", tmp_path / "sets" / f"axis_{i}")
    sets = str(tmp_path / "sets")
    SIMPLE.save(tmp_path / "simple.toml")
    out = tmp_path / "out"
    argv = [sys.executable, "-m", "gms_mujoco", "fleet", sets, "-o", str(out), "--jobs", "1"]
    argv += ["--model", str(tmp_path / "simple.toml")]
    process = subprocess.Popen(argv, cwd=tmp_path, stderr=subprocess.DEVNULL)  # outside the tree, as installed
    while not list(out.rglob("result.json")) and process.poll() is None:
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = {p: p.stat().st_mtime_ns for p in out.rglob("result.json")}
    assert 1 <= len(before) < 10, "killed in the middle"
    assert all(json.loads(p.read_text())["status"] == "done" for p in before)
    seen: list[float] = []
    done = fleet.fit_all(sets, out, SIMPLE, jobs=1, progress=lambda x, m: seen.append(x))
    assert seen[0] == pytest.approx(len(before) / 10) and seen[-1] == 1.0
    assert {p: p.stat().st_mtime_ns for p in before} == before, "what was done is not done again"
    whole = fleet.fit_all(sets, tmp_path / "whole", SIMPLE, jobs=1)
    assert numbers(done.rows) == numbers(whole.rows)


def test_diagnoses_have_their_files(robots: Path, tmp_path: Path) -> None:
    t = 1e-3 * np.arange(1500)
    torque = 0.02 * np.sin(2 * np.pi * 2 * t) + 0.01 * np.sin(2 * np.pi * 7.3 * t)
    hidden = SIMPLE + effects.TorqueOffset(torque=2e-3)
    runs = [replace(run(hidden, torque, seed=i), name=str(i), use=u) for i, u in enumerate(("fit", "fit", "validate"))]
    dataset.save(tmp_path / "set", runs, inertia=J)
    done = fleet.diagnose_all(tmp_path / "set", tmp_path / "out", SIMPLE, jobs=1)
    row = done.rows[0]
    assert row["verdict"] in ("explained", "partly_explained") and row["added"][0] == "torque_offset"
    folder = tmp_path / "out" / row["name"]
    assert json.loads((folder / "diagnosis.json").read_text())["verdict"] == row["verdict"]
    assert "torque_offset" in done.plant(row["name"]) and "torque_offset" not in Plant.load(folder / "baseline.toml")
    assert row["verdict"] in str(done)


def test_a_long_table_shows_some_and_every_failure() -> None:
    row = {"name": "a", "status": "done", "effects": [], "fit_error": 0.1, "validate_error": None, "noise_floor": 0.1}
    text = str(fleet.Fleet(Path(), tuple([row] * 100 + [{"name": "b", "status": "failed", "error": "no such file"}])))
    assert len(text.splitlines()) == 44 and "b  " in text and "failed: no such file" in text
    assert "... and 60 more that are done" in text and text.endswith("100 done, 1 failed")


def test_bootstrap_agrees_with_the_intervals_of_the_fit(tmp_path: Path) -> None:
    t = 1e-3 * np.arange(3000)
    torque = 0.012 * np.sin(2 * np.pi * 1.3 * t) + 0.008 * np.sin(2 * np.pi * 7.3 * t)
    dataset.save(tmp_path / "set", [replace(run(SIMPLE, torque, seed=5), name="a")], inertia=J)
    told = SIMPLE
    found = fleet.bootstrap(tmp_path / "set", tmp_path / "out", told, refits=40, jobs=1)
    fitted = Plant.load(tmp_path / "out" / "fit" / "model.toml")
    assert found == fitted == Plant.load(tmp_path / "out" / "model.toml")
    known = Coordinates(fitted)  # the fit's intervals are wider still, by Student's t for as few blocks
    normal = known.intervals(known.encode(fitted), np.array(list(fitted.covariance.values())))
    for name, (low, high) in normal.items():
        a, b = found.uncertainty[name]
        assert 0.5 < (b - a) / (high - low) < 2.0, name
        assert a < fitted.numbers()[name][0] < b
    assert "40 refits" in found.provenance["intervals"]
    assert len({p["coulomb"].coulomb for p in sample(found, 5, 0)}) == 5, "its covariance is there to draw from"
    again = fleet.bootstrap(tmp_path / "set", tmp_path / "out", told, refits=40, jobs=1)
    assert again.uncertainty == found.uncertainty
    other = fleet.bootstrap(tmp_path / "set", tmp_path / "other", told, refits=3, jobs=1, seed=1)
    assert other.uncertainty != found.uncertainty


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"verb": "ponder"}, "verbs for a fleet are diagnose, fit; 'ponder' given"),
        ({"datasets": []}, "at least one measurement set"),
        ({"datasets": "nowhere"}, "nowhere: no such folder"),
        ({"jobs": 0}, "jobs must be"),
        ({"jobs": -2}, "jobs must be a number of processes, or -1 .*; -2 given"),
        ({"cluster": "tcp://127.0.0.1:1"}, "no Dask scheduler answers at 'tcp://127.0.0.1:1'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(change: dict, message: str, robots: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(workers, "_PATIENCE", 0.5)
    what = {"verb": "fit", "datasets": robots, "out": tmp_path / "out", "plant": SIMPLE, "jobs": 1} | change
    with pytest.raises(GmsError, match=message) as error:
        fleet.run_all(**what)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_fleet_of_which_nothing_is_left_is_no_success(tmp_path: Path, capsys) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "dataset.toml").write_text("[axis]\n")
    assert cli.main(["fleet", str(tmp_path / "set"), "--jobs", "1", "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert "0 done, 1 failed" in said.out and "every measurement set failed, the first with: " in said.err
    assert (tmp_path / "out" / "summary.csv").is_file()


def test_a_plant_of_another_kind_and_a_bootstrap_that_cannot_be(robots: Path, tmp_path: Path) -> None:
    slide = Plant.axis(1.0, "slide") + effects.Viscous(coefficient=1.0)
    done = fleet.fit_all(robots / "axis_0", tmp_path, slide, jobs=1)
    assert "the plant is a slide joint" in done.failed[0]["error"]
    for refused in ({"refits": 1}, {"block": 0.0}, {"block": 10.0}):
        with pytest.raises(GmsError, match=r"at least|positive"):
            fleet.bootstrap(robots / "axis_0", tmp_path / "b", SIMPLE, jobs=1, **({"refits": 2} | refused))
    assert cli.main(["fleet", "a", "b", "-o", "x", "--verb", "bootstrap"]) == 2


def test_names_stay_what_they_are_whatever_else_is_in_the_fleet(robots: Path, tmp_path: Path) -> None:
    sets = fleet.find_sets([robots, robots / "axis_1"])
    assert len(sets) == 4
    names = [fleet.task_of("fit", tmp_path, p, "left/knee", None).name for p in sets]
    assert len(set(names)) == 4 and all("/" not in n and "left_knee" in n for n in names)
    with pytest.raises(DataError):
        fleet.find_sets(tmp_path)
    with pytest.raises(DataError, match="nowhere: no such folder"):
        fleet.find_sets(tmp_path / "nowhere")
