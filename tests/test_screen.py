"""Screening: the effect that is hidden gains most, a healthy axis gives none a gain, and the gain is what a refit
gains."""

import math

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, UNKNOWN, J, runs

from gms_mujoco import effects
from gms_mujoco.fit import FitResult, fit, observe, refine
from gms_mujoco.held_out import BLOCK
from gms_mujoco.intervals import block_sums
from gms_mujoco.misfit import Misfit
from gms_mujoco.plant import Plant
from gms_mujoco.scales import Scales
from gms_mujoco.screen import (
    Candidate,
    LinearModel,
    Screen,
    applicable,
    cross_validated,
    has_phase,
    is_possible,
    is_present,
    joined,
    shapes,
    strengths,
)

# What has the hidden effect in it for some values of its parameters gains as much.
CONTAINS = {"torque_offset": {"spring"}, "delay": {"current_loop_lag"}}
# In sliding the two are one; only what does not slide tells them apart.
ALIKE = {"torque_offset": {"asymmetric_friction"}, "asymmetric_friction": {"torque_offset"}}

OBSERVED = observe(runs(HEALTHY), J)

every_hidden = pytest.mark.parametrize("name", HIDDEN)


@pytest.fixture(scope="module")
def screened() -> dict[str, tuple[FitResult, dict[str, Candidate]]]:
    """The fit of the baseline to each axis, and every candidate; "" is the healthy one."""
    out = {}
    for name in ("", *HIDDEN):
        found = fit(UNKNOWN, runs(HEALTHY + HIDDEN[name] if name else HEALTHY))
        screen = Screen(found.misfit, found.vector)
        candidates = [c for c in map(screen.candidate, applicable(found.plant)) if c]
        out[name] = found, {c.effect.name: c for c in candidates}
    return out


@every_hidden
def test_the_hidden_effect_gains_most(screened: dict, name: str) -> None:
    candidates = screened[name][1]
    near = CONTAINS.get(name, set()) | ALIKE.get(name, set())
    others = [c.gain for k, c in candidates.items() if k != name and k not in near]
    assert candidates[name].gain > 0.7 and candidates[name].gain > 3 * max(others)
    for k in near & candidates.keys():
        assert candidates[name].gain > 0.99 * candidates[k].gain


def test_a_healthy_axis_gives_no_effect_a_gain(screened: dict) -> None:
    assert max(c.gain for c in screened[""][1].values()) < 0.05


@pytest.mark.parametrize("name", ["", *HIDDEN])
def test_a_gain_is_a_share(screened: dict, name: str) -> None:
    assert all(0 <= c.gain <= 1 for c in screened[name][1].values())


@every_hidden
def test_a_joint_fit_starts_near_the_hidden_effect(screened: dict, name: str) -> None:
    start = screened[name][1][name].effect
    for p in strengths(type(start)):
        found, true = np.ravel(start.values[p.name])[0], np.ravel(HIDDEN[name].values[p.name])[0]
        assert 0.4 < found / true < 1.3
    if has_phase(type(start)):
        off = np.ravel(start.phase)[0] - np.ravel(HIDDEN[name].phase)[0]
        assert math.remainder(off, 2 * math.pi) == pytest.approx(0, abs=0.1)


def test_the_harmonic_is_found(screened: dict) -> None:
    assert screened["cogging"][1]["cogging"].effect.harmonics == (6.0,)


@every_hidden
def test_the_gain_is_at_most_what_a_refit_gains(screened: dict, name: str) -> None:
    """A linear refit promises no more than the nonlinear one keeps, up to the curvature."""
    found, candidates = screened[name]
    misfit = Misfit(found.plant + candidates[name].effect, found.misfit.observations)
    refitted = refine(misfit, misfit.vector(found.plant + candidates[name].effect))
    gained = 1 - (refitted.error / found.error) ** 2
    assert candidates[name].gain < gained + 0.02


@every_hidden
def test_the_error_on_blocks_not_seen_falls_with_the_right_effect(screened: dict, name: str) -> None:
    found, candidates = screened[name]
    before = Screen(found.misfit, found.vector).held_out
    assert candidates[name].held_out.total < 0.4 * before.total
    assert np.mean(candidates[name].held_out.squares < before.squares) > 0.6


