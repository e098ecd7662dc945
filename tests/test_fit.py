"""fit: what a simulated axis was made of comes back, with intervals that mean something."""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import GMS, HEALTHY, LEVEL, SAMPLE_TIME, UNKNOWN, J, baseline_fit, rms, run, runs, slow

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.comparison.score import relative_error
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.effect import Effect
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import baseline, fit, fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.intervals import block_sums, covariance
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.least_squares import approach, nudge, solve
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import finish, finished, refine, to_end
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

DRAG = Plant.axis(J) + effects.Viscous(coefficient=3e-4)

# What the torque hardly depends on comes back less sharply.
SHARP = {"gms.attraction": 0.2, "gms.stribeck_velocity": 0.1}


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    return baseline_fit()


def _off(found: Plant, truth: Plant) -> dict[str, float]:
    """Relative error of each identified parameter, elements in the order of their stiffness."""
    numbers = truth.numbers()
    return {k: found.numbers()[k][0] / numbers[k][0] - 1 for k in found.uncertainty}


def test_the_parameters_of_a_known_axis_come_back(fitted: FitResult) -> None:
    for label, off in _off(fitted.plant, HEALTHY).items():
        assert abs(off) < SHARP.get(label, 0.02), label


def test_the_fit_is_at_the_floor(fitted: FitResult) -> None:
    assert fitted.error < 1.2 * fitted.floor < 0.01
    applied = [o.applied(HEALTHY) for o in fitted.misfit.observations]
    left = [o.applied(HEALTHY) - o.needed(HEALTHY) for o in fitted.misfit.observations]
    assert fitted.error <= relative_error(left, applied)  # no worse than the truth itself


def test_inertia_is_identified_where_it_is_not_known() -> None:
    found = fit(replace(UNKNOWN, inertia=None, inertia_known=False), runs(HEALTHY)).plant
    assert found.inertia == pytest.approx(J, rel=0.01)
    assert "inertia" in found.uncertainty and not found.inertia_known
    for label, off in _off(found, HEALTHY).items():
        assert abs(off) < SHARP.get(label, 0.03), label


def test_a_known_inertia_stays(fitted: FitResult) -> None:
    assert fitted.plant.inertia == J and "inertia" not in fitted.plant.uncertainty


def test_a_slide_joint_is_the_same_in_other_units(fitted: FitResult) -> None:
    found = fit(replace(UNKNOWN, kind="slide"), runs(replace(HEALTHY, kind="slide"))).plant
    assert found.kind == "slide" and found.effects == fitted.plant.effects
    assert found.numbers()["viscous.coefficient"][1] == "N s/m"


def test_every_free_parameter_has_an_interval_around_it(fitted: FitResult) -> None:
    plant = fitted.plant
    free = {f"{e.name}.{p.name}" for e in plant.effects for p in e.parameters if p.free}
    assert {k.split("[")[0] for k in plant.uncertainty} == free
    for k, (low, high) in plant.uncertainty.items():
        assert low < plant.numbers()[k][0] < high, k


def test_a_linear_problem_has_the_solution_of_linear_least_squares() -> None:
    plant = replace(DRAG, inertia=None, inertia_known=False)
    found = fit(plant, runs(DRAG))
    drag = found.plant["viscous"].coefficient
    unit = Plant.axis(1.0) + effects.Viscous(coefficient=drag)
    seen = found.misfit.observations
    fine = [o.grid(unit, None, 10.0) for o in seen]  # the last steps of a fit take these instants
    columns = [
        (o.acceleration, -o.replay(unit, None, g) / drag, o.applied(plant), o.applied(plant, 1e-6))
        for o, g in zip(seen, fine, strict=True)
    ]
    a, v, u, late = (np.concatenate(c) for c in zip(*columns, strict=True))
    matrix = np.stack([a, v, (u - late) / 1e-6], 1)  # inertia, drag and the skew of the clocks
    scale = np.sqrt((matrix**2).sum(0))
    inertia, drag, skew = np.linalg.lstsq(matrix / scale, u, rcond=None)[0] / scale
    assert found.plant.inertia == pytest.approx(inertia, rel=1e-6)
    assert found.plant["viscous"].coefficient == pytest.approx(drag, rel=1e-6)
    assert found.plant.provenance["clock_skew"] == pytest.approx(skew, abs=1e-6)


