"""Which law of friction a diagnosis takes: the data choose it, before effects and beside them."""

import math
import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from bench import COUNT, HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, TORQUE_NOISE, UNKNOWN, J, dataset, in_mujoco, runs, slow

from gms_mujoco import effects, effort
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.diagnosis.friction_law import (
    _NEAR,
    FrictionLaw,
    _strays,
    add_law,
    brought_back,
    choices,
    comes_further,
    law_of,
    leading_further,
    told_instead,
    with_law,
    with_laws_added,
    with_other_laws,
)
from gms_mujoco.diagnosis.friction_shape import slipping_back
from gms_mujoco.diagnosis.judgement import Trial
from gms_mujoco.diagnosis.patience import Patience
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.fit import baseline, fit, fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.candidates import GENERAL_LAWS, stronger
from gms_mujoco.identification.frf_observation import Seen
from gms_mujoco.identification.habits import as_logged
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.plant import Plant
from gms_mujoco.progress import silent
from gms_mujoco.record import Record
from gms_mujoco.views.report import render

TRUE = {"stiffness": 2.0, "damping": 1e-3, "coulomb": LEVEL, "static": 5.5e-3, "stribeck_velocity": 0.6}
SECONDS = 2.0
SUBSTEPS = 10  # of MuJoCo in a sample
BRISTLE = Plant.axis(J) + effects.LuGre(**TRUE) + effects.Viscous(coefficient=2e-5)
CREEPS = Plant.axis(J) + effects.Viscous(coefficient=2e-5) + effects.Stribeck(
    coulomb=LEVEL, static=5.5e-3, stribeck_velocity=3.0, creep_velocity=0.3
)  # fmt: skip
AND_WHAT_IT_HIDES = pytest.mark.parametrize("hidden", ["", "cogging"])


@cache
def found(hidden: str) -> Diagnosis:
    """What an axis with one bristle is found to be, bare or with a hidden effect, from the default baseline."""
    return diagnose(dataset(BRISTLE + HIDDEN[hidden] if hidden else BRISTLE, SECONDS))


def test_the_law_of_a_plant_is_a_choice_where_it_has_one() -> None:
    own, *others = choices(HEALTHY)
    assert own is HEALTHY["gms"] and [e.name for e in others] == ["lugre", "dahl", "stribeck", "frictionloss"]
    assert all(e.unset for e in others) and "creep_velocity" in others[2].unset
    assert [e.name for e in choices(BRISTLE)] == ["lugre", "gms", "dahl", "stribeck", "frictionloss"]
    assert not choices(Plant.axis(J) + effects.Coulomb(coulomb=LEVEL)) and not choices(HEALTHY + BRISTLE["lugre"])


def test_another_law_takes_the_place_of_the_first_and_nothing_else_changes() -> None:
    changed = with_law(HEALTHY + HIDDEN["cogging"], BRISTLE["lugre"])
    assert changed.effects == (BRISTLE["lugre"], HEALTHY["viscous"], HIDDEN["cogging"])
    assert with_law(changed, HEALTHY["gms"]) == HEALTHY + HIDDEN["cogging"]
    curved = Plant.axis(J) + effects.Dahl() + effects.Stribeck()  # which beside it is an effect
    assert with_law(curved, HEALTHY["gms"]) == Plant.axis(J) + HEALTHY["gms"]


@pytest.mark.parametrize("size", [1.0, 1e7])
def test_one_bristle_is_found_from_nothing_on_axes_of_any_size(size: float) -> None:
    records = [replace(r, signals={**r.signals, "torque": size * r.torque}) for r in runs(BRISTLE)]
    plant = fit(Plant.axis() + effects.LuGre() + effects.Viscous(), records).plant
    assert plant.inertia == pytest.approx(size * J, rel=0.01)
    for name, value in TRUE.items():
        expected = value if name == "stribeck_velocity" else size * value
        assert plant["lugre"].values[name] == pytest.approx(expected, rel=0.1)


def test_a_bristle_that_turns_round_by_another_exponent_is_healthy() -> None:
    """Neither elements nor one bristle of `lugre` bend like it."""
    d = diagnose(dataset(Plant.axis(J) + effects.Dahl(stiffness=2.0, coulomb=LEVEL, exponent=1.6), SECONDS))
    assert d.verdict == "adequate" and not d.found and "dahl describes the friction" in d.steps[0].evidence
    assert d.plant["dahl"].values["exponent"] == pytest.approx(1.6, abs=0.05)


