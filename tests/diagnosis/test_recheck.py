"""What was found first is judged again beside what was found later; what no effect of the catalogue is gets no name."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, UNKNOWN, J, dataset, driven, runs, slow, worn
from scipy import signal

from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.beyond import Hint
from gms_mujoco.diagnosis.friction_law import with_law
from gms_mujoco.diagnosis.judgement import Trial, carries
from gms_mujoco.diagnosis.recheck import (
    drop_false,
    drop_last,
    drop_ripple,
    drop_shadows,
    exchange,
    join_laws,
    law_first,
    undoing,
)
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit_observations
from gms_mujoco.fit_result import result_of
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record


def quiet(done: float, message: str) -> None: ...


def fit_steps(search: Search, *added: Effect) -> None:
    """Gives a search a step for the plant that it begins with and one for each effect, each fitted to its end."""
    plant = search.start
    for effect in (None, *added):
        plant = plant if effect is None else plant + effect
        result = fit_observations(plant, search.seen)
        name = effect and effect.name
        search.steps.append(Step(name, result, held_out=cross_validated(result.misfit, result.vector)))


def changed(runs: Dataset, torque: object) -> Dataset:
    """The set with another torque in each record, a function of it."""

    def one(r: Record) -> Record:
        return driven(r, torque(r))  # type: ignore[operator]

    return replace(runs, records=tuple(map(one, runs.records)))


@pytest.mark.slow
def test_a_torque_that_follows_the_place_late_gets_no_name_but_is_told() -> None:
    def late(r: Record) -> np.ndarray:
        velocity = np.gradient(r.position, SAMPLE_TIME)
        away = signal.lfilter([0.03], [1, -0.97], np.sign(velocity))  # the lag turns over while the axis moves on
        return r.torque + 0.3 * LEVEL * np.sin(6 * r.position + 0.4 - 0.7 * away)

    d = diagnose(changed(dataset(HEALTHY), late), UNKNOWN)
    assert not d.found and d.verdict == "unexplained"
    assert "follows harmonic 6 of the place" in d.remainder


@pytest.mark.parametrize("ripples", [True, False])
def test_friction_that_varies_over_the_place_gives_way_to_a_torque_constant_that_does(ripples: bool) -> None:
    uneven = effects.PositionDependentFriction(harmonics=[6], amplitude=[0.3], phase=[0.4])

    def rippling(r: Record) -> Record:
        return driven(r, r.torque / (1 + 0.12 * np.sin(6 * r.position + 0.4)))

    data = list(map(rippling, runs(HEALTHY))) if ripples else runs(HEALTHY + uneven)
    name = uneven.name
    search = Search(observe(data, J), [], UNKNOWN)
    fit_steps(search, uneven)
    said = drop_ripple(search)
    assert [s.effect for s in search.steps] == ([None] if ripples else [None, name])
    assert ("a torque constant that ripples with harmonic 6 of the place, by 12 %" in said) == ripples
    assert [t.name for t in search.rejected] == ([name] if ripples else [])


@pytest.mark.parametrize("runs_in", [True, *slow(False)])
def test_a_drift_gives_way_to_friction_that_runs_in_where_that_is_told_later(runs_in: bool) -> None:
    """And stays where that leaves more, though it was told of what is missing beside it."""
    drift, missing = effects.ThermalDrift(amplitude=0.3, time_constant=1.0), HIDDEN["cogging"]

    data = list(map(worn, runs(HEALTHY))) if runs_in else runs(HEALTHY + drift + missing)
    search = Search(observe(data, J), [], UNKNOWN)
    fit_steps(search, drift)
    search.hint = Hint("told of the rest", "none")
    drop_shadows(search)
    assert [s.effect for s in search.steps] == ([None] if runs_in else [None, drift.name])
    assert search.hint.said.startswith("friction that falls over the way" if runs_in else "told of the rest")
    assert [t.name for t in search.rejected] == ([drift.name] if runs_in else [])


@pytest.mark.parametrize("first", [True, False])
def test_a_law_that_was_found_beside_the_own_one_is_no_effect(first: bool) -> None:
    """Where the data choose the law: `stribeck` beside `dahl` is how friction is described."""
    curve, offset = effects.Stribeck(static=5e-4, stribeck_velocity=2.0), effects.TorqueOffset(torque=0.0)
    search = Search(observe(runs(HEALTHY + HIDDEN["torque_offset"]), J), [], with_law(UNKNOWN, effects.Dahl()))
    fit_steps(search, *((curve, offset) if first else (offset, curve)))
    last = search.steps[-1].result
    said = join_laws(search, "dahl")
    assert [s.effect for s in search.steps] == [None, "torque_offset"] and "stribeck was found beside it" in said
    assert "stribeck" in search.steps[0].result.plant and "torque_offset" not in search.steps[0].result.plant
    assert search.steps[-1].result is last and search.steps[0].result.error > 1.2 * last.error
    assert search.steps[-1].p_value < 1e-3 and join_laws(search, "dahl") == ""


def test_a_general_law_comes_before_what_was_found_beside_the_simple_one() -> None:
    """Else the table has a plant with neither of the two on its way, and more left of it than of the first."""
    simple = Plant.axis(J) + effects.Frictionloss() + effects.Viscous()
    search = Search(observe(runs(HEALTHY + HIDDEN["torque_offset"]), J), [], simple)
    fit_steps(search, effects.TorqueOffset(torque=0.0))
    whole = fit_observations(with_law(search.steps[-1].result.plant, UNKNOWN["gms"]), search.seen)
    search.steps.append(Step("gms", whole, held_out=cross_validated(whole.misfit, whole.vector)))
    law_first(search)
    assert [s.effect for s in search.steps] == [None, "gms", "torque_offset"]
    errors = [s.result.error for s in search.steps]
    assert errors == sorted(errors, reverse=True) and search.steps[-1].result is whole
    assert "torque_offset" not in search.steps[1].result.plant and search.steps[1].p_value < 1e-3
    before = list(search.steps)
    law_first(search)
    assert search.steps == before


@pytest.mark.parametrize("phase", [0.0, np.pi])
def test_effects_of_the_place_that_undo_each_other_are_a_series(phase: float) -> None:
    """A slope and a sine of the revolution, all but the same over a tenth of it, and a harmonic; or all one way."""
    near = [r for r in runs(HEALTHY) if np.ptp(r.position) < 1]
    data = [replace(r, signals={**r.signals, "position": r.position - np.mean(r.position)}) for r in near]
    parts = (
        effects.Spring(stiffness=20 * LEVEL, preload=0.0),
        effects.Gravity(amplitude=20 * LEVEL, phase=phase),
        effects.Cogging(harmonics=[2], amplitude=[LEVEL], phase=[phase]),
    )
    seen = observe(data, J)
    search, plant = Search(seen, [], UNKNOWN), HEALTHY
    for effect in (None, *parts):
        plant = plant + effect if effect else plant
        misfit = Misfit(plant, seen)
        search.steps.append(Step(effect.name if effect else None, result_of(misfit, misfit.vector(plant))))
    names, times = undoing(search)
    assert set(names) == (set() if phase else {"spring", "gravity", "cogging"})
    assert phase or times > 3


@pytest.mark.slow
def test_a_torque_reading_that_rings_is_no_coupling_but_is_told() -> None:
    def ringing(r: Record) -> np.ndarray:
        omega, zeta, h = 2 * np.pi * 30, 0.1, SAMPLE_TIME
        sensor = signal.cont2discrete(([omega**2], [1, 2 * zeta * omega, omega**2]), h)
        return signal.lfilter(sensor[0].ravel(), sensor[1], r.torque)

    d = diagnose(changed(dataset(HEALTHY), ringing), UNKNOWN)
    assert not {e.name for e in d} & {"flexible_coupling", "backlash"}
    said = d.remainder.split("torque reading that rings at ")[1].split(" Hz")[0]
    assert float(said) == pytest.approx(30, rel=0.1)


def test_an_effect_that_leaves_no_less_at_the_end_of_its_fit_is_taken_away() -> None:
    search = Search(observe(runs(HEALTHY + HIDDEN["gravity"]), J), [], UNKNOWN)
    search.first(quiet)
    before = search.steps[0].result
    after = fit_observations(before.plant + HIDDEN["gravity"], search.seen)
    search.steps.append(Step("gravity", after))
    assert not drop_last(search, after) and len(search.steps) == 2
    assert drop_last(search, replace(after, error=before.error))
    assert [s.effect for s in search.steps] == [None] and "gravity" in search.false
    assert [t.name for t in search.rejected] == ["gravity"]
    assert not drop_last(search, before), "a plant that nothing was added to stays"


def test_an_effect_that_is_taken_away_is_in_no_plant_on_the_way() -> None:
    """Nor is one left out of a plant that was found with it."""
    shown = [HIDDEN["gravity"], HIDDEN["cogging"]]
    idle = effects.QuadraticDrag(coefficient=1e-12)
    search = Search(observe(runs(HEALTHY + shown[0] + shown[1]), J), [], UNKNOWN)
    fit_steps(search, idle, *shown)
    assert drop_false(search) and search.false == {idle.name}
    for i, step in enumerate(search.steps):
        added = [e.name for e in step.result.plant.effects if e.name not in UNKNOWN]
        assert added == [s.effect for s in search.steps[1 : i + 1]]
    assert [s.effect for s in search.steps] == [None, "gravity", "cogging"]


def test_an_effect_gets_the_form_that_leaves_least_beside_what_was_found_later() -> None:
    """Short of the noise floor, and once beside the same."""
    load = effects.PositionDependentFriction(harmonics=[1], amplitude=[0.3], phase=[0.5], stiffening=0.0)
    search = Search(observe(runs(HEALTHY + load + HIDDEN["torque_offset"]), J), [], UNKNOWN)
    fit_steps(search, load.replace(stiffening=1.0), HIDDEN["torque_offset"])
    before = search.steps[-1].result
    assert not search.at_floor and search.reformed()
    after = search.steps[-1].result
    assert after.plant[load.name].values["stiffening"] == 0 and after.error < 0.9 * before.error
    assert not search.reformed()


def test_two_effects_that_are_refused_alone_are_found_together(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(observe(dataset(HEALTHY + HIDDEN["cogging"] + HIDDEN["gravity"]).fit, HEALTHY.inertia), [], UNKNOWN)
    search.first(quiet)
    monkeypatch.setattr(Search, "_accept", lambda *_: False)
    assert search.add_one(quiet)
    assert {s.effect for s in search.steps[1:]} == {"cogging", "gravity"}
    assert all(s.p_value < 1e-3 for s in search.steps[1:])
    errors = [s.result.error for s in search.steps]
    assert errors == sorted(errors, reverse=True) and search.at_floor
    assert not search.add_one(quiet)  # a healthy axis has no two either


@pytest.mark.slow
def test_an_effect_that_stood_in_for_another_makes_room_for_it() -> None:
    hidden = HEALTHY + effects.AsymmetricFriction(level=0.2) + HIDDEN["cogging"]
    seen = observe(dataset(hidden).fit, HEALTHY.inertia)

    def fitted(*added: object) -> Trial:
        plant = UNKNOWN
        for e in added:
            plant = plant + e  # type: ignore[operator]
        result = fit_observations(plant, seen)
        return Trial(plant.effects[-1].name, result, cross_validated(result.misfit, result.vector))

    offset, uneven = effects.TorqueOffset(torque=1e-4), effects.AsymmetricFriction(level=0.1)
    first, right, both = fitted(offset), fitted(uneven), fitted(offset, HIDDEN["cogging"])
    search = Search(seen, [], UNKNOWN)
    begun = fitted()
    search.steps = [
        Step(None, begun.result, held_out=begun.held_out),
        Step("torque_offset", first.result, held_out=first.held_out, others=(right,)),
        Step("cogging", both.result, held_out=both.held_out),
    ]
    assert exchange(search)
    assert [s.effect for s in search.steps] == [None, "asymmetric_friction", "cogging"]
    assert search.held_out.total < 0.5 * both.held_out.total
    assert "torque_offset" in [t.name for t in search.steps[1].others]
    assert not exchange(search)  # and stays
    assert [s.effect for s in search.steps] == [None, "asymmetric_friction", "cogging"]


def test_an_effect_of_fewer_parameters_that_took_as_much_is_tried_beside_the_same_friction() -> None:
    """Two yield limits are a torque offset. The fit with the offset had ended beside worse friction."""
    flat = HEALTHY.replace(HEALTHY["gms"].replace(static=LEVEL))
    seen = observe(dataset(flat + effects.TorqueOffset(torque=0.3 * LEVEL)).fit, flat.inertia)

    def fitted(plant: Plant) -> Trial:
        result = fit_observations(plant, seen)
        return Trial(plant.effects[-1].name, result, cross_validated(result.misfit, result.vector))

    limits = effects.AsymmetricFriction(level=0.3, stiffening=0, dropping=0)
    begun, chosen, simple = map(fitted, (UNKNOWN, UNKNOWN + limits, UNKNOWN + effects.TorqueOffset(torque=1e-3)))
    simple = simple._replace(held_out=replace(simple.held_out, rows=3 * simple.held_out.rows))
    search = Search(seen, [], UNKNOWN)
    search.steps = [
        Step(None, begun.result, held_out=begun.held_out),
        Step("asymmetric_friction", chosen.result, held_out=chosen.held_out, others=(simple,)),
    ]
    assert search.at_floor
    exchange(search)
    assert [s.effect for s in search.steps] == [None, "torque_offset"]


@pytest.mark.parametrize("stiffness, told", [(0.0, False), (1e-4, True)])
def test_an_offset_is_not_told_from_a_spring_only_where_that_leans(stiffness: float, told: bool) -> None:
    """A spring has an offset as its preload, and leaves no more with a stiffness of nothing."""
    torque = 0.3 * LEVEL
    seen = observe(dataset(HEALTHY + effects.TorqueOffset(torque=torque)).fit, HEALTHY.inertia)

    def trial(plant: Plant) -> Trial:
        result = fit_observations(plant, seen)
        return Trial(plant.effects[-1].name, result, cross_validated(result.misfit, result.vector))

    begun, offset, spring = map(trial, (UNKNOWN, UNKNOWN + effects.TorqueOffset(torque=torque),
                                        UNKNOWN + effects.Spring(stiffness=1e-7, preload=torque)))  # fmt: skip
    if stiffness:
        leaning = spring.result.plant.replace(spring.result.plant["spring"].replace(stiffness=stiffness))
        misfit, x = spring.result.misfit.onto(leaning, spring.result.vector)
        spring = spring._replace(result=replace(result_of(misfit, x), error=0.0), held_out=offset.held_out)
    search = Search(seen, [], UNKNOWN)
    search.steps = [
        Step(None, begun.result, held_out=begun.held_out),
        Step("torque_offset", offset.result, None, ("spring",), held_out=offset.held_out, others=(spring,)),
    ]
    exchange(search)
    assert [s.effect for s in search.steps] == [None, "torque_offset"]
    assert search.steps[1].confusable_with == (("spring",) if told else ())


def test_a_spring_that_is_all_preload_goes_before_the_offset_that_it_has() -> None:
    """Beside each other both do nothing; without the offset first, none is left of what both were."""
    offset, drag = effects.TorqueOffset(torque=0.15 * LEVEL), HIDDEN["quadratic_drag"]
    search = Search(observe(dataset(HEALTHY + drag + offset).fit, HEALTHY.inertia), [], UNKNOWN)
    fit_steps(search, drag, effects.Spring(stiffness=1e-6, preload=0.1 * LEVEL), offset)
    last = search.steps[-1]
    rigid = last.result.plant.replace(effects.Spring(stiffness=0.0, preload=0.0))
    misfit, x = last.result.misfit.onto(rigid, last.result.vector)
    end = refine(misfit, x)
    search.steps[-1] = replace(last, result=end, held_out=cross_validated(misfit, end.vector))
    assert search.at_floor and drop_false(search)
    assert [s.effect for s in search.steps] == [None, "quadratic_drag", "torque_offset"] and search.at_floor


def test_an_effect_that_does_nothing_does_not_carry_what_was_gained_beside_it() -> None:
    seen = observe(dataset(HEALTHY + HIDDEN["cogging"]).fit[:1], HEALTHY.inertia)
    before = fit_observations(UNKNOWN, seen)
    after = fit_observations(UNKNOWN + HIDDEN["cogging"] + effects.Gravity(amplitude=1e-7, phase=0.0), seen)
    assert carries("cogging", before, after) and not carries("gravity", before, after)


def test_an_effect_without_strengths_carries_what_it_gains() -> None:
    limit = effects.TorqueSaturation(limit=3 * LEVEL)
    seen = observe(dataset(HEALTHY + limit).fit[2:], HEALTHY.inertia)
    assert carries("torque_saturation", fit_observations(UNKNOWN, seen), fit_observations(UNKNOWN + limit, seen))
