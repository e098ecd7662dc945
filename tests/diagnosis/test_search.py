"""The search for what is missing: what it lets go before it names an effect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import GMS, HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, UNKNOWN, J, runs

from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.friction_shape import straightened
from gms_mujoco.diagnosis.joint_fits import JointFits
from gms_mujoco.diagnosis.judgement import Trial
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.fit import baseline, fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.habits import EARLY_SHARE, acting_early
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.identification.screen import Candidate
from gms_mujoco.plant import Plant
from gms_mujoco.progress import silent
from gms_mujoco.record import Record


def _logged(record: Record, early: float, line: float) -> Record:
    """The log of a current that acted `early` samples before its row, beside a torque of 12 Hz that nobody knows."""
    held = (1 - early) * record.torque + early * np.append(record.torque[:1], record.torque[:-1])
    unknown = line * LEVEL * np.sin(2 * np.pi * 12 * SAMPLE_TIME * np.arange(len(held)))
    return replace(record, signals={**record.signals, "torque": held + unknown})


@pytest.mark.parametrize("line", [0.0, 0.2])
def test_what_was_found_stays_beside_another_habit_of_the_log_where_nothing_is_left(line: float) -> None:
    """Else all is looked for again: it may have stood for a part of that habit."""
    offset = effects.TorqueOffset(torque=0.2 * LEVEL)
    search = Search(observe([_logged(r, 0.5, line) for r in runs(HEALTHY + offset)], J), [], UNKNOWN)
    for effect, plant in ((None, UNKNOWN), ("torque_offset", UNKNOWN + effects.TorqueOffset())):
        found = fit_observations(plant, search.seen)
        search.steps.append(Step(effect, found, held_out=cross_validated(found.misfit, found.vector)))
    search.seen = [o.acting_early() for o in search.seen if isinstance(o, Observation)]
    search._seen_anew()
    assert [s.effect for s in search.steps] == [None, "torque_offset"][: 1 if line else 2]
    assert all(o.early for s in search.steps for o in s.result.misfit.observations)
    if not line:
        assert search.at_floor
        assert search.steps[-1].result.plant["torque_offset"].torque == pytest.approx(0.2 * LEVEL, rel=0.02)


@pytest.mark.slow
def test_an_effect_that_takes_far_more_than_a_habit_of_the_log_comes_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is missing presses the clocks apart as well, and so explains a little."""
    shares: list[float] = []
    for stiffness in (0.02, 0.1):
        search = Search(observe(runs(HEALTHY + effects.Spring(stiffness=stiffness)), J), [], UNKNOWN)
        search.first(silent)
        first = search.steps[0].result
        whole = fit_observations(first.plant + effects.Spring(stiffness=stiffness), search.seen)
        trial = Trial("spring", whole, cross_validated(whole.misfit, whole.vector))
        with monkeypatch.context() as m:
            m.setattr(search, "is_worth_it", lambda *given: True)
            m.setattr(search, "relogged", lambda share=EARLY_SHARE: shares.append(share))
            m.setattr("gms_mujoco.diagnosis.search.carries", lambda *given: True)
            search._accept([trial], {"spring": 1e-9})
        taken = 1 - (whole.error / first.error) ** 2
        assert shares[-2:] == [pytest.approx(EARLY_SHARE * taken, rel=1e-3), EARLY_SHARE]


