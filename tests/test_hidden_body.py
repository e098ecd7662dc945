"""Loads behind a coupling: against the exact motion of two masses, against MuJoCo's, and their momentum."""

import warnings

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm

from gms_mujoco import effects, engine
from gms_mujoco.errors import ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

J, J2, F, ZETA = 3e-5, 1.2e-5, 120.0, 0.1
W = 2 * np.pi * F
LOAD = effects.FlexibleCoupling(inertia=J2, frequency=F, damping=ZETA)
PLAY = effects.Backlash(inertia=J2, gap=0.02, frequency=F, damping=0.2)
H = 5e-4


@pytest.fixture(scope="module")
def command():
    return multisine(4000, H, 1.0, 200.0, 5e-3, np.random.default_rng(1))


def in_small_steps(torque, h, n, slow, pull):
    """(n, 3) motor position and velocity and torque on it of two masses, semi-implicit Euler in small steps.

    Dry friction slows the load down; `pull` gives the torque over its inertia from relative position and velocity.
    """
    v1 = v2 = q1 = q2 = f = 0.0
    out = np.zeros((len(torque), 3))
    dt = h / n
    for i, u in enumerate(torque):
        out[i] = q1, v1, f
        for _ in range(n):
            f = J2 * pull(q2 - q1, v2 - v1)
            v1 += dt * (u + f) / (J - J2)
            v2 -= dt * f / J2
            v2 -= max(min(v2, dt * slow), -dt * slow)
            q1 += dt * v1
            q2 += dt * v2
    return out


def sprung_reference(torque, h, n, slow=0.0):
    return in_small_steps(torque, h, n, slow, lambda r, v: W**2 * r + 2 * ZETA * W * v)


def backlash_reference(torque, h, n, slow=0.0):
    zeta, half = PLAY.damping, PLAY.gap / 2

    def pull(r, v):
        x = r - half if r > half else r + half if r < -half else 0.0
        f = W**2 * x + 2 * zeta * W * v
        return f if f * x > 0 else 0.0

    return in_small_steps(torque, h, n, slow, pull)


def two_masses(torque, h, j1=J - J2, viscous=0.0):
    """(n, 4) motor and load position, motor and load velocity; exact for a held torque."""
    k, c = J2 * W**2, 2 * ZETA * W * J2
    a = np.zeros((5, 5))
    a[0, 2] = a[1, 3] = 1
    a[2, :4] = np.array([-k, k, -c - viscous, c]) / j1
    a[3, :4] = np.array([k, -k, c, -c]) / J2
    a[2, 4] = 1 / j1
    step = expm(a * h)
    x = np.zeros((len(torque), 4))
    for i in range(len(torque) - 1):
        x[i + 1] = (step @ np.append(x[i], torque[i]))[:4]
    return x


def coupling_torque(x):
    return J2 * (W**2 * (x[:, 1] - x[:, 0]) + 2 * ZETA * W * (x[:, 3] - x[:, 2]))


def relative(wrong, right):
    return np.sqrt(np.mean((wrong - right) ** 2) / np.mean(right**2))


def test_simulated_axis_moves_as_two_masses(command):
    exact = two_masses(command, H)[:, 0]
    errors = [relative(simulate(Plant.axis(J) + LOAD, command, H, substeps=n).position, exact) for n in (4, 16)]
    assert errors[0] < 0.01
    assert errors[1] < 0.3 * errors[0]  # of first order, as the axis simulation is


def test_replay_along_the_exact_motion_gives_the_torque_of_the_coupling(command):
    x = two_masses(command, H)
    t = H * np.arange(len(x))
    torque = (Plant.axis(J) + LOAD).joint().replay(t, x[:, 0], x[:, 2]).torque
    assert relative(torque, coupling_torque(x)) < 0.02


def test_inverse_dynamics_of_the_exact_motion_is_the_command(command):
    x = two_masses(command, H)
    o = Observation(Record("exact", H * np.arange(len(x)), {"torque": command, "position": x[:, 0]}), 150.0)
    plant = Plant.axis(J) + LOAD
    assert relative(o.needed(plant), o.applied(plant)) < 0.03
    assert relative(o.needed(Plant.axis(J)), o.applied(plant)) > 0.3


