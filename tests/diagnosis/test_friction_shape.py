"""The shape of a plant's own friction, where a fit does not find it."""

import numpy as np
import pytest
from bench import GMS, HEALTHY, LEVEL, J, fitted_sticking, runs, slow

from gms_mujoco import effects
from gms_mujoco.diagnosis.friction_shape import (
    by_the_letter,
    elastic_bristle,
    fading_damping,
    following,
    later_elements,
    more_elements,
    other_curve,
    other_kind,
    spring_instead,
    turning_round,
    with_exponents,
    with_many_elements,
    without_vanished,
)
from gms_mujoco.diagnosis.judgement import at_floor
from gms_mujoco.effect import Effect
from gms_mujoco.fit import baseline, fit_as_logged, fit_observations
from gms_mujoco.fit_result import FitResult, result_of
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import finished, fit_to_end, refine
from gms_mujoco.identification.screen import Screen
from gms_mujoco.identification.starts import is_softest
from gms_mujoco.plant import Plant


def test_beside_friction_that_follows_its_level_what_modulates_it_is_seen() -> None:
    """Elements that keep their forces while they slide follow no level, of the place or of anything else."""
    hidden = effects.PositionDependentFriction(harmonics=[3], amplitude=[0.3], phase=[0.5])
    seen = observe(runs(HEALTHY + hidden)[2:], J)  # turning
    kept = HEALTHY.replace(GMS.replace(attraction=0.01 * LEVEL))
    misfit = Misfit(kept, seen, fixed=["gms.attraction"])
    slow = fit_to_end(misfit, misfit.vector(kept))
    near = following(slow)
    assert near is not None and near.plant["gms"].attraction > 20 * LEVEL
    before, after = (Screen(r.misfit, r.vector).candidate(type(hidden)) for r in (slow, near))
    assert before is not None and after is not None
    assert after.gain > 0.5 > 0.3 > before.gain and np.ravel(after.effect.harmonics)[0] == 3
    for plant in (HEALTHY.replace(GMS.replace(attraction=500 * LEVEL)), HEALTHY.without("gms")):
        misfit = Misfit(plant, seen, fixed=["gms.attraction"])
        assert following(refine(misfit, misfit.vector(plant), 1)) is None


@pytest.mark.parametrize("exponent", [0.75, *slow(1.4)])
def test_an_exponent_between_the_usual_ones_is_found(exponent: float) -> None:
    """With it the levels come out right, and none is better still."""
    law = GMS.replace(static=2 * LEVEL, stribeck_velocity=1.5)
    true = HEALTHY.replace(law.replace(stribeck_exponent=exponent))
    seen = observe(runs(true, seconds=6.0, seed=2, torque_noise=2e-6), J)
    misfit = Misfit(HEALTHY.replace(law), seen)
    before = refine(misfit, misfit.vector(true))
    found, left = other_curve(before, cross_validated(before.misfit, before.vector))
    assert found.plant["gms"].stribeck_exponent == pytest.approx(exponent, rel=0.03)
    assert found.plant["gms"].coulomb == pytest.approx(LEVEL, rel=0.002)
    assert found.plant["gms"].static == pytest.approx(2 * LEVEL, rel=0.02)
    assert found.error < 0.3 * before.error and other_curve(found, left)[0] is found
    assert with_exponents(before, HEALTHY) is before
    low, high = finished(with_exponents(found, HEALTHY)).plant.uncertainty["gms.stribeck_exponent"]
    assert low < exponent < high < 1.1 * low


def test_a_gaussian_curve_is_found_where_no_step_from_an_exponential_one_leads_to_it() -> None:
    law = GMS.replace(static=2 * LEVEL, stribeck_velocity=1.5)
    true = HEALTHY.replace(law.replace(stribeck_exponent=2.0))
    misfit = Misfit(HEALTHY.replace(law), observe(runs(true, seconds=6.0, seed=2, torque_noise=2e-6), J))
    before = refine(misfit, misfit.vector(true))
    found, _ = other_curve(before, cross_validated(before.misfit, before.vector))
    assert found.plant["gms"].stribeck_exponent == pytest.approx(2.0, abs=0.1)
    assert found.error < 0.15 * before.error


