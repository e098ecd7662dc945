"""Joint fits with one effect more: of a load that rests by its own friction, and of one that glides."""

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, runs

from gms_mujoco import effects
from gms_mujoco.diagnosis.joint_fits import JointFits, rubs
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.screen import Screen

GLIDING = effects.Backlash(inertia=0.5 * J, gap=0.03, frequency=40.0, damping=0.3)
RUBBING = GLIDING.replace(deceleration=0.4 * LEVEL / (0.5 * J))


@pytest.fixture(scope="module", params=[GLIDING, RUBBING], ids=["gliding", "rubbing"])
def tried(request: pytest.FixtureRequest) -> tuple[JointFits, FitResult, effects.Backlash]:
    seen = tuple(observe(runs(HEALTHY + request.param, seed=2), J))
    return JointFits(HEALTHY, seen, frozenset()), fit_observations(HEALTHY, seen), request.param


def test_both_forms_of_a_load_are_tried_from_the_deceleration_that_the_axis_would_have(
    tried: tuple[JointFits, FitResult, effects.Backlash],
) -> None:
    fits, _, _ = tried
    own, other, weak = (form["deceleration"] for form in fits.forms(GLIDING))
    typical = np.sqrt(np.mean([np.mean(o.applied(HEALTHY) ** 2) for o in fits.seen]))
    assert own == 0 < weak < other == pytest.approx(typical / J, rel=0.2)
    assert fits.forms(RUBBING)[1] == {"deceleration": RUBBING.deceleration}


@pytest.mark.slow
def test_a_load_is_found_with_the_friction_that_it_has(tried: tuple[JointFits, FitResult, effects.Backlash]) -> None:
    fits, now, play = tried
    found = Screen(now.misfit, now.vector).candidate(effects.Backlash)
    assert found is not None
    rough = [("backlash", *fits.roughly(now, found))]
    rough += fits.gliding(now, found, rough[0])
    assert len({rubs(misfit.plant(x)["backlash"]) for _, misfit, x in rough}) == len(rough)
    result = fits.leading("backlash", now, rough)
    assert rubs(result.plant["backlash"]) == rubs(play)
    assert result.plant["backlash"].gap == pytest.approx(play.gap, rel=0.05)
    assert result.plant["backlash"].deceleration == pytest.approx(play.deceleration, rel=0.02)
    assert result.error < 0.3 * now.error


@pytest.mark.parametrize("whole", [1.0, 2.0], ids=["by the motion", "by its sign"])
def test_friction_that_leans_as_a_whole_is_found_where_a_level_that_leans_leaves_more(whole: float) -> None:
    seen = tuple(observe(runs(HEALTHY + effects.AsymmetricFriction(level=0.2, whole=whole), seconds=4.0, seed=4), J))
    level = fit_observations(HEALTHY + effects.AsymmetricFriction(level=0.1), seen)
    found = JointFits(HEALTHY, seen, frozenset()).formed("asymmetric_friction", level)
    assert found.plant["asymmetric_friction"].whole == whole
    assert found.plant["asymmetric_friction"].level == pytest.approx(0.2, rel=0.02)
    assert found.error < 0.7 * level.error


PLACE = effects.PositionDependentFriction(harmonics=[3], amplitude=[0.3], phase=[0.5])
HEAT = effects.ThermalDrift(amplitude=-0.5, time_constant=2.0)


@pytest.mark.parametrize(("hidden", "form"), [
    (PLACE, {"whole": 0}), (PLACE, {"whole": 1}), (PLACE, {"whole": 1, "drag": 0}),
    (HEAT, {"whole": 0}), (HEAT, {"whole": 1}),
], ids=lambda x: x.name if isinstance(x, Effect) else str(x))  # fmt: skip
def test_what_multiplies_friction_is_found_with_what_it_multiplies(hidden: Effect, form: dict[str, float]) -> None:
    """The level that contacts reach, or all of the torque, with what they hold at rest, and with drag or without."""
    seen = tuple(observe(runs(HEALTHY + hidden.replace(**form), seconds=4.0, seed=3), J))
    healthy = fit_observations(HEALTHY, seen)
    candidate = Screen(healthy.misfit, healthy.vector).candidate(type(hidden))
    assert candidate is not None
    misfit, x = JointFits(HEALTHY, seen, frozenset()).roughly(healthy, candidate)
    found = misfit.plant(x)[hidden.name].values
    assert {k: found[k] for k in form} == form
