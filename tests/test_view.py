"""A diagnosis can be looked at: the recording reads back."""

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from told import Told, tell

from gms_mujoco import figure, view
from gms_mujoco.errors import GmsError


@pytest.fixture(scope="module")
def told(small_set: Path) -> Told:
    return tell(small_set)


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
