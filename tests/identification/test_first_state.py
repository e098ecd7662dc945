"""The state before a record: what elements held is found again, however late in the record they slip."""

import numpy as np
import pytest
from bench import LEVEL, SAMPLE_TIME, J, rms, run

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.identification.first_state import _opening
from gms_mujoco.identification.least_squares import solve
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant

LAW = effects.GMS(
    stiffness=[0.6, 0.5, 0.2, 0.08, 0.04], fraction=[0.15, 0.25, 0.2, 0.15, 0.25], coulomb=LEVEL, static=1.2 * LEVEL,
    stribeck_velocity=1.0, attraction=0.5,
)  # fmt: skip
PLANT = Plant.axis(J) + LAW + effects.Viscous(coefficient=2e-5)
BEFORE, SECONDS = 1.0, 6.0


def growing(seed: int) -> np.ndarray:
    """(n,) torque [N m]: moves somewhere, comes to rest, and then a sine that grows to where most elements slip."""
    rng = np.random.default_rng(seed)
    t = np.arange(round((BEFORE + SECONDS) / SAMPLE_TIME)) * SAMPLE_TIME - BEFORE
    way = rng.choice([-1, 1]) * rng.uniform(0.8, 1.4) * np.sin(np.pi * np.clip(t + BEFORE, 0, BEFORE) / BEFORE) ** 2
    sine = (0.1 + 0.8 * np.clip(t / SECONDS, 0, 1)) * np.sin(2 * np.pi * rng.uniform(1, 3) * t) * (t > 0)
    return LEVEL * (way + sine)


@pytest.mark.parametrize("hidden", [None, effects.AsymmetricFriction(level=0.3)])
@pytest.mark.parametrize("seed", range(6))
def test_a_record_that_begins_anywhere_is_left_as_one_of_which_all_is_known(seed: int, hidden: Effect | None) -> None:
    """The same motion with what led to it, from where the joint had never moved, says what the true state leaves."""
    plant = PLANT if hidden is None else PLANT + hidden
    whole = run(plant, growing(seed), seed)
    cut = whole.slice(round(BEFORE / SAMPLE_TIME), len(whole))
    (known,), (seen,) = observe([whole], J), observe([cut], J)
    there = known.record.time[known.index] > BEFORE + 0.1
    least = rms((known.applied(plant) - known.needed(plant))[there])
    misfit = Misfit(plant, [seen])
    settled = misfit.settle(misfit.vector(plant))
    x = solve(misfit, settled, columns=np.arange(misfit.n_common, misfit.size))
    assert rms(misfit.residual(x)) < 1.1 * least
    assert rms(misfit.residual(settled)) < 3 * least


@pytest.mark.parametrize("law", [
    LAW.replace(fraction=[0.4, 0.6, 0, 0, 0]), LAW.replace(stiffness=[0.6, 0.5, 0.2, 0.08, 0]),
    LAW.replace(coulomb=0, static=0),
])  # fmt: skip
def test_elements_that_carry_nothing_or_never_slip_are_no_obstacle(law: Effect) -> None:
    (seen,) = observe([run(PLANT, growing(0)).slice(round(BEFORE / SAMPLE_TIME), None)], J)
    misfit = Misfit(PLANT.replace(law), [seen])
    start = misfit.vector(PLANT.replace(law))
    assert misfit.cost(misfit.settle(start)) <= misfit.cost(start)


def test_the_opening_of_a_record_ends_once_every_element_may_have_slipped() -> None:
    (late,) = observe([run(PLANT, growing(0)[round(BEFORE / SAMPLE_TIME) :])], J)
    (soon,) = observe([run(PLANT, 3 * growing(0))], J)
    furthest = 3 * 1.2 * LEVEL * max(np.array(LAW.fraction) / LAW.stiffness)
    assert np.ptp(late.position[: round(2 / SAMPLE_TIME)]) < furthest < np.ptp(soon.position[: round(2 / SAMPLE_TIME)])
    assert len(_opening(soon, PLANT).record) == round(2 / SAMPLE_TIME)
    assert len(_opening(late, PLANT).record) > round(4 / SAMPLE_TIME)
    assert len(_opening(late, Plant.axis(J) + effects.Viscous(coefficient=1e-5)).record) == round(2 / SAMPLE_TIME)
