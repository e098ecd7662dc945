"""Coordinates: the same plant back, and never one that is not allowed, for every effect of the catalogue."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import every_effect, some_plant

from gms_mujoco import effects
from gms_mujoco.identification.coordinates import Coordinates, all_labels
from gms_mujoco.parameter import WAVES
from gms_mujoco.plant import JOINT_KINDS, Plant


@every_effect
@settings(max_examples=25)
@given(data=st.data())
def test_the_same_plant_comes_back(name: str, data: st.DataObject) -> None:
    plant = data.draw(some_plant(name, JOINT_KINDS))
    coordinates = Coordinates(plant)
    x = coordinates.encode(plant)
    again = coordinates.decode(x)
    assert len(x) == coordinates.size == len(coordinates.is_linear)
    before, after = plant.numbers(), again.numbers()
    for label, (value, _) in before.items():
        assert after[label][0] == pytest.approx(value, rel=1e-9, abs=1e-12), label


@every_effect
@settings(max_examples=10)
@given(data=st.data())
def test_a_plant_beside_another_is_that_of_its_coordinates(name: str, data: st.DataObject) -> None:
    other = effects.find("viscous" if name == "spring" else "spring")()
    plant = replace(data.draw(some_plant(name)), inertia_known=False) + other
    coordinates = Coordinates(plant)
    x = coordinates.encode(plant)
    here, owners = coordinates.decode(x), [b.effect for b in coordinates.blocks for _ in range(b.size)]
    for owner, moved in zip(owners, np.clip(x + 1e-3 * np.eye(len(x)), *coordinates.bounds), strict=True):
        assert coordinates.decode(moved, (here, owner)) == coordinates.decode(moved)


@every_effect
@settings(max_examples=25)
@given(data=st.data())
def test_wherever_an_optimiser_goes_the_plant_is_allowed(name: str, data: st.DataObject) -> None:
    plant = data.draw(some_plant(name, JOINT_KINDS))
    coordinates = Coordinates(plant)
    lower, upper = coordinates.bounds
    n = coordinates.size
    steps = data.draw(st.lists(st.floats(-50, 50), min_size=n, max_size=n))
    x = np.clip(coordinates.encode(plant) + steps, lower, upper)
    there = coordinates.decode(x)  # an effect refuses values out of its bounds
    assert not there.unset and there.inertia > 0
    for e in there.effects:
        for p in e.parameters:
            if p.share:
                assert sum(e.values[p.name]) == pytest.approx(1, abs=1e-9)
            if p.at_least:
                assert np.all(np.asarray(e.values[p.name]) >= np.asarray(e.values[p.at_least]))
            if not p.free and not (p.unit == WAVES and there.kind == "slide"):
                assert e.values[p.name] == plant[e.name].values[p.name]


@every_effect
@settings(max_examples=25)
@given(data=st.data())
def test_intervals_hold_the_value_and_the_bounds(name: str, data: st.DataObject) -> None:
    plant = data.draw(some_plant(name, JOINT_KINDS))
    coordinates = Coordinates(plant)
    x = coordinates.encode(plant)
    root = np.random.default_rng(data.draw(st.integers(0, 99))).normal(0, 0.1, (coordinates.size, coordinates.size))
    intervals = coordinates.intervals(x, root @ root.T)
    numbers = plant.numbers()
    table = {f"{name}.{p.name}": p for p in effects.find(name).parameters}
    for label, (low, high) in intervals.items():
        value = numbers[label][0]
        slack = 1e-9 * abs(value) + 1e-12
        assert low - slack <= value <= high + slack, label
        p = table.get(label.split("[")[0])
        if p is not None:
            assert low >= p.lower - slack and high <= p.upper + slack, label


@every_effect
def test_labels_are_those_of_the_numbers(name: str) -> None:
    n = 3 if any(p.per_element for p in effects.find(name).parameters) else None
    scales = {p.name: 1.0 for p in effects.find(name).parameters if p.is_scale and p.default == 0}
    plant = Plant(1.0, (effects.find(name)(n, **scales),), "hinge", False)
    coordinates = Coordinates(plant)
    labels = list(coordinates.intervals(np.zeros(coordinates.size), np.eye(coordinates.size)))
    assert len(set(labels)) == len(labels)
    assert set(labels) <= set(plant.numbers())
    free = {f"{name}.{p.name}" for p in effects.find(name).parameters if p.free} | {"inertia"}
    assert {label.split("[")[0] for label in labels} == free <= set(all_labels(plant))


def test_a_velocity_of_zero_is_no_unknown_and_any_other_moves_on_a_logarithmic_scale() -> None:
    holds = Plant.axis(1.0) + effects.Stribeck(coulomb=1.0, static=1.1, stribeck_velocity=1.0)
    creeps = holds.replace(holds["stribeck"].replace(creep_velocity=1e-3))
    assert "stribeck.creep_velocity" not in Coordinates(holds).labels
    coordinates = Coordinates(creeps)
    where = coordinates.labels.index("stribeck.creep_velocity")
    assert coordinates.encode(creeps)[where] == pytest.approx(np.log(1e-3)) and not coordinates.is_linear[where]


def test_what_is_fixed_or_known_does_not_move() -> None:
    coordinates = Coordinates(HEALTHY, fixed=["gms.stiffness", "viscous.coefficient"])
    moved = coordinates.decode(coordinates.encode(HEALTHY) + 0.1)
    assert moved.inertia == HEALTHY.inertia and moved["viscous"] == HEALTHY["viscous"]
    assert moved["gms"].stiffness == HEALTHY["gms"].stiffness and moved["gms"].coulomb != HEALTHY["gms"].coulomb
    nothing = Coordinates(HEALTHY, fixed=all_labels(HEALTHY))
    assert nothing.size == 0 and nothing.decode(np.empty(0)) == HEALTHY


def test_the_interval_of_a_level_is_a_factor_and_of_a_strength_a_distance() -> None:
    plant = Plant(2.0, (effects.TorqueOffset(torque=0.3),), "hinge", False)
    coordinates = Coordinates(plant)
    intervals = coordinates.intervals(coordinates.encode(plant), np.diag([0.1**2, 0.01**2]))
    assert intervals["inertia"] == pytest.approx((2 * math.exp(-0.196), 2 * math.exp(0.196)))
    (offset,) = [v for k, v in intervals.items() if k != "inertia"]
    assert offset == pytest.approx((0.3 - 0.0196, 0.3 + 0.0196))


def test_intervals_of_shares_follow_from_all_log_ratios() -> None:
    """Against a sample of plants drawn from the covariance of the coordinates."""
    rest = {"coulomb": 1, "static": 1.1, "stribeck_velocity": 1, "attraction": 1}
    coordinates = Coordinates(Plant.axis(1.0) + effects.GMS(stiffness=[1, 1, 1], fraction=[0.2, 0.3, 0.5], **rest))
    x = coordinates.encode(coordinates.template)
    root = 0.02 * np.random.default_rng(0).normal(size=(len(x), len(x)))
    covariance = root @ root.T
    drawn = np.random.default_rng(1).multivariate_normal(x, covariance, 4000)
    shares = np.array([coordinates.values(d)["gms.fraction"] for d in drawn])
    intervals = coordinates.intervals(x, covariance)
    for i in range(3):
        low, high = intervals[f"gms.fraction[{i}]"]
        assert (high - low) / 3.92 == pytest.approx(shares[:, i].std(), rel=0.05)


def test_a_fit_moves_how_often_a_wave_comes_back_on_a_slide_joint_only() -> None:
    waves = effects.Cogging(harmonics=[6.5, 13.0], amplitude=[1.0, 2.0], phase=[0.0, 0.0])
    on_slide, on_hinge = (Coordinates(Plant.axis(1.0, kind) + waves) for kind in ("slide", "hinge"))
    assert [k for k in on_slide.labels if k not in on_hinge.labels] == ["cogging.harmonics[0]", "cogging.harmonics[1]"]
    assert not on_hinge.is_wave_number.any() and on_slide.is_wave_number.sum() == 2
    assert on_slide.is_linear[on_slide.is_wave_number].all()


def test_a_share_is_not_known_better_than_the_log_ratios_that_move_it() -> None:
    rest = {"coulomb": 1, "static": 1.1, "stribeck_velocity": 1, "attraction": 1}
    coordinates = Coordinates(Plant.axis(1.0) + effects.GMS(stiffness=[1, 1, 1], fraction=[0.2, 0.3, 0.5], **rest))
    x = coordinates.encode(coordinates.template)
    at = [i for i, label in enumerate(coordinates.labels) if "fraction" in label]
    covariance = 1e-4 * np.eye(len(x))
    covariance[at[0], at[0]] = 500.0**2  # not seen
    open_ = coordinates.intervals(x, covariance)
    assert all(open_[f"gms.fraction[{i}]"] == (0, 1) for i in range(3))
    lost = 1e40 * np.ones((2, 2))  # of which nothing is left but rounding
    lost[1, 1] *= 1 - 1e-12
    covariance[np.ix_(at, at)] = lost - np.outer([1, -1], [1, -1]) * 1e27
    assert all(low < high for label, (low, high) in coordinates.intervals(x, covariance).items() if "fraction" in label)
