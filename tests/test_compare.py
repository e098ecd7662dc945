"""compare: the true plant is at the floor, a wrong one is not, and each figure is the one it is called."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, rms, runs

from gms_mujoco import effects
from gms_mujoco.compare import WINDOW, Comparison, compare, quick_error
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

BARE = Plant.axis(J)


@pytest.fixture(scope="module")
def healthy() -> Comparison:
    return compare(HEALTHY, runs(HEALTHY, "validate"))


def test_the_true_plant_is_at_the_floor() -> None:
    bare = compare(BARE, runs(BARE))
    assert bare.torque_error == pytest.approx(bare.noise_floor, rel=0.15)


def test_the_true_plant_with_friction_is_at_the_floor(healthy: Comparison) -> None:
    assert 0.8 * healthy.noise_floor < healthy.torque_error < 1.3 * healthy.noise_floor


@pytest.mark.parametrize("bandwidth", [0, -1.0, math.nan, math.inf, True, "50"])
def test_a_bandwidth_that_is_none_is_refused(bandwidth: float) -> None:
    with pytest.raises(DataError, match=f"a bandwidth is a positive number of Hz; {bandwidth!r} given"):
        compare(BARE, runs(BARE, seconds=1.0), bandwidth=bandwidth)


@pytest.mark.parametrize(
    "other",
    [
        HEALTHY,
        HEALTHY + effects.Backlash(inertia=J / 3, gap=0.01, frequency=30),
        Plant.axis(J) + effects.FlexibleCoupling(inertia=J / 3, frequency=30) + HEALTHY["viscous"] + HEALTHY["gms"],
    ],
    ids=["less", "another", "in another order"],
)
def test_an_error_near_a_comparison_takes_the_states_of_the_effects_that_both_plants_have(other: Plant) -> None:
    coupled = HEALTHY + effects.FlexibleCoupling(inertia=J / 3, frequency=30)
    rr = runs(coupled, "validate", seconds=1.0)
    near, whole = compare(coupled, rr), compare(other, rr)
    quick = quick_error(other, observe(rr, J, near.bandwidth, other), near)
    assert whole.torque_error * 0.99 < quick < 1.2 * whole.torque_error


@pytest.mark.parametrize(
    "wrong",
    [
        HEALTHY.without("viscous"),
        HEALTHY.without("gms"),
        HEALTHY.replace(HEALTHY["gms"].replace(coulomb=4.8e-3)),
        replace(HEALTHY, inertia=1.05 * J),
        HEALTHY + effects.Delay(time=1e-3),
    ],
    ids=["no drag", "no friction", "stronger friction", "heavier", "late"],
)
def test_a_wrong_plant_is_not(healthy: Comparison, wrong: Plant) -> None:
    found = compare(wrong, runs(HEALTHY, "validate"))
    assert found.torque_error > 3 * healthy.torque_error and found.torque_error > 1.3 * found.noise_floor
    assert found.simulation_error > healthy.simulation_error


def test_the_torque_error_of_a_wrong_inertia_is_its_share() -> None:
    found = compare(Plant.axis(1.1 * J), runs(BARE))
    assert found.torque_error == pytest.approx(0.1, rel=0.01)
    assert all(r.torque_error == pytest.approx(0.1, rel=0.05) for r in found.records)


def test_the_simulation_error_is_that_of_parabolas_over_each_window() -> None:
    h, wrong = 1e-3, 1.2 * J
    u = multisine(4000, h, 1, 30, 2e-3, np.random.default_rng(0))
    record = simulate(BARE, u, h)
    found = compare(Plant.axis(wrong), [record], bandwidth=100.0)
    n = round(WINDOW / h)
    # With the true motion: what the torque does differs by the ratio of the inertias, the first velocity is known.
    v = np.concatenate([[0], np.cumsum(u * h / J)])
    lag = np.arange(n)[::-1] + 0.5
    start = np.arange(round(found.records[0].time[0] / h), 4000 - n, n)
    pushed = np.array([(u[a : a + n] * lag).sum() * h**2 for a in start])
    moved = np.array([v[a] * n * h for a in start]) + pushed / J
    expected = rms(pushed / wrong - pushed / J) / rms(moved)
    assert found.simulation_error == pytest.approx(expected, rel=0.01)
    assert compare(BARE, [record], bandwidth=100.0).simulation_error < 0.02 * expected


def test_pooled_figures_weigh_records_equally(healthy: Comparison) -> None:
    above = np.mean([rms(r.residual) ** 2 for r in healthy.records])
    below = np.mean([rms(r.measured) ** 2 for r in healthy.records])
    noise = np.mean([rms(r.floor) ** 2 for r in healthy.records])
    assert healthy.torque_error == pytest.approx(math.sqrt(above / below))
    assert healthy.noise_floor == pytest.approx(math.sqrt(noise / below))
    assert healthy.simulation_error == pytest.approx(rms(np.array([r.simulation_error for r in healthy.records])))


def test_each_record_has_its_own_figures(healthy: Comparison) -> None:
    assert [r.name for r in healthy.records] == ["validate_0", "validate_1", "validate_2"]
    for r in healthy.records:
        assert r.use == "validate"
        assert r.torque_error == pytest.approx(rms(r.residual) / rms(r.measured))
        assert r.noise_floor == pytest.approx(rms(r.floor) / rms(r.measured))
        n = len(r.time)
        assert all(len(x) == n for x in (r.position, r.velocity, r.measured, r.needed, r.floor))


def test_what_friction_does_below_a_count_is_no_part_of_what_the_motion_determines() -> None:
    """All of a record that moves; of one that rests a third of the time two thirds."""
    torque = multisine(3000, 1e-3, 1, 30, 2 * LEVEL, np.random.default_rng(0))
    torque[2000:] = 0.0
    coarse = 2 * math.pi / 1024
    rests = compare(HEALTHY, [simulate(HEALTHY, torque, 1e-3, resolution=coarse)])
    record = rests.records[0]
    told = record.observation.determined
    assert 0.4 < told.mean() < 0.75

    def with_more(where: np.ndarray) -> Comparison:
        more = replace(record, needed=record.needed + np.where(where, LEVEL, 0.0))
        return replace(rests, records=(more,))

    assert with_more(~told).determined == rests.determined
    error, floor = with_more(told).determined
    assert error > 2 * rests.determined[0] and floor == rests.determined[1] < rests.noise_floor
    said = f"elsewhere the torque error is {100 * rests.determined[0]:.2f} %, the noise floor {100 * floor:.2f} %"
    assert said in with_more(~told).where and said in str(with_more(~told))
    assert "whatever holds it" not in with_more(told).where


def test_the_loudest_is_where_most_of_the_squared_error_stands(healthy: Comparison) -> None:
    for loud in healthy.records:
        off = [replace(r, needed=r.needed + LEVEL * (r is loud)) for r in healthy.records]
        assert replace(healthy, records=tuple(off)).loudest == loud.name


def test_the_dictionary_has_the_keys_of_the_contract(healthy: Comparison) -> None:
    table = healthy.to_dict()
    assert {"torque_error", "simulation_error", "noise_floor", "simulation_window_s", "bandwidth_hz"} <= set(table)
    assert table["schema"] == 1 and table["torque_error"] == healthy.torque_error
    assert [set(r) >= {"name", "use", "torque_error", "simulation_error"} for r in table["records"]] == [True] * 3


def test_printed_it_is_a_table(healthy: Comparison) -> None:
    lines = str(healthy).splitlines()
    assert [line.split()[0] for line in lines[2:6]] == ["validate_0", "validate_1", "validate_2", "pooled"]
    assert f"{100 * healthy.torque_error:.2f}" in lines[5] and "50 ms" in lines[0]
    assert "\n".join(lines[6:]) == healthy.where


def test_the_dictionary_shows_every_view(healthy: Comparison) -> None:
    table = json.loads(json.dumps(healthy.to_dict()))
    assert len(table["views"]) == len(healthy.views) and table["where"] == healthy.where
    for shown, m in zip(table["views"], healthy.views, strict=True):
        assert shown["name"] == m.name and shown["outside"] == m.outside.sum()
        assert len(shown["centres"]) == len(shown["mean"]) == len(shown["band"]) == len(shown["expected"])
    assert {g["name"] for g in table["regimes"]} <= {"pre-sliding", "reversal", "sliding"}


def test_the_band_is_that_of_the_fit_unless_told() -> None:
    records = runs(HEALTHY, "validate")
    fitted = replace(HEALTHY, provenance={"bandwidth": 37.0})
    assert compare(fitted, records).bandwidth == 37.0
    assert compare(fitted, records, bandwidth=50.0).bandwidth == 50.0
    assert compare(HEALTHY, records).bandwidth == 100.0


def test_the_skew_of_the_clocks_that_a_fit_found_is_taken_out() -> None:
    late = HEALTHY + effects.Delay(time=8e-5)
    plant = fit(HEALTHY, runs(late)).plant
    with_it, without = (compare(p, runs(late, "validate")) for p in (plant, replace(plant, provenance={})))
    assert with_it.torque_error < 0.5 * without.torque_error


def test_the_state_before_a_record_is_found_and_the_plant_stays() -> None:
    cut = [r.slice(1200, len(r)) for r in runs(HEALTHY, "validate")]
    found = compare(HEALTHY, cut)
    assert found.plant == HEALTHY
    assert found.torque_error < 1.3 * found.noise_floor


def test_what_cannot_be_compared_is_said() -> None:
    with pytest.raises(ModelError, match=r"gms\.stiffness"):
        compare(BARE + effects.GMS(elements=2), runs(BARE))
    with pytest.raises(DataError, match="no records"):
        compare(BARE, [])
