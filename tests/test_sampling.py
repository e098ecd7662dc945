"""Plants drawn from what the data of a fit allow: inside the intervals, with the correlations, allowed themselves."""

from dataclasses import replace

import numpy as np
import pytest
from bench import baseline_fit
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import every_effect, some_plant

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.coordinates import Coordinates
from gms_mujoco.plant import Plant
from gms_mujoco.sampling import sample


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    return baseline_fit()


def encoded(plants: list[Plant]) -> np.ndarray:
    return np.array([Coordinates(p).encode(p) for p in plants])


def test_draws_have_the_covariance_of_the_fit(fitted: FitResult) -> None:
    plant = fitted.plant
    labels = Coordinates(plant).labels
    assert list(plant.covariance) == labels
    covariance = np.array(list(plant.covariance.values()))
    drawn = encoded(sample(plant, 4000, 1))
    sigma = np.sqrt(np.diag(covariance))
    # Cut at 1.96 sigma a normal number has 0.872 of its deviation (variance 1 - 2 z phi(z) / 0.95).
    assert drawn.std(axis=0) == pytest.approx(0.872 * sigma, rel=0.05)
    assert drawn.mean(axis=0) == pytest.approx(Coordinates(plant).encode(plant), abs=0.06 * sigma.max())
    expected = covariance / np.outer(sigma, sigma)
    assert np.abs(np.corrcoef(drawn.T) - expected).max() < 0.06
    assert np.abs(expected - np.eye(len(labels))).max() > 0.5, "or the test would say nothing"


def test_draws_with_the_correlations_fit_the_data_better_than_without(fitted: FitResult) -> None:
    """That is what the covariance is for: along the directions that data leave open the error hardly grows."""
    alone = replace(fitted.plant, covariance={})
    n = fitted.misfit.coordinates.size

    def cost(plants: list[Plant]) -> float:
        found = []
        for plant in plants:
            x = fitted.vector.copy()
            x[:n] = fitted.misfit.coordinates.encode(plant)
            found.append(fitted.misfit.cost(x) - fitted.misfit.cost(fitted.vector))
        return float(np.median(found))

    assert cost(sample(fitted.plant, 40, 2)) < 0.5 * cost(sample(alone, 40, 2))


def test_every_draw_lies_in_its_interval_and_outside_beyond_it(fitted: FitResult) -> None:
    for outside in (False, True):
        for plant in sample(fitted.plant, 200, 3, outside=outside):
            for name in ("viscous.coefficient", "gms.coulomb", "gms.stiffness[0]", "gms.attraction"):
                low, high = fitted.plant.uncertainty[name]
                inside = low * (1 - 1e-9) <= plant.numbers()[name][0] <= high * (1 + 1e-9)
                assert inside != outside, name


def test_the_same_seed_the_same_plants_also_through_a_file(fitted: FitResult, tmp_path) -> None:
    fitted.plant.save(tmp_path / "model.toml")
    again = Plant.load(tmp_path / "model.toml")
    once, twice = (encoded(sample(p, 5, 4)) for p in (fitted.plant, again))
    assert twice == pytest.approx(once, rel=1e-4)
    assert sample(fitted.plant, 5, 4) == sample(fitted.plant, 5, np.random.default_rng(4))
    assert sample(fitted.plant, 2, 4) != sample(fitted.plant, 2, 5)


@every_effect
@settings(max_examples=20)
@given(data=st.data())
def test_a_draw_is_an_allowed_plant_for_any_intervals(name: str, data: st.DataObject) -> None:
    plant = data.draw(some_plant(name))
    width = st.floats(0, 100)
    intervals = {
        k: (v - data.draw(width) * max(abs(v), 1e-3), v + data.draw(width) * max(abs(v), 1e-3))
        for k, (v, _) in plant.numbers().items()
    }
    for drawn in sample(replace(plant, uncertainty=intervals), 3, data.draw(st.integers(0, 99)), outside=True):
        assert not drawn.unset  # an effect refuses values out of its bounds, and shares that do not sum to 1
        assert not drawn.uncertainty and "sampled" in drawn.provenance


def test_only_the_kinds_asked_for_are_drawn_and_wide_intervals_stay_near_the_value() -> None:
    plant = Plant.axis(2.0) + effects.LuGre(stiffness=1.0, coulomb=1.0, static=1.0, stribeck_velocity=0.5)
    plant = plant + effects.Cogging(harmonics=[3], amplitude=[0.1], phase=[0.0])
    plant = replace(
        plant,
        uncertainty={"inertia": (1.0, 3.0), "cogging.amplitude": (0.05, 0.15), "lugre.stribeck_velocity": (1e-9, 1e9)},
    )
    for p in sample(plant, 20, 0, kinds=("friction",)):
        assert p.inertia == 2.0 and p["cogging"] == plant["cogging"]
        assert 0.05 <= p["lugre"].stribeck_velocity <= 5.0, "data that say nothing open a factor of ten"
    assert len({p.inertia for p in sample(plant, 20, 0)}) == 20
    with pytest.raises(ModelError, match="of drive none has one"):
        sample(replace(plant, uncertainty={"inertia": (1.0, 3.0)}), 1, kinds=("drive",))
    for kinds, wrong in ((("dry",), "dry"), ("friction", "friction")):
        with pytest.raises(ModelError, match=rf"kinds is a list out of .*friction.*; '{wrong}' given"):
            sample(plant, 1, kinds=kinds)


def test_what_stands_above_another_stays_above_it() -> None:
    plant = Plant.axis(1.0) + effects.Stribeck(coulomb=1.0, static=1.05, stribeck_velocity=0.5)
    for name in ("stribeck.coulomb", "stribeck.static"):
        drawn = [p["stribeck"] for p in sample(replace(plant, uncertainty={name: (0.5, 1.5)}), 50, 0)]
        assert all(e.static >= e.coulomb for e in drawn) and len({e.values[name.split(".")[1]] for e in drawn}) > 10


def test_a_covariance_that_outlives_its_effect_is_left_aside(fitted: FitResult) -> None:
    plant = fitted.plant.without("gms") + effects.Coulomb(coulomb=4e-3)
    drawn = sample(plant, 3, 0)
    assert len({p["viscous"].coefficient for p in drawn}) == 3 and {p["coulomb"].coulomb for p in drawn} == {4e-3}


def test_arguments_that_cannot_be_are_told_in_one_line_and_a_plant_may_be_a_name() -> None:
    assert sample("sts3215", 2, 0) == sample(Plant.load("sts3215"), 2, 0)
    for n in (-1, 1.5, True):
        with pytest.raises(ModelError, match=f"n must be a whole number from 0 on; {n} given"):
            sample("sts3215", n)
    with pytest.raises(DataError, match="seed must be a whole number from 0 on, or None; -1 given"):
        sample("sts3215", 1, -1)


def test_it_is_public() -> None:
    assert gms.sample is sample
