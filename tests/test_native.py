"""Replay and simulation of one axis in the native library."""

import copy
import gc
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gms_mujoco import effects, native, threads
from gms_mujoco.errors import ModelError
from gms_mujoco.plant import Plant

J = 2.4e-5
FC, FS = 4.5e-3, 5.4e-3


def gms(total_stiffness=1.5, static=FS):
    k = np.array([8.0, 4.0, 2.0, 1.0])
    return effects.GMS(
        stiffness=k * total_stiffness / k.sum(), fraction=[0.1, 0.2, 0.3, 0.4], coulomb=FC, static=static,
        stribeck_velocity=0.8, attraction=0.3,
    )


def test_replay_starts_from_the_memory_given():
    joint = (Plant.axis(J) + gms()).joint()
    still = np.zeros(3)
    torque = joint.replay(np.arange(3) * 1e-3, still, still, memory=np.array([1.0, 1.0, -1.0, 0.0])).torque
    assert np.allclose(torque, -FC * (0.1 + 0.2 - 0.3))


@pytest.mark.parametrize("verb", ["replay", "mean"])
@pytest.mark.parametrize("name", ["time", "position", "velocity", "load", "temperature", "memory"])
@pytest.mark.parametrize("wrong", [1.0, np.zeros(2), np.zeros((3, 1))], ids=["scalar", "short", "column"])
def test_arrays_of_another_length_are_refused_by_name(verb, name, wrong):
    joint = (Plant.axis(J) + gms()).joint()
    series = ("time", "position", "velocity", "load", "temperature")
    arrays = {key: np.arange(3.0) for key in series} | {"memory": np.zeros(4)}
    getattr(joint, verb)(**arrays)
    with pytest.raises(ModelError, match=r"has shape \(.*\), expected \("):
        getattr(joint, verb)(**arrays | {name: wrong})


def test_replay_does_not_depend_on_where_time_or_position_begins():
    joint = (Plant.axis(J) + gms()).joint()
    t = np.arange(1000) * 1e-3
    q = 0.05 * np.sin(9 * t)
    v = np.gradient(q, t)
    assert np.allclose(joint.replay(t, q, v).torque, joint.replay(t + 8, q + 4, v).torque, atol=1e-12)


def test_axis_without_effects_is_double_integration():
    h, torque = 1e-3, np.full(500, 2e-3)
    motion = Plant.axis(J).joint().simulate(J, h, torque, position=0.1, velocity=-3.0)
    k = np.arange(500)
    assert np.allclose(motion.velocity, -3 + torque[0] / J * h * k)
    assert np.allclose(motion.position, 0.1 - 3 * h * k + torque[0] / J * h**2 * k * (k + 1) / 2)


@pytest.mark.parametrize("integration", ["explicit", "implicit"])
def test_simulation_converges_with_the_first_order_claimed(integration):
    joint = (Plant.axis(J) + gms() + effects.Viscous(coefficient=2e-5)).joint()
    t = np.arange(400) * 1e-3
    torque = 9e-3 * np.sin(2 * np.pi * 5 * t)
    fine = joint.simulate(J, 1e-3, torque, substeps=4096, integration="explicit").position
    error = [
        np.abs(joint.simulate(J, 1e-3, torque, substeps=n, integration=integration).position - fine).max()
        for n in (4, 8, 16, 32)
    ]
    order = np.log2(np.divide(error[:-1], error[1:]))
    assert (order > 0.8).all() and error[-1] < 2e-3 * np.ptp(fine), (order, error)


def test_simulation_agrees_with_a_reference_to_a_thousandth_of_the_range():
    joint = (Plant.axis(J) + gms()).joint()
    t = np.arange(1000) * 5e-4
    torque = 0.8 * FS * np.sin(2 * np.pi * 3 * t)
    fine = joint.simulate(J, 5e-4, torque, substeps=1000, integration="explicit").position
    plain = joint.simulate(J, 5e-4, torque, substeps=20).position
    assert np.abs(plain - fine).max() < 1e-3 * np.ptp(fine)


@pytest.mark.parametrize("law", [effects.Coulomb(coulomb=4e-3), effects.Stribeck(
    coulomb=3e-3, static=4e-3, stribeck_velocity=0.1)])
@pytest.mark.parametrize("h", [1e-4, 5e-4, 5e-3])
def test_static_law_holds_without_creep(law, h):
    t = np.arange(int(2 / h)) * h
    load = 1.7e-3 + 1.2e-3 * np.sin(2 * np.pi * 5 * t)
    motion = (Plant.axis(J) + law).joint().simulate(J, h, load)
    assert np.abs(motion.position).max() < 1e-15
    assert np.allclose(motion.friction, -load, atol=1e-12)


