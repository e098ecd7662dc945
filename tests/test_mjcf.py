"""A plant from the joint of a MuJoCo model moves as that joint does in MuJoCo, and what was attached comes back."""

import warnings

import mujoco
import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, in_mujoco
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import every_effect, some_plant

from gms_mujoco import effects, engine
from gms_mujoco.errors import ModelError
from gms_mujoco.plant import Plant
from gms_mujoco.sampling import sample
from gms_mujoco.simulate import simulate

J, H, SUBSTEPS = 0.02, 2e-3, 40
T = H * np.arange(1500)
TORQUE = 1.5 * np.sin(2 * np.pi * 1.3 * T) * (0.6 + 0.4 * np.sin(2 * np.pi * 0.31 * T))


def model(joint: str = "", actuators: str = "", options: str = "") -> str:
    return f"""<mujoco><compiler angle="radian"/><option timestep="{H / SUBSTEPS}" gravity="0 0 0" {options}/>
    <worldbody><body name="link"><joint name="shaft" axis="0 0 1" armature="0.004" {joint}/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 {J - 0.004}"/></body></worldbody>
    <actuator><motor name="drive" joint="shaft"/>{actuators}</actuator></mujoco>"""


def apart(xml: str, plant: Plant, torque: np.ndarray = TORQUE) -> float:
    """Largest distance of the two motions over the largest motion."""
    theirs = in_mujoco(mujoco.MjModel.from_xml_string(xml), torque, SUBSTEPS)[:-1]
    ours = simulate(plant, torque, H, substeps=SUBSTEPS).position
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def test_damping_becomes_viscous_and_quadratic_drag() -> None:
    xml = model('damping="0.05 0.02"')
    plant = Plant.from_mjcf(xml, "shaft")
    assert plant.inertia == pytest.approx(J, rel=1e-12) and plant.inertia_known
    assert plant.effects == (effects.Viscous(coefficient=0.05), effects.QuadraticDrag(coefficient=0.02))
    assert apart(xml, plant) < 1e-4  # of two integrators of first order
    assert apart(xml, plant.without("quadratic_drag")) > 0.1


def test_frictionloss_becomes_coulomb() -> None:
    """MuJoCo's constraint is soft: the harder it is made, the nearer it comes to the law that ours follows."""
    far = []
    for time in (2e-2, 2e-3, 2e-4):  # constant of the constraint [s]
        xml = model(f'frictionloss="0.3" damping="0.02" solreffriction="{time} 1"')
        plant = Plant.from_mjcf(xml, "shaft")
        assert plant.effects == (effects.Coulomb(coulomb=0.3), effects.Viscous(coefficient=0.02))
        far.append(apart(xml, plant))
    assert far[2] < far[1] < far[0] and far[2] < 2e-3
    assert apart(xml, plant.replace(effects.Coulomb(coulomb=0.29))) > 5 * far[2]


LUGRE = (
    '<dcmotor joint="shaft" input="none" motorconst="{K}" resistance="2" lugre="300 2 0.3 0.45 0.2" gear="{G}" {MORE}/>'
)


@pytest.mark.parametrize(("gear", "constant"), [(1.0, 0.0), (2.0, 0.1)])
def test_lugre_of_a_dcmotor_becomes_lugre(gear: float, constant: float) -> None:
    xml = model(actuators=LUGRE.format(G=gear, K=constant, MORE=""))
    plant = Plant.from_mjcf(xml, "shaft")
    lugre = plant["lugre"]
    assert lugre.stiffness == pytest.approx(300 * gear**2) and lugre.stribeck_velocity == pytest.approx(0.2 / gear)
    assert ("viscous" in plant) == (constant > 0), "closed windings brake"
    assert apart(xml, plant) < 0.01
    assert apart(xml, plant.replace(lugre.replace(coulomb=0.95 * lugre.coulomb))) > 0.02
    micro = 0.15 * gear * np.sign(TORQUE)  # below break-away: the bristle bends and swings
    assert apart(xml, plant, micro) < 0.02


