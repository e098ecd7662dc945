"""Misfit: derivatives that are looked at where a change acts alone are those of the whole residual."""

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, rms, runs

from gms_mujoco import effects, threads
from gms_mujoco.identification.least_squares import _normal
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant

MANY = (
    Plant(J, HEALTHY.effects, inertia_known=False)
    + effects.find("cogging")(harmonics=[6, 9], amplitude=[0.1 * LEVEL, 0.05 * LEVEL], phase=[0.4, 1.0])
    + effects.find("asymmetric_friction")(level=0.1)
    + effects.find("flexible_coupling")(inertia=0.1 * J, frequency=60.0, damping=0.1)
    + effects.find("delay")(time=1e-3)
    + effects.find("encoder_eccentricity")(amplitude=1e-3, phase=0.3)
)


@pytest.fixture(scope="module")
def problem() -> tuple[Misfit, np.ndarray, np.ndarray]:
    misfit = Misfit(MANY, observe(runs(HEALTHY, seconds=1.5), J))
    x = misfit.vector(MANY)
    x[misfit.n_common :] = np.linspace(-0.8, 0.8, misfit.size - misfit.n_common)
    return misfit, x, misfit.jacobian(x)


def test_a_residual_is_worked_out_once(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    """Of the same problem; a coarse look at it is another, and nobody writes to what is kept."""
    misfit, x, _ = problem
    r = misfit.residual(x)
    assert misfit.residual(x.copy()) is r and misfit.with_steps(x, 1.0).residual(x) is r
    assert not np.array_equal(misfit.coarsely().residual(x), r) and not r.flags.writeable
    assert np.array_equal(Misfit(MANY, misfit.observations).residual(x), r)


def test_what_no_fit_frees_may_be_an_unknown(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    misfit, x, _ = problem
    freed, there = misfit.onto(MANY, x, freed=["gms.stribeck_exponent"])
    assert set(freed.coordinates.labels) - set(misfit.coordinates.labels) == {"gms.stribeck_exponent"}
    assert np.array_equal(freed.residual(there), misfit.residual(x))
    column = freed.coordinates.labels.index("gms.stribeck_exponent")
    assert rms(freed.jacobian(there)[:, column]) > 0


def _on_one_grid(misfit: Misfit, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The residual at `at`, all effects together, at the instants that `x` asks for."""
    plant, here = (misfit.coordinates.decode(v[: misfit.coordinates.size]) for v in (at, x))
    parts = []
    for i, o in enumerate(misfit.observations):
        grid = o.grid(here, misfit.memory(x, i))
        parts.append(o.applied(plant, misfit.skew(at)) - o.needed(plant, misfit.memory(at, i), grid))
    return np.concatenate(parts)


def test_derivatives_are_those_of_the_whole_residual(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    misfit, x, jacobian = problem
    labels = [*misfit.coordinates.labels, *["skew"] * misfit.n_skew]
    labels += ["state"] * (misfit.size - len(labels))
    for column, label in enumerate(labels):
        linear = label in misfit.coordinates.labels and misfit.coordinates.is_linear[column]
        step = 1e-6 if label == "skew" else 1e-3 * (abs(x[column]) or 1e-3 * LEVEL if linear else 1.0)
        there = x.copy()
        there[column] += step
        slope = (_on_one_grid(misfit, x, there) - _on_one_grid(misfit, x, x)) / step
        # Where an element just slips or just does not its torque jumps, and the derivative keeps out of that.
        assert np.quantile(np.abs(jacobian[:, column] - slope), 0.9) <= 0.02 * rms(slope), label


@pytest.mark.parametrize("records", [1, 2])
def test_derivatives_are_the_same_to_the_last_bit_however_they_are_shared_out(
    records: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    misfit = Misfit(MANY, observe(runs(HEALTHY, seconds=1.5)[:records], J))
    x = misfit.vector(MANY)
    made = []
    for n in ("1", "3"):
        monkeypatch.setenv(threads.VARIABLE, n)
        made.append(misfit.jacobian(x))
    assert made[0].any()
    np.testing.assert_array_equal(*made)


def test_only_the_columns_asked_for_are_made(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    misfit, x, jacobian = problem
    some = np.array([0, 3, misfit.n_common, misfit.size - 1])
    made = misfit.jacobian(x, some)
    np.testing.assert_array_equal(made[:, some], jacobian[:, some])
    assert not np.delete(made, some, 1).any()


@pytest.mark.parametrize("name", ["spring", "asymmetric_friction", "delay", "encoder_eccentricity", "backlash"])
def test_the_change_by_an_added_effect_is_that_of_the_whole(name: str) -> None:
    values = {
        "spring": {"stiffness": 0.1 * LEVEL}, "asymmetric_friction": {"level": 0.2}, "delay": {"time": 1e-3},
        "encoder_eccentricity": {"amplitude": 1e-3, "phase": 0.5},
        "backlash": {"inertia": 0.2 * J, "gap": 4e-3, "frequency": 80.0, "damping": 1.0},
    }  # fmt: skip
    misfit = Misfit(HEALTHY, observe(runs(HEALTHY, seconds=1.5), J))
    x = misfit.vector(HEALTHY)
    there = HEALTHY + effects.find(name)(**values[name])
    moved = Misfit(there, misfit.observations)
    whole = moved.residual(moved.vector(there)) - misfit.residual(x)
    assert rms(misfit.change(x, there, name) - whole) < 0.02 * rms(whole)


@pytest.mark.parametrize("effect", [e for e in effects.CATALOGUE.values() if e.separable], ids=lambda e: e.name)
def test_the_elements_of_a_separable_effect_add_up_to_it(effect: type) -> None:
    joint = (Plant.axis(J) + HEALTHY[effect.name]).joint()
    o = observe(runs(HEALTHY, seconds=1.0), J)[1]
    motion = o.record.time, o.position, o.velocity
    memory = np.linspace(-1, 1, joint.n_memory)
    parts, torque = joint.elements(0, *motion, memory=memory), joint.replay(*motion, memory=memory).torque
    assert parts.shape == (len(torque), HEALTHY[effect.name].elements)
    np.testing.assert_allclose(parts.sum(1), torque, atol=1e-12 * LEVEL)
    other = joint.elements(0, *motion, memory=np.append(memory[0], -memory[1:]))
    np.testing.assert_array_equal(other[:, 0], parts[:, 0])  # none knows of the others


def test_no_plant_has_more_behind_a_coupling_than_its_inertia(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    misfit, *_ = problem
    coupling = MANY["flexible_coupling"]
    impossible = misfit.vector(MANY.replace(coupling.replace(inertia=1.01 * J)))
    assert misfit.cost(impossible) > 1e5 * misfit.cost(misfit.vector(MANY.replace(coupling.replace(inertia=0.99 * J))))


def test_weak_effects_that_are_looked_at_together_change_what_each_does_alone() -> None:
    misfit = Misfit(HEALTHY, observe(runs(HEALTHY, seconds=1.5), J))
    x, size = misfit.vector(HEALTHY), 1e-3 * LEVEL
    for made in (
        lambda k: effects.find("cogging")(harmonics=[5 + k], amplitude=[k * size], phase=[0.3]),
        lambda k: effects.find("position_dependent_friction")(harmonics=[5 + k], amplitude=[1e-3 * k], phase=[0.3]),
        lambda k: effects.find("asymmetric_friction")(level=1e-3 * k),
        lambda k: effects.find("torque_offset")(torque=k * size),
    ):
        name, (without, *there) = made(0).name, [HEALTHY + made(k) for k in range(3)]
        alone = np.stack([misfit.change(x, plant, name) for plant in there], 1)
        assert rms(misfit.changes(x, without, there, name) - alone) < 1e-3 * rms(alone), name


def test_a_step_of_least_squares_is_that_of_all_rows(problem: tuple[Misfit, np.ndarray, np.ndarray]) -> None:
    """Although the rows of a record are worked on without the states before others."""
    misfit, x, jacobian = problem
    r = misfit.residual(x)
    for columns in (np.arange(misfit.size), np.arange(3, misfit.n_common), np.array([0, 4, misfit.size - 2])):
        normal, gradient = _normal(misfit, jacobian, r, columns)
        some = jacobian[:, columns]
        np.testing.assert_allclose(normal, some.T @ some, rtol=1e-9, atol=1e-12 * np.abs(normal).max())
        np.testing.assert_allclose(gradient, some.T @ r, rtol=1e-9, atol=1e-12 * np.abs(gradient).max())
