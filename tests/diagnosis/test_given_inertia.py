"""An inertia that is given, and that the records contradict."""

from dataclasses import replace

import pytest
from bench import HEALTHY, HIDDEN, LEVEL, J, dataset, slow

from gms_mujoco import effects
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.beyond import Hint
from gms_mujoco.diagnosis.given_inertia import contradicts, free, is_doubtful
from gms_mujoco.diagnosis.judgement import floor_of
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
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_plant_that_has_bent_far_does_not_hide_a_wrong_inertia(factor: float) -> None:
    """Half or twice of it friction that creeps, or a load that swings once in half a minute, would stand for."""
    search = Search(observe(dataset(HEALTHY).fit, factor * J), [], baseline(factor * J))
    search.first(silent)
    assert contradicts(search)
    found = diagnose(replace(dataset(HEALTHY), inertia=factor * J))
    assert found.verdict == "adequate" and not found.found
    assert found.plant.inertia == pytest.approx(J, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [30.0, 90.0])
def test_a_load_behind_a_coupling_is_found_where_the_motor_alone_was_given(frequency: float) -> None:
    coupling = effects.FlexibleCoupling(inertia=0.4 * J, frequency=frequency)
    found = diagnose(replace(dataset(HEALTHY + coupling), inertia=0.6 * J))
    assert [e.name for e in found.found] == ["flexible_coupling"] and found.verdict == "explained"
    assert found.plant.inertia == pytest.approx(J, rel=0.02)


@pytest.mark.slow
def test_what_is_hidden_beside_a_wrong_inertia_is_found_with_it() -> None:
    found = diagnose(replace(dataset(HEALTHY + HIDDEN["cogging"]), inertia=0.93 * J))
    assert [e.name for e in found.found] == ["cogging"] and found.verdict == "explained"
    assert found.plant.inertia == pytest.approx(J, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.97, 1.04])
def test_two_effects_beside_a_wrong_inertia_are_found_with_it(factor: float) -> None:
    """Friction bends beside it, and neither another inertia nor one effect more alone explains much."""
    hidden = effects.TorqueOffset(torque=0.2 * LEVEL), effects.QuadraticDrag(coefficient=3e-4 * LEVEL)
    found = diagnose(replace(dataset(HEALTHY + hidden[0] + hidden[1]), inertia=factor * J))
    assert [e.name for e in found.found] == ["torque_offset", "quadratic_drag"] and found.verdict == "explained"
    assert found.plant.inertia == pytest.approx(J, rel=2e-3)


@pytest.mark.parametrize("name", [None, *slow("delay", "quadratic_drag")])
def test_a_right_inertia_is_not_doubted(name: str | None) -> None:
    records = dataset(HEALTHY + HIDDEN[name] if name else HEALTHY).fit
    search = Search(observe(records, J), [], baseline(J))
    searched(search, True, silent, halt=contradicts)
    assert [s.effect for s in search.steps[1:]] == ([name] if name else [])
    assert not is_doubtful(search, Search(search.seen, [], free(baseline(J))))


@pytest.mark.slow
def test_what_explains_a_part_of_a_wrong_inertia_does_not_keep_it() -> None:
    """An inertia that leaves no more than noise is better than what might leave less beside a wrong one."""
    wave, start = effects.Cogging(harmonics=[6], amplitude=[0.004 * LEVEL], phase=[0.4]), baseline(1.0025 * J)
    search = Search(observe(dataset(HEALTHY + wave).fit, start.inertia), [], start, ["cogging"])
    search.first(silent)
    search.hint = Hint("a body that friction carries along", "Steps.", floor_of(search.steps[-1].result))
    assert not search.at_floor and is_doubtful(search, Search(search.seen, [], free(start), ["cogging"]))