def test_a_curve_with_a_tail_is_found_from_an_exponential_one() -> None:
    law = GMS.replace(static=2 * LEVEL, stribeck_velocity=0.5)
    true = HEALTHY.replace(law.replace(stribeck_exponent=2.0, stribeck_tail=1.0))
    misfit = Misfit(HEALTHY.replace(law), observe(runs(true, seconds=6.0, seed=2, torque_noise=2e-6), J))
    before = refine(misfit, misfit.vector(true))
    found, left = other_curve(before, cross_validated(before.misfit, before.vector))
    assert found.plant["gms"].stribeck_tail == 1.0
    assert found.plant["gms"].stribeck_exponent == pytest.approx(2.0, abs=0.05)
    assert found.plant["gms"].static == pytest.approx(2 * LEVEL, rel=0.02)
    assert found.error < 0.3 * before.error and other_kind(found, left)[0] is found


@pytest.mark.parametrize("exponent", [0.5, 1.8])
def test_the_exponent_by_which_a_law_turns_round_is_found_from_the_usual_one(exponent: float) -> None:
    bare = Plant.axis(J) + effects.Viscous(coefficient=2e-5)
    seen = observe(runs(bare + effects.Dahl(stiffness=2.0, coulomb=LEVEL, exponent=exponent), torque_noise=2e-6), J)
    usual = bare + effects.Dahl(stiffness=2.0, coulomb=LEVEL)
    misfit = Misfit(usual, seen)
    x = misfit.vector(usual)
    near, there = turning_round(misfit, x, "dahl", 0.0)
    assert near.plant(there)["dahl"].exponent == pytest.approx(exponent, rel=0.02)
    assert near.cost(there) < 0.02 * misfit.cost(x)
    assert near.coordinates.labels == misfit.coordinates.labels  # and is no unknown


def test_a_contact_that_gives_way_bit_by_bit_comes_down_to_the_noise_floor() -> None:
    """As Iwan's, of which no few elements are any likeness."""
    share = np.full(40, 1 / 40)
    smooth = HEALTHY.replace(effects.GMS(
        stiffness=share * LEVEL / np.geomspace(1e-3, 40e-3, 40), fraction=share, coulomb=LEVEL, static=LEVEL,
        stribeck_velocity=1.0, attraction=500 * LEVEL,
    ))  # fmt: skip
    seen = observe(runs(smooth, seconds=4.0, torque_noise=1e-6), J)
    before = fit_as_logged(baseline(J, elements=4), seen)
    found, left = more_elements(before, cross_validated(before.misfit, before.vector))
    assert found.error < 0.2 * before.error and at_floor(found, left)
    assert 4 < found.plant["gms"].elements <= 16
    ended = with_many_elements(before)
    assert ended.error < 0.3 * before.error and 4 < ended.plant["gms"].elements <= 16


def test_friction_at_the_noise_gets_no_more_elements_at_the_end() -> None:
    found = fit_as_logged(baseline(J, elements=2), observe(runs(HEALTHY, seed=4), J))
    assert found.is_near_floor and with_many_elements(found) is found


def test_an_exponent_stays_where_a_curve_is_one() -> None:
    """What a curve cannot explain, as here a drag, sends it as far as it may go and no further."""
    law = GMS.replace(static=1.6 * LEVEL, stribeck_velocity=1.5, stribeck_exponent=0.75)
    true = HEALTHY.replace(law) + effects.QuadraticDrag(coefficient=0.02 * LEVEL / 20**2)
    seen = observe(runs(true, seconds=4.0, seed=3, torque_noise=1e-5), J)
    before = fit_as_logged(baseline(J), seen)
    found, _ = other_curve(before, cross_validated(before.misfit, before.vector))
    assert 0.25 <= found.plant["gms"].stribeck_exponent <= 4 and found.error <= before.error