def test_intervals_are_as_wide_as_repeated_measurements_scatter() -> None:
    """Over noise drawn anew. A 95 % interval that holds the truth in 95 % of 40 runs does in 33 or more of them."""
    u = multisine(6000, SAMPLE_TIME, 0.3, 20, 4 * LEVEL, np.random.default_rng(0))
    plant = replace(DRAG, inertia=None, inertia_known=False)
    records = [run(DRAG, u, seed, torque_noise=1e-3, substeps=200) for seed in range(40)]
    found = [fit(plant, [r], bandwidth=50.0).plant for r in records]
    for label, truth in (("inertia", J), ("viscous.coefficient", 3e-4)):
        values = np.array([p.numbers()[label][0] for p in found])
        low, high = np.array([p.uncertainty[label] for p in found]).T
        assert np.mean(high - low) / 3.92 == pytest.approx(values.std(), rel=0.35), label
        assert np.sum((low < truth) & (truth < high)) >= 33, label


def test_starting_values_that_are_given_are_where_the_fit_starts() -> None:
    near = fit(HEALTHY, runs(HEALTHY))
    for label, off in _off(near.plant, HEALTHY).items():
        assert abs(off) < SHARP.get(label, 0.02), label


@pytest.mark.parametrize("attraction", [20.0, 100.0, 1000.0])
def test_a_fit_leaves_no_more_than_the_plant_that_it_was_given(attraction: float) -> None:
    """A coarse look does not see what elements do between samples, and would lead away from the truth."""
    fast = effects.GMS(
        5, stiffness=np.geomspace(30, 0.5, 5) * LEVEL, fraction=[0.1, 0.3, 0.1, 0.3, 0.2], coulomb=LEVEL,
        static=1.1 * LEVEL, stribeck_velocity=0.6, stribeck_exponent=1, attraction=attraction * LEVEL,
    )  # fmt: skip
    truth = HEALTHY.replace(fast) + effects.AsymmetricFriction(level=0.12)
    found = fit(truth, runs(truth))
    given = found.misfit.settle(found.misfit.vector(truth))
    assert found.misfit.cost(found.vector) <= found.misfit.cost(given)


@pytest.mark.parametrize("velocity", [0.05, 0.5, 5.0])
def test_a_fit_that_ends_above_the_noise_goes_on_with_another_weakening(velocity: float) -> None:
    """Of a friction that weakens far below the usual speeds a few steps tell little of which start leads to it."""
    truth = HEALTHY.replace(GMS.replace(stribeck_velocity=velocity, static=1.15 * LEVEL))
    found = fit(Plant.axis(J) + effects.GMS(elements=4) + effects.Viscous(), runs(truth))
    assert found.error < 1.1 * found.floor
    assert found.plant["gms"].stribeck_velocity == pytest.approx(velocity, rel=0.5)


@pytest.mark.parametrize("level", [0.0, 0.1, 0.15])
def test_a_fit_with_an_effect_begins_again_with_another_weakening_too(level: float) -> None:
    """From a level of 0.15 the first start leads to where eight times the noise is left; of other records others do."""
    rr = runs(HEALTHY + effects.AsymmetricFriction(level=0.15), seed=23)
    found = fit(UNKNOWN + effects.AsymmetricFriction(level=level), rr)
    assert found.error < 1.2 * found.floor
    assert found.plant["asymmetric_friction"].level == pytest.approx(0.15, rel=0.01)


