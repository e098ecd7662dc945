"""The README's promises: its workflow runs as printed, its files exist."""

import re
from pathlib import Path

import pytest

from gms_mujoco.dataset import load

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
ROBOT = '<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom size="0.1"/></body></worldbody></mujoco>'


def _block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", TEXT, re.S)
    assert found, f"no {language} block"
    return found.group(1)


def test_the_workflow_runs_as_printed(
    small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = _block("python")
    assert len(code.strip().splitlines()) <= 15
    (tmp_path / "measurements").symlink_to(small_set)
    (tmp_path / "robot.xml").write_text(ROBOT)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    assert names["model"].nplugin == 1 and (tmp_path / "model.toml").exists()
    assert names["found"].verdict in capsys.readouterr().out


def test_the_measurement_set_is_one_that_loads(small_set: Path, tmp_path: Path) -> None:
    text = _block("toml").replace("slow_sweep.csv", "a.csv").replace("fast.mat", "a.csv")
    text = text.replace('time = "t", torque = "vir", position = "qm"', "")
    (tmp_path / "a.csv").write_bytes((small_set / "fit.csv").read_bytes())
    (tmp_path / "dataset.toml").write_text(text)
    assert [r.use for r in load(tmp_path).records] == ["fit", "validate"]


def test_links_and_pictures_are_there() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", TEXT):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