def test_a_law_is_taken_with_the_exponent_that_brings_it_there() -> None:
    """With the usual one it leaves more than the law whose place it takes, and is not looked at."""
    true = Plant.axis(J) + effects.Viscous(coefficient=2e-5) + effects.Dahl(stiffness=2.0, coulomb=LEVEL, exponent=0.5)
    search = Search(observe(runs(true, seconds=SECONDS, torque_noise=TORQUE_NOISE), J), [], UNKNOWN)
    own = fit_observations(UNKNOWN, search.seen)
    usual = fit_observations(with_law(UNKNOWN, effects.Dahl()), search.seen)
    assert usual.error**2 > _NEAR * own.error**2
    search.steps = [Step(None, own, held_out=cross_validated(own.misfit, own.vector))]
    law = FrictionLaw(search, free=True)
    trial = law.better()
    assert trial is not None and trial.law.name == "dahl" and trial.result.error < 1.1 * trial.result.floor
    law.take(trial)
    assert search.start["dahl"].exponent == pytest.approx(0.5, abs=0.02)  # of what is looked for beside it, too


def test_beside_another_law_a_search_is_as_patient_as_at_first() -> None:
    offset = effects.TorqueOffset(torque=0.3 * LEVEL)
    with effort.counted() as spent:
        search = Search(observe(runs(BRISTLE + offset), J), [], UNKNOWN, patience=Patience(1.0, spent))
        for effect, plant in ((None, UNKNOWN), ("torque_offset", UNKNOWN + effects.TorqueOffset())):
            found = fit_observations(plant, search.seen)
            search.steps.append(Step(effect, found, held_out=cross_validated(found.misfit, found.vector)))
        law = FrictionLaw(search, free=True)
        trial = law.better()
        assert trial is not None and trial.law.name == "lugre"
        search.patience.begin(search.steps[0].result)
        while not search.patience.is_at_end:
            spent.add(10**9)
        law.take(trial)
        assert not search.patience.is_at_end
    assert "in the place of gms: with it and what was found beside it by then the torque error" in law.said


@pytest.mark.slow
def test_an_axis_with_one_bristle_is_healthy() -> None:
    d = found("")
    assert d.verdict == "adequate" and not d.found
    assert [e.name for e in d.plant.effects] == ["lugre", "viscous"]
    assert d.steps[0].validate_error <= 1.3 * d.noise_floor


@pytest.mark.slow
@AND_WHAT_IT_HIDES
def test_friction_that_gives_way_below_its_level_is_found_and_what_it_hides(hidden: str) -> None:
    d = diagnose(dataset(CREEPS + HIDDEN[hidden] if hidden else CREEPS, SECONDS))
    assert [e.name for e in d] == [hidden] * bool(hidden) and d.verdict == ("explained" if hidden else "adequate")
    assert str(d.to_dict()["steps"][0]["evidence"]).startswith("stribeck, which gives way below its level (creep")
    law = d.plant["stribeck"]
    assert law.creep_velocity == pytest.approx(0.3, rel=0.05) and law.coulomb == pytest.approx(LEVEL, rel=0.02)


@pytest.mark.slow
@AND_WHAT_IT_HIDES
def test_a_damped_spring_that_is_cut_off_is_found_and_what_it_hides(hidden: str) -> None:
    law = effects.LuGre(**TRUE | {"damping": 0.3 * np.sqrt(TRUE["stiffness"] * J), "plastic": 1.0})
    true = BRISTLE.replace(law)
    d = diagnose(dataset(true + HIDDEN[hidden] if hidden else true, SECONDS))
    assert [e.name for e in d] == [hidden] * bool(hidden) and d.verdict == ("explained" if hidden else "adequate")
    assert d.steps[0].evidence.startswith("lugre, as a damped spring that is cut off at its level, describes the")
    for name in ("stiffness", "damping", "coulomb"):
        assert d.plant["lugre"].values[name] == pytest.approx(law.values[name], rel=0.05)