@pytest.mark.parametrize("seed", [13, 14, 24])
def test_a_fit_begins_again_from_the_records_that_slide(seed: int) -> None:
    """To and fro an asymmetry hangs on all slips before: from all records at once 7 to 10 times the floor was left."""
    truth = HEALTHY + effects.AsymmetricFriction(level=0.15)
    found = fit(UNKNOWN + effects.AsymmetricFriction(level=0.1), runs(truth, seed=seed))
    assert found.error < 1.1 * found.floor
    assert found.plant["asymmetric_friction"].level == pytest.approx(0.15, rel=0.02)


def test_an_element_that_slips_late_beside_a_stiff_contact_is_found() -> None:
    """A hundred times as late as the one that holds half of the level, and still in each record."""
    distance, share = 5e-4 * np.array([1, 10, 100]), np.array([3, 2, 1]) / 6
    level = float(np.asarray(HEALTHY["gms"].coulomb))
    values = {k: HEALTHY["gms"].values[k] for k in ("coulomb", "static", "stribeck_velocity", "attraction")}
    late = HEALTHY.replace(effects.GMS(3, fraction=share, stiffness=share * level / distance, **values))
    found = fit(baseline(J), runs(late))
    law = found.plant["gms"]
    slips = np.asarray(law.fraction) * level / np.asarray(law.stiffness)
    assert found.is_near_floor
    assert float(np.asarray(law.fraction)[slips > 0.7 * distance[2]].sum()) == pytest.approx(share[2], abs=0.02)


def test_friction_that_follows_its_level_at_once_is_fitted_to_the_floor() -> None:
    """Elements that are cut off at the level, as in many a simulation, follow it within a sample."""
    soft = GMS.replace(stiffness=[0.5, 0.05], static=1.4 * LEVEL, attraction=100 * LEVEL / SAMPLE_TIME)
    found = fit(UNKNOWN, runs(HEALTHY.replace(soft)))
    assert found.error < 1.1 * found.floor


def test_what_is_fixed_stays() -> None:
    wrong = UNKNOWN.replace(effects.Viscous(coefficient=5e-5))
    found = fit(wrong, runs(HEALTHY), fixed=["viscous.coefficient"])
    assert found.plant["viscous"].coefficient == 5e-5 and "viscous.coefficient" not in found.plant.uncertainty
    assert found.error > 1.5 * found.floor


BESIDE: list[Effect] = [
    effects.Cogging(harmonics=[6, 11], amplitude=[0.2 * LEVEL, 0.1 * LEVEL], phase=[3.5, 0.4]),
    effects.EncoderEccentricity(amplitude=0.02, phase=-2.0),
    effects.FlexibleCoupling(inertia=J / 3, frequency=60, damping=0.05),
    effects.Gravity(amplitude=0.3 * LEVEL, phase=-2.0),
    effects.PositionDependentFriction(harmonics=[3], amplitude=[0.2], phase=[4.0]),
    effects.ThermalDrift(amplitude=0.4, time_constant=1.5),
    effects.TorqueSaturation(limit=2.5 * LEVEL),
]


@pytest.mark.parametrize("effect", [*BESIDE[:3], *slow(*BESIDE[3:])], ids=lambda e: str(e.name))
def test_an_effect_without_values_begins_with_what_the_data_show(effect: Effect) -> None:
    """At a strength of zero nothing is seen of a frequency, and nothing leads to a phase on the other side."""
    rr = runs(HEALTHY + effect)
    found, known = fit(UNKNOWN + type(effect)(), rr), fit(HEALTHY + effect, rr)
    assert found.error < 1.1 * known.error
    ours, true = found.plant[effect.name], known.plant[effect.name]
    if "harmonics" in ours.values:
        order = np.argsort(ours.harmonics)
        ours = ours.replace(**{p.name: np.take(ours.values[p.name], order) for p in ours.parameters if p.per_element})
    for p in ours.parameters:
        apart = np.subtract(ours.values[p.name], true.values[p.name])
        apart -= 2 * np.pi * np.round(apart / (2 * np.pi)) * (p.name == "phase")
        np.testing.assert_allclose(apart, 0, atol=0.03 * np.abs(true.values[p.name]).max() + 1e-6, err_msg=p.name)


