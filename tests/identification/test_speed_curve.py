"""Friction that changes with something else than speed is told from friction that is any function of speed."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.diagnosis.judgement import Trial
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.trials import _beyond_speed, p_beside
from gms_mujoco.fit import fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.held_out import HeldOut, p_value
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.speed_curve import curve
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

J, FC, DRAG, C = 0.5, 1.0, 0.2, 0.3
H, SPEED, OMEGA = 0.01, 1.0, 2 * np.pi * 0.2


def _record(load: str) -> Record:
    """One sine, whose friction grows with a load: of the axis's inertia, or of a weight that is changed twice."""
    t = np.arange(3000) * H
    middle = t + H / 2  # the drive holds its torque for a sample
    v, a = SPEED * np.cos(OMEGA * middle), -SPEED * OMEGA * np.sin(OMEGA * middle)
    carried = J * a if load == "inertia" else np.floor(t / 10)
    torque = J * a + DRAG * v + FC * np.sign(v) * (1 + C * np.abs(carried))
    torque += 0.01 * np.random.default_rng(0).standard_normal(len(t))
    return Record(load, t, {"torque": torque, "position": SPEED / OMEGA * np.sin(OMEGA * t), "load": carried})


@pytest.mark.parametrize(("load", "told"), [("inertia", False), ("weight", True)])
def test_load_dependence_is_told_where_the_load_differs_at_the_same_speed(load: str, told: bool) -> None:
    plant = Plant.axis(None) + effects.Coulomb(coulomb=FC) + effects.Viscous(coefficient=DRAG)
    search = Search(observe([_record(load)], None), [], plant)
    search.first(lambda done, message: None)
    name = "load_dependent_friction"
    first = search.steps[-1].result
    result = fit_observations(first.plant + effects.LoadDependentFriction(coefficient=0.1), search.seen)
    assert result.plant[name].coefficient == pytest.approx(C, rel=0.1) and result.error < 0.5 * first.error
    trial = Trial(name, result, cross_validated(result.misfit, result.vector))
    p = _beyond_speed(first, search.held_out, trial)
    assert p < 1e-4 if told else p > 0.05


def test_a_curve_that_predicts_worse_than_none_is_nothing_to_beat(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = Plant.axis(None) + effects.Coulomb(coulomb=FC) + effects.Viscous(coefficient=DRAG)
    search = Search(observe([_record("weight")], None), [], plant)
    search.first(lambda done, message: None)
    first = search.steps[-1].result
    result = fit_observations(first.plant + effects.LoadDependentFriction(coefficient=0.1), search.seen)
    trial = Trial("load_dependent_friction", result, cross_validated(result.misfit, result.vector))
    rng = np.random.default_rng(0)

    def overfitted(fitted: FitResult) -> HeldOut:
        left = search.held_out if fitted is first else trial.held_out
        return HeldOut(left.rows + rng.normal(0, 5 * FC, len(left.rows)), left.observations)

    monkeypatch.setattr("gms_mujoco.diagnosis.trials.with_curve", overfitted)
    assert p_beside(first, search.held_out, trial) == p_value(search.held_out, trial.held_out) < 1e-4


def test_the_curve_holds_every_level_over_speed() -> None:
    """The hats add up to the friction of the plant."""
    plant = Plant.axis(J) + effects.Coulomb(coulomb=FC) + effects.Viscous(coefficient=DRAG)
    seen = observe([_record("weight")], J)
    alone = Plant.axis(J) + effects.Coulomb(coulomb=FC)
    assert np.allclose(curve(plant, seen).sum(1), seen[0].replay(alone), atol=1e-12)
