"""Where a search ends short of the noise floor, effects that were passed over are gone on with."""

from dataclasses import replace

import numpy as np
import pytest
from bench import GMS, HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, UNKNOWN, dataset

from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnosis.friction_law import FrictionLaw
from gms_mujoco.diagnosis.judgement import Trial
from gms_mujoco.diagnosis.paths import _to_its_end, along_rivals
from gms_mujoco.diagnosis.patience import Patience
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit_observations
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine

OFFSET, LEANING = effects.TorqueOffset(torque=0.0), effects.AsymmetricFriction(level=0.1)


def quiet(done: float, message: str) -> None: ...


def gone_astray(runs: Dataset) -> Search:
    """A search that took friction that differs between the directions for an offset, which it passed over."""
    search = Search(observe(runs.fit, HEALTHY.inertia), [], UNKNOWN)
    search.first(quiet)

    def trial(effect: Effect) -> Trial:
        found = fit_observations(search.steps[0].result.plant + effect, search.seen)
        return Trial(effect.name, found, cross_validated(found.misfit, found.vector))

    taken, passed_over = trial(LEANING), trial(OFFSET)
    astray = search.branch(1, taken)
    astray.steps[1] = replace(astray.steps[1], others=(passed_over,))
    return astray


def names(search: Search) -> list[str | None]:
    return [s.effect for s in search.steps[1:]]


@pytest.mark.slow
def test_the_path_of_an_effect_that_was_passed_over_is_taken_where_it_leads_further() -> None:
    search = gone_astray(dataset(HEALTHY + OFFSET.replace(torque=0.3 * LEVEL) + HIDDEN["cogging"]))
    assert names(search) == ["asymmetric_friction"] and not search.at_floor
    along_rivals(search, FrictionLaw(search, free=False), quiet)
    assert sorted(map(str, names(search))) == ["cogging", "torque_offset"] and search.at_floor


@pytest.mark.slow
def test_a_search_stays_where_it_ended_if_no_other_path_leads_further() -> None:
    hum = 0.2 * LEVEL * np.sin(2 * np.pi * 12 * SAMPLE_TIME * np.arange(len(dataset(HEALTHY).fit[0])))
    known = dataset(HEALTHY + LEANING.replace(level=0.25))
    records = [replace(r, signals={**r.signals, "torque": r.torque + hum}) for r in known.records]
    search = gone_astray(replace(known, records=tuple(records)))
    end, law = search.steps[-1], FrictionLaw(search, free=False)
    assert not search.at_floor and names(search.branch(1, end.others[0])) == ["torque_offset"]
    law = along_rivals(search, law, quiet)  # to the same effect, which the other path fits better
    assert names(search) == ["asymmetric_friction"] and search.steps[-1].result.error < 0.7 * end.result.error
    search.steps[1] = end = replace(search.steps[1], others=end.others)
    assert along_rivals(search, law, quiet) is law and search.steps[1:] == [end]


@pytest.mark.slow
def test_friction_gets_another_shape_beside_an_effect_that_was_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before it is asked whether that path promises anything: a wrong exponent leaves more than many an effect."""
    gauss = GMS.replace(static=1.6 * LEVEL, stribeck_velocity=1.5, stribeck_exponent=2.0)
    search = gone_astray(dataset(HEALTHY.replace(gauss) + OFFSET.replace(torque=0.3 * LEVEL)))
    found: list[float] = []

    def none(other: Search, search: Search) -> bool:
        found.append(float(np.asarray(other.steps[-1].result.plant["gms"].stribeck_exponent)))
        return True

    monkeypatch.setattr("gms_mujoco.diagnosis.paths._promises_nothing", none)
    along_rivals(search, FrictionLaw(search, free=False), quiet)
    assert found == pytest.approx([2.0], rel=0.05)


def test_a_search_ends_where_another_has_been(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would go on from there as that one did."""
    search = gone_astray(dataset(HEALTHY + OFFSET.replace(torque=0.3 * LEVEL) + HIDDEN["cogging"]))
    asked: list[Search] = []

    def none_more(search: Search, report: object, law: object) -> bool:
        asked.append(search)
        return False

    monkeypatch.setattr(Search, "add_one", none_more)
    end = search.steps[-1]
    passed_over = Trial("torque_offset", end.result, end.held_out)  # of the same effects, and leaves as much
    search.steps[1] = replace(end, others=(passed_over,))
    along_rivals(search, FrictionLaw(search, free=False), quiet)
    assert not asked
    search.steps[1] = end
    along_rivals(search, FrictionLaw(search, free=False), quiet)
    assert asked


@pytest.mark.parametrize(("first", "then", "looks"), [("gravity", "cogging", 2), ("cogging", "gravity", 1)])
def test_a_search_at_the_end_of_its_work_goes_on_where_it_has_just_taken_most(
    monkeypatch: pytest.MonkeyPatch, first: str, then: str, looks: int
) -> None:
    """The weight is a half stronger than the cogging, and makes up more than two thirds of what is missing."""
    seen = observe(dataset(HEALTHY + HIDDEN["cogging"] + HIDDEN["gravity"]).fit, HEALTHY.inertia)

    def step(*added: str) -> Step:
        plant = HEALTHY
        for name in added:
            plant = plant + HIDDEN[name]
        misfit = Misfit(plant, seen)
        found = refine(misfit, misfit.vector(plant))
        return Step(added[-1] if added else None, found, held_out=cross_validated(misfit, found.vector))

    found = [step(first), step(first, then)]
    monkeypatch.setattr(Patience, "is_at_end", True)
    monkeypatch.setattr("gms_mujoco.diagnosis.paths.drop_false", lambda search: False)
    monkeypatch.setattr(Search, "add_one", lambda self, report, law: self.steps.append(found.pop(0)) or True)
    search = Search(seen, [], HEALTHY)
    search.steps = [step()]
    _to_its_end(search, FrictionLaw(search, free=False), quiet)
    assert names(search) == [first, then][:looks]