def by_mujoco(hidden: str, limit: float = 1.0) -> Dataset:
    """Runs of an axis that MuJoCo itself simulates, frictionloss and all, at its default solver parameters, with a
    drive that gives no more than a limit [N m]."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{SAMPLE_TIME / SUBSTEPS}" gravity="0 0 0"/><worldbody><body>
        <joint name="shaft" axis="0 0 1" damping="2e-5" frictionloss="{LEVEL}"/>
        <inertial pos="0 0 0" mass="1e-6" diaginertia="{J} {J} {J}"/></body></worldbody>
        <actuator><motor joint="shaft" ctrllimited="true" ctrlrange="{-limit} {limit}"/>{hidden}</actuator></mujoco>"""
    )

    def again(record: Record) -> Record:
        position = in_mujoco(model, record.torque, SUBSTEPS)[:-1]
        noise = TORQUE_NOISE * np.random.default_rng(len(record.name)).standard_normal(len(record))
        signals = {"torque": record.torque + noise, "position": COUNT * np.round(position / COUNT)}
        return replace(record, signals=signals)

    made = dataset(HEALTHY, SECONDS)
    return replace(made, records=tuple(again(r) for r in made.records))


@pytest.mark.slow
@AND_WHAT_IT_HIDES
def test_the_friction_of_mujoco_is_known_as_it_is_and_what_it_hides(hidden: str) -> None:
    cogs = f'<dcmotor joint="shaft" input="none" motorconst="0" resistance="1" cogging="{0.2 * LEVEL} 7 0.3"/>'
    d = diagnose(by_mujoco(cogs if hidden else ""))
    assert [e.name for e in d] == [hidden] * bool(hidden) and d.verdict == ("explained" if hidden else "adequate")
    law, ahead = d.plant["frictionloss"], 0.02 * 0.95 / 2
    assert law.coulomb == pytest.approx(LEVEL, rel=0.02)
    assert law.creep_velocity == pytest.approx(LEVEL * ahead / (9 * J), rel=0.02)
    assert law.creep_time == pytest.approx(ahead, rel=0.02)


@pytest.mark.slow
def test_a_law_that_shows_only_beside_what_it_hides_is_found_with_it() -> None:
    """Elements that bend as they like leave less of a drive at its limit than the right law does by itself."""
    d = diagnose(by_mujoco("", 1.5 * LEVEL))
    assert [e.name for e in d] == ["torque_saturation"] and d.verdict == "explained"
    assert d.found[0].limit == pytest.approx(1.5 * LEVEL, rel=0.01)
    said = str(d.to_dict()["steps"][0]["evidence"])
    assert said.startswith("frictionloss, which gives way below its level (creep velocity 0.")
    assert "describes the friction, in the place of gms: with it and what is found beside" in said
    assert d.comparisons[-1].error <= 1.2 * d.noise_floor


def _ended(error: float, floor: float, plant: Plant = HEALTHY, start: Plant = HEALTHY) -> Any:
    result = SimpleNamespace(error=error, floor=floor, plant=plant)
    steps = [SimpleNamespace(result=result)]
    return SimpleNamespace(steps=steps, start=start, selects=lambda result: True, hint=None)


@pytest.mark.parametrize(
    ("error", "floor", "better"), [(0.06, 0.05, True), (0.29, 0.05, False), (0.29, 0.28, False), (0.06, 0.001, True)]
)
def test_a_law_that_passes_on_more_noise_is_no_better_for_it(error: float, floor: float, better: bool) -> None:
    assert comes_further(_ended(0.3, 0.04), _ended(error, floor)) == better


@pytest.mark.slow
def test_what_is_in_no_catalogue_is_told_beside_the_law_that_shows_it() -> None:
    """Elements that bend as they like hide a record in which friction is stronger."""
    records = dataset(BRISTLE, SECONDS).all
    stronger_one = dataset(stronger(BRISTLE, 1.2), SECONDS).all[1]
    d = diagnose(Dataset(Path(), (records[0], stronger_one, *records[2:]), inertia=J))
    assert not d.found and "lugre" in d.plant and d.verdict == "unexplained"
    told = re.search(r"friction that is another in each record, (\S+) % in (\S+) beside the others", str(d.remainder))
    assert told is not None and told[2] == stronger_one.name and float(told[1]) == pytest.approx(20, abs=3)


