"""An inertia that is given, and that the records contradict."""

from dataclasses import replace

import pytest
from bench import HEALTHY, HIDDEN, J, dataset, slow

from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.given_inertia import free, is_doubtful
from gms_mujoco.diagnosis.paths import searched
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.fit import baseline
from gms_mujoco.identification.observe import observe
from gms_mujoco.progress import silent


@pytest.mark.parametrize("factor", [1.05, *slow(0.95)])
def test_a_wrong_inertia_is_called_that_and_no_effect(factor: float) -> None:
    """Of a twentieth too much a load on a spring that is too soft to move it would take care."""
    found = diagnose(replace(dataset(HEALTHY), inertia=factor * J))
    assert found.verdict == "adequate" and not found.found
    assert found.plant.inertia == pytest.approx(J, rel=1e-3)
    low, high = found.plant.uncertainty["inertia"]
    assert low < high < low * 1.01
    assert f"The given inertia of {factor * J:.4g} kg m^2 does not fit these records" in found.steps[0].evidence


@pytest.mark.slow
def test_what_is_hidden_beside_a_wrong_inertia_is_found_with_it() -> None:
    found = diagnose(replace(dataset(HEALTHY + HIDDEN["cogging"]), inertia=0.93 * J))
    assert [e.name for e in found.found] == ["cogging"] and found.verdict == "explained"
    assert found.plant.inertia == pytest.approx(J, rel=2e-3)


@pytest.mark.parametrize("name", [None, "delay", "quadratic_drag"])
def test_a_right_inertia_is_not_doubted(name: str | None) -> None:
    records = dataset(HEALTHY + HIDDEN[name] if name else HEALTHY).fit
    search = Search(observe(records, J), [], baseline(J))
    searched(search, True, silent)
    assert [s.effect for s in search.steps[1:]] == ([name] if name else [])
    assert not is_doubtful(search, Search(search.seen, [], free(baseline(J))))
