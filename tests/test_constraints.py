"""Joints that hold a load by a constraint, which MuJoCo solves after friction: a weld, another joint, a contact."""

import mujoco
import numpy as np
import pytest
from axes import WELD

from gms_mujoco import effects, engine
from gms_mujoco.plant import Plant

MIMIC = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody>
  <body><joint name="j" axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0.1 0 0" mass="0.05"/></body>
  <body pos="0 0.3 0"><joint name="other" axis="0 1 0"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.1 0 0" mass="0.4"/></body>
  </worldbody><equality><joint joint1="j" joint2="other"/></equality></mujoco>"""
LEVER = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody>
  <body><joint name="j" axis="0 1 0"/><geom type="box" size="0.2 0.05 0.01" pos="0.2 0 0" mass="0.05"/></body>
  <body pos="0.3 0 0.035"><freejoint/><geom type="box" size="0.025 0.025 0.025" mass="0.1"/></body>
  </worldbody></mujoco>"""
G = 9.81
# A model, the load of its joint, and how far a constraint that MuJoCo keeps softly lets it go before it holds.
MODELS = {"weld": (WELD, 1.1 * G, 1e-3), "mimic": (MIMIC, 0.45 * 0.05 * G, 1e-2), "lever": (LEVER, 0.04 * G, 2e-3)}
LAWS = {
    "gms": lambda level: effects.GMS(
        stiffness=np.array([4e3, 2e3, 1e3]) * level, fraction=[0.5, 0.3, 0.2], coulomb=level, static=level,
        stribeck_velocity=0.1, attraction=level,
    ),
    "lugre": lambda level: effects.LuGre(
        stiffness=3e3 * level, damping=3 * level, coulomb=level, static=level, stribeck_velocity=0.1
    ),
    "coulomb": lambda level: effects.Coulomb(coulomb=level),
}  # fmt: skip


def held(xml: str, law: str, level: float, h: float, integration: str, integrator: str = "implicitfast") -> np.ndarray:
    """(n, 2) position of the joint and the torque of its friction over two seconds."""
    kind = "slide" if "slide" in xml else "hinge"
    spec = engine.attach(
        xml.format(h=h, integrator=integrator), {"j": Plant.axis(kind=kind) + LAWS[law](level)}, integration
    )
    model = spec.compile()
    data, out = mujoco.MjData(model), []
    for _ in range(round(2 / h)):
        mujoco.mj_step(model, data)
        out.append((data.joint("j").qpos[0], engine.friction(model, data, "j").torque))
    return np.array(out)


@pytest.mark.parametrize("h", [1e-3, 2e-3])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", MODELS)
def test_a_load_below_break_away_is_held(name: str, law: str, h: float) -> None:
    """Within what the law and the softness of the constraint give, and then without creep: of the light side alone an
    implicit step takes the load for none, and slid by h F / m."""
    xml, load, gives = MODELS[name]
    motion = held(xml, law, 2.5 * load, h, "implicit")
    half = len(motion) // 2
    assert np.abs(motion[:, 0]).max() < gives
    assert np.ptp(motion[half:, 0]) < 1e-6 and motion[half:, 1] == pytest.approx(-load, rel=0.02)


@pytest.mark.parametrize("law", LAWS)
def test_a_load_beyond_break_away_falls_as_it_would(law: str) -> None:
    motion = held(WELD, law, 0.5 * 1.1 * G, 2e-3, "implicit")
    assert motion[-1, 0] == pytest.approx(0.5 * 0.5 * G * 2**2, rel=0.02)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "RK4"])
def test_a_load_is_held_under_every_integrator(integrator: str) -> None:
    motion = held(WELD, "gms", 2.5 * 1.1 * G, 2e-3, "implicit", integrator)
    assert np.abs(motion[:, 0]).max() < 1e-3 and np.ptp(motion[500:, 0]) < 1e-6


@pytest.mark.parametrize("law", LAWS)
def test_a_chain_that_lies_on_the_floor_comes_to_rest(law: str) -> None:
    """Contacts that joints share, more of them than joints."""
    bodies = "".join(
        f'<body pos="{0.15 * (i > 0)} 0 {0.5 * (i == 0)}">'
        f'<joint name="j{i}" axis="0 {1 - i % 2} {i % 2}" armature="2e-4"/>'
        f'<geom type="capsule" size="0.02" fromto="0 0 0 0.15 0 0" mass="{0.3 * 0.7**i}"/>'
        for i in range(5)
    )
    floor = '<geom type="plane" size="2 2 0.1" pos="0 0 0.3"/>'
    xml = f'<mujoco><worldbody>{floor}{bodies}{"</body>" * 5}</worldbody></mujoco>'
    plants = {f"j{i}": Plant.axis() + LAWS[law](0.25 * 0.6**i) for i in range(5)}
    model = engine.attach(xml, plants, "implicit").compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 2000)
    assert data.ncon > 0
    fastest = 0.0
    for _ in range(500):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel).max()))
    assert fastest < 1e-3


def test_evaluating_again_changes_nothing() -> None:
    xml, load, _ = MODELS["weld"]
    spec = engine.attach(
        xml.format(h=2e-3, integrator="Euler"), {"j": Plant.axis(kind="slide") + LAWS["gms"](2 * load)}, "implicit"
    )
    model = spec.compile()
    once, again = mujoco.MjData(model), mujoco.MjData(model)
    for _ in range(50):
        mujoco.mj_step(model, once)
        for _ in range(3):
            mujoco.mj_forward(model, again)
        mujoco.mj_step(model, again)
    # The solver of the constraints begins where it was: that alone differs.
    assert again.qpos == pytest.approx(once.qpos, abs=1e-9)