def test_static_law_sticks_slips_and_stops():
    h = 5e-4
    torque = np.concatenate([np.full(200, 3e-3), np.full(200, 6e-3), np.zeros(600)])
    motion = (Plant.axis(J) + effects.Coulomb(coulomb=4e-3)).joint().simulate(J, h, torque)
    assert np.abs(motion.position[:200]).max() < 1e-15
    assert motion.velocity[400] == pytest.approx(2e-3 / J * 0.1, rel=1e-9)
    assert motion.velocity[400:].min() > -1e-12 and abs(motion.velocity[-1]) < 1e-12
    assert motion.position[-1] == pytest.approx(0.5 * 2e-3 / J * 0.1**2 * 1.5, rel=0.02)


def test_500_hz_joint_runs_at_2_ms():
    """Error in pre-sliding, against a 1 us reference, in parts of the travel from full slip to full slip."""
    stiffness = J * (2 * np.pi * 500) ** 2
    joint = (Plant.axis(J) + gms(stiffness)).joint()
    t = np.arange(500) * 2e-3
    torque = 0.6 * FS * np.sin(2 * np.pi * 3 * t)
    reference = joint.simulate(J, 2e-3, torque, substeps=2000, integration="explicit").position
    travel = 2 * 0.4 * FS / (stiffness / 15)
    assert np.abs(joint.simulate(J, 2e-3, torque).position - reference).max() < 0.02 * travel
    explicit = joint.simulate(J, 2e-3, torque, integration="explicit").position
    assert np.abs(explicit - reference).max() > travel, "the explicit step is unstable here"


def test_a_joint_stops_however_short_its_break_away_distance_is():
    """0.1 nrad against 5 urad of motion: no step that ends beyond where it should hold takes friction for a drive."""
    h, k = 1e-3, (30 / 1e-3) ** 2
    joint = (Plant.axis(1.0) + gms(k)).joint()
    torque = 8e-3 * np.sin(0.03 * np.arange(1000))
    reference = joint.simulate(1.0, h, torque, substeps=300, integration="explicit").position
    q = joint.simulate(1.0, h, torque).position
    assert np.abs(q - reference).max() < 0.02 * np.ptp(reference)