def test_a_log_made_by_the_letter_of_the_switching_law_is_fitted_by_it() -> None:
    """Its moments, each from one reversal to the next, are explained by elements that slip back."""
    law = GMS.replace(static=1.4 * LEVEL)
    before = fitted_sticking(HEALTHY.replace(law.replace(slips_back=1.0)), 3)
    found, left = by_the_letter(before, cross_validated(before.misfit, before.vector))
    assert found.plant["gms"].slips_back == 1 and found.error < 0.5 * before.error
    assert left.total < 0.3 * before.misfit.cost(before.vector)
    healthy = fitted_sticking(HEALTHY.replace(law), 3)
    assert by_the_letter(healthy, cross_validated(healthy.misfit, healthy.vector))[0] is healthy


def test_a_bristle_whose_damping_fades_is_found_to_where_it_does() -> None:
    law = effects.LuGre(
        stiffness=2.0, damping=3e-3, coulomb=LEVEL, static=1.4 * LEVEL, stribeck_velocity=1.0, damping_velocity=0.8
    )
    stays = law.replace(damping=1e-3, damping_velocity=0.0)

    def fitted(true: Effect) -> FitResult:
        plant = Plant.axis(J) + effects.LuGre() + effects.Viscous()
        return fit_as_logged(plant, observe(runs(Plant.axis(J) + true + effects.Viscous(coefficient=2e-5)), J))

    before = fitted(law)
    found, left = fading_damping(before, cross_validated(before.misfit, before.vector))
    assert found.error < 0.7 * before.error and found.error < 1.1 * found.floor
    assert found.plant["lugre"].damping_velocity == pytest.approx(0.8, rel=0.1)
    assert found.plant["lugre"].damping == pytest.approx(3e-3, rel=0.1)
    assert fading_damping(found, left)[0] is found
    healthy = fitted(stays)
    assert fading_damping(healthy, cross_validated(healthy.misfit, healthy.vector))[0] is healthy


def test_a_bristle_that_only_bends_is_found_with_its_share() -> None:
    law = effects.LuGre(stiffness=2.0, damping=1e-3, coulomb=LEVEL, static=1.2 * LEVEL, stribeck_velocity=1.0)

    def fitted(true: Effect) -> FitResult:
        plant = Plant.axis(J) + effects.LuGre() + effects.Viscous()
        return fit_as_logged(plant, observe(runs(Plant.axis(J) + true + effects.Viscous(coefficient=2e-5)), J))

    before = fitted(law.replace(elastic=0.7))
    found, left = elastic_bristle(before, cross_validated(before.misfit, before.vector))
    assert found.error < 0.7 * before.error and found.error < 1.1 * found.floor
    assert found.plant["lugre"].elastic == pytest.approx(0.7, abs=0.02)
    assert found.plant["lugre"].stiffness == pytest.approx(2.0, rel=0.03)
    assert elastic_bristle(found, left)[0] is found
    healthy = fitted(law)
    assert elastic_bristle(healthy, cross_validated(healthy.misfit, healthy.vector))[0] is healthy


def test_elements_that_have_come_to_nothing_are_left_out() -> None:
    """They stay where something would be lost."""
    law = HEALTHY["gms"]
    more = law.replace(stiffness=[*law.stiffness, 1e6], fraction=[*(0.99999 * np.array(law.fraction)), 1e-5])
    misfit = Misfit(HEALTHY.replace(more), observe(runs(HEALTHY), J))
    found = result_of(misfit, misfit.vector(HEALTHY.replace(more)))
    less = without_vanished(found)
    assert less.plant["gms"].elements == 2 and sum(less.plant["gms"].fraction) == pytest.approx(1)
    assert less.error <= 1.001 * found.error
    assert without_vanished(less) is less