def test_on_a_healthy_axis_nothing_helps_blocks_not_seen(screened: dict) -> None:
    found, candidates = screened[""]
    before = Screen(found.misfit, found.vector).held_out
    for c in candidates.values():
        assert c.held_out.total > 0.95 * before.total, c.effect.name


def test_cross_validation_leaves_at_least_what_the_fit_left(screened: dict) -> None:
    for found, _ in screened.values():
        residual = found.misfit.residual(found.vector)
        held_out = cross_validated(found.misfit, found.vector)
        assert len(held_out.rows) == len(residual)
        assert 0.999 * residual @ residual < held_out.total < 3 * residual @ residual


def test_what_the_plant_can_do_is_projected_out() -> None:
    """A linear problem: the tangents of inertia and drag leave nothing, and others keep what is their own."""
    plant = Plant(J, (effects.Viscous(coefficient=3e-4),), inertia_known=False)
    found = fit(plant, runs(plant))
    residual = found.misfit.residual(found.vector)
    model = LinearModel(found.misfit, found.vector, residual)
    own = found.misfit.jacobian(found.vector)
    other = np.random.default_rng(0).normal(size=(len(residual), 1))
    kept = model.without(np.column_stack([own, other]))
    left = np.sqrt((kept**2).sum(0)) / np.sqrt((np.column_stack([own, other]) ** 2).sum(0))
    assert np.all(left[:-1] < 0.05) and left[-1] > 0.99
    coefficients = np.linalg.lstsq(own, other, rcond=None)[0]
    np.testing.assert_allclose(kept[: len(residual), -1:], other - own @ coefficients, atol=0.01)


def test_held_out_blocks_are_those_of_an_explicit_refit() -> None:
    """One refit per fold, written out with a dense solver."""
    plant = Plant(J, (effects.Viscous(coefficient=3e-4),), inertia_known=False)
    found = fit(plant, runs(plant, torque_noise=1e-3))
    residual = found.misfit.residual(found.vector)
    model = LinearModel(found.misfit, found.vector, residual)
    added = np.random.default_rng(0).normal(size=(len(residual), 2))
    got = block_sums(found.misfit.observations, model.held_out(added) ** 2, BLOCK)
    columns = np.column_stack([model.tangents, added])
    lengths = block_sums(found.misfit.observations, np.ones(len(residual)), BLOCK).astype(int)
    block = np.repeat(np.arange(len(lengths)), lengths)
    prior = model.prior * np.eye(len(columns.T))[: model.tangents.shape[1]]
    expected = np.empty(len(lengths))
    for fold in range(5):
        rest = block % 5 != fold
        a = np.vstack([columns[rest], prior])
        b = np.append(residual[rest], np.zeros(len(prior)))
        left = residual - columns @ np.linalg.lstsq(a, b, rcond=None)[0]
        for k in range(fold, len(lengths), 5):
            expected[k] = (left[block == k] ** 2).sum()
    np.testing.assert_allclose(got, expected, rtol=1e-3)


def test_a_plant_without_friction_lacks_its_friction() -> None:
    """The laws that are not small changes are left out, those that are gain most and start near the level."""
    law = effects.Stribeck(coulomb=3e-3, static=4.5e-3, stribeck_velocity=1.0)
    drag = Plant.axis(J) + effects.Viscous(coefficient=2e-5)
    found = fit(Plant.axis(J) + effects.Viscous(), runs(drag + law)[1:])
    screen = Screen(found.misfit, found.vector)
    candidates = {c.effect.name: c for c in map(screen.candidate, applicable(found.plant)) if c}
    names = sorted(candidates, key=lambda k: -candidates[k].gain)
    assert set(names[:2]) == {"stribeck", "coulomb"} and not {"gms", "lugre"} & set(names)
    start = candidates["stribeck"].effect
    assert 0.8 < start.coulomb / law.coulomb < 1.2 and start.coulomb < start.static < 1.2 * law.static


def test_every_effect_of_the_catalogue_can_be_screened(screened: dict) -> None:
    """On records that turn and rest every effect shows, but those that need a signal that was not recorded."""
    found, candidates = screened[""]
    missing = {e.name for e in applicable(found.plant)} - set(candidates)
    assert missing <= {"load_dependent_friction"}


