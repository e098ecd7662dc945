"""The page of a servo stands alone and shows every run with its units."""

from pathlib import Path

from test_report import _sound

from gms_mujoco.compare import compare
from gms_mujoco.dataset import load
from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.views import report


def test_the_page_of_a_diagnosis_shows_goal_measured_and_model(servo_diagnosis: Diagnosis) -> None:
    text = report.render(servo_diagnosis)
    assert len(_sound(text)) > 8
    for said in ("+ delay", "position error", "mrad", "simulated from the goal", "gain 24", "Without power"):
        assert said in text
    assert "orque error" not in text and "0.99 %" not in text
    for r in servo_diagnosis.comparisons[0].servos:
        assert r.name in text
    for name, *_ in servo_diagnosis.plant.rows():
        assert name in text


def test_the_page_of_a_comparison_says_how_errors_are_counted(servo_diagnosis: Diagnosis, servo_set: Path) -> None:
    c = compare(servo_diagnosis.baseline, load(servo_set).all)
    text = report.render_comparison(c, "servo")
    _sound(text)
    assert "strays from its own repetitions" in text and c.score.told(c.error) in text
    assert "times the noise floor" in text and "orque error" not in text
