"""Rough fits that begin where no tangent leads."""

import pytest
from bench import GMS, HEALTHY, LEVEL, UNKNOWN, J, runs

from gms_mujoco import effects
from gms_mujoco.diagnosis.judgement import left_of
from gms_mujoco.diagnosis.openings import afresh, beside_straight
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.diagnosis.steps import Step
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.identification.scales import Scales
from gms_mujoco.identification.screen import Screen
from gms_mujoco.progress import silent


def test_from_the_beginning_an_effect_is_tried_however_little_it_promised() -> None:
    """Friction has bent to hide it; and what leaves no less is not looked at further."""
    drag = effects.QuadraticDrag(coefficient=0.3 * LEVEL / 30**2)
    search = Search(observe(runs(HEALTHY + drag, seconds=1.0), J), [], UNKNOWN)
    search.first(silent)
    now = search.steps[0].result
    names = ("gravity", "cogging", "spring", "quadratic_drag")
    screen = Screen(now.misfit, now.vector)
    found = afresh(now, search.fits, [c for n in names if (c := screen.candidate(effects.find(n)))])
    assert "quadratic_drag" in [name for name, *_ in found]
    assert all(left_of(misfit, x) < left_of(now.misfit, now.vector) for _, misfit, x in found)


def test_a_drag_is_tried_beside_another_curve_than_one_that_has_bent_to_stand_for_it() -> None:
    """Beside a curve that falls at slow speed it leaves less than beside one that falls over all; else nothing is."""
    law, drag = GMS.replace(static=1.02 * LEVEL), effects.QuadraticDrag(coefficient=0.1 * LEVEL / 20**2)
    seen = observe(runs(HEALTHY.replace(law) + drag), J)
    bent = HEALTHY.replace(law.replace(static=3 * LEVEL, stribeck_velocity=Scales.of(seen)["rad/s"]))
    search = Search(seen, [], HEALTHY)
    for plant, tried in ((HEALTHY, False), (bent + drag, False), (bent, True)):
        near = Misfit(plant, seen, fixed=["gms.stribeck_velocity"])
        now = refine(near, near.vector(plant))
        search.steps = [Step(None, now)]
        found = beside_straight(now, search.fits, search._addable)
        assert [name for name, *_ in found] == ["quadratic_drag"] * tried
        for _, misfit, x in found:
            assert left_of(misfit, x) < 0.1 * left_of(now.misfit, now.vector)
            assert misfit.plant(x)["quadratic_drag"].coefficient == pytest.approx(drag.coefficient, rel=0.02)
    search.false.add("quadratic_drag")
    assert not beside_straight(now, search.fits, search._addable)


def test_a_drag_is_tried_beside_the_usual_exponent_of_a_curve_that_has_taken_another() -> None:
    """Beside that other one it leaves more, and another coefficient."""
    law, drag = GMS.replace(static=1.4 * LEVEL, stribeck_velocity=3.0), effects.QuadraticDrag(coefficient=1e-6)
    seen = observe(runs(HEALTHY.replace(law) + drag), J)
    other = HEALTHY.replace(law.replace(stribeck_exponent=0.8))
    search, near = Search(seen, [], HEALTHY), Misfit(other, seen, fixed=["gms.stribeck_velocity"])
    now = refine(near, near.vector(other))
    search.steps = [Step(None, now)]
    ((name, misfit, x),) = beside_straight(now, search.fits, search._addable)
    assert name == "quadratic_drag"
    plant = misfit.plant(x)
    assert plant["gms"].stribeck_exponent == 1
    assert plant["quadratic_drag"].coefficient == pytest.approx(drag.coefficient, rel=0.02)
    beside = refine(*now.misfit.onto(now.plant + drag, now.vector))
    assert left_of(misfit, x) < 0.5 * left_of(beside.misfit, beside.vector)
