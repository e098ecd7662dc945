"""What a diagnosis comes to: when all is told, and what to measure where it is not."""

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco import effects
from gms_mujoco.diagnosis.conclusion import _as_good, _comes_back, _to_isolate
from gms_mujoco.diagnosis.findings import Rejected
from gms_mujoco.diagnosis.remainder import Remainder
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.servo_observation import ServoObservation


@given(st.dictionaries(st.sampled_from(sorted(effects.CATALOGUE)), st.floats(0, 1)))
def test_what_came_closest_is_told_only_where_it_came_closer_than_chance(p_values: dict[str, float]) -> None:
    said = _to_isolate([Rejected(name, p) for name, p in p_values.items()], "slow.csv")
    closest = min(p_values, key=p_values.__getitem__, default="")
    if closest and p_values[closest] <= 0.1:
        assert f"{closest} came closest" in said
    else:
        assert "came closest" not in said and "Measure slow.csv" in said


def test_what_leaves_as_much_of_new_records_did_not_come_close() -> None:
    tried = [Rejected("delay", 1e-6, 0.0499), Rejected("spring", 1e-3, 0.04), Rejected("cogging", 0.02, 0.03)]
    assert "spring came closest" in _to_isolate(tried, "slow.csv", error=0.05)
    assert "delay came closest" in _to_isolate(tried, "slow.csv")
    assert "Measure slow.csv" in _to_isolate(tried[:1], "slow.csv", error=0.05)


def test_what_the_rest_looks_like_comes_before_an_effect_that_takes_less_of_it() -> None:
    tried = [Rejected("spring", 1e-3, 0.04)]  # takes 36 % of the square
    waves = Remainder("in waves over the place", 0.6, "what is tied to the place: slow runs.")
    assert "the cause of what is tied to the place: slow runs." in _to_isolate(tried, "slow.csv", waves, 0.05)
    assert "spring came closest" in _to_isolate(tried, "slow.csv", waves._replace(share=0.3), 0.05)
    assert "tied to the place" in _to_isolate([], "slow.csv", waves, 0.05)


@pytest.mark.parametrize(("fitted", "new", "back"), [(0.2, 0.22, True), (0.2, 0.35, False), (0.01, 0.011, False)])
def test_what_new_records_have_too_is_not_measured_again_in_the_same_way(
    fitted: float, new: float, back: bool
) -> None:
    step: Any = SimpleNamespace(
        result=SimpleNamespace(error=fitted, floor=0.008), comparison=SimpleNamespace(error=new, noise_floor=0.007)
    )
    assert _comes_back(step) == back
    said = _to_isolate([], "slow.csv", error=new, comes_back=back)
    assert ("one thing changed at a time" in said) == back and "slow.csv" in said


@pytest.mark.parametrize(
    ("fitted", "new", "good"), [(1.18, 1.1, True), (1.3, 1.1, False), (1.1, 1.3, False), (1.18, None, True)]
)
def test_what_is_left_is_noise_where_all_of_it_hardly_exceeds_the_floor(
    fitted: float, new: float | None, good: bool
) -> None:
    result: Any = SimpleNamespace(error=0.1 * fitted, floor=0.1)
    comparison: Any = None if new is None else SimpleNamespace(error=0.2 * new, noise_floor=0.2)
    assert _as_good(Step(None, result, comparison), 0.0) == good


def test_less_than_a_thousandth_is_left_alone_where_it_is_of_a_torque() -> None:
    result: Any = SimpleNamespace(error=9e-4, floor=1e-6)
    assert _as_good(Step(None, result), Observation.negligible)
    assert not _as_good(Step(None, result), ServoObservation.negligible)
