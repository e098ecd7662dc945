"""Placement: elements in the wrong places find the right ones, and those in the right places stay."""

import numpy as np
import pytest
from bench import LEVEL, J, runs

from gms_mujoco import effects
from gms_mujoco.identification.least_squares import solve
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.placement import parted, placed, placed_anew
from gms_mujoco.identification.starts import LONGEST_BREAK_AWAY, longest_break_away
from gms_mujoco.plant import Plant

DISTANCE = np.array([2e-3, 4e-3, 12e-3, 24e-3])
LAW = {"coulomb": LEVEL, "static": 1.1 * LEVEL, "stribeck_velocity": 0.5, "attraction": 0.5}


def axis(distance: np.ndarray, share: np.ndarray) -> Plant:
    gms = effects.GMS(stiffness=share * LEVEL / distance, fraction=share, **LAW)
    return Plant.axis(J) + gms + effects.Viscous(coefficient=1e-5)


TRUE = axis(DISTANCE, np.array([0.3, 0.25, 0.25, 0.2]))
# Two stand where there is one, and one where there are two.
WRONG = axis(np.array([1.9e-3, 2.1e-3, 4e-3, 17e-3]), np.array([0.15, 0.15, 0.25, 0.45]))


def solved(plant: Plant, seconds: float = 2.0, true: Plant = TRUE) -> tuple[Misfit, np.ndarray]:
    misfit = Misfit(plant, observe(runs(true, seconds=seconds), J))
    return misfit, solve(misfit, misfit.settle(misfit.vector(plant)))


def distances(misfit: Misfit, x: np.ndarray) -> np.ndarray:
    gms = misfit.coordinates.decode(x[: misfit.coordinates.size])["gms"]
    return np.sort(gms.fraction * np.asarray(gms.coulomb) / gms.stiffness)


def test_two_elements_of_a_kind_become_one_and_the_one_between_two_is_parted() -> None:
    misfit, x = solved(WRONG)
    best, at_best = solved(TRUE)
    least = best.cost(at_best)
    assert misfit.cost(x) > 3 * least
    better, y = placed(misfit, x)
    y = solve(better, y)
    assert better.cost(y) < 1.2 * least
    np.testing.assert_allclose(distances(better, y), DISTANCE, rtol=0.1)


def test_elements_that_stand_a_little_wrong_all_over_are_placed_anew() -> None:
    """No element parted and no two made one leave less: where each slips stands between it and a better place."""
    misfit, x = solved(axis(np.array([1e-3, 1.2e-3, 1.5e-3, 2e-3]), np.full(4, 0.25)))
    best, at_best = solved(TRUE)
    least = best.cost(at_best)
    assert misfit.cost(x) > 3 * least
    assert placed(misfit, x) == (misfit, x)
    anew = placed_anew(misfit, x)
    assert anew is not None
    y = solve(*anew)
    assert anew[0].cost(y) < 1.2 * least
    np.testing.assert_allclose(distances(anew[0], y), DISTANCE, rtol=0.01)


def test_elements_in_the_right_places_stay() -> None:
    misfit, x = solved(TRUE)
    assert placed(misfit, x) == (misfit, x)
    assert placed_anew(misfit, x) is None


@pytest.mark.parametrize("fixed", ["gms.stiffness", "gms.fraction"])
def test_what_is_fixed_stays(fixed: str) -> None:
    misfit = Misfit(WRONG, observe(runs(TRUE, seconds=0.5), J), [fixed])
    x = misfit.vector(WRONG)
    assert placed(misfit, x, [fixed]) == (misfit, x)
    assert placed_anew(misfit, x, [fixed]) is None
    few = Plant.axis(J) + effects.GMS(stiffness=[1.0, 0.1], fraction=[0.5, 0.5], **LAW)
    misfit = Misfit(few, misfit.observations)
    assert placed(misfit, x := misfit.vector(few)) == (misfit, x)


def test_elements_alone_do_to_the_residual_what_they_do_together() -> None:
    misfit, x = solved(WRONG, 0.5)
    x[misfit.n_common :] = np.linspace(-0.8, 0.8, misfit.size - misfit.n_common)
    each = misfit.of_elements(x, WRONG["gms"], np.arange(4))
    without = Misfit(WRONG.without("gms"), misfit.observations)
    plant = WRONG.without("gms")
    rest = without.residual(without.vector(plant, None, misfit.skew(x)))
    here = misfit.vector(WRONG, misfit.memories(x, misfit.n_memory), misfit.skew(x))
    np.testing.assert_allclose(rest + each.sum(0), misfit.residual(here), atol=1e-3 * LEVEL)


def test_an_element_that_stands_for_two_is_parted_into_them() -> None:
    """Three elements where the axis has four: one more, and the torque is right; a fifth has nothing to bring."""
    few = axis(np.array([2.8e-3, 12e-3, 24e-3]), np.array([0.55, 0.25, 0.2]))
    misfit, x = solved(few)
    best, at_best = solved(TRUE)
    least, cost = best.cost(at_best), misfit.cost(x)
    assert cost > 2 * least
    more = parted(misfit, x, 0.1 * (cost - least))
    assert more is not None
    better, y = more
    y = solve(better, y)
    assert better.cost(y) < 1.2 * least
    np.testing.assert_allclose(distances(better, y), DISTANCE, rtol=0.1)
    assert parted(better, y, 0.1 * better.cost(y)) is None


def test_an_element_that_hardly_slips_is_not_parted_into_springs() -> None:
    """Halves of halves, each as much softer, took the place of a spring that nobody had named yet."""
    seen = observe(runs(TRUE + effects.Spring(stiffness=0.05), seconds=2.0), J)
    soft = axis(np.array([2e-3, 4e-3, 12e-3, 50e-3]), np.array([0.3, 0.25, 0.25, 0.2]))
    misfit = Misfit(soft, seen)
    x = solve(misfit, misfit.settle(misfit.vector(soft)))
    assert distances(misfit, x)[-1] > 1  # rad: what little of the spring a fit can do with one
    assert placed(misfit, x) == (misfit, x)
    assert placed_anew(misfit, x) is None
    assert parted(misfit, x, 0.02 * misfit.cost(x)) is None


def test_what_hardly_slips_does_not_say_how_late_elements_may_slip() -> None:
    seen = observe(runs(TRUE, seconds=0.5), J)
    level = np.array([0.4, 0.4, 0.2])
    usual = longest_break_away(np.array([2e-3, 4e-3, 12e-3]), level, seen)
    assert usual == pytest.approx(LONGEST_BREAK_AWAY * 4e-3)
    distance = np.array([2e-3, 4e-3, 12e-3, 1e3])
    assert longest_break_away(distance, np.append(level, 9.0), seen) == pytest.approx(usual)
    assert longest_break_away(distance[3:], level[:1], seen) == pytest.approx(LONGEST_BREAK_AWAY * 1e3)


def test_a_contact_that_gives_way_bit_by_bit_gets_many_elements_at_once() -> None:
    smooth = axis(np.geomspace(1e-3, 40e-3, 40), np.full(40, 1 / 40))
    misfit, x = solved(WRONG, true=smooth)
    found = placed_anew(misfit, x, most=16)
    assert found is not None
    more, y = found
    assert 4 < len(distances(more, y)) <= 16
    assert more.cost(solve(more, y)) < 0.1 * misfit.cost(x)


def test_a_contact_of_a_few_elements_gets_no_more() -> None:
    assert placed_anew(*solved(TRUE), most=16) is None
