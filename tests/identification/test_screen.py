"""Screening: the effect that is hidden gains most, a healthy axis gives none a gain, and the gain is what a refit
gains."""

import math

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, UNKNOWN, J, baseline_fit, run, runs

from gms_mujoco import effects
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.candidates import applicable, has_phase, strengths
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.refine import refine
from gms_mujoco.identification.screen import Candidate, Screen
from gms_mujoco.plant import Plant

# What has the hidden effect in it for some values of its parameters gains as much.
CONTAINS = {"torque_offset": {"spring"}, "delay": {"current_loop_lag"}}
# In sliding the two are one; only what does not slide tells them apart.
ALIKE = {"torque_offset": {"asymmetric_friction"}, "asymmetric_friction": {"torque_offset"}}

every_hidden = pytest.mark.parametrize("name", HIDDEN)


@pytest.fixture(scope="module")
def screened() -> dict[str, tuple[FitResult, dict[str, Candidate]]]:
    """The fit of the baseline to each axis, and every candidate; "" is the healthy one."""
    out = {}
    for name in ("", *HIDDEN):
        found = baseline_fit(name)
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


@pytest.mark.parametrize("name", ["cogging", "position_dependent_friction"])
def test_a_harmonic_of_a_gear_is_found_however_high(name: str) -> None:
    """Two periods to a turn of a motor that turns a hundred times as fast as the joint."""
    size = {"cogging": 0.1 * LEVEL, "position_dependent_friction": 0.1}[name]
    slow = HEALTHY.replace(effects.Viscous(coefficient=3e-3))
    truth = slow + effects.find(name)(harmonics=[200], amplitude=[size], phase=[0.4])
    torques = [multisine(4000, SAMPLE_TIME, 0.5, 3.0, 2 * LEVEL, np.random.default_rng(i)) for i in range(2)]
    found = fit(UNKNOWN, [run(truth, u, i) for i, u in enumerate(torques)])
    candidate = Screen(found.misfit, found.vector).candidate(effects.find(name))
    assert candidate is not None and candidate.effect.values["harmonics"] == (200.0,)
    assert candidate.gain > 0.3


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


@pytest.mark.parametrize(("gap", "damping"), [(0.015, 1.0), (0.03, 0.5)])
def test_the_width_of_a_play_is_told_before_any_fit(gap: float, damping: float) -> None:
    """Within a tenth, beyond which a fit does not find it; what else a fit may start from is far from it."""
    hidden = effects.Backlash(inertia=0.3 * J, gap=gap, frequency=100.0, damping=damping)
    found = fit(UNKNOWN, runs(HEALTHY + hidden, seconds=4.0)[1:])
    candidate = Screen(found.misfit, found.vector).candidate(effects.Backlash)
    assert candidate is not None and candidate.effect.gap == pytest.approx(gap, rel=0.1)
    assert all(abs(math.log(float(e.gap) / gap)) > 0.2 for e in candidate.others)


def test_an_effect_whose_signal_was_not_recorded_is_no_candidate(screened: dict) -> None:
    found, candidates = screened["cogging"]
    assert "load_dependent_friction" in {e.name for e in applicable(found.plant)}
    assert "load_dependent_friction" not in candidates
    assert "load_dependent_friction" not in screened[""][1]