def test_stiff_coupling_is_rigid():
    t = 1e-3 * np.arange(2000)
    q, v, a = np.sin(6 * t), 6 * np.cos(6 * t), -36 * np.sin(6 * t)
    for frequency in (400.0, 1e4, 1e7):
        plant = Plant.axis(J) + LOAD.replace(frequency=frequency, damping=0.3)
        torque = plant.joint().replay(t, q, v).torque
        assert relative(torque[50:], -J2 * a[50:]) < 0.005


@pytest.mark.parametrize(
    "effect, damping", [*((LOAD, z) for z in (0.0, 0.3, 1.0, 1.0 + 1e-9, 3.0)), (PLAY, 0.0), (PLAY, 0.2)]
)
def test_momentum_is_kept(effect, damping):
    """What the joint loses the load gains, over any stretch of the motion."""
    t = 2e-5 * np.arange(50000)
    q, v = 0.3 * np.sin(25 * t), 7.5 * np.cos(25 * t)
    replay = (Plant.axis(J) + effect.replace(damping=damping)).joint().replay(t, q, v, states=True)
    impulse = np.concatenate([[0], np.cumsum((replay.torque[1:] + replay.torque[:-1]) / 2 * 2e-5)])
    gained = J2 * (replay.states[:, 3] - replay.states[0, 3])
    assert np.abs(impulse + gained).max() < 2e-3 * np.abs(gained).max()


@pytest.mark.parametrize(
    "effect",
    [LOAD, LOAD.replace(deceleration=5.0), PLAY, PLAY.replace(deceleration=5.0)],
    ids=["flexible_coupling", "dry flexible_coupling", "backlash", "dry backlash"],
)
@pytest.mark.parametrize("integration", ["explicit", "implicit"])
def test_a_load_let_go_does_not_gain_energy(effect, integration):
    plant = Plant.axis(J) + effect.replace(damping=0.01)
    motion = plant.joint().simulate(
        plant.driven_inertia, 2e-4, np.where(np.arange(20000) < 50, 5e-3, 0.0), integration=integration, states=True
    )
    energy = plant.driven_inertia * motion.velocity**2 + J2 * motion.states[:, 3] ** 2
    assert energy[-2000:].max() < 1.02 * energy[50:2050].max()


@pytest.mark.parametrize("frequency", [1.0, 300.0, 3e3, 1e5])
@pytest.mark.parametrize("damping", [0.05, 3.0])
@pytest.mark.parametrize("kind", [effects.FlexibleCoupling, effects.Backlash])
def test_bounded_at_any_stiffness_and_damping(kind, damping, frequency, command):
    extra = {"damping": damping, **({"gap": 0.01} if kind is effects.Backlash else {})}
    plant = Plant.axis(J) + kind(inertia=0.9 * J, frequency=frequency, **extra) + effects.Viscous(coefficient=1e-4)
    record = simulate(plant, command, H, substeps=1)
    rigid = simulate(Plant.axis(0.1 * J) + effects.Viscous(coefficient=1e-4), command, H)
    assert np.ptp(record.position) < 2 * np.ptp(rigid.position)


def test_simulated_backlash_moves_as_two_masses_with_play():
    torque = 8e-3 * np.cos(2 * np.pi * 8 * H * np.arange(600))
    exact = backlash_reference(torque, H, 100)[:, 0]
    plain = two_masses(torque, H)[:, 0]
    record = simulate(Plant.axis(J) + PLAY, torque, H, substeps=20)
    assert relative(np.diff(record.position, 2), np.diff(exact, 2)) < 0.02
    assert relative(np.diff(plain, 2), np.diff(exact, 2)) > 0.5


@pytest.mark.parametrize("slow", [30.0, 300.0])
@pytest.mark.parametrize("reference, effect", [(sprung_reference, LOAD), (backlash_reference, PLAY)])
def test_a_load_with_dry_friction_moves_and_rests_as_one_of_two_masses_does(reference, effect, slow):
    torque = (5e-3 + J2 * slow) * np.cos(2 * np.pi * 5 * H * np.arange(600))
    exact = reference(torque, H, 200, slow)
    plant = Plant.axis(J) + effect.replace(deceleration=slow)
    free = Plant.axis(J) + effect
    rubbing, gliding = (np.diff(simulate(p, torque, H, substeps=20).position, 2) for p in (plant, free))
    assert relative(rubbing, np.diff(exact[:, 0], 2)) < 0.02
    assert relative(gliding, np.diff(exact[:, 0], 2)) > 0.08
    replayed = plant.joint().replay(H * np.arange(len(exact)), exact[:, 0], exact[:, 1]).torque
    assert relative(replayed, exact[:, 2]) < 0.03


