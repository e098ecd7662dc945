"""Friction from the Dahl resonance, against Maxwell-slip sets that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from gms_mujoco import effects
from gms_mujoco.dahl_resonance import (
    describing_function,
    harmonic_part,
    identify_dahl,
    read_resonances,
    virgin_curve,
)
from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF
from gms_mujoco.plant import Plant
from gms_mujoco.responses.resonance import Resonance, find_resonance, mass_line, secant_curve, slope_curve
from gms_mujoco.sweep import stepped_sine

J, LEVEL = 2.4e-5, 4.5e-3
Set = tuple[np.ndarray, np.ndarray]


def random_set(seed: int, elements: int = 6) -> Set:
    """Stiffnesses and break-away distances from 1e-4 to 1e-2 rad."""
    rng = np.random.default_rng([11, seed])
    distance = np.sort(np.exp(rng.uniform(np.log(1e-4), np.log(1e-2), elements)))
    return LEVEL * rng.dirichlet(np.ones(elements)) / distance, distance


def plant_of(true: Set, drag: float = 2e-5) -> Plant:
    k, x = true
    level = k @ x
    gms = effects.find("gms")(
        stiffness=k, fraction=k * x / level, coulomb=level, static=level, stribeck_velocity=1.0, attraction=level
    )
    return Plant.axis(J) + gms + effects.find("viscous")(coefficient=drag)


def ideal(true: Set, noise: float = 0.0, seed: int = 0) -> list[Resonance]:
    rng = np.random.default_rng([12, seed])
    size = np.geomspace(0.5 * true[1].min(), 2 * true[1].max(), 12)
    k = describing_function(*true, size)
    omega = np.sqrt(k.real / J) * (1 + noise * rng.standard_normal(12))
    loss = k.imag / k.real * (1 + noise * rng.standard_normal(12))
    return [Resonance(a, w / 2 / np.pi, e * J * w**2) for a, w, e in zip(size, omega, loss, strict=True)]


def error(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))


def distances(largest: float) -> np.ndarray:
    return np.linspace(0, largest, 301)[1:]


# The formulas.


@pytest.mark.parametrize("ratio", [0.05, 0.4, 0.9, 1.0, 3.0])
def test_describing_function_is_the_integral_over_the_loop(ratio: float) -> None:
    """The loop from Masing's rule: from each reversal the element stretches by up to twice its break-away distance."""

    def force(angle: float) -> float:  # of a spring of 1 on the motion cos(angle)
        if ratio >= 1:
            return float(np.cos(angle))
        if angle < np.pi:
            return float(max(ratio - (1 - np.cos(angle)), -ratio))
        return float(min(-ratio + (1 + np.cos(angle)), ratio))

    kink = float(np.arccos(1 - 2 * min(ratio, 1)))
    options = {"points": [kink, np.pi, np.pi + kink], "limit": 200}
    real = quad(lambda a: force(a) * np.cos(a), 0, 2 * np.pi, **options)[0] / np.pi
    imag = -quad(lambda a: force(a) * np.sin(a), 0, 2 * np.pi, **options)[0] / np.pi
    found = describing_function(np.array([1.0]), np.array([ratio]), np.array([1.0]))[0]
    assert found == pytest.approx(real + 1j * imag, abs=1e-7)


def test_virgin_curve_is_that_of_the_native_effect() -> None:
    true = random_set(0)
    push = np.linspace(0, 0.02, 4001)
    plant = Plant.axis(J) + plant_of(true)["gms"]
    time = 1e-3 * np.arange(len(push))
    replayed = plant.joint().replay(time, push, np.gradient(push, 1e-3)).torque
    assert np.allclose(-replayed, virgin_curve(*true, push), atol=2e-3 * LEVEL)


# Ideal resonances.


def test_ideal_resonances_give_the_virgin_curve() -> None:
    scores = []
    for seed in range(20):
        true = random_set(seed)
        found = ideal(true)
        x = distances(found[-1].amplitude)
        curve = virgin_curve(*true, x)
        guesses = (read_resonances(found, J).virgin_curve(x), secant_curve(found, J, x), slope_curve(found, J, x))
        scores.append([error(g, curve) for g in guesses])
    ours, secant, slope = np.median(scores, 0)
    assert ours < 0.006 and secant > 20 * ours and slope > 2 * secant


def test_noise_of_three_percent_costs_two() -> None:
    scores = []
    for seed in range(50):
        true = random_set(seed)
        found = ideal(true, 0.03, seed)
        x = distances(found[-1].amplitude)
        scores.append(error(read_resonances(found, J).virgin_curve(x), virgin_curve(*true, x)))
    assert np.median(scores) < 0.02


def test_one_element_comes_back() -> None:
    true = (np.array([1.5]), np.array([3e-3]))
    reading = read_resonances(ideal(true), J)
    assert reading.stiffness.sum() == pytest.approx(1.5, rel=5e-3)
    assert reading.stiffness @ reading.breakaway == pytest.approx(4.5e-3, rel=5e-3)
    assert reading.plant["gms"].static == pytest.approx(4.5e-3, rel=5e-3)


def test_viscous_drag_is_told_from_friction() -> None:
    true = random_set(5)
    found = [
        Resonance(r.amplitude, r.frequency, r.dissipation + 1e-4 * 2 * np.pi * r.frequency) for r in ideal(true)
    ]
    reading = read_resonances(found, J)
    assert reading.viscous == pytest.approx(1e-4, rel=0.25)


