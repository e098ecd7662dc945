"""Views of the residual: noise stays in its bands, and each cause shows in the view where it acts."""

from dataclasses import replace

import numpy as np
import pytest
from bench import COUNT, HEALTHY, HIDDEN, LEVEL, J, run, runs, slow

from gms_mujoco import effects
from gms_mujoco.compare import Comparison, compare
from gms_mujoco.comparison.residual_maps import ResidualMap
from gms_mujoco.comparison.residuals import Residuals
from gms_mujoco.effect import Effect
from gms_mujoco.identification.noise import Noise, sensor_residual
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

MEANS = ("position", "revolution", "velocity", "acceleration", "torque", "torque_rate", "since_reversal",
         "time_since_reversal")  # fmt: skip


def _of(true: Plant, plant: Plant = HEALTHY, seconds: float = 3.0) -> Comparison:
    return compare(plant, runs(true, "validate", seconds, seed=11))


def _best(c: Comparison) -> ResidualMap:
    return max((m for m in c.views if m.name in MEANS), key=lambda m: m.share)


def _shows(c: Comparison, name: str) -> ResidualMap:
    found = c.view(name)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def healthy() -> Comparison:
    return _of(HEALTHY)


@pytest.fixture(scope="module")
def drawn() -> list[ResidualMap]:
    """Views of records whose residual is sensor noise and nothing else, from several draws of motion and noise."""
    noise = Noise(2e-5, 1.9e-6, COUNT)
    out: list[ResidualMap] = []
    for seed in range(8):
        c = compare(HEALTHY, runs(HEALTHY, "validate", seed=30 + seed))
        rng = np.random.default_rng(seed)
        records = []
        for r in c.records:
            one, other = (sensor_residual(r.observation, HEALTHY, r.memory, noise, rng) for _ in range(2))
            records.append(replace(r, measured=r.needed + one, floor=other, sampling=0 * other))
        out += Residuals(HEALTHY, records).views()
    return out


def test_the_hysteresis_has_one_value_where_a_joint_holds(healthy: Comparison) -> None:
    """Most of its samples lie at the same few distances from the reversal, then."""
    residuals = Residuals(HEALTHY, healthy.records)
    held = [replace(s, distance=np.ceil(s.distance / 0.02) * 0.02) for s in residuals._swings]
    residuals.__dict__["_swings"] = held
    found = residuals.after_reversal()
    assert found is not None
    distance, measured, needed = found
    assert (np.diff(distance) > 0).all() and np.isfinite(measured).all() and np.isfinite(needed).all()
    assert {*distance.round(9)} <= {*np.concatenate([s.distance for s in held]).round(9)}


@pytest.mark.parametrize("name", ["position", "revolution", "velocity", "acceleration", "since_reversal", "time"])
def test_of_noise_the_nominal_share_of_bins_lies_outside(drawn: list[ResidualMap], name: str) -> None:
    outside = np.concatenate([m.outside for m in drawn if m.name == name])
    assert len(outside) > 250
    # 1 % of them; neighbours are correlated, hence wider than binomial
    assert 0 <= outside.mean() < 0.035, outside.mean()


def test_of_all_means_together_about_one_in_a_hundred(drawn: list[ResidualMap]) -> None:
    outside = np.concatenate([m.outside for m in drawn if m.name in (*MEANS, "time", "frequency")])
    assert 0.003 < outside.mean() < 0.02, outside.mean()


@pytest.mark.parametrize("bench", [{}, *slow({"resolution": 50 * COUNT}, {"torque_noise": 2e-6})],
                         ids=["as it is", "coarse encoder", "quiet drive"])  # fmt: skip
def test_a_healthy_axis_with_noise_read_off_its_records_lies_outside_as_often(bench: dict) -> None:
    views = [m for seed in range(70, 94) for m in compare(HEALTHY, runs(HEALTHY, "validate", seed=seed, **bench)).views]
    for names in (MEANS, ("time",), ("frequency",), ("autocorrelation",), ("revolution_harmonic",)):
        outside = np.concatenate([m.outside for m in views if m.name in names])
        assert outside.mean() < 0.05, names
    # 1 % were the noise known; it is estimated from the records that it disturbs.
    assert np.concatenate([m.outside for m in views]).mean() < 0.025