@pytest.mark.parametrize("early", [0.0, 0.5])
def test_a_habit_of_the_log_is_let_go_before_an_effect_is_named(early: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though it takes little beside what is unknown, for which an effect may stand; without one nothing changes."""
    search = Search(observe([_logged(r, early, 0.2) for r in runs(HEALTHY)], J), [], UNKNOWN)
    search.first(silent)
    first = search.steps[0].result
    assert first.error > 2 * first.floor and acting_early(first) is None
    with_spring = fit_observations(first.plant + effects.Spring(stiffness=0.1), search.seen)
    trial = Trial("spring", with_spring, cross_validated(with_spring.misfit, with_spring.vector))
    monkeypatch.setattr(search, "is_worth_it", lambda *given: True)
    monkeypatch.setattr("gms_mujoco.diagnosis.search.carries", lambda *given: True)
    assert search._accept([trial], {"spring": 1e-9})
    if early:
        assert [s.effect for s in search.steps] == [None]
        skew = search.steps[0].result.plant.provenance["clock_skew"]
        assert skew == pytest.approx(-early * SAMPLE_TIME, rel=0.2)
        assert search._accept([trial], {"spring": 1e-9})  # once: then it is named
    assert [s.effect for s in search.steps] == [None, "spring"]


@pytest.mark.slow
def test_a_habit_that_shows_only_out_of_a_local_optimum_is_allowed_for() -> None:
    """Friction that never slips stands for a spring, as another one in each record: what it leaves hides when torques
    acted."""
    true = HEALTHY + effects.Spring(stiffness=0.05)
    records = tuple(_logged(r, 0.5, 0.0) for use in ("fit", "validate") for r in runs(true, use))
    found = diagnose(Dataset(Path(), records, true.kind, true.inertia))
    assert found.plant.provenance["clock_skew"] == pytest.approx(-0.5 * SAMPLE_TIME, rel=0.1)


@pytest.mark.slow
def test_at_the_noise_floor_only_what_may_earn_its_place_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []
    roughly = JointFits.roughly

    def told(fits: JointFits, current: FitResult, candidate: Candidate, below: float) -> tuple[Misfit, np.ndarray]:
        tried.append(candidate.effect.name)
        return roughly(fits, current, candidate, below)

    monkeypatch.setattr(JointFits, "roughly", told)
    drag = effects.QuadraticDrag(coefficient=0.0015 * LEVEL / 30**2)
    for plant, expected in ((HEALTHY, []), (HEALTHY + drag, ["quadratic_drag"])):
        search = Search(observe(runs(plant), J), [], UNKNOWN)
        search.first(silent)
        assert search.at_floor
        search.add_one(silent)
        assert tried[:1] == expected


def test_a_drag_takes_the_place_of_a_curve_that_stands_for_it_at_the_noise_floor() -> None:
    """And a curve that does bend over all speeds keeps its own."""
    law, noise = GMS.replace(static=1.02 * LEVEL), 1e-3
    drag = effects.QuadraticDrag(coefficient=0.3 * LEVEL / 20**2)
    curve = law.replace(static=1.4 * LEVEL, stribeck_velocity=25.0)
    for plant, there in ((HEALTHY.replace(law) + drag, True), (HEALTHY.replace(curve), False)):
        near = Misfit(HEALTHY.replace(curve), observe(runs(plant, torque_noise=noise), J))
        now = refine(near, near.vector(HEALTHY.replace(curve)))
        search = Search(near.observations, [], HEALTHY)
        search.steps = [Step(None, now, held_out=cross_validated(now.misfit, now.vector))]
        assert search.at_floor and straightened(now)
        assert search._drag_for_curve() == there
        assert [s.effect for s in search.steps[1:]] == ["quadratic_drag"] * there
        if there:
            base, last = (s.result for s in search.steps)
            assert last.plant["quadratic_drag"].coefficient == pytest.approx(drag.coefficient, rel=0.1)
            assert base.error > 1.2 * last.error


@pytest.mark.slow
def test_a_curve_that_would_hide_a_drag_waits_for_it() -> None:
    """An effect that leaves less beside the present curve goes first; the curve that is left to find comes after it."""
    law = GMS.replace(static=1.6 * LEVEL, stribeck_velocity=1.5, stribeck_exponent=0.75)
    hidden = effects.QuadraticDrag(coefficient=0.01 * LEVEL / 20**2)
    records = runs(HEALTHY.replace(law) + hidden, seconds=4.0, seed=7, torque_noise=1e-5)
    search = Search(observe(records, J), [], baseline(J))
    search.first(silent)
    assert search.waits and search.steps[0].result.plant["gms"].stribeck_exponent == 1
    assert search.add_one(silent)
    assert [s.effect for s in search.steps] == [None, "quadratic_drag"] and not search.waits
    found = search.steps[-1].result.plant
    assert found["gms"].stribeck_exponent == pytest.approx(0.75, rel=0.03)
    assert found["quadratic_drag"].coefficient == pytest.approx(hidden.coefficient, rel=0.02)


@pytest.mark.slow
def test_a_curve_that_waits_for_nothing_comes_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    law = GMS.replace(static=2 * LEVEL, stribeck_velocity=1.5, stribeck_exponent=0.75)
    others = [name for name in effects.CATALOGUE if name not in ("spring", "cogging")]
    search = Search(observe(runs(HEALTHY.replace(law), seconds=6.0, seed=3), J), [], baseline(J), without=others)
    monkeypatch.setattr(search, "_explains_more", lambda *given: True)
    search.first(silent)
    assert search.waits and search.steps[0].result.plant["gms"].stribeck_exponent == 1
    assert search.add_one(silent) and len(search.steps) == 1 and not search.waits
    assert search.steps[0].result.plant["gms"].stribeck_exponent == pytest.approx(0.75, rel=0.05)
    assert search.at_floor


def test_a_curve_is_looked_for_again_where_a_plant_has_come_well_below_where_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    law = GMS.replace(static=2 * LEVEL, stribeck_velocity=1.5, stribeck_exponent=0.75)
    search = Search(observe(runs(HEALTHY.replace(law), seconds=6.0, seed=3), J), [], baseline(J))
    with monkeypatch.context() as unseen:
        unseen.setattr("gms_mujoco.diagnosis.search.other_curve", lambda now, left: (now, left))
        search.first(silent)
    for name in ("_accept", "_accept_two", "_drag_for_curve", "_refined", "relogged"):
        monkeypatch.setattr(search, name, lambda *given: False)
    for name in ("_candidates", "_trials", "_afresh", "_beside_following"):
        monkeypatch.setattr(search, name, lambda *given: [])
    assert not search.add_one(silent) and search.steps[0].result.plant["gms"].stribeck_exponent == 1
    monkeypatch.setattr(search, "_shaped_at", 1.2 * search.steps[0].result.error)
    assert search.add_one(silent) and len(search.steps) == 1
    assert search.steps[0].result.plant["gms"].stribeck_exponent == pytest.approx(0.75, rel=0.05)


def test_friction_gets_more_elements_from_where_a_trial_has_led() -> None:
    many = GMS.replace(stiffness=[0.5, 0.3, 0.12, 0.08], fraction=[0.3, 0.25, 0.25, 0.2])
    search = Search(observe(runs(HEALTHY.replace(many)), J), [], HEALTHY)
    few = fit_observations(HEALTHY.replace(effects.GMS(elements=3)), search.seen)
    search.steps = [Step(None, few, held_out=cross_validated(few.misfit, few.vector))]
    assert not search.at_floor and search._refined()
    assert search.steps[-1].result.plant["gms"].elements > 3 and search.at_floor
    assert not search._refined()


def test_what_takes_little_beside_what_comes_down_to_the_floor_is_no_rival() -> None:
    seen = observe(runs(HEALTHY + HIDDEN["gravity"]), J)

    def fitted(plant: Plant) -> FitResult:
        misfit = Misfit(plant, seen)
        return refine(misfit, misfit.vector(plant))

    base, gravity, offset = map(fitted, (HEALTHY, HEALTHY + HIDDEN["gravity"], HEALTHY + effects.TorqueOffset()))
    search = Search(seen, [], HEALTHY)
    search.steps = [Step(None, base, held_out=cross_validated(base.misfit, base.vector))]
    first, poor = (Trial(n, r, cross_validated(r.misfit, r.vector))
                   for n, r in (("gravity", gravity), ("torque_offset", offset)))  # fmt: skip
    assert search._is_no_rival(offset.misfit, offset.vector, first)
    assert not search._is_no_rival(gravity.misfit, gravity.vector, first)
    assert not search._is_no_rival(base.misfit, base.vector, poor)  # far from the floor anything may
