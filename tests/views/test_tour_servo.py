"""The recording of a servo's diagnosis reads back: its stations, and the numbers of goal, position and model."""

from pathlib import Path

import numpy as np
import pytest
from recordings import last_values

from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.views import tour


def test_the_recording_shows_every_run(servo_diagnosis: Diagnosis, tmp_path: Path) -> None:
    tour.write_recording(tmp_path / "recording.rrd", servo_diagnosis)
    rows = last_values(tmp_path / "recording.rrd")
    stations = ("verdict", "baseline", "fails", "candidates", "added/delay", "final")
    assert {f"/{s}/text" for s in stations} <= set(rows)
    for r in servo_diagnosis.comparisons[0].servos:
        root = f"/records/{r.name.replace(' ', '_')}"
        assert rows[f"{root}/position/goal"]["rows"] == len(r.time)
        assert {f"{root}/position/measured", f"{root}/residual/baseline", f"{root}/residual/delay"} <= set(rows)
    said = str(rows["/verdict/text"]["text"]) + str(rows["/baseline/text"]["text"])
    assert "mrad" in said and "orque error" not in said
    worst = max(servo_diagnosis.comparisons[0].servos, key=lambda r: r.error)
    data = rows["/baseline/run/data/measured"]
    assert np.ravel(data["y"]) == pytest.approx(worst.position)