def test_values_that_are_given_stay_beside_those_that_are_not() -> None:
    coupling = effects.FlexibleCoupling(inertia=J / 3, frequency=60, damping=0.05)
    rr = runs(HEALTHY + coupling)
    asked = UNKNOWN + effects.FlexibleCoupling(damping=0.1)
    found = fit(asked, rr, fixed=["flexible_coupling.damping"]).plant["flexible_coupling"]
    assert found.damping == 0.1 and found.frequency == pytest.approx(60, rel=0.05)
    orders = fit(UNKNOWN + effects.Cogging(harmonics=[6, 11]), runs(HEALTHY + BESIDE[0])).plant["cogging"]
    assert orders.harmonics == (6, 11)
    np.testing.assert_allclose(orders.amplitude, BESIDE[0].amplitude, rtol=0.02)


def test_an_effect_that_the_data_cannot_show_has_to_be_given() -> None:
    """Less than a turn, in which no harmonic of it is told from an offset."""
    short = run(HEALTHY, multisine(2000, SAMPLE_TIME, 5.0, 60.0, 0.4 * LEVEL, np.random.default_rng(0)))
    with pytest.raises(ModelError, match="cogging has no values yet, and these data show nothing of it"):
        fit(UNKNOWN + effects.Cogging(), [short])


def test_a_delay_comes_back_whatever_its_size() -> None:
    for delay in (0.4e-3, 1.5e-3, 4e-3):
        records = runs(HEALTHY + effects.Delay(time=delay))
        found = fit(UNKNOWN + effects.Delay(), records)
        assert found.plant["delay"].time == pytest.approx(delay, abs=0.02 * SAMPLE_TIME)
        assert found.error < 1.2 * found.floor


def test_a_small_skew_of_the_clocks_is_no_effect() -> None:
    skew = 0.05 * SAMPLE_TIME
    late = fit(UNKNOWN, runs(HEALTHY + effects.Delay(time=skew)))
    assert late.error < 1.2 * late.floor
    assert late.plant.provenance["clock_skew"] == pytest.approx(skew, rel=0.2)


def _measured_after(record: Record) -> Record:
    """The log of a drive that reads its current before it sets the next one: that of the interval before."""
    return replace(record, signals={**record.signals, "torque": np.append(record.torque[:1], record.torque[:-1])})


def test_a_current_that_was_measured_after_it_acted_is_no_effect() -> None:
    found = fit(UNKNOWN, [_measured_after(r) for r in runs(HEALTHY)])
    assert found.error < 1.2 * found.floor
    assert found.plant.provenance["clock_skew"] == pytest.approx(-SAMPLE_TIME, rel=0.05)
    assert "1.00 samples) before" in found.status and not fit(UNKNOWN, runs(HEALTHY)).habit


def _logged_now_and_then(record: Record, every: int = 5, age: int = 0) -> Record:
    """Every so many-th row of a log, with the torque read up to a few rows before the position."""
    rows = slice(10 - age, len(record) - age, every)
    signals = {"torque": record.torque[rows], "position": record.position[10::every][: len(record.torque[rows])]}
    return Record(record.name, every * SAMPLE_TIME * np.arange(len(signals["torque"])), signals, sensed=True)


def test_a_current_is_read_with_the_position_and_not_held() -> None:
    """What a slow log of a fast drive says of an instant; and where current and position are not of one instant."""
    rng = np.random.default_rng(3)
    bands = ((1, 8, 1.0), (0.5, 5, 3.0))
    torques = [multisine(6000, SAMPLE_TIME, low, high, size * LEVEL, rng) for low, high, size in bands]
    fast = [run(HEALTHY, torque, seed) for seed, torque in enumerate(torques)]
    read = fit(UNKNOWN, [_logged_now_and_then(r) for r in fast])
    assert read.error < 1.3 * read.floor and not read.habit
    held = fit(UNKNOWN, [replace(_logged_now_and_then(r), sensed=False) for r in fast])
    assert held.error > read.error
    older = fit(UNKNOWN, [_logged_now_and_then(r, age=2) for r in fast])
    assert older.plant.provenance["clock_skew"] == pytest.approx(-2 * SAMPLE_TIME, abs=0.5 * SAMPLE_TIME)