def test_the_other_usual_curve_is_taken_at_the_noise_floor_where_it_is_the_right_one() -> None:
    """A Gaussian one in the place of an exponential one had left no more than noise, and a sixth too little of how
    strong friction is at rest."""
    true = HEALTHY.replace(HEALTHY["gms"].replace(static=1.6 * LEVEL))
    seen = observe(runs(true, torque_noise=1e-4), J)

    def fitted(exponent: float) -> FitResult:
        return fit_observations(Plant.axis(J) + effects.GMS(2, stribeck_exponent=exponent) + effects.Viscous(), seen)

    wrong, right = fitted(2.0), fitted(1.0)
    left = cross_validated(wrong.misfit, wrong.vector)
    assert at_floor(wrong, left, 1.15) and wrong.plant["gms"].static < 1.4 * LEVEL
    found, _ = other_kind(wrong, left)
    assert found.plant["gms"].stribeck_exponent == 1.0
    assert found.plant["gms"].static == pytest.approx(1.6 * LEVEL, rel=0.03)
    assert other_kind(right, cross_validated(right.misfit, right.vector))[0] is right


@pytest.mark.parametrize("stiffness", [0.3 * LEVEL, 3 * LEVEL])
def test_an_element_that_slips_late_stands_for_no_spring(stiffness: float) -> None:
    """It would slip later, and later again, without leaving much less."""
    hidden = fit_observations(baseline(J), observe(runs(HEALTHY + effects.Spring(stiffness=stiffness)), J))
    assert is_softest(hidden.plant["gms"], hidden.misfit.observations)
    assert later_elements(hidden, cross_validated(hidden.misfit, hidden.vector))[0] is hidden


def test_a_spring_is_tried_in_the_place_of_elements_that_slip_in_no_record() -> None:
    """They hold another torque as each record begins, wherever that is, and hide one spring in all of them."""
    stiffness, law = 0.5 * LEVEL, HEALTHY["gms"]
    records = runs(HEALTHY + effects.Spring(stiffness=stiffness))
    more = law.replace(
        stiffness=[*law.stiffness, stiffness], fraction=[*(0.02 * np.array(law.fraction)), 0.98],
        coulomb=50 * law.coulomb, static=50 * law.static,
    )  # fmt: skip
    hiding = HEALTHY.replace(more)
    misfit = Misfit(hiding, observe(records, J))
    hidden = refine(misfit, misfit.vector(hiding))
    begun = spring_instead(hidden)
    assert begun is not None and begun[0].size < misfit.size
    found = refine(*begun)
    assert found.plant["spring"].stiffness == pytest.approx(stiffness, rel=0.02)
    assert found.plant["gms"].coulomb == pytest.approx(LEVEL, rel=0.05) and found.error < 1.2 * found.floor
    assert spring_instead(found) is None and spring_instead(fit_as_logged(HEALTHY, misfit.observations)) is None


def test_a_spring_is_tried_in_the_place_of_an_element_that_slips_late() -> None:
    """One that slips over the second half of a way alone has stood for a spring over the first."""
    stiffness, law = 0.5 * LEVEL, HEALTHY["gms"]
    seen = observe(runs(HEALTHY + effects.Spring(stiffness=stiffness)), J)
    way = 0.3 * max(float(np.ptp(o.position)) for o in seen)
    whole = LEVEL + stiffness * way
    fraction = [*(LEVEL / whole * np.array(law.fraction)), stiffness * way / whole]
    more = law.replace(stiffness=[*law.stiffness, stiffness], fraction=fraction, coulomb=whole, static=whole)
    misfit = Misfit(HEALTHY.replace(more), seen)
    hidden = refine(misfit, misfit.vector(HEALTHY.replace(more)))
    begun = spring_instead(hidden)
    assert begun is not None
    found = refine(*begun)
    assert found.plant["spring"].stiffness == pytest.approx(stiffness, rel=0.02)
    assert found.error < 1.2 * found.floor < hidden.error