def test_applicable_effects_are_not_there_yet_nor_contained() -> None:
    names = {e.name for e in applicable(HEALTHY)}
    assert not names & {"gms", "viscous", "coulomb", "stribeck", "dahl", "lugre"}
    assert {"cogging", "gravity", "delay", "asymmetric_friction"} <= names
    assert "viscous" in {e.name for e in applicable(HEALTHY.without("viscous"))}
    assert "coulomb" in {e.name for e in applicable(Plant.axis(J))}


def test_shapes_are_values_that_the_effect_accepts(screened: dict) -> None:
    observations = screened[""][0].misfit.observations
    scales = Scales.of(observations)
    for name, kind in effects.CATALOGUE.items():
        for shape in shapes(kind, scales, observations):
            table = {p.name: p for p in kind.parameters}
            assert all(table[k].lower <= v <= table[k].upper for k, v in shape.items()), name


def test_harmonics_are_tried_only_where_the_motion_passes_them(screened: dict) -> None:
    observations = screened[""][0].misfit.observations
    tried = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(observations), observations)]
    assert tried[0] == 2 and tried == sorted(tried)
    small = fit(UNKNOWN, runs(HEALTHY)[:1], bandwidth=100.0).misfit.observations  # pre-sliding: far from a turn
    turn = float(np.ptp(small[0].position)) / (2 * math.pi)
    few = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(small), small)]
    assert all(n * turn >= 1 for n in few) and len(few) < len(tried)


def test_an_effect_whose_strength_vanished_is_not_present() -> None:
    assert is_present(HIDDEN["cogging"]) and not is_present(effects.Cogging(harmonics=[6]))
    assert is_present(HIDDEN["delay"]) and not is_present(effects.Delay(time=0.0))


def test_an_effect_whose_signal_was_not_recorded_is_no_candidate(screened: dict) -> None:
    found, candidates = screened["cogging"]
    assert "load_dependent_friction" in {e.name for e in applicable(found.plant)}
    assert "load_dependent_friction" not in candidates
    assert "load_dependent_friction" not in screened[""][1]


def test_one_more_harmonic_is_a_candidate_and_no_other_effect_twice() -> None:
    plant = HEALTHY + effects.Cogging(harmonics=[6], amplitude=[0.2 * LEVEL], phase=[0.4])
    names = {e.name for e in applicable(plant + HIDDEN["gravity"])}
    assert {"cogging", "position_dependent_friction"} <= names and "gravity" not in names
    more = joined(plant, effects.Cogging(harmonics=[9], amplitude=[0.1 * LEVEL], phase=[1.0]))
    assert more["cogging"].harmonics == (6.0, 9.0) and len(more.effects) == len(plant.effects)
    tried = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(OBSERVED), OBSERVED, plant)]
    assert 6.0 not in tried and {5.0, 7.0} <= set(tried)


def test_candidates_for_a_gap_are_close_and_knock_hard() -> None:
    tried = list(shapes(effects.Backlash, Scales.of(OBSERVED), OBSERVED))
    gaps, frequencies = ({s[k] for s in tried} for k in ("gap", "frequency"))
    assert min(gaps) >= 3 * OBSERVED[0].record.resolution and all(20 <= f <= 120 for f in frequencies)
    # Two refinements close the steps of the grid to less than 1.3.
    steps = np.diff(np.log(sorted(gaps)))
    assert np.exp(steps.max()) / (1.41 * 1.19) ** 2 < 1.3


def test_an_effect_at_the_end_of_its_range_or_a_resonance_without_one_is_not_what_it_is_called() -> None:
    lag, coupling = effects.CurrentLoopLag, effects.FlexibleCoupling
    assert is_possible(lag(time=0.01)) and not is_possible(lag(time=0.05))
    assert is_possible(coupling(inertia=1e-5, frequency=30, damping=0.3))
    assert not is_possible(coupling(inertia=1e-5, frequency=1, damping=5))
    assert is_possible(effects.Backlash(inertia=1e-5, gap=0.01, frequency=100, damping=1))
    assert is_possible(effects.Cogging(harmonics=[2, 3], amplitude=[1, 2], phase=[0, 0]))


def test_a_load_that_joins_a_plant_is_less_than_its_inertia() -> None:
    load = effects.find("flexible_coupling")(inertia=3 * J, frequency=50.0)
    assert 0 < joined(HEALTHY, load).driven_inertia < J
    assert joined(HEALTHY, load.replace(inertia=0.2 * J))["flexible_coupling"].inertia == 0.2 * J