def test_a_law_that_is_much_better_is_told_as_it_was_found() -> None:
    begun = CREEPS.replace(CREEPS["stribeck"].replace(creep_velocity=math.nan))
    said = told_instead(_ended(0.3, 0.04), _ended(0.06, 0.05, CREEPS, begun))
    assert said.startswith("stribeck, which gives way below its level (creep velocity 0.3 rad/s), describes")
    back = told_instead(_ended(0.3, 0.04, CREEPS, begun), _ended(0.06, 0.05))
    assert "gms describes" in back and "in the place of stribeck, which gives way below its level (creep" in back
    assert ",:" not in back
    few, many = (baseline(J, elements=n) for n in (2, 5))
    said = told_instead(_ended(0.3, 0.04, few, few), _ended(0.06, 0.05, many, many))
    assert said.startswith("gms of 5 elements describes the friction, in the place of gms of 2: with it")
    assert told_instead(_ended(0.3, 0.04), _ended(0.06, 0.05)) == ""


@pytest.mark.parametrize(("share", "leads"), [(0.95, False), (0.8, True)])
def test_another_reading_of_the_law_is_searched_with_where_it_plainly_promises_more(
    monkeypatch: pytest.MonkeyPatch, share: float, leads: bool,
) -> None:
    """Than the first one did at its beginning, however much less that has come to since."""
    seen = observe(runs(HEALTHY + HIDDEN["cogging"], seconds=1.0, seed=1), J)
    search, letter = (Search(seen, [], plant) for plant in (UNKNOWN, slipping_back(UNKNOWN)))
    search.first(silent)
    monkeypatch.setattr(Search, "within_reach", lambda self, least=math.inf: share if self is letter else 1.0)
    assert leading_further(search, [letter]) == [letter] * leads
    usual = baseline(J)  # which has as many elements as it may need
    laws = [law_of(plant) for plant in with_other_laws(search, usual)]
    assert laws[-1] == "gms" and "gms" not in laws[:-1]
    assert "gms" not in [law_of(plant) for plant in with_other_laws(letter, usual)]
    few = [plant["gms"].elements for plant in with_other_laws(letter, UNKNOWN) if "gms" in plant]
    assert few == [usual["gms"].elements]


def test_friction_that_has_come_out_as_no_bearing_is_fitted_from_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(observe(runs(HEALTHY, seconds=1.0), J), [], UNKNOWN)
    search.first(silent)
    before = search.steps[-1].result
    assert not brought_back(search) and search.steps[-1].result is before
    monkeypatch.setattr("gms_mujoco.diagnosis.friction_law._strays", lambda plant: plant is before.plant)
    assert brought_back(search)
    after = search.steps[-1].result
    assert after is not before and after.error == pytest.approx(before.error, rel=0.02)
    monkeypatch.setattr("gms_mujoco.diagnosis.friction_law._strays", lambda plant: True)
    assert not brought_back(search) and search.steps[-1].result is after


def test_a_search_from_simple_friction_may_begin_anew_with_a_general_law_that_counts_as_an_effect() -> None:
    simple = Plant.axis(J) + effects.Coulomb() + effects.Viscous()
    seen = observe(runs(HEALTHY, seconds=1.0), J)
    search = Search(seen, [], simple)
    general = with_laws_added(search, simple)
    assert [law_of(p) for p in general] == ["gms", "lugre"]
    assert [law_of(p) for p in with_laws_added(Search(seen, [], simple, ["gms"]), simple)] == ["lugre"]
    assert with_laws_added(Search(seen, [], UNKNOWN), UNKNOWN) == []
    other = Search(seen, [], general[0])
    for s in (search, other):
        s.first(silent)
    add_law(search, other)
    assert [s.effect for s in other.steps] == [None, "gms"] and other.steps[0] is search.steps[0]
    assert other.steps[1].p_value < 1e-6


def test_what_it_hides_is_named_beside_its_own_law() -> None:
    d = found("cogging")
    assert d.verdict == "explained" and [e.name for e in d] == ["cogging"] and "lugre" in d.plant
    np.testing.assert_allclose(d.found[0].amplitude, HIDDEN["cogging"].amplitude, rtol=0.05)


