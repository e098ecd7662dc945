"""simulate: closed forms, what the bench adds, and what it refuses."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

J, C, U = 2e-5, 1e-3, 3e-3  # inertia, viscous coefficient, constant torque
SPAN = 0.1  # s


def _viscous_error(substeps: int) -> float:
    """Largest error [rad] of an axis with viscous drag that starts to turn under a constant torque."""
    record = simulate(Plant.axis(J) + effects.Viscous(coefficient=C), np.full(101, U), SPAN / 100, substeps=substeps)
    tau = J / C
    exact = U / C * (record.time - tau * (1 - np.exp(-record.time / tau)))
    return float(np.abs(record.position - exact).max())


def _spring_error(substeps: int) -> float:
    """Largest error, as a share of the amplitude, of a swing at 5 Hz for half a second."""
    spring = effects.find("spring")(stiffness=J * (2 * np.pi * 5) ** 2)
    record = simulate(Plant.axis(J) + spring, np.zeros(501), 1e-3, position=0.1, substeps=substeps)
    return float(np.abs(record.position / 0.1 - np.cos(2 * np.pi * 5 * record.time)).max())


@pytest.mark.parametrize("velocity", [0.0, -3.0])
def test_a_bare_inertia_under_constant_torque_is_a_parabola(velocity: float) -> None:
    record = simulate(Plant.axis(J), np.full(101, U), SPAN / 100, position=0.4, velocity=velocity)
    exact = 0.4 + velocity * record.time + 0.5 * U / J * record.time**2
    np.testing.assert_allclose(record.position, exact, rtol=1e-10)


def test_a_held_torque_is_a_chain_of_parabolas() -> None:
    u, h = np.random.default_rng(0).normal(0, U, 200), 1e-3
    record = simulate(Plant.axis(J), u, h)
    v = np.concatenate([[0], np.cumsum(u * h / J)])[:-1]
    q = np.concatenate([[0], np.cumsum(v * h + 0.5 * u / J * h**2)])[:-1]
    np.testing.assert_allclose(record.position, q, rtol=1e-9, atol=1e-12)


def test_viscous_drag_is_an_exponential() -> None:
    assert _viscous_error(64) < 1e-4 * U / C * SPAN


def test_drag_is_first_order_in_the_time_step_and_a_spring_second() -> None:
    """Semi-implicit Euler, as MuJoCo steps; the reading is taken half a step back, where positions are centred."""
    drag = np.array([_viscous_error(n) for n in (4, 8, 16)])
    spring = np.array([_spring_error(n) for n in (4, 8, 16)])
    np.testing.assert_allclose(drag[:-1] / drag[1:], 2, rtol=0.02)
    np.testing.assert_allclose(spring[:-1] / spring[1:], 4, rtol=0.1)


def test_a_spring_swings_at_its_frequency() -> None:
    assert _spring_error(32) < 1e-6


def test_the_encoder_rounds_to_counts() -> None:
    command = multisine(500, 1e-3, 2, 50, U, np.random.default_rng(0))
    count = 1e-3
    smooth, read = (simulate(Plant.axis(J), command, 1e-3, resolution=r) for r in (None, count))
    counts = read.position / count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(read.position - smooth.position).max() <= count / 2 * (1 + 1e-9)
    assert read.resolution == count and smooth.resolution is None


def test_noise_is_what_was_asked_for_and_comes_again_with_its_seed() -> None:
    command = multisine(4000, 1e-3, 2, 50, U, np.random.default_rng(0))
    clean = simulate(Plant.axis(J), command, 1e-3)
    a, b, c = (
        simulate(Plant.axis(J), command, 1e-3, torque_noise=1e-4, position_noise=1e-5, seed=s) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(a.torque, b.torque)
    np.testing.assert_array_equal(a.position, b.position)
    assert not np.array_equal(a.torque, c.torque)
    assert np.std(a.torque - command) == pytest.approx(1e-4, rel=0.05)
    assert np.std(a.position - clean.position) == pytest.approx(1e-5, rel=0.05)
    np.testing.assert_array_equal(clean.torque, command)  # logged is the command


def test_a_delay_moves_the_motion_and_not_the_command() -> None:
    command = np.concatenate([np.zeros(50), multisine(400, 1e-3, 3, 50, U, np.random.default_rng(0))])
    here, late = (simulate(p, command, 1e-3) for p in (Plant.axis(J), Plant.axis(J) + effects.Delay(time=3e-3)))
    np.testing.assert_allclose(late.position[3:], here.position[:-3], atol=1e-12)
    np.testing.assert_array_equal(late.torque, command)


def test_what_cannot_be_simulated_is_said() -> None:
    with pytest.raises(ModelError, match=r"viscous\.coefficient|inertia"):
        simulate(Plant.axis(), np.zeros(20), 1e-3)
    with pytest.raises(ModelError, match=r"gms\.stiffness"):
        simulate(Plant.axis(J) + effects.GMS(elements=2), np.zeros(20), 1e-3)
    heavy = effects.find("flexible_coupling")
    load = {p.name: J if p.unit == "kg m^2" else 1.0 for p in heavy.parameters}
    with pytest.raises(ModelError, match="flexible_coupling must have less inertia"):
        simulate(Plant.axis(J) + heavy(**load), np.zeros(20), 1e-3)
    with pytest.raises(DataError, match="runs away"):
        simulate(Plant.axis(1e-300), np.full(4000, 1e30), 1.0)


def test_a_multisine_has_its_lines_between_low_and_high() -> None:
    n, h = 2000, 1e-3
    u = multisine(n, h, 5, 60, 0.7, np.random.default_rng(0), lines=30)
    power = np.abs(np.fft.rfft(u)) ** 2
    lines = np.flatnonzero(power > 1e-6 * power.max()) / (n * h)
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.7) and abs(u.mean()) < 1e-12
    assert lines.min() == 5 and lines.max() <= 60 and 15 <= len(lines) <= 30
    np.testing.assert_allclose(power[power > 1e-6 * power.max()], power.max(), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"torque": [0.0, np.nan, 0.0]}, "torque is nan at sample 1, 0.001 s; it must be finite"),
        ({"torque": np.zeros((3, 2))}, "one number for each sample is expected"),
        ({"torque": "x"}, "a torque is one number for each sample; 'x' given"),
        ({"torque": np.array([0.0, 1j, 0.0])}, "torque must be real numbers; complex ones given"),
        ({"load": np.array([0.0, 1j, 0.0])}, "load must be real numbers; complex ones given"),
        ({"sample_time": True}, "needs its sample_time, a positive number"),
        ({"torque_noise": True}, "torque_noise must not be negative; True given"),
        ({"position": "x"}, "position must be a finite number; 'x' given"),
        ({"velocity": np.nan}, "velocity must be a finite number; nan given"),
        ({"sample_time": -1e-3}, "needs its sample_time, a positive number"),
        ({"sample_time": "fast"}, "needs its sample_time, a positive number"),
        ({"substeps": 2.5}, "substeps must be a whole number from 1 on; 2.5 given"),
        ({"substeps": 0}, "substeps must be a whole number from 1 on; 0 given"),
        ({"seed": -1}, "seed must be a whole number from 0 on, or None; -1 given"),
        ({"resolution": -1e-3}, "resolution must not be negative"),
        ({"torque_noise": -1.0}, "torque_noise must not be negative; -1.0 given"),
        ({"position_noise": np.nan}, "position_noise must not be negative; nan given"),
        ({"load": np.zeros(4)}, r"load has shape \(4,\), the torque \(3,\)"),
        ({"temperature": [20.0, np.inf, 20.0]}, "temperature is inf at sample 1"),
    ],
)
def test_an_argument_that_cannot_be_is_told_in_one_line(change: dict, message: str) -> None:
    what = {"plant": Plant.axis(J), "torque": np.zeros(3), "sample_time": 1e-3} | change
    with pytest.raises(DataError, match=message) as error:
        simulate(**what)
    assert "\n" not in str(error.value)


def test_a_plant_is_no_name() -> None:
    with pytest.raises(ModelError, match=r"a Plant is expected.*'servo_axis' given"):
        simulate("servo_axis", np.zeros(3), 1e-3)