@pytest.mark.parametrize("missing", ["flexible_coupling", "gravity"])
def test_an_effect_does_not_become_a_habit_of_the_log(missing: str) -> None:
    coupling = {"inertia": 0.3 * J, "frequency": 90.0, "damping": 0.05}
    hidden = effects.find(missing)(**(coupling if missing == "flexible_coupling" else {"amplitude": LEVEL}))
    found = fit(UNKNOWN, runs(HEALTHY + hidden))
    assert found.error > 3 * found.floor and not found.habit


def test_a_record_may_begin_in_the_middle_of_a_motion() -> None:
    whole = runs(HEALTHY)
    cut = [r.slice(1200, len(r)) for r in whole]
    known = fit(UNKNOWN, cut)
    assert known.error < 1.2 * known.floor
    # Taken as never moved, the elements are wrong until they have slipped.
    misfit = Misfit(HEALTHY, observe(cut, J), memory=False)
    unknown = misfit.residual(misfit.vector(HEALTHY))
    assert rms(unknown) > 2 * rms(known.misfit.residual(known.vector))


def test_a_load_may_swing_where_a_record_begins() -> None:
    """Behind a coupling that hardly damps it goes on for half a second, which had all been taken for friction."""
    truth = HEALTHY + effects.FlexibleCoupling(inertia=J / 3, frequency=30, damping=0.02)
    rr = [r.slice(round(0.3 / SAMPLE_TIME), round(1.3 / SAMPLE_TIME)) for r in runs(truth)]
    rr = [replace(r, time=r.time - r.time[0]) for r in rr]
    found = fit(UNKNOWN + effects.FlexibleCoupling(), rr)
    assert found.error < 1.1 * found.floor
    assert found.plant["flexible_coupling"].damping == pytest.approx(0.02, rel=0.05)


def test_the_result_says_what_happened(fitted: FitResult) -> None:
    assert fitted.status == (
        f"torque error {100 * fitted.error:.2f} % of the torque up to 100 Hz, noise floor {100 * fitted.floor:.2f} %"
    )
    said, observations = fitted.plant.provenance, fitted.misfit.observations
    assert said["records"] == ["fit_0", "fit_1", "fit_2"] and said["version"] == f"gms_mujoco {gms.__version__}"
    assert said["error"] == fitted.error and said["noise_floor"] == fitted.floor and said["bandwidth"] == 100.0
    residual = np.split(fitted.misfit.residual(fitted.vector), fitted.misfit.splits)
    assert fitted.error == pytest.approx(relative_error(residual, [o.applied(HEALTHY) for o in observations]))


def test_a_fit_is_the_same_every_time(fitted: FitResult) -> None:
    again = fit(UNKNOWN, runs(HEALTHY))
    assert again.plant == fitted.plant and again.plant.uncertainty == fitted.plant.uncertainty


def test_progress_runs_forward_to_its_end() -> None:
    told: list[tuple[float, str]] = []
    found = fit(Plant.axis(J) + effects.Viscous(), runs(DRAG), progress=lambda done, text: told.append((done, text)))
    shares = [done for done, _ in told]
    assert shares == sorted(shares) and shares[0] >= 0 and told[-1] == (1.0, found.status)


