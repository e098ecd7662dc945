"""A play that is begun again from other contacts: out of fits in which its load knocks at the wrong instants."""

import numpy as np
import pytest
from bench import COUNT, HEALTHY, J, runs

from gms_mujoco import effects
from gms_mujoco.diagnosis import plays
from gms_mujoco.diagnosis.joint_fits import JointFits
from gms_mujoco.diagnosis.plays import from_other_contacts, looked_at, play_of
from gms_mujoco.fit_result import result_of
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.plant import Plant

PLAY = effects.Backlash(inertia=0.4 * J, gap=0.05, frequency=20.0, damping=0.15)
SEEN = observe(runs(HEALTHY + PLAY, seed=1), J)


def _begun(plant: Plant) -> tuple[Misfit, object]:
    misfit = Misfit(plant, SEEN)
    return misfit, misfit.vector(plant)


def test_the_effect_with_a_play_is_found_with_its_width() -> None:
    assert play_of(HEALTHY + effects.FlexibleCoupling(inertia=0.4 * J, frequency=20.0)) is None
    assert play_of(HEALTHY + PLAY) == (PLAY, "gap")


def test_the_plant_that_made_the_records_is_the_first_of_those_looked_at() -> None:
    others = [HEALTHY + PLAY.replace(**{k: v}) for k, v in {"gap": 0.08, "frequency": 60.0, "damping": 0.9}.items()]
    found = looked_at(*_begun(HEALTHY + PLAY), [*others, HEALTHY + PLAY])
    assert len(found) == 4
    assert found[0]["backlash"].gap == pytest.approx(0.05, rel=0.01)
    assert found[0]["backlash"].damping == pytest.approx(0.15, rel=0.1)


def test_a_fit_without_a_play_or_at_the_noise_floor_stays() -> None:
    there = refine(*_begun(HEALTHY + PLAY))
    assert there.error < 1.1 * there.floor and from_other_contacts(there) is there
    healthy = refine(*_begun(HEALTHY))
    assert healthy.error > 2 * healthy.floor and from_other_contacts(healthy) is healthy


def test_contacts_are_looked_at_all_around_with_some_inertia_left_to_the_motor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a load that is nearly all of the axis no heavier one is looked at that would be more."""
    offered: list[Plant] = []
    monkeypatch.setattr(plays, "looked_at", lambda misfit, vector, plants: offered.extend(plants) or plants)
    heavy = PLAY.replace(inertia=0.95 * J)
    misfit, vector = _begun(HEALTHY + heavy)
    plays._promising(result_of(misfit, vector), heavy, "gap")
    assert len(offered) > 60 and all(p.driven_inertia > 0 for p in offered)
    for name in ("gap", "frequency", "damping"):
        there = [float(np.asarray(p["backlash"].values[name])) for p in offered]
        assert min(there) < heavy.values[name] < max(there)
    assert max(p["backlash"].inertia for p in offered) > 0.95 * J


def test_contacts_beside_one_at_the_end_of_its_range_stay_within_it(monkeypatch: pytest.MonkeyPatch) -> None:
    offered: list[Plant] = []
    monkeypatch.setattr(plays, "looked_at", lambda misfit, vector, plants: offered.extend(plants) or plants)
    least = next(p.lower for p in PLAY.parameters if p.name == "frequency")
    soft = PLAY.replace(frequency=least)
    plays._promising(result_of(*_begun(HEALTHY + soft)), soft, "gap")
    assert min(p["backlash"].frequency for p in offered) == least


@pytest.mark.slow
def test_a_fit_that_knocks_at_the_wrong_instants_is_led_out() -> None:
    """Too much damping smears knocks that come at the wrong time, and no step leads from there to less."""
    astray = refine(*_begun(HEALTHY + PLAY.replace(gap=0.07, frequency=26.0, damping=0.9)))
    assert astray.plant["backlash"].damping > 2 * 0.15
    led_out = from_other_contacts(astray)
    assert led_out.error < astray.error / 2
    values = led_out.plant["backlash"].values
    assert values["gap"] == pytest.approx(0.05, rel=0.15) and values["damping"] == pytest.approx(0.15, rel=0.15)


@pytest.mark.slow
def test_a_coupling_that_leaves_more_than_noise_is_opened_to_a_play_of_some_width() -> None:
    baseline = refine(*_begun(HEALTHY))
    coupling = effects.FlexibleCoupling(inertia=0.4 * J, frequency=20.0, damping=0.15)
    near = refine(*_begun(HEALTHY + coupling))
    fits = JointFits(HEALTHY, tuple(SEEN), frozenset())
    ((name, misfit, x),) = fits.opened(baseline, [("flexible_coupling", near.misfit, near.vector)])
    assert name == "backlash" and misfit.cost(x) < near.misfit.cost(near.vector)
    found = misfit.plant(x)
    assert "flexible_coupling" not in found and 10 * COUNT < found["backlash"].gap < 0.2
    assert not fits.opened(refine(*_begun(HEALTHY + PLAY)), [("flexible_coupling", near.misfit, near.vector)])