@pytest.mark.parametrize("h", [1e-4, 5e-4, 2e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("slow", [20.0, 200.0])
@pytest.mark.parametrize("effect", [LOAD, PLAY], ids=["flexible_coupling", "backlash"])
def test_dry_friction_of_a_load_holds_what_it_can(effect, h, slow):
    """A joint that pushes by less comes to rest against it, whatever the time step, and by more carries it along."""
    plant = Plant.axis(J) + effect.replace(deceleration=slow) + effects.Viscous(coefficient=1e-4)
    steps = round(4 / h)
    held, driven = (
        plant.joint().simulate(plant.driven_inertia, h, np.full(steps, times * J2 * slow), integration="implicit")
        for times in (0.95, 1.05)
    )
    assert np.ptp(held.position[steps // 2 :]) < 1e-9
    assert driven.velocity[-1] == pytest.approx(0.05 * J2 * slow / 1e-4, rel=0.02)


def test_a_load_at_rest_in_the_gap_stays_there_while_the_joint_crosses_it():
    t = 1e-3 * np.arange(1000)
    q, v = 0.03 * np.sin(6 * t), 0.18 * np.cos(6 * t)
    replay = (Plant.axis(J) + PLAY.replace(deceleration=1e3)).joint().replay(t, q, v, states=True)
    load = q + replay.states[:, 2]  # rests but where it is pushed
    still = np.abs(np.diff(load)) < 1e-12
    assert 0.2 < still.mean() < 0.8
    assert not np.any(replay.torque[1:][still & (np.abs(replay.states[1:, 2]) < 0.999 * PLAY.gap / 2)])
    pushing = np.abs(replay.torque) > 0.5 * J2 * 1e3
    assert pushing.mean() > 0.2
    assert np.median(np.abs(replay.torque[pushing])) == pytest.approx(J2 * 1e3, rel=0.02)


def test_load_in_the_gap_is_not_felt():
    t = 1e-3 * np.arange(500)
    q, v = 0.009 * (1 - np.cos(20 * t)) / 2, 0.09 * np.sin(20 * t)
    assert not np.any((Plant.axis(J) + PLAY).joint().replay(t, q, v).torque)
    touching = (Plant.axis(J) + PLAY).joint().replay(t, q, v, memory=np.array([-1.0])).torque
    assert np.any(touching)


def test_load_leaves_the_armature_of_a_mujoco_joint(command):
    """A servo axis with its whole inertia as armature moves as the simulated axis does."""
    xml = f"""<mujoco><option timestep="{H / 4}" gravity="0 0 0"/><worldbody><body><joint name="j" armature="{J}"/>
        <geom size="0.001" mass="1e-6"/></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""
    model = engine.attach(xml, {"j": Plant.axis(J) + LOAD}, "explicit").compile()
    assert model.dof_armature[0] == pytest.approx(J - J2)
    data = mujoco.MjData(model)
    position = np.zeros(500)
    for i in range(500):
        position[i] = data.qpos[0]
        data.ctrl[0] = command[i]
        mujoco.mj_step(model, data, 4)
    assert relative(position, two_masses(command[:500], H)[:, 0]) < 0.02


def test_a_load_without_armature_to_take_from_is_told():
    xml = """<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>"""
    with pytest.warns(UserWarning, match="take the rest off the body"):
        engine.attach(xml, {"j": Plant.axis(J) + LOAD})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        engine.attach(xml, {"j": Plant.axis(J) + effects.Spring(stiffness=1.0)})


def test_a_load_heavier_than_the_axis_is_refused(command):
    with pytest.raises(ModelError, match="flexible_coupling must have less inertia than the axis"):
        simulate(Plant.axis(J) + LOAD.replace(inertia=2 * J), command, H)