def test_what_cannot_be_fitted_is_said() -> None:
    rr = runs(HEALTHY, seconds=1.0)
    with pytest.raises(DataError, match="no records"):
        fit(UNKNOWN, [])
    with pytest.raises(ModelError, match=r"a plant is expected before the data, .*; list given"):
        fit(rr, UNKNOWN)  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"the data are a list .*; Record given"):
        fit(UNKNOWN, rr[0])  # type: ignore[arg-type]
    with pytest.raises(DataError, match="int among them"):
        fit(UNKNOWN, [3])  # type: ignore[list-item]
    with pytest.raises(DataError, match=r"'data/dataset\.toml' given"):
        fit(UNKNOWN, "data/dataset.toml")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match=r"no parameter 'gms\.level'; its parameters are gms\.attraction, "):
        fit(UNKNOWN, rr, fixed=["gms.level"])
    with pytest.raises(ModelError, match=r"fixed leaves .* and gms\.coulomb has none"):
        fit(UNKNOWN, rr, fixed=["gms.coulomb"])
    with pytest.raises(ModelError, match=r"as in \['inertia'\]"):
        fit(UNKNOWN, rr, fixed="inertia")
    with pytest.raises(ModelError, match=r"GMS is a kind of effect; .* GMS\(\)"):
        Plant.axis(J) + effects.GMS  # type: ignore[operator]


@pytest.mark.parametrize("bandwidth", [-3.0, 0.0, math.nan, math.inf, 1e-3, 0.5])
def test_a_band_that_shows_nothing_is_refused(bandwidth: float) -> None:
    with pytest.raises(DataError, match=r"a bandwidth is a positive number of Hz|too short for a bandwidth of"):
        fit(UNKNOWN, runs(HEALTHY, seconds=1.0), bandwidth=bandwidth)


@pytest.mark.parametrize("samples", [16, 19, 20, 23, 24, 30])
def test_a_record_that_is_too_short_is_named_or_else_serves(samples: int) -> None:
    first, second = runs(HEALTHY, seconds=0.5)[:2]
    few = second.slice(100, 100 + samples, name="few.csv")
    for look in (lambda: fit(UNKNOWN, [first, few]), lambda: gms.compare(DRAG, [first, replace(few, use="validate")])):
        try:
            look()
        except DataError as error:
            assert f"few.csv: {few.time[-1] - few.time[0]:.3g} s in {samples} samples are too short" in str(error)


def test_a_band_ends_with_what_the_samples_can_tell() -> None:
    rr = runs(HEALTHY, seconds=1.0)
    assert fit(UNKNOWN, rr, bandwidth=1e9).plant.provenance["bandwidth"] == 0.5 / SAMPLE_TIME


def test_the_default_baseline() -> None:
    plant = baseline(J, "slide")
    assert [e.name for e in plant.effects] == ["gms", "viscous"] and plant.kind == "slide" and plant.inertia == J
    assert plant["gms"].elements == 8 and set(plant["gms"].unset) >= {"stiffness", "coulomb", "static"}
    assert baseline().unset[0] == "inertia"


def test_relative_error_weighs_records_equally() -> None:
    one, two = np.full(1000, 0.1), np.full(10, 0.7)
    assert relative_error([one, two], [np.ones(1000), np.ones(10)]) == pytest.approx(math.sqrt((0.01 + 0.49) / 2))
    assert math.isnan(relative_error([one], [np.zeros(1000)]))