@pytest.mark.parametrize("hidden", ["cogging", *slow("")])
def test_the_choice_is_told_wherever_the_steps_are(hidden: str) -> None:
    d = found(hidden)
    said = d.to_dict()["steps"][0]["evidence"]
    assert said.startswith("lugre describes the friction, in the place of gms") and "p = " in said
    assert said in str(d) and said[1:] in render(d)


@pytest.mark.slow
def test_a_habit_of_the_log_is_allowed_for_beside_the_law_that_was_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though what the wrong law left was too much to see beside it that currents were measured after they had acted."""

    def seen(found: FitResult, **given: float) -> list[Seen] | None:
        return as_logged(found, **given) if "lugre" in found.plant else None

    for module in ("diagnosis.search", "fit"):
        monkeypatch.setattr(sys.modules[f"gms_mujoco.{module}"], "as_logged", seen)
    early = 0.4
    held = [(1 - early) * r.torque + early * np.append(r.torque[:1], r.torque[:-1]) for r in runs(BRISTLE)]
    logged = [replace(r, signals={**r.signals, "torque": u}) for r, u in zip(runs(BRISTLE), held, strict=True)]
    search = Search(observe(logged, J), [], UNKNOWN)
    search.first(lambda done, message: None)
    law = FrictionLaw(search, free=True)
    trial = law.better()
    assert trial is not None
    law.take(trial)
    found = search.steps[0].result
    assert "lugre" in found.plant and found.error < 0.5 * trial.result.error
    assert found.plant.provenance["clock_skew"] == pytest.approx(-early * SAMPLE_TIME, rel=0.2)


@pytest.mark.slow
def test_maxwell_elements_stay_where_something_is_hidden_beside_them() -> None:
    """One bristle is damped, and a delay looks like damping."""
    d = diagnose(dataset(HEALTHY + HIDDEN["delay"], SECONDS))
    assert "gms" in d.plant and [e.name for e in d] == ["delay"] and d.verdict == "explained"
    assert "evidence" not in d.to_dict()["steps"][0]


def test_at_the_noise_floor_no_other_law_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: object) -> None:
        raise AssertionError

    monkeypatch.setattr("gms_mujoco.diagnosis.friction_law.with_law", refuse)
    assert diagnose(dataset(HEALTHY, SECONDS)).verdict == "adequate"


@pytest.mark.parametrize(("floor", "tried"), [(0.6, True), (0.9, False)], ids=["room", "no room"])
def test_within_the_tolerance_of_the_floor_another_law_is_taken_where_noise_leaves_room(
    monkeypatch: pytest.MonkeyPatch, floor: float, tried: bool
) -> None:
    """Behind a coarse encoder a wrong law may leave hardly more than noise, and fail on records that are new."""
    search = Search(observe(runs(BRISTLE, seconds=SECONDS), J), [], replace(UNKNOWN, inertia=J))
    search.first(lambda done, message: None)
    noise = floor * search.held_out.total
    for where in ("diagnosis.judgement", "diagnosis.friction_law"):
        monkeypatch.setattr(f"gms_mujoco.{where}.floor_of", lambda *given: noise)
    assert search.at_floor
    better = FrictionLaw(search, free=True).better()
    assert (better is not None and better.law.name == "lugre" and better.clear) == tried


@pytest.mark.parametrize("strays", [True, False])
def test_a_law_as_no_bearing_has_it_goes_for_one_of_fewer_unknowns(
    strays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though nothing tells them apart: samples that are too coarse have let it go wherever it likes."""
    law = effects.Stribeck(coulomb=LEVEL, static=LEVEL, stribeck_velocity=1.0, creep_velocity=0.3)
    seen = observe(runs(Plant.axis(J) + law + HEALTHY["viscous"], seconds=4.0, resolution=2 * np.pi / 4096)[1:], J)
    unseen = effects.GMS(elements=4).replace(
        stiffness=[2.0, 1.0, 0.5, 0.2], coulomb=LEVEL, static=6 * LEVEL, stribeck_velocity=1e-4, attraction=0.5
    )
    start = Plant.axis(J) + unseen + HEALTHY["viscous"]
    near = Misfit(start, seen, fixed=["gms.static", "gms.stribeck_velocity"])
    now = refine(near, near.vector(start))
    search = Search(seen, [], UNKNOWN)
    search.steps = [Step(None, now, held_out=cross_validated(now.misfit, now.vector))]
    assert search.at_floor and _strays(now.plant) and not _strays(HEALTHY)
    monkeypatch.setattr("gms_mujoco.diagnosis.friction_law.p_value", lambda *held_out: 0.5)
    monkeypatch.setattr("gms_mujoco.diagnosis.friction_law._strays", lambda plant: strays)
    better = FrictionLaw(search, free=True).better()
    assert (better is not None) == strays
    if better:
        assert better.result.misfit.size < now.misfit.size and better.result.error < now.error