@pytest.mark.parametrize("gear", [3.0, -3.0])
def test_cogging_and_damping_of_a_geared_motor_act_as_in_mujoco(gear: float) -> None:
    motor = f'<dcmotor joint="shaft" input="none" motorconst="0" resistance="1" gear="{gear}" cogging="0.05 4 0.3"'
    xml = model(actuators=motor + ' damping="0.002 0.001"/>')
    plant = Plant.from_mjcf(xml, "shaft")
    assert {e.name for e in plant.effects} == {"cogging", "viscous", "quadratic_drag"}
    m = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(m)
    for q, v in ((0.3, 2.0), (-1.0, -3.0), (2.0, 0.5)):
        data.qpos[0], data.qvel[0] = q, v
        mujoco.mj_forward(m, data)
        ours = plant.joint().replay(np.array([0.0, 1.0]), np.array([q - 1e-9, q]), np.array([v, v])).torque[-1]
        assert ours == pytest.approx(data.qfrc_actuator[0] + data.qfrc_passive[0], rel=1e-6)


@settings(max_examples=10)
@given(seed=st.integers(0, 999))
def test_a_sampled_plant_goes_to_mjcf_and_back_exactly(seed: int) -> None:
    plant = HEALTHY + HIDDEN["cogging"] + HIDDEN["torque_offset"] + effects.LoadDependentFriction(coefficient=0.3)
    wide = {k: (0.7 * v, 1.4 * v) for k, (v, _) in plant.numbers().items() if "cogging.harm" not in k and v > 0}
    plant = Plant(plant.inertia, plant.effects, uncertainty=wide)
    drawn = sample(plant, 1, seed)[0]
    spec = engine.attach(model(), {"shaft": drawn})
    spec.compile()
    for there in (spec, spec.to_xml()):
        back = Plant.from_mjcf(there, "shaft")
        assert back.effects == drawn.effects, "to the last bit, also through text"
    assert back.inertia == pytest.approx(J, rel=1e-5), "attach leaves the inertia of the model"