def test_blocks_hold_everything_once_and_end_with_their_record() -> None:
    observations = [Observation(r, 100.0) for r in runs(HEALTHY, seconds=2.3)]
    lengths = [len(o.index) for o in observations]
    ones = np.ones((sum(lengths), 1))
    sums = block_sums(observations, ones, 0.5)[:, 0]
    per = int(0.5 / (observations[0].stride * SAMPLE_TIME))
    assert sums.sum() == len(ones) and sums.min() >= per
    counts = [n // per for n in lengths]
    assert len(sums) == sum(counts)
    assert [s.sum() for s in np.split(sums, np.cumsum(counts)[:-1])] == lengths


def test_the_solver_stays_within_bounds_and_finds_the_best_there() -> None:
    """An axis that is pushed on by its drag: the coefficient, which may not be negative, ends on its bound."""
    records = runs(Plant.axis(J) + effects.TorqueOffset(torque=1e-4))
    push = [-1e-5 * np.gradient(r.position, SAMPLE_TIME) for r in records]
    driven = [replace(r, signals={**r.signals, "torque": r.torque + p}) for r, p in zip(records, push, strict=True)]
    found = fit(Plant.axis(J) + effects.Viscous(), driven)
    assert found.plant["viscous"].coefficient == 0
    assert found.plant.uncertainty["viscous.coefficient"][0] == 0


def test_the_solver_goes_downhill(fitted: FitResult) -> None:
    misfit = fitted.misfit
    start = misfit.vector(HEALTHY.replace(effects.Viscous(coefficient=4e-5)))
    ends = [rms(misfit.residual(solve(misfit, start, n))) for n in (0, 1, 3, 10)]
    assert ends == sorted(ends, reverse=True) and ends[0] > 1.5 * ends[-1]


def test_a_search_that_cannot_come_below_what_is_of_use_is_given_up(fitted: FitResult) -> None:
    """One that can goes on as if nobody had asked."""
    misfit = fitted.misfit
    start = misfit.vector(HEALTHY.replace(effects.Viscous(coefficient=4e-5)))
    costs = [misfit.cost(solve(misfit, start, below=b * misfit.cost(fitted.vector))) for b in (0.3, 1.01, math.inf)]
    assert costs[0] >= costs[1] == costs[2]


def test_a_coarse_look_leads_near_and_not_away(fitted: FitResult) -> None:
    misfit = Misfit(fitted.misfit.coordinates.template, fitted.misfit.observations)
    far = misfit.vector(HEALTHY.replace(effects.Viscous(coefficient=4e-4)))
    assert misfit.cost(approach(misfit, far, 20)) < 0.01 * misfit.cost(far)
    np.testing.assert_array_equal(approach(misfit, fitted.vector, 20), fitted.vector)  # its error is more than is left


def test_what_a_coarse_look_rules_out_is_not_looked_at_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = HEALTHY + effects.TorqueOffset(torque=0.5 * LEVEL)
    misfit = Misfit(HEALTHY, observe(runs(plant, seconds=1.5), J))
    exact, whole = [], Misfit.jacobian
    monkeypatch.setattr(Misfit, "jacobian", lambda m, *a: exact.append(not m.coarse) or whole(m, *a))
    x = nudge(misfit, misfit.vector(HEALTHY))
    assert exact and not any(exact), "the coarse look errs by next to nothing of what is left"
    exact.clear()
    nudge(true := Misfit(plant, misfit.observations), true.vector(plant))
    assert any(exact)
    exact.clear()
    nudge(misfit, misfit.vector(HEALTHY), below=0.3 * misfit.cost(x))
    assert exact and not any(exact)
    np.testing.assert_array_less(misfit.cost(nudge(misfit, x, below=1.1 * misfit.cost(x))), 1.01 * misfit.cost(x))


def test_a_fit_is_finished_with_its_intervals() -> None:
    misfit = Misfit(HEALTHY, observe(runs(HEALTHY, seconds=1.0), J))
    near = refine(misfit, misfit.vector(HEALTHY))
    whole = finished(near)
    assert not near.plant.uncertainty and {"gms.coulomb", "viscous.coefficient"} <= set(whole.plant.uncertainty)
    fine = misfit.on_grids(whole.vector, 10.0)
    assert fine.cost(whole.vector) <= fine.cost(near.vector)


def test_the_end_of_a_fit_leaves_no_more_than_its_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Less on the instants of where it began may be more on its own, where friction jumps."""
    misfit = Misfit(HEALTHY, observe(runs(HEALTHY, seconds=1.0), J))
    near = refine(misfit, misfit.vector(HEALTHY)).vector
    worse = misfit.vector(HEALTHY.replace(effects.Viscous(coefficient=4e-5)))
    monkeypatch.setattr("gms_mujoco.identification.refine.solve", lambda *a, **k: worse)
    there = finish(misfit, near).vector
    assert misfit.on_grids(there, 10.0).cost(there) <= misfit.on_grids(near, 10.0).cost(near)


def test_a_fit_that_is_far_behind_after_a_few_steps_is_not_followed(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    followed, whole = [], to_end
    monkeypatch.setattr(sys.modules["gms_mujoco.fit"], "to_end", lambda *a: followed.append(a) or whole(*a))
    seen, cost = fitted.misfit.observations, fitted.misfit.cost(fitted.vector)
    far = fit_observations(HEALTHY, seen, below=0.01 * cost)
    assert not followed and far.misfit.cost(far.vector) > 0.04 * cost
    near = fit_observations(HEALTHY, seen, below=1.1 * cost)
    assert followed and near.misfit.cost(near.vector) < 1.1 * cost


def test_the_covariance_is_symmetric_and_positive(fitted: FitResult) -> None:
    c, deviations = covariance(fitted.misfit, fitted.vector)
    assert np.all(deviations >= 1.959)
    np.testing.assert_allclose(c, c.T, rtol=1e-6, atol=1e-12 * np.abs(c).max())
    assert np.all(np.diag(c) >= 0)


def test_a_saturation_does_not_hide_all_that_a_drive_was_asked_for() -> None:
    """With an inertia to be identified, a torque cut off to nothing would leave no error at all."""
    rng = np.random.default_rng(0)
    truth = Plant.axis(2.4e-5) + effects.find("coulomb")(coulomb=4e-3) + effects.find("gravity")(amplitude=0.2)
    record = simulate(truth, multisine(3000, 1e-3, 0.5, 20.0, 0.1, rng), 1e-3)
    blind = Plant.axis() + effects.find("coulomb")(coulomb=4e-3) + effects.find("torque_saturation")(limit=0.1)
    found = fit(blind, [record]).plant
    assert found["torque_saturation"].limit >= 0.99 * np.median(np.abs(record.torque))


@pytest.mark.parametrize("off", [np.pi, 3.6])
def test_a_harmonic_that_is_given_with_a_phase_far_off_is_found(off: float) -> None:
    """The strength of one that acts the other way round goes to zero, and no step leads on from there."""
    true = effects.Cogging(harmonics=[7], amplitude=[LEVEL], phase=[0.4])
    found = fit(HEALTHY + true.replace(phase=[0.4 + off]), runs(HEALTHY + true)).plant["cogging"]
    assert found.amplitude == pytest.approx(true.amplitude, rel=0.01)
    assert np.cos(np.subtract(found.phase, true.phase)) == pytest.approx(1.0, abs=1e-3)


def _asked(plant: Plant, whole: Dataset) -> list[Callable[[], object]]:
    return [lambda: compare(plant, whole.all), lambda: fit(plant, whole.fit), lambda: diagnose(whole, plant)]


@pytest.mark.parametrize("verb", range(3), ids=["compare", "fit", "diagnose"])
def test_a_plant_of_the_other_kind_of_joint_is_refused(verb: int) -> None:
    slide = Plant.axis(1.5, "slide") + effects.Coulomb(coulomb=4.0)
    unsaid = [replace(r, kind=None) for r in runs(DRAG, seconds=0.5)]
    for records in (unsaid, runs(DRAG, seconds=0.5)):
        whole = Dataset(Path(), tuple(records))
        with pytest.raises(DataError, match="a record of a hinge joint, where a slide joint is asked for"):
            _asked(slide, whole)[verb]()
    assert compare(DRAG, unsaid).torque_error < 1  # where nobody has said it, nothing is asked


@pytest.mark.parametrize("verb", range(3), ids=["compare", "fit", "diagnose"])
def test_a_load_heavier_than_the_axis_is_refused_where_that_is_known(verb: int) -> None:
    heavy = DRAG + effects.Backlash(inertia=2 * J, gap=0.1, frequency=50.0)
    with pytest.raises(ModelError, match=r"backlash must have less inertia than the axis, 2\.4e-05"):
        _asked(heavy, Dataset(Path(), tuple(runs(DRAG, seconds=0.5))))[verb]()
    assert replace(heavy, inertia=None).light_loads().inertia is None