@pytest.mark.parametrize("fitted", [False, *slow(True)])
def test_a_general_law_of_a_plant_gives_way_as_the_default_does(fitted: bool) -> None:
    """A plant of your own says what to start from: beside the wrong law a weak coupling has seemed to be missing."""
    runs = dataset(BRISTLE, SECONDS)
    own = baseline(J, elements=3)
    d = diagnose(runs, fit(own, runs.fit).plant if fitted else own)
    assert not d.found and d.verdict == "adequate" and "lugre" in d.plant
    assert d.steps[0].evidence.startswith("lugre describes the friction, in the place of gms")


@pytest.mark.slow
def test_a_law_that_is_not_to_be_looked_at_is_none_to_be_chosen() -> None:
    d = diagnose(dataset(BRISTLE, SECONDS), without=["lugre"])
    assert "lugre" not in d.plant and "lugre" not in str(d.remainder)


@pytest.mark.slow
def test_what_modulates_friction_is_found_beside_one_bristle() -> None:
    hidden = effects.AsymmetricFriction(level=0.25)
    d = diagnose(dataset(BRISTLE + hidden, SECONDS))
    assert "lugre" in d.plant and [e.name for e in d] == ["asymmetric_friction"]
    assert d.found[0].level == pytest.approx(0.25, rel=0.05)


DRY = Plant.axis(J) + effects.Coulomb() + effects.Viscous()
DRAG = effects.Viscous(coefficient=2e-5)
LAWS = {
    "lugre": BRISTLE,
    "gms": HEALTHY,
    "stribeck": Plant.axis(J) + effects.Stribeck(coulomb=LEVEL, static=6e-3, stribeck_velocity=2.0) + DRAG,
    "dahl": Plant.axis(J) + effects.Dahl(stiffness=1.0, coulomb=LEVEL, exponent=1.5) + DRAG,
}


@pytest.mark.parametrize("name", ["lugre", *slow("stribeck", "gms", "dahl")])
def test_the_law_that_a_plant_lacks_is_named(name: str) -> None:
    """A general one too, in the place of what it contains; and not where what it contains does as well."""
    found = diagnose(dataset(LAWS[name], SECONDS), DRY)
    assert [s.effect for s in found.steps] == [None, name] and found.verdict == "explained"
    law, true = found.plant[name], LAWS[name][name]
    assert ("coulomb" in found.plant) == (name not in GENERAL_LAWS)
    assert (f"{name}, in the place of coulomb: with it" in found.steps[1].evidence) == (name in GENERAL_LAWS)
    if name == "dahl":
        assert law.exponent == pytest.approx(true.exponent, rel=0.05)
    if name != "stribeck":  # which shares the level with the other law
        assert law.coulomb == pytest.approx(true.coulomb, rel=0.02)


def test_a_law_that_was_found_gives_way_to_one_that_contains_it() -> None:
    """What it was found by is then no step of its own."""
    search = Search(observe(dataset(BRISTLE, SECONDS).fit, J), [], DRY)
    search.first(quiet)
    dahl = fit_observations(search.steps[0].result.plant + effects.Dahl(), search.seen)
    search = search.branch(1, Trial("dahl", dahl, cross_validated(dahl.misfit, dahl.vector)))
    assert search.add_one(quiet) and [s.effect for s in search.steps] == [None, "lugre"]
    assert {e.name for e in search.steps[-1].result.plant.effects} == {"lugre", "viscous"}


def quiet(done: float, message: str) -> None: ...