@every_effect
@settings(max_examples=8)
@given(data=st.data())
def test_every_effect_comes_back_from_the_joint_that_it_was_put_on(name: str, data: st.DataObject) -> None:
    plant = data.draw(some_plant(name))
    assume(plant.inertia is None or plant.driven_inertia > 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what MuJoCo has no element for is left out, and attach says so
        spec = mujoco.MjSpec.from_string(model())
        if name == "position_loop":
            spec.delete(spec.actuators[0])
        spec = engine.attach(spec, {"shaft": plant})
        back = Plant.from_mjcf(spec, "shaft")
    lost = {"encoder_eccentricity", "least_duty", "position_loop"}  # the measurement's; the servo's own controller
    if name in lost:
        assert back.effects == ()
    elif not any(np.any(v) for v in plant[name].values.values()):
        assert set(back.effects) <= set(plant.effects), "of strength nothing"
    elif name == "delay":  # MuJoCo knows none below a time step
        assert back.effects == plant.effects or plant["delay"].time < H
    else:
        assert back.effects == plant.effects


def test_joints_of_one_instance_and_of_a_model_that_has_joined_another_are_told_apart() -> None:
    two = model().replace("</body>", '<body><joint name="tilt" axis="0 1 0"/><geom size="0.1"/></body></body>')
    parent = mujoco.MjSpec()
    child = engine.attach(two, {"*": HEALTHY})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the time step differs
        parent.attach(child, prefix="left_", suffix="_x", frame=parent.worldbody.add_frame())
    parent.worldbody.add_body().add_joint(name="shaft")
    parent.bodies[-1].add_geom(size=[0.1, 0, 0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        text = parent.to_xml()
    for there in (parent, text):
        for name in ("left_shaft_x", "left_tilt_x"):
            assert Plant.from_mjcf(there, name).effects == HEALTHY.effects
        assert Plant.from_mjcf(there, "shaft").effects == ()


def test_friction_of_the_model_and_of_a_plant_on_it_add_up() -> None:
    with pytest.warns(UserWarning, match="both act"):
        spec = engine.attach(model('damping="0.5"'), {"shaft": Plant.axis(1.0) + effects.Viscous(coefficient=0.25)})
    assert Plant.from_mjcf(spec, "shaft")["viscous"].coefficient == 0.75
    with pytest.raises(ModelError, match="lugre acts on joint 'shaft' twice"):
        motor = LUGRE.format(G=1, K=0, MORE="")
        Plant.from_mjcf(model(actuators=motor + motor), "shaft")


def test_what_no_effect_expresses_is_named() -> None:
    with pytest.warns(UserWarning, match="third power"):
        plant = Plant.from_mjcf(model('damping="0.1 0 0.03"'), "shaft")
    assert "third power" in plant.provenance["left_out"][0] and plant["viscous"].coefficient == 0.1
    with pytest.warns(UserWarning, match=r"lugre of dcmotor 'm' is left out: it needs 0 < Coulomb"):
        motor = LUGRE.format(G=1, K=0, MORE='name="m"').replace("0.3 0.45", "0.5 0.45")
        Plant.from_mjcf(model(actuators=motor), "shaft")


def test_a_springdamper_is_the_damping_that_it_is_compiled_to() -> None:
    xml = model('springdamper="0.2 1" damping="7 0.02"')  # 7 does not count then
    plant = Plant.from_mjcf(xml, "shaft")
    damping = mujoco.MjModel.from_xml_string(xml).dof_damping[0]
    assert plant.effects == (effects.Viscous(coefficient=damping), effects.QuadraticDrag(coefficient=0.02))
    assert damping == pytest.approx(2 * J / 0.2)


def test_tendons_that_brake_a_joint_are_named() -> None:
    tendons = (
        '<tendon><fixed name="rope" frictionloss="2" damping="3"><joint joint="shaft" coef="2"/></fixed>'
        '<fixed name="free" stiffness="1"><joint joint="shaft" coef="2"/></fixed>'
        '<fixed name="other" damping="1"><joint joint="tilt" coef="1"/></fixed></tendon></mujoco>'
    )
    tilt = '<body><joint name="tilt"/><geom size="0.1"/></body></worldbody>'
    xml = model().replace("</worldbody>", tilt).replace("</mujoco>", tendons)
    with pytest.warns(UserWarning, match="tendon 'rope' with frictionloss 2 and damping 3 acts on it") as told:
        plant = Plant.from_mjcf(xml, "shaft")
    assert len(told) == len(plant.provenance["left_out"]) == 1 and not plant.effects


def test_a_slide_and_the_axis_of_the_package(tmp_path) -> None:
    path = tmp_path / "table.xml"
    path.write_text(model('frictionloss="2" type="slide"'))
    plant = Plant.from_mjcf(path, "shaft")
    assert plant.kind == "slide" and plant.inertia == pytest.approx(1.004) and "table.xml" in plant.provenance["source"]
    plant.save(tmp_path / "model.toml")
    assert Plant.load(tmp_path / "model.toml") == plant


@pytest.mark.parametrize(
    ("source", "joint", "message"),
    [
        (model(), None, "the name of a joint is expected; None given"),
        (model(), "elbow", "no joint is called 'elbow'; the joints are shaft"),
        (model('type="ball"').replace('<motor name="drive" joint="shaft"/>', ""), "shaft", "ball or free joint"),
        ("nowhere.xml", "shaft", "nowhere.xml: no such file"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(source: str, joint: str, message: str) -> None:
    with pytest.raises(ModelError, match=message) as error:
        Plant.from_mjcf(source, joint)
    assert "\n" not in str(error.value)