@pytest.mark.parametrize("wh", [3.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize("amplitude", [0.7, 1.5])
def test_stiff_joint_stays_bounded_without_chatter(wh, amplitude):
    h = 2e-3
    joint = (Plant.axis(J) + gms(J * (wh / h) ** 2)).joint()
    torque = amplitude * FS * np.sin(2 * np.pi * 3 * np.arange(1000) * h)
    motion = joint.simulate(J, h, torque)
    assert np.abs(motion.friction).max() <= FS
    if amplitude < 1:  # held all along: friction mirrors the load
        assert np.abs(motion.friction + torque).max() < 0.02 * FS
    else:
        v = motion.velocity
        reversals = np.count_nonzero(np.diff(np.sign(v[np.abs(v) > 0.05 * np.abs(v).max()])))
        assert reversals <= 2 * 6 + 1


@pytest.mark.parametrize("scale", [
    effects.ThermalDrift(amplitude=-0.3, time_constant=1e6),
    effects.PositionDependentFriction(harmonics=[1], amplitude=[0.4], phase=[-1.6]),
], ids=lambda e: e.name)  # fmt: skip
def test_friction_that_something_weakens_is_no_stiffer_for_it(scale):
    """What would be more than its level lets it hold had been taken for a stiffness: auto took the implicit step, whose
    damping is a tenth of the motion where friction is a spring."""
    plant = Plant.axis(J) + gms() + scale
    joint, torque = plant.joint(), 0.4 * FC * np.random.default_rng(3).normal(size=2000)
    auto, explicit = (joint.simulate(J, 5e-5, torque, integration=i).position for i in ("auto", "explicit"))
    assert np.array_equal(auto, explicit)


def test_a_runaway_is_reported_as_nan():
    joint = (Plant.axis(J) + effects.Viscous(coefficient=1.0)).joint()
    motion = joint.simulate(J, 1e-3, np.ones(5000), integration="explicit")
    assert np.isnan(motion.position[-1]) and np.isfinite(motion.position[0])
    assert np.isfinite(joint.simulate(J, 1e-3, np.ones(5000)).position).all(), "auto takes the implicit step"


@pytest.mark.parametrize("wrong", [{"inertia": 0.0}, {"sample_time": -1.0}, {"substeps": 0}])
def test_refuses_impossible_axes(wrong):
    arguments = {"inertia": J, "sample_time": 1e-3, "torque": np.zeros(3)} | wrong
    with pytest.raises(ModelError, match="must be positive"):
        (Plant.axis(J) + gms()).joint().simulate(**arguments)


def test_refuses_an_unknown_integration():
    with pytest.raises(ModelError, match="auto, explicit, implicit"):
        Plant.axis(J).joint().simulate(J, 1e-3, np.zeros(3), integration="magic")


def test_a_copied_joint_is_a_joint_of_its_own():
    joint = (Plant.axis() + effects.Viscous(coefficient=2.0)).joint()
    twins = [copy.copy(joint), copy.deepcopy(joint)]
    del joint
    gc.collect()
    t = np.arange(3.0)
    for twin in twins:
        np.testing.assert_allclose(twin.replay(t, t, np.ones(3)).torque, -2.0)
    assert len({twin.handle for twin in twins}) == 2


def test_a_motion_whose_torque_never_comes_back_to_itself_has_one_at_every_sample() -> None:
    """Axis 2848 turns from half periods to whole ones in the last that it is given."""
    rng = np.random.default_rng(2848)
    fraction, distance = rng.dirichlet(np.ones(12)), np.geomspace(1e-3, 1e-1, 12)
    law = effects.GMS(
        stiffness=5e-3 * fraction / distance, fraction=fraction, coulomb=4.5e-3, static=4.5e-3 * rng.uniform(1, 1.3),
        stribeck_velocity=10 ** rng.uniform(-1.5, 0), attraction=10 ** rng.uniform(-2, 0),
    )  # fmt: skip
    omega, amplitude = 2 * np.pi * 10 ** rng.uniform(1, 2), 10 ** rng.uniform(-3, -1.5)
    phase = 2 * np.pi * np.arange(64) / 64
    motion = [np.array([2 * np.pi / omega]), amplitude * np.cos(phase)[None], -amplitude * omega * np.sin(phase)[None]]
    torque, joint = np.full((1, 64), np.nan), (Plant.axis() + law).joint()
    native.library.gms_joint_cycle(joint.handle, -1, 1, 1, 64, *(a.ctypes.data for a in (*motion, torque)))
    assert np.isfinite(torque).all()


def waves(number: int, law: Plant) -> tuple[native.Joint, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Sines from deep inside pre-sliding to far beyond it, some with a third harmonic, some that are not alike in both
    directions."""
    size, omega = np.geomspace(1e-4, 1e-1, number), 2 * np.pi * np.geomspace(30, 2, number)
    phase = 2 * np.pi * np.arange(64) / 64
    third, second = 0.1 * (np.arange(number) % 3 == 1), 0.05 * (np.arange(number) % 7 == 2)
    q = size[:, None] * sum(np.outer(a, np.cos(n * phase)) for n, a in ((1, np.ones(number)), (2, second), (3, third)))
    v = np.gradient(np.tile(q, 3), 2 * np.pi / 64, axis=1)[:, 64:128] * omega[:, None]
    return law.joint(), (2 * np.pi / omega, q, v)


LAWS = [
    Plant.axis(J) + gms(),
    Plant.axis(J) + gms() + effects.Viscous(coefficient=2e-5) + effects.Gravity(amplitude=1e-3),
    Plant.axis(J) + gms() + effects.AsymmetricFriction(level=0.2),
    Plant.axis(J) + effects.LuGre(stiffness=1.5, coulomb=FC, static=FS, stribeck_velocity=0.8),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda p: "+".join(e.name for e in p.effects))
def test_periodic_motions_are_the_same_alone_together_and_on_several_threads(law, monkeypatch):
    joint, motions = waves(150, law)
    monkeypatch.setenv(threads.VARIABLE, "1")
    together = joint.cycle(*motions)
    alone = np.concatenate([joint.cycle(*(x[i : i + 1] for x in motions)) for i in range(150)])
    assert np.array_equal(together, alone)
    monkeypatch.setenv(threads.VARIABLE, "3")
    for _ in range(20):
        assert np.array_equal(joint.cycle(*motions), together)
    if law is LAWS[0]:
        assert np.allclose(joint.cycle(*motions, 0).sum(1), together)


def test_several_python_threads_may_ask_for_periodic_motions_at_a_time(monkeypatch):
    joint, motions = waves(150, LAWS[0])
    expected = joint.cycle(*motions)
    monkeypatch.setenv(threads.VARIABLE, "2")
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: joint.cycle(*motions), range(40)):
            assert np.array_equal(found, expected)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_fork_of_a_process_with_threads_has_its_own(monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, "2")
    joint, motions = waves(150, LAWS[0])
    expected = joint.cycle(*motions)
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(joint.cycle(*motions), expected) else 1)
    for _ in range(200):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        pytest.fail("the child waits for threads that it does not have")
    assert os.waitstatus_to_exitcode(status) == 0