def test_the_band_is_as_wide_as_the_scatter_of_the_means(drawn: list[ResidualMap]) -> None:
    for name in ("velocity", "time", "position"):
        z = np.concatenate([m.mean / m.band for m in drawn if m.name == name])
        assert 2.576 * np.std(z) == pytest.approx(1.0, abs=0.3), name


def test_noise_is_a_function_of_nothing(drawn: list[ResidualMap]) -> None:
    assert max(m.share for m in drawn if m.name in MEANS) < 0.1


def test_noise_has_the_correlations_of_noise(drawn: list[ResidualMap]) -> None:
    for name in ("autocorrelation", "input_correlation", "revolution_harmonic", "frequency"):
        outside = np.concatenate([m.outside for m in drawn if m.name == name])
        assert outside.mean() < 0.04, name


def test_a_healthy_axis_stays_in_its_bands(healthy: Comparison) -> None:
    assert "stays within its noise band" in healthy.where
    assert max(m.share for m in healthy.views if m.name in MEANS) < 0.15  # not worth a word


@pytest.mark.parametrize(
    ("hidden", "view", "share"),
    [
        (HIDDEN["cogging"], "revolution", 0.8),
        (HIDDEN["gravity"], "revolution", 0.8),
        (HIDDEN["quadratic_drag"], "velocity", 0.7),
        (HIDDEN["delay"], "torque_rate", 0.8),
        (effects.Spring(stiffness=LEVEL / 20), "position", 0.8),
        (effects.TorqueSaturation(limit=2 * LEVEL), "torque", 0.6),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_a_hidden_effect_shows_where_it_acts(hidden: Effect, view: str, share: float) -> None:
    c = _of(HEALTHY + hidden)
    assert _best(c).name == view and _shows(c, view).share > share
    assert _shows(c, view).outside.mean() > 0.3
    assert c.where.startswith("the residual leaves its noise band mostly with") and _shows(c, view).label in c.where


@pytest.mark.parametrize(("name", "harmonic"), [("cogging", 6), ("gravity", 1)])
def test_the_harmonic_of_the_revolution_is_named(name: str, harmonic: int) -> None:
    c = _of(HEALTHY + HIDDEN[name])
    tones = _shows(c, "revolution_harmonic")
    assert int(tones.centres[np.argmax(tones.mean)]) == harmonic
    assert tones.outside[harmonic - 1] and f"({harmonic} per revolution" in c.where


@pytest.mark.parametrize(
    ("true", "view"),
    [
        (HEALTHY.replace(HEALTHY["gms"].replace(coulomb=1.2 * LEVEL, static=6e-3)), "since_reversal"),
        (HEALTHY.replace(HEALTHY["gms"].replace(stiffness=[1.0, 0.2])), "since_reversal"),
        (HEALTHY.replace(effects.Viscous(coefficient=6e-5)), "velocity"),
        (replace(HEALTHY, inertia=1.1 * J), "acceleration"),
    ],
    ids=["level", "stiffness", "drag", "inertia"],
)
def test_a_wrong_parameter_shows_where_it_acts(true: Plant, view: str) -> None:
    assert _best(_of(true)).name == view


def test_too_little_friction_is_positive_along_the_motion() -> None:
    c = _of(HEALTHY.replace(HEALTHY["gms"].replace(coulomb=1.2 * LEVEL, static=6e-3)))
    m = _shows(c, "since_reversal")
    assert m.along and m.mean[-10:] == pytest.approx(0.2 * LEVEL, rel=0.15)


def test_an_offset_is_said() -> None:
    where = _of(HEALTHY + HIDDEN["torque_offset"]).where
    assert "mostly as an offset of" in where
    # In pre-sliding the unknown state before the record hides a part of it.
    assert -float(where.split("offset of ")[1].split(" N m")[0]) == pytest.approx(0.15 * LEVEL, rel=0.15)


def test_a_resonance_is_said_with_its_frequency() -> None:
    coupled = HEALTHY + effects.FlexibleCoupling(inertia=0.4 * J, frequency=40.0, damping=0.02)
    where = _of(coupled).where
    assert "mostly near" in where
    # Seen from the motor the torque peaks where the load alone swings on the coupling.
    said = float(where.split("near ")[1].split(" Hz")[0])
    assert 30 < said < 65


def test_load_and_temperature_have_views_where_they_are_recorded(healthy: Comparison) -> None:
    assert healthy.view("load") is None and healthy.view("temperature") is None
    t = 1e-3 * np.arange(4000)
    load, warm = LEVEL * (1 + np.sin(2 * np.pi * 0.9 * t)), 20 + 5 * t
    command = 3 * LEVEL * np.sin(2 * np.pi * 1.3 * t)
    true = HEALTHY + effects.LoadDependentFriction(coefficient=100.0)
    record = simulate(true, command, 1e-3, load=load, temperature=warm, substeps=20, torque_noise=2e-5, seed=0)
    c = compare(HEALTHY, [record])
    assert c.view("temperature") is not None
    m = _shows(c, "load")
    slope = np.polyfit(m.centres[m.count > 20], m.mean[m.count > 20], 1)[0]
    assert slope == pytest.approx(100 * LEVEL, rel=0.2)


def test_a_slide_has_no_revolutions() -> None:
    plant = Plant.axis(1.0, "slide") + effects.Coulomb(coulomb=2.0)
    t = 1e-3 * np.arange(3000)
    c = compare(plant, [simulate(plant, 30 * np.sin(2 * np.pi * t), 1e-3, torque_noise=0.01, seed=0)])
    assert c.view("revolution") is None and c.view("revolution_harmonic") is None
    assert _shows(c, "velocity").unit == "m/s" and _shows(c, "velocity").value_unit == "N"


def test_harmonics_of_a_periodic_excitation_tell_odd_from_even() -> None:
    t = 1e-3 * np.arange(8000)
    command = 4 * LEVEL * np.sin(2 * np.pi * 2 * t)
    details = {}
    for name, true in {
        "odd": HEALTHY.replace(HEALTHY["gms"].replace(coulomb=1.3 * LEVEL, static=6.5e-3)),
        "even": HEALTHY + effects.AsymmetricFriction(level=0.3),
    }.items():
        m = compare(HEALTHY, [run(true, command, name="sine")]).view("time_harmonic", "sine")
        assert m is not None and m.label == "harmonic of 2 Hz"
        details[name] = m
    odd, even = details["odd"], details["even"]
    assert (odd.mean[::2] ** 2).sum() > 20 * (odd.mean[1::2] ** 2).sum(), odd.detail
    assert odd.outside[0] and odd.mean[0] == pytest.approx(4 / np.pi * 0.3 * LEVEL, rel=0.1)
    assert even.mean[1::2].sum() / odd.mean[1::2].sum() > 2 or "even" in even.detail


def test_shares_of_regimes_add_up(healthy: Comparison) -> None:
    for share in ("time_share", "square_share"):
        assert sum(getattr(g, share) for g in healthy.regimes) == pytest.approx(1.0)
    assert [g.name for g in healthy.regimes] == ["pre-sliding", "reversal", "sliding"]


def test_stiffness_errors_stand_in_pre_sliding() -> None:
    c = _of(HEALTHY.replace(HEALTHY["gms"].replace(stiffness=[1.0, 0.2])))
    worst = max(c.regimes, key=lambda g: g.error)
    assert worst.name == "pre-sliding" and "stands in pre-sliding" in c.where


def test_a_record_of_nothing_has_views_without_nan() -> None:
    still = run(HEALTHY, np.zeros(2000))
    c = compare(HEALTHY, [still])
    for m in c.views:
        assert np.isfinite([m.centres, m.mean, m.expected, m.band]).all(), m.name
    assert c.where
