"""The demo: what it draws, and that the whole way ends in the files of the contract."""

import json
from pathlib import Path

import numpy as np
import pytest

from gms_mujoco import cli, demo
from gms_mujoco.errors import GmsError
from gms_mujoco.plant import Plant

SEEDS = range(40)


def test_the_seed_draws_the_axis_and_every_kind_of_effect() -> None:
    drawn = [demo.axis(rng) + demo.hide(1e-3, rng) for rng in map(np.random.default_rng, SEEDS)]
    assert len(set(drawn)) == len(drawn)
    assert len({p.effects[-1].name for p in drawn}) == 4
    assert all(not p.unset for p in drawn)
    with pytest.raises(GmsError, match="seed"):
        demo.run("nowhere", -1)


def test_records_move_through_every_regime() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        plant = demo.axis(rng)
        travel = {r.name: np.ptp(r.position) for r in demo.records(plant, rng)}
        assert {n.split("_")[0] for n in travel} == {"fit", "validate"} and len(travel) == 6
        assert travel["fit_presliding"] < 0.2 and travel["fit_turning"] > 2 * np.pi


def test_the_whole_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["demo", "-o", str(tmp_path / "demo")]) == 0
    out = capsys.readouterr().out
    table = json.loads((tmp_path / "demo" / "diagnosis.json").read_text())
    hidden = out.split("hidden: ")[1].split(";")[0]
    errors = [s["validate_error"] for s in table["steps"]]
    assert table["steps"][1]["effect"] == hidden and errors[-1] <= 1.3 * table["noise_floor"] < errors[0]
    for name in ("dataset.toml", "recording.rrd", "report.html"):
        assert (tmp_path / "demo" / name).stat().st_size > 0
    assert hidden in Plant.load(tmp_path / "demo" / "model.toml")
    assert hidden not in Plant.load(tmp_path / "demo" / "baseline.toml")
