"""What the search accepts, and what it looks at twice."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, runs
from scipy import stats

from gms_mujoco import effects
from gms_mujoco.diagnosis import judgement
from gms_mujoco.diagnosis.judgement import (
    FALSE_DISCOVERY_RATE,
    LEAST_SHARE,
    carries,
    discoveries,
    finalists,
    least_share,
    simplest,
    without,
)
from gms_mujoco.effect import Effect
from gms_mujoco.fit_result import FitResult, result_of
from gms_mujoco.identification.candidates import stronger
from gms_mujoco.identification.held_out import HeldOut
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.plant import Plant


def test_discoveries_are_those_of_benjamini_and_hochberg() -> None:
    for seed in range(50):
        p = np.random.default_rng(seed).uniform(0, 1, 15) ** 4
        names = {f"effect {i}": float(v) for i, v in enumerate(p)}
        adjusted = stats.false_discovery_control(p)
        assert discoveries(names) == {f"effect {i}" for i in np.flatnonzero(adjusted <= FALSE_DISCOVERY_RATE)}


@pytest.mark.parametrize(
    ("held_out", "left", "negligible", "chosen", "others"),
    [(1.0, 1.0, 0.0, 1, [0]), (2.0, 1.0, 0.0, 1, [0]), (2.0, 1.005, 0.0, 1, [0]), (2.0, 1.2, 0.0, 0, []),
     (2.0, 1.2, 1e9, 1, [0])],
    ids=["as good on both", "refits led astray", "hardly more", "worse", "too little to have a cause"],
)
def test_fewer_parameters_that_leave_as_much_are_preferred(
    monkeypatch: pytest.MonkeyPatch, held_out: float, left: float, negligible: float, chosen: int, others: list[int]
) -> None:
    assert simplest(_play_and_coupling(monkeypatch, held_out, left, negligible)) == (chosen, others)


@pytest.mark.parametrize(("unforeseen", "chosen", "others"), [(0.0, 1, [0]), (0.2, 0, []), (0.8, 1, [0])],
                         ids=["neither", "a part", "nearly all: at the noise floor"])  # fmt: skip
def test_what_does_not_claim_to_foretell_all_that_it_leaves_is_better(
    monkeypatch: pytest.MonkeyPatch, unforeseen: float, chosen: int, others: list[int]
) -> None:
    trials = _play_and_coupling(monkeypatch, 1.0, 1.0, unforeseen=unforeseen)
    assert simplest(trials) == (chosen, others)


def _play_and_coupling(
    monkeypatch: pytest.MonkeyPatch, held_out: float, left: float, negligible: float = 0.0, unforeseen: float = 0.0
) -> list[judgement.Trial]:
    """The play is the first, with one parameter more than the coupling, and leaves 1.

    Args:
        unforeseen: share of that, that the play does not foretell.
    """
    monkeypatch.setattr(judgement, "left_of", lambda misfit, vector: misfit.left)
    monkeypatch.setattr(judgement, "floor_of", lambda result: max(result.floor, result.negligible))
    seen = observe(runs(HEALTHY), J)
    noise = np.random.default_rng(0).standard_normal(sum(len(o.index) for o in seen))

    def trial(name: str, size: int, left: float, held_out: float, floor: float) -> judgement.Trial:
        behind = HeldOut(np.sqrt(held_out) * noise, seen)
        misfit = SimpleNamespace(left=left, coordinates=SimpleNamespace(size=size))
        result: Any = SimpleNamespace(
            misfit=misfit, vector=None, negligible=negligible, floor=floor * behind.total, rattles=False
        )
        return judgement.Trial(name, result, behind)

    return [trial("backlash", 5, 1.0, 1.0, unforeseen), trial("flexible_coupling", 4, left, held_out, 0.0)]


@pytest.mark.parametrize(("second", "taken"), [((1.0, 0.1), 3), ((0.1, 1.0), 2)], ids=["alike", "different"])
def test_two_finalists_that_do_the_same_make_room_for_a_third(second: tuple[float, float], taken: int) -> None:
    def left(*residual: float) -> Any:
        return SimpleNamespace(residual=lambda x: np.array(residual))

    current: Any = SimpleNamespace(misfit=left(2.0, 2.0), vector=None)
    rough = [("a", left(1.0, 2.0), np.empty(0)), ("b", left(*np.subtract(2.0, second)), np.empty(0)),
             ("c", left(2.0, 1.5), np.empty(0))]  # fmt: skip
    assert [name for name, *_ in finalists(current, rough)] == ["a", "b", "c"][:taken]
    assert finalists(current, rough[:1]) == rough[:1]


def test_a_series_goes_on_with_a_usual_harmonic_at_no_least_share() -> None:
    teeth = effects.Cogging(harmonics=[6], amplitude=[1e-3], phase=[0.4])
    grown = {n: teeth.replace(harmonics=[6, n], amplitude=[1e-3, 1e-4], phase=[0.4, 0.0]) for n in (12, 561)}
    plant = Plant.axis(1e-5) + teeth
    assert least_share(plant, grown[12]) == 0 and least_share(plant, grown[561]) == LEAST_SHARE
    assert least_share(Plant.axis(1e-5), grown[12]) == LEAST_SHARE


@pytest.mark.parametrize(
    ("noise", "friction", "coupling", "worth"),
    [(60.0, 0.0, 0.0, True), (60.0, 50.0, 0.0, True), (60.0, 0.0, 50.0, False), (101.0, 0.0, 0.0, False),
     (90.0, 0.0, 0.0, False)],
    ids=["as loud", "beside stiffer friction", "quieter", "no more than noise", "hardly more than noise"],
)
def test_at_the_floor_less_noise_is_no_explanation(
    monkeypatch: pytest.MonkeyPatch, noise: float, friction: float, coupling: float, worth: bool
) -> None:
    """A coupling takes inertia off high frequencies and with it the encoder's noise, whatever the axis is. Friction
    that has stiffened where it stood alone passed on noise of its own, which says nothing against a coupling."""
    name, seen = "flexible_coupling", observe(runs(HEALTHY, seconds=1.0)[:1], J)
    swings = effects.find(name)(inertia=0.3 * J, frequency=80.0)

    def fitted(plant: Plant) -> FitResult:
        misfit = Misfit(plant, seen)
        return refine(misfit, misfit.vector(plant), 1)

    now, result = fitted(HEALTHY), fitted(HEALTHY + swings)

    def floor(r: FitResult, *given: object) -> float:
        rigid = name not in r.plant or r.plant[name].values["inertia"] == 0
        return noise + coupling * rigid + friction * (r is now)

    monkeypatch.setattr(judgement, "floor_of", floor)
    monkeypatch.setattr(judgement, "left_of", lambda misfit, vector: 90.0 if misfit is now.misfit else 55.0)
    before: Any = SimpleNamespace(total=100.0)
    after: Any = SimpleNamespace(total=60.0)
    assert judgement.at_floor(now, before)
    assert judgement.is_worth_it(now, before, result, after) == worth


@pytest.mark.parametrize(
    ("effect", "worth"),
    [
        (effects.Cogging(harmonics=[6]), True),
        (effects.EncoderEccentricity(amplitude=0.01), True),
        (effects.Delay(time=1e-3), False),
        (effects.TorqueSaturation(limit=1.0), False),
        (effects.FlexibleCoupling(inertia=0.2, frequency=24.0, damping=0.02), False),
    ],
    ids=lambda p: getattr(p, "name", None),
)
def test_much_of_the_little_above_the_floor_is_enough_but_for_what_passes_on_less_noise(
    monkeypatch: pytest.MonkeyPatch, effect: Effect, worth: bool
) -> None:
    now: Any = SimpleNamespace(plant=Plant.axis(1.0), negligible=0.0, rattles=False)
    result: Any = SimpleNamespace(plant=now.plant + effect)
    monkeypatch.setattr(judgement, "floor_of", lambda *given: 75.0)
    monkeypatch.setattr(judgement, "_left_by", lambda *given: (100.0, 88.0))  # less than a fifth of all
    monkeypatch.setattr(judgement, "_noise_beside", lambda *given: (75.0, 0.0))
    monkeypatch.setattr(judgement, "_while_sliding", lambda *given: None)
    monkeypatch.setattr(judgement, "_takes_beside_moments", lambda *given: False)
    monkeypatch.setattr(judgement, "_holds_below", lambda *given: True)
    before: Any = SimpleNamespace(total=100.0)
    after: Any = SimpleNamespace(total=88.0)
    assert judgement.is_worth_it(now, before, result, after) == worth


@pytest.mark.parametrize("floor", [10.0, 60.0], ids=["above the floor", "at the floor"])
def test_blocks_that_only_another_start_of_the_refits_predicts_better_are_no_gain(
    monkeypatch: pytest.MonkeyPatch, floor: float
) -> None:
    """Of two seconds of a healthy axis refits of the bare plant lost so much that cogging seemed to take a third."""
    left = {"now": 90.0, "result": 89.0}
    bare = Plant.axis(1.0)
    now: Any = SimpleNamespace(misfit="now", vector=None, plant=bare, negligible=0.0, rattles=False)
    result: Any = SimpleNamespace(misfit="result", vector=None, plant=bare + effects.Cogging(harmonics=[6]))
    monkeypatch.setattr(judgement, "floor_of", lambda *given: floor)
    monkeypatch.setattr(judgement, "left_of", lambda misfit, vector: left[misfit])
    monkeypatch.setattr(judgement, "_noise_beside", lambda *given: (0.0, 0.0))
    monkeypatch.setattr(judgement, "_while_sliding", lambda *given: None)
    monkeypatch.setattr(judgement, "_takes_beside_moments", lambda *given: False)
    before: Any = SimpleNamespace(total=100.0)
    after: Any = SimpleNamespace(total=60.0)
    assert not judgement.is_worth_it(now, before, result, after)
    left["result"] = 50.0
    assert judgement.is_worth_it(now, before, result, after)


@pytest.mark.parametrize(
    ("sliding", "turning", "worth"),
    [(0.1, 1.0, True), (0.1, 1.2, False), (0.8, 0.99, False)],
    ids=["most while it slides", "worse at reversals", "little"],
)
def test_what_a_stiff_contact_leaves_at_reversals_hides_nothing_while_the_axis_slides(
    sliding: float, turning: float, worth: bool
) -> None:
    """An effect is judged by what it takes where friction is no more than its level, too."""
    seen = observe(runs(HEALTHY)[2:], J)
    slides = np.concatenate([o.slides for o in seen if isinstance(o, Observation)])
    assert 0.2 < slides.mean() < 0.95
    rows = np.where(slides, 1.0, 30.0)
    after = rows * np.sqrt(np.where(slides, sliding, turning))

    def fitted(plant: Plant) -> FitResult:
        misfit = Misfit(plant, seen)
        found = refine(misfit, misfit.vector(plant), 1)
        return replace(found, floor_rows=np.where(slides, 0.2, 10.0))

    now, result = fitted(HEALTHY), fitted(HEALTHY + effects.Cogging(harmonics=[6], amplitude=[0.1 * LEVEL], phase=[0]))
    left, gone = HeldOut(rows, seen), HeldOut(after, seen)
    assert not judgement.takes(left.total, gone.total, 0.0)  # of all, it takes too little
    assert judgement.is_worth_it(now, left, result, gone) == worth
    assert not judgement.is_worth_it(now, left, now, gone)  # another shape of the same is no effect
    quiet = [replace(f, floor_rows=np.where(slides, 0.9, 10.0)) for f in (now, result)]
    assert not judgement.is_worth_it(quiet[0], left, quiet[1], gone)  # no more than noise is left there


@pytest.mark.parametrize(
    ("seconds", "elsewhere", "there", "worth"),
    [(0.4, 0.5, 1.0, True), (0.4, 0.5, 1.2, False), (0.4, 0.95, 1.0, False), (3.0, 0.5, 1.0, False)],
    ids=["a moment", "worse there", "little elsewhere", "no moment"],
)
def test_a_knock_hides_nothing_of_what_an_effect_does_in_the_rest_of_the_records(
    seconds: float, elsewhere: float, there: float, worth: bool
) -> None:
    """A drag that was found to a fifth of a percent had been left out: 85 % of what remained was at one instant."""
    seen = observe(runs(HEALTHY, seconds=8.0), J)
    time = np.concatenate([o.record.time[o.index] for o in seen if isinstance(o, Observation)])
    knocked = np.arange(len(time)) < np.argmax(time > 2.0 + seconds)
    knocked &= time >= 2.0
    rows = np.where(knocked, 30.0, 1.0)
    after = rows * np.sqrt(np.where(knocked, there, elsewhere))
    now, result = (
        replace(refine(m, m.vector(plant), 1), floor_rows=np.full(len(rows), 0.2))
        for plant in (HEALTHY, HEALTHY + effects.Cogging(harmonics=[6], amplitude=[0.1 * LEVEL], phase=[0]))
        for m in [Misfit(plant, seen)]
    )
    left, gone = HeldOut(rows, seen), HeldOut(after, seen)
    assert not judgement.takes(left.total, gone.total, 0.0)
    assert judgement._takes_beside_moments(now, left, result, gone) == worth
    assert judgement.is_worth_it(now, left, result, gone) == worth
    assert not judgement.is_worth_it(now, left, now, gone)


def test_a_part_that_swings_by_itself_carries_nothing_and_one_that_the_axis_drives_does() -> None:
    swings = effects.FlexibleCoupling(inertia=0.2 * J, frequency=24.0, damping=0.02)
    hums = [
        replace(r, signals={**r.signals, "torque": r.torque + 0.1 * LEVEL * np.sin(2 * np.pi * 24.0 * r.time + i)})
        for i, r in enumerate(runs(HEALTHY, seconds=2.0)[:2])
    ]
    alone = swings.replace(inertia=1e-3 * J, damping=0.0)
    for measured, start in ((hums, alone), (runs(HEALTHY + swings)[:2], swings)):
        misfit = Misfit(HEALTHY, observe(measured, J))
        before = refine(misfit, misfit.vector(HEALTHY))
        after = refine(*before.misfit.onto(before.plant + start, before.vector))
        assert after.error < 0.5 * before.error
        assert judgement.carries("flexible_coupling", before, after) is (measured is not hums)


def test_a_play_of_no_width_carries_nothing_that_is_a_plays_and_one_that_opens_does() -> None:
    """Whatever the coupling has taken that it then is."""
    contact = {"inertia": 0.2 * J, "frequency": 24.0, "damping": 0.1}
    play = effects.Backlash(gap=0.02, **contact)
    wide, none = (
        observe(runs(HEALTHY + e, seconds=2.0), J) for e in (play, effects.FlexibleCoupling(**contact))
    )
    for seen, gap in ((wide, 0.02), (none, 1e-14)):
        before = _as_it_is(HEALTHY, seen)
        misfit = Misfit(HEALTHY + play.replace(gap=gap), seen)
        after = refine(misfit, misfit.vector(HEALTHY + play.replace(gap=gap)))
        assert after.error < 0.5 * before.error
        assert carries("backlash", before, after) is (seen is wide)


def test_what_multiplies_friction_always_by_the_same_carries_nothing_and_is_gone_without_a_loss() -> None:
    """Beside friction that is twice as strong what halves it for good leaves as little as none."""
    seen = observe(runs(HEALTHY), J)
    halved = stronger(HEALTHY, 2.0) + effects.ThermalDrift(amplitude=-0.5, time_constant=1e12, whole=1.0)
    weaker, result = (_as_it_is(p, seen) for p in (stronger(HEALTHY, 0.5), halved))
    assert result.error < 0.2 * weaker.error
    assert not carries("thermal_drift", weaker, result)
    misfit, x = without(result, "thermal_drift")
    assert misfit.cost(x) == pytest.approx(result.misfit.cost(result.vector), rel=0.01)
    fades = HEALTHY + effects.ThermalDrift(amplitude=1.0, time_constant=1.0)
    before, after = (_as_it_is(p, observe(runs(fades), J)) for p in (stronger(HEALTHY, 1.32), fades))  # its mean
    assert carries("thermal_drift", before, after)


def _as_it_is(plant: Plant, seen: list[Observation]) -> FitResult:
    misfit = Misfit(plant, seen)
    return result_of(misfit, misfit.vector(plant))
