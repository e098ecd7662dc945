"""The linear model: what the plant can do is projected out, and blocks not seen are those of an explicit refit."""

import numpy as np
import pytest
from bench import J, baseline_fit, runs

from gms_mujoco import effects
from gms_mujoco.fit import fit
from gms_mujoco.frf import FRF
from gms_mujoco.identification.folds import folds
from gms_mujoco.identification.held_out import BLOCK
from gms_mujoco.identification.intervals import block_sums
from gms_mujoco.identification.linear_model import FOLDS, LinearModel, cross_validated
from gms_mujoco.plant import Plant


@pytest.mark.parametrize("name", ["", "cogging", "delay"])
def test_cross_validation_leaves_at_least_what_the_fit_left(name: str) -> None:
    found = baseline_fit(name)
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


def test_what_is_fitted_without_a_rest_has_a_linear_model_too() -> None:
    """Of few points, where unknowns stand for each other and nothing is left to weigh them by."""
    f = np.geomspace(9, 120, 8)
    frf = FRF("few", f, 1 / (0.5 + 1e-2j * 2 * np.pi * f - J * (2 * np.pi * f) ** 2), excitation=1e-3)
    found = fit(Plant.axis(J) + effects.GMS(elements=5) + effects.Viscous(), [frf])
    model = LinearModel(found.misfit, found.vector, np.zeros(16))
    assert model.prior > 0 and np.isfinite(model.target).all() and np.isfinite(model.held_out()).all()


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
    fold = folds(len(lengths), FOLDS)
    for left_out in range(FOLDS):
        rest = fold[block] != left_out
        a = np.vstack([columns[rest], prior])
        b = np.append(residual[rest], np.zeros(len(prior)))
        left = residual - columns @ np.linalg.lstsq(a, b, rcond=None)[0]
        for k in np.flatnonzero(fold == left_out):
            expected[k] = (left[block == k] ** 2).sum()
    np.testing.assert_allclose(got, expected, rtol=1e-3)