def test_what_never_slipped_is_told() -> None:
    true = (np.array([1.0, 2.0]), np.array([1e-3, 1.0]))
    size = np.geomspace(1e-4, 1e-2, 10)
    k = describing_function(*true, size)
    found = [Resonance(a, np.sqrt(c.real / J) / 2 / np.pi, c.imag) for a, c in zip(size, k, strict=True)]
    reading = read_resonances(found, J)
    assert reading.stuck == pytest.approx(2.0, rel=0.01) and "lower bound" in reading.status


# Simulated experiments, which know nothing of describing functions.


def swept(true: Set, held: str, drag: float = 2e-5, **bench: object) -> list[FRF]:
    plant = plant_of(true, drag)
    stuck = np.sqrt(true[0].sum() / J) / (2 * np.pi)
    if held == "torque":
        grid = np.geomspace(0.1 * stuck, min(4 * stuck, 450), 20)
        return [stepped_sine(plant, grid, u, held=held, **bench) for u in np.geomspace(0.05, 1.5, 8) * LEVEL]
    out = []
    for a in np.geomspace(max(0.5 * true[1].min(), 1e-4), 2 * true[1].max(), 8):
        own = np.sqrt(describing_function(*true, np.array([a])).real[0] / J) / (2 * np.pi)
        out.append(stepped_sine(plant, np.geomspace(0.6 * own, min(8 * own, 450), 14), a, held=held, **bench))
    return out


@pytest.mark.parametrize("held", ["position", "torque"])
def test_stepped_sines_give_curve_inertia_and_drag(held: str) -> None:
    """At 2 kHz through an encoder of 10^6 counts, nothing known."""
    true = random_set(1)
    reading = identify_dahl(swept(true, held, 2e-4, resolution=2 * np.pi / 1e6, torque_noise=2e-5))
    x = distances(min(reading.amplitude[1], 2 * true[1].max()))
    assert error(reading.virgin_curve(x), virgin_curve(*true, x)) < 0.02
    assert reading.inertia == pytest.approx(J, rel=2e-3)
    assert reading.viscous == pytest.approx(2e-4, rel=0.1)
    assert not reading.plant.inertia_known and reading.plant.complete()


def test_the_identified_axis_gives_its_responses_back() -> None:
    true = random_set(2)
    frfs = swept(true, "position")
    again = identify_dahl(frfs).plant
    for frf in frfs[::3]:
        assert frf.excitation is not None
        for i in (2, 7, len(frf) - 2):
            one = stepped_sine(again, [frf.frequency[i]], float(frf.excitation[i]), held="torque")
            assert abs(one.response[0] / frf.response[i] - 1) < 0.03


def test_harmonics_change_the_fundamental_as_in_simulation() -> None:
    true = random_set(3)
    size = np.array([float(true[1].mean())])
    own = np.sqrt(describing_function(*true, size).real[0] / J) / (2 * np.pi)
    frf = stepped_sine(plant_of(true), [0.8 * own], float(size[0]), held="position")
    assert frf.amplitude is not None
    plain = describing_function(*true, frf.amplitude) + 2e-5j * frf.omega - J * frf.omega**2
    extra, balanced = harmonic_part(*true, J, 2e-5, frf.amplitude, frf.omega)
    assert balanced.good.all()
    gap = np.abs(1 / frf.response - plain)
    assert np.abs(1 / frf.response - plain - extra) < 0.1 * gap


# Parts.


def linear(frequency: np.ndarray, spring: float = 0.5, drag: float = 1e-3, inertia: float = J) -> FRF:
    s = 2j * np.pi * frequency
    return FRF("linear", frequency, 1 / (inertia * s**2 + drag * s + spring), amplitude=np.full(len(s), 1e-4))


def test_resonance_and_mass_line_of_a_linear_axis() -> None:
    frf = linear(np.geomspace(5, 400, 40))
    found = find_resonance(frf)
    assert found is not None
    assert found.stiffness(J) == pytest.approx(0.5, rel=1e-6)
    assert found.dissipation == pytest.approx(1e-3 * 2 * np.pi * found.frequency, rel=2e-2)
    inertia, sigma = mass_line([frf, linear(frf.frequency, spring=0.3)])
    assert inertia == pytest.approx(J, rel=1e-6) and sigma < 1e-6 * J


def test_no_resonance_is_none_and_no_mass_line_is_told() -> None:
    assert find_resonance(linear(np.geomspace(100, 400, 10))) is None
    with pytest.raises(DataError, match="higher frequencies"):
        mass_line([linear(np.geomspace(5, 40, 10))])


def test_data_that_cannot_tell_are_refused() -> None:
    frf = linear(np.geomspace(5, 400, 20))
    for frfs, words in (
        ([], "no frequency responses"),
        ([frf], "same amplitude"),
        (frf, "same amplitude"),
        (["a"], "frequency responses are expected, .*; str given"),
        ([replace(frf, response=frf.response / np.abs(frf.response), excitation=np.linspace(1, 2, 20), amplitude=None)],
         "linear: no friction is seen: .* are units"),
        ([replace(frf, sine=False)], "many frequencies at once"),
        ([FRF("a", frf.frequency, frf.response)], "amplitude of the excitation is not known"),
        ([FRF("a", frf.frequency, frf.response, input="voltage")], "torque to position is needed"),
    ):
        with pytest.raises(DataError, match=words):
            identify_dahl(frfs)
    with pytest.raises(DataError, match="the inertia must be a positive number; nan given"):
        identify_dahl([frf], inertia=float("nan"))
    with pytest.raises(DataError, match="at least two"):
        read_resonances([Resonance(1e-3, 20.0, 0.1)], J)
