"""Friction put on the joints of a model, read out, saved, and refused where it cannot be."""

import ctypes
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from axes import AXIS, BEARING, DRY, axis, run, stick_slip

from gms_mujoco import effects, engine
from gms_mujoco.effect import Effect
from gms_mujoco.errors import EngineError, ModelError
from gms_mujoco.mjcf import plant_of_joint
from gms_mujoco.parameter import Parameter
from gms_mujoco.plant import Plant

MODELS = Path(__file__).resolve().parent.parent / "models"


def test_attach_takes_a_path_a_text_a_spec_and_patterns(tmp_path):
    path = tmp_path / "axis.xml"
    path.write_text(AXIS)
    for source in (path, str(path), AXIS, mujoco.MjSpec.from_string(AXIS)):
        assert engine.attach(source, {"sh*": BEARING}).compile().nplugin == 1
    spec = mujoco.MjSpec.from_string(AXIS)
    BEARING.attach(spec, joint="shaft")
    assert spec.compile().nplugin == 1


def test_an_effect_that_mujoco_does_not_get_is_told():
    class Weak(Effect):
        name, kind, parameters = "weak", "drive", (Parameter("share", "1", 0.0),)

        def deliver(self, time, command):
            return command * (1 - self.share)

    class Strong(Weak):
        name = "strong"

        def edit(self, spec, joint):
            pass

    with pytest.warns(UserWarning, match=r"weak is left out of joint 'shaft': it has no `edit`") as told:
        engine.attach(AXIS, {"shaft": BEARING + Weak(share=0.1) + Strong(share=0.1)})
    assert len(told) == 1


def test_prefix_and_suffix_follow_when_a_model_joins_another():
    two = AXIS.replace("</body>", '<body name="second"/></body>').replace(
        '<joint name="shaft" axis="0 0 1"/>',
        '<joint name="shaft" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/>',
    )
    parent = mujoco.MjSpec()
    for prefix in ("left_", "right_"):
        child = engine.attach(two, {"*": BEARING})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the time step differs
            parent.attach(child, prefix=prefix, suffix="_x", frame=parent.worldbody.add_frame())
            model = parent.compile()
    assert model.nplugin == 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = mujoco.MjModel.from_xml_string(parent.to_xml())
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 2, 3, 4]
    mujoco.mj_forward(model, data)
    for name, speed in (("left_shaft_x", 1), ("left_tilt_x", 2), ("right_shaft_x", 3), ("right_tilt_x", 4)):
        assert engine.friction(model, data, name).torque == pytest.approx(-2e-5 * speed)


def test_friction_is_read_out_by_joint():
    model, data = axis()
    run(model, data, stick_slip(500))
    mujoco.mj_forward(model, data)
    reading = engine.friction(model, data, "shaft")
    assert reading.torque == data.qfrc_passive[0]
    assert reading.power == reading.torque * data.qvel[0]
    assert reading.torque == pytest.approx(-reading.forces.sum() - 2e-5 * data.qvel[0])
    assert np.array_equal(reading.slips, reading.states["gms"][1::2] != 0) and len(reading.slips) == 4
    for name in (None, 0, b"shaft"):
        with pytest.raises(ModelError, match="the name of a joint is expected"):
            engine.friction(model, data, name)
    with pytest.raises(ModelError, match="no joint is called 'elbow'; the joints are shaft"):
        engine.friction(model, data, "elbow")
    bare = mujoco.MjModel.from_xml_string(AXIS)
    with pytest.raises(ModelError, match="no friction"):
        engine.friction(bare, mujoco.MjData(bare), "shaft")


@pytest.mark.parametrize("integration", ["explicit", "implicit"])
def test_sensors_give_what_friction_gives(integration):
    """Torque, power and states of each joint, also of a model that has joined another and gone through MJCF."""
    spec = engine.attach(two_joint_arm(), {"shoulder": BEARING, "elbow": DRY}, integration, engine.READINGS)
    parent = mujoco.MjSpec()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gravity differs
        parent.attach(spec, prefix="left_", frame=parent.worldbody.add_frame())
        parent.compile()
        model = mujoco.MjModel.from_xml_string(parent.to_xml())
    data = mujoco.MjData(model)
    slipped = 0
    for k in range(200):
        data.qfrc_applied[:] = 5.0 * np.sin([0.1 * k, 0.17 * k])
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        for joint, law in (("left_shoulder", "gms"), ("left_elbow", "coulomb")):
            reading = engine.friction(model, data, joint)
            sensed = [data.sensor(f"{joint}_friction_{reads}").data for reads in engine.READINGS]
            assert sensed[0] == reading.torque and sensed[1] == reading.power
            assert np.array_equal(sensed[2], reading.states[law])
            slipped += reading.slips.sum()
    assert slipped


def test_after_a_step_friction_is_that_of_its_end_and_sensors_that_of_its_beginning():
    """So power times the time step is the work of the step, and what the sensors had is gone."""
    model = engine.attach(AXIS, {"shaft": BEARING}, sensors=engine.READINGS).compile()
    data = mujoco.MjData(model)
    data.qvel[0] = 1e-2
    for _ in range(5):
        before, q = engine.friction(model, data, "shaft"), data.qpos[0]
        speed = data.qvel[0]
        mujoco.mj_step(model, data)
        reading = engine.friction(model, data, "shaft")
        assert reading.power * model.opt.timestep == pytest.approx(reading.torque * (data.qpos[0] - q), rel=1e-9)
        assert data.sensor("shaft_friction_torque").data == reading.torque
        assert data.sensor("shaft_friction_power").data == reading.torque * speed
        assert np.array_equal(data.sensor("shaft_friction_states").data, before.states["gms"])
        assert not np.array_equal(reading.forces, before.forces)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('value="power"', 'value="heat"', "reads must be torque, power or states; 'heat' given"),
        ('key="size" value="8"', 'key="size" value="7"', "'shaft_friction_states'.* has 8 states, size is 7"),
        ('key="size" value="8"', 'key="size" value="many"', "size must be the number of states; 'many' given"),
        ('objtype="joint" objname="shaft"', 'objtype="body" objname="rotor"', "objtype must be joint"),
        ('objname="shaft"', 'objname="bare"', "joint 'bare' has no friction of gms_mujoco"),
    ],
)
def test_a_bad_sensor_is_refused_when_it_is_compiled(old, new, message):
    xml = AXIS.replace("</worldbody>", '<body><joint name="bare"/><geom size="1"/></body></worldbody>')
    spec = engine.attach(xml, {"shaft": BEARING}, sensors=engine.READINGS)
    spec.compile()
    good = spec.to_xml()
    assert old in good
    with pytest.raises(ValueError, match=message):
        mujoco.MjModel.from_xml_string(good.replace(old, new))


def test_attach_knows_its_sensors():
    for given in ["heat"], "torque":
        with pytest.raises(ModelError, match="sensors is a list out of power, states, torque"):
            engine.attach(AXIS, {"shaft": BEARING}, sensors=given)
    with pytest.raises(ModelError, match="a joint has each sensor once"):
        engine.attach(AXIS, {"shaft": BEARING}, sensors=["power", "power"])
    spec = mujoco.MjSpec.from_string(AXIS)
    spec.add_sensor(name="shaft_friction_power", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objname="shaft",
                    objtype=mujoco.mjtObj.mjOBJ_JOINT)  # fmt: skip
    with pytest.raises(ModelError, match="a sensor is called 'shaft_friction_power' already"):
        engine.attach(spec, {"shaft": BEARING}, sensors=["torque", "power"])
    assert engine.attach(spec, {"shaft": BEARING}, sensors=["torque"]).compile().nsensor == 2


@pytest.mark.parametrize("order", [("shoulder_and_others", "*"), ("*", "shoulder_and_others")])
def test_names_that_attach_gives_are_free(order):
    """Also those of joints, which their friction alone is called after."""
    hand = '<body><joint name="shoulder_and_others" axis="0 0 1"/><geom size=".1"/></body></worldbody>'
    spec = mujoco.MjSpec.from_string(two_joint_arm().replace("</worldbody>", hand))
    for pattern in order:
        names = ("shoulder", "elbow") if pattern == "*" else (pattern,)
        engine.attach(spec, dict.fromkeys(names, BEARING), sensors=["torque"])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:] = 1
    mujoco.mj_forward(model, data)
    assert np.allclose(data.sensordata, -2e-5) and len(data.sensordata) == 3


def test_more_elements_than_a_joint_holds_are_refused_at_once():
    many = effects.GMS(300, stiffness=np.ones(300), coulomb=1, static=1, stribeck_velocity=1, attraction=1)
    with pytest.raises(ModelError, match="gms with 300 elements needs more state than the 512 numbers of a joint"):
        engine.attach(AXIS, {"shaft": Plant.axis() + many})

MIXED = """<mujoco><worldbody>
<body><freejoint name="free"/><geom size="0.1"/><body><joint name="ball" type="ball"/><geom size="0.1"/>
<body><joint name="slider" type="slide" frictionloss="0.1"/><geom size="0.1"/></body></body></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("joint", "plant", "message"),
    [
        ("elbow", BEARING, "no joint is called 'elbow'; the joints are ball, free, slider"),
        ("ball", BEARING, "'ball' is a ball or free joint"),
        ("free", BEARING, "'free' is a ball or free joint"),
        ("slider", BEARING, "'slider' is a slide, the plant is for a hinge"),
        ("slider", Plant.axis(kind="slide") + effects.Viscous(coefficient=float("nan")), "viscous.coefficient"),
        ("slider", "servo_axis", "a Plant is expected for joint 'slider', .*; 'servo_axis' given"),
        ("slider", effects.Coulomb(coulomb=1.0), "a Plant is expected for joint 'slider', .*; Coulomb given"),
        (0, BEARING, "no joint is called 0"),
    ],
)
def test_attach_refuses_in_one_line(joint, plant, message):
    with pytest.raises(ModelError, match=message) as error:
        engine.attach(MIXED, {joint: plant})
    assert "\n" not in str(error.value)


def test_attach_refuses_what_is_no_model(tmp_path):
    with pytest.raises(ModelError, match="no such file"):
        engine.attach(tmp_path / "none.xml", {"shaft": BEARING})
    with pytest.raises(ModelError) as error:
        engine.attach("<mujoco><nonsense/></mujoco>", {"shaft": BEARING})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("model", [None, b"<mujoco/>", mujoco.MjModel.from_xml_string(AXIS)], ids=type)
def test_attach_says_what_it_takes(model):
    with pytest.raises(ModelError, match=f"the text of an MJCF file is expected; {type(model).__name__} given"):
        engine.attach(model, {"shaft": BEARING})
    with pytest.raises(ModelError, match="plants by the names of joints are expected"):
        engine.attach(AXIS, BEARING)


@pytest.mark.parametrize("drive", [effects.CurrentLoopLag(time=1e-3), effects.Delay(time=1e-3)], ids=lambda e: e.name)
def test_a_model_is_changed_as_a_whole_or_not_at_all(drive):
    spec = mujoco.MjSpec.from_string(MIXED.replace("type=\"slide\" frictionloss=\"0.1\"", "armature=\"0.01\""))
    before = spec.to_xml()
    coupled = effects.FlexibleCoupling(inertia=0.005, frequency=20.0)
    with pytest.raises(ModelError, match="needs an actuator"):
        engine.attach(spec, {"slider": Plant.axis(0.01) + effects.Coulomb(coulomb=0.1) + coupled + drive})
    assert spec.to_xml() == before
    engine.attach(spec, {"slider": Plant.axis(0.01) + effects.Coulomb(coulomb=0.1)}).compile()


@pytest.mark.parametrize("drive", [effects.CurrentLoopLag(time=1e-3), effects.Delay(time=1e-3)], ids=lambda e: e.name)
def test_a_drive_acts_on_the_joint_and_on_no_tendon_of_its_name(drive):
    tendon = "<tendon><fixed name='shaft'><joint joint='shaft' coef='1'/></fixed></tendon>"
    xml = AXIS.replace("</worldbody>", "</worldbody>" + tendon)
    xml = xml.replace("</actuator>", "<motor name='pull' tendon='shaft'/></actuator>")
    spec = engine.attach(xml, {"shaft": BEARING + drive})
    touched = [a.name for a in spec.actuators if a.delay > 0 or a.dyntype != mujoco.mjtDyn.mjDYN_NONE]
    assert touched == ["drive"]


def test_a_plant_attaches_itself_and_gives_the_model():
    model = BEARING.attach(AXIS, "shaft", sensors=["torque"]).compile()
    assert model.nplugin == 2 and model.nsensor == 1


def test_muscles_get_their_ranges_of_length():
    """MuJoCo's compiler steps data then that have no plug-ins."""
    xml = """<mujoco><worldbody><site name="wall" pos="0.1 0 -0.2"/><body><joint name="shaft" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.1 0 0" mass="0.1"/><site name="tip" pos="0.1 0 0"/></body>
      </worldbody>
      <tendon><spatial name="string"><site site="wall"/><site site="tip"/></spatial></tendon>
      <actuator><muscle tendon="string" force="2"/></actuator></mujoco>"""
    bare = mujoco.MjModel.from_xml_string(xml)
    model = engine.attach(xml, {"shaft": BEARING}, sensors=engine.READINGS).compile()
    assert np.array_equal(model.actuator_lengthrange, bare.actuator_lengthrange)


def test_data_of_another_model_have_no_friction_to_read():
    bare = mujoco.MjModel.from_xml_string(AXIS)
    with pytest.raises(ModelError, match="the data was made for a model with other friction"):
        engine.friction(axis()[0], mujoco.MjData(bare), "shaft")


def test_friction_twice_on_one_body_finds_a_name():
    """A body holds one plug-in: the second hangs on a body inside."""
    first = AXIS.replace("</body>", "<body name='b_friction'><geom size='0.01'/></body></body>")
    first = first.replace('axis="0 0 1"/>', 'axis="0 0 1"/><joint name="b" axis="0 1 0"/>')
    spec = engine.attach(first, {"shaft": BEARING})
    assert engine.attach(spec, {"b": BEARING}).compile().nplugin == 2


def test_attach_refuses_friction_twice():
    spec = engine.attach(AXIS, {"shaft": BEARING})
    with pytest.raises(ModelError, match="has friction already"):
        engine.attach(spec, {"shaft": DRY})
    with pytest.raises(ModelError, match="named twice"):
        engine.attach(AXIS, {"shaft": BEARING, "*": DRY})


def test_attach_warns_of_friction_that_counts_twice():
    with pytest.warns(UserWarning, match="frictionloss 0.1"):
        engine.attach(MIXED, {"slider": Plant.axis(kind="slide") + effects.Coulomb(coulomb=1.0)})
    with pytest.warns(UserWarning, match="damping"):
        engine.attach(AXIS.replace('name="shaft"', 'name="shaft" damping="1e-5"'), {"shaft": BEARING})
    with pytest.warns(UserWarning, match=r"springdamper 0\.1 1 .*both act"):
        engine.attach(AXIS.replace('name="shaft"', 'name="shaft" springdamper="0.1 1"'), {"shaft": BEARING})


def test_attach_says_which_armature_a_servo_needs_on_a_joint_that_has_none():
    servo = Plant.load("sts3215")
    bare = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', "")
    with pytest.warns(UserWarning, match=r"'shaft' has no armature.* 0\.0181383 kg m\^2.*: set `armature`") as told:
        spec = servo.attach(bare, "shaft")
    assert len(told) == 1 and spec.joint("shaft").armature == 0
    with warnings.catch_warnings(action="error"):
        servo.attach(bare.replace('name="shaft"', f'name="shaft" armature="{servo.inertia}"'), "shaft")


def test_attach_leaves_other_joints_and_inertia_alone():
    model = engine.attach(MODELS / "arm.xml", {"elbow": Plant.load(MODELS / "arm_joint.toml")}).compile()
    bare = mujoco.MjModel.from_xml_path(str(MODELS / "arm.xml"))
    assert model.nplugin == 1 and model.nbody == bare.nbody
    assert np.array_equal(model.dof_armature, bare.dof_armature)
    assert np.array_equal(model.dof_M0, bare.dof_M0)


def test_delay_becomes_the_delay_of_the_actuator():
    delay = effects.Delay(time=1.7e-3)
    model = engine.attach(AXIS, {"shaft": Plant.axis() + delay}).compile()
    data = mujoco.MjData(model)
    command = stick_slip(200)
    acted = []
    for u in command:
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        acted.append(data.qfrc_actuator[0])
    assert np.allclose(acted, delay.deliver(np.arange(200) * 5e-4, command), atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('joint name="shaft"', 'joint name="other"', "no joint is called 'shaft'; the joints are other"),
        ('gms.fraction" value="0.1 ', 'gms.fraction" value="0.3 ', "gms.fraction must sum to 1"),
        ('gms.coulomb" value="0.0045"', 'gms.coulomb" value="abc"', "must be a list of numbers; 'abc' given"),
        ('gms.coulomb" value="0.0045"', 'gms.coulomb" value="-1"', r"must lie in \[0, inf\) N m; -1 given"),
        ('gms.coulomb" value="0.0045"', 'gms.coulomb" value="1 2"', "must be one number"),
        ('gms.static" value="0.0054"', 'gms.static" value="0.001"', "at least coulomb"),
        ('gms.stiffness" value="0.8 ', 'gms.stiffness" value="', "has 4 values, others 3"),
        ('key="effects" value="gms viscous"', 'key="effects" value="gms viscous gms"', "'effects' lists gms twice"),
        ('key="effects" value="gms viscous"', 'key="effects" value="magic"', "no native effect is called 'magic'"),
        ('key="effects" value="gms viscous"', 'key="effects" value="gms"', "does not list viscous"),
        ('key="effects" value="gms viscous"', 'key="effects" value=""', "at least one effect|does not list"),
        ('key="gms.coulomb"', 'key="gms.wrong"', "gms.wrong"),
        ('<joint name="shaft"', '<joint type="ball" name="shaft"', "hinge or a slide"),
    ],
)
def test_a_bad_file_is_refused_when_it_is_compiled(old, new, message):
    xml = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', "")
    spec = engine.attach(xml, {"shaft": BEARING})
    spec.compile()
    good = spec.to_xml()
    assert old in good
    with pytest.raises(ValueError, match=message):
        mujoco.MjModel.from_xml_string(good.replace(old, new))


@pytest.mark.parametrize("version", [316, 3016000, 3009000, 4001000, 5000000, 0])
def test_other_series_of_mujoco_are_refused(version):
    class Library:
        mj_version = ctypes.CFUNCTYPE(ctypes.c_int)(lambda: version)

    with pytest.raises(EngineError, match=rf"runs with MuJoCo 4.0.x; .* version {version}: install"):
        engine.register(Library())
    model, data = axis()
    mujoco.mj_step(model, data)


def two_joint_arm(second="elbow"):
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="upper"><joint name="shoulder" axis="0 0 1"/>
<geom size=".1" mass="1"/><body name="lower" pos="0 1 0"><joint name="{second}" axis="0 0 1"/><geom size=".1" mass="1"/>
</body></body></worldbody></mujoco>"""


def test_friction_that_came_with_a_prefix_is_that_of_the_joint_as_it_is_called_now():
    parent = mujoco.MjSpec.from_string(two_joint_arm())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gravity differs
        child = engine.attach(two_joint_arm(), {"*": BEARING})
        parent.attach(child, prefix="left_", frame=parent.worldbody.add_frame())
    with pytest.raises(ModelError, match="'left_elbow' has friction already"):
        engine.attach(parent, {"left_elbow": DRY})
    assert engine.attach(parent, {"elbow": DRY}).compile().nplugin == 2


def test_joints_with_the_same_plant_share_one_instance():
    spec = engine.attach(two_joint_arm(), {"*": BEARING})
    model = spec.compile()
    assert model.nplugin == 1
    reloaded = mujoco.MjModel.from_xml_string(spec.to_xml())
    data = mujoco.MjData(reloaded)
    data.qvel[:] = [1, 2]
    mujoco.mj_forward(reloaded, data)
    assert engine.friction(reloaded, data, "shoulder").torque == pytest.approx(-2e-5)
    assert engine.friction(reloaded, data, "elbow").torque == pytest.approx(-4e-5)
    with pytest.raises(ModelError, match="'elbow' has friction already"):
        engine.attach(spec, {"elbow": BEARING})


def test_sharing_changes_no_bit():
    plants = {"shoulder": BEARING, "elbow": BEARING}
    shared = engine.attach(two_joint_arm(), plants)
    alone = mujoco.MjSpec.from_string(two_joint_arm())
    for name, plant in plants.items():
        engine.attach(alone, {name: plant})
    out = []
    for spec in (shared, alone):
        model = spec.compile()
        data = mujoco.MjData(model)
        for k in range(300):
            data.qfrc_applied[:] = 0.01 * np.sin([0.1 * k, 0.17 * k])
            mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    assert alone.compile().nplugin == 2
    assert np.array_equal(*out)


def push(model, data, steps):
    for k in range(steps):
        data.qfrc_applied[:] = 3 * np.sin(0.1 * k + np.arange(model.nv))
        mujoco.mj_step(model, data)


def seven_plants():
    """Three laws with four and two elements, some alike, on the seven joints of the arm."""
    stiff = effects.GMS(
        stiffness=[900, 400], fraction=[0.4, 0.6], coulomb=1.5, static=2, stribeck_velocity=0.3, attraction=40
    )
    laws = (
        Plant.axis() + stiff,
        Plant.axis() + effects.Cogging(harmonics=[8], amplitude=[0.2], phase=[0.3]) + effects.Coulomb(coulomb=1.0),
        Plant.axis() + stiff.replace(coulomb=1.2) + effects.Viscous(coefficient=0.3),
        Plant.axis() + stiff.replace(coulomb=1.0, stribeck_exponent=2.0),
        Plant.axis() + stiff,
        Plant.axis() + stiff.replace(coulomb=1.1) + effects.Viscous(coefficient=0.2),
        Plant.load(MODELS / "arm_joint.toml"),
    )
    spec = mujoco.MjSpec.from_file(str(MODELS / "arm.xml"))
    return dict(zip((j.name for j in spec.joints), laws, strict=True))


@pytest.mark.parametrize("integration", ["auto", "explicit", "implicit"])
def test_joints_of_different_friction_share_an_instance_and_no_bit_changes(integration):
    plants = seven_plants()
    shared = engine.attach(MODELS / "arm.xml", plants, integration)
    alone = mujoco.MjSpec.from_file(str(MODELS / "arm.xml"))
    for name, plant in plants.items():
        engine.attach(alone, {name: plant}, integration)
    models = [mujoco.MjModel.from_xml_string(spec.to_xml()) for spec in (shared, alone) if spec.compile()]
    assert [m.nplugin for m in models] == [1, 7]
    datas = [mujoco.MjData(m) for m in models]
    for model, data in zip(models, datas, strict=True):
        data.qvel[:] = 1
        mujoco.mj_step(model, data, 20)
        mujoco.mj_resetData(model, data)
        push(model, data, 300)
        assert np.array_equal(data.qpos, datas[0].qpos)
    for name in plants:
        readings = [engine.friction(m, d, name) for m, d in zip(models, datas, strict=True)]
        for reading in readings[1:]:
            assert reading.torque == readings[0].torque and list(reading.states) == list(readings[0].states)
            for law, states in reading.states.items():
                assert np.array_equal(states, readings[0].states[law])
    for name, plant in plants.items():
        found = plant_of_joint(shared, name)
        for effect in plant.effects:
            assert not effect.is_native or found[effect.name].values == effect.values


def test_joints_of_different_friction_are_each_read_by_sensors():
    plants = seven_plants()
    model = engine.attach(MODELS / "arm.xml", plants, sensors=engine.READINGS).compile()
    data = mujoco.MjData(model)
    push(model, data, 100)
    mujoco.mj_forward(model, data)
    for name in plants:
        reading = engine.friction(model, data, name)
        assert data.sensor(f"{name}_friction_torque").data == reading.torque
        assert data.sensor(f"{name}_friction_power").data == reading.power
        states = np.concatenate([[], *reading.states.values()])
        assert not states.size or np.array_equal(data.sensor(f"{name}_friction_states").data, states)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('key="gms.coulomb" value="0.0045; 0.004"', 'key="gms.coulomb" value="0.0045; 0.004; 1"', "3 parts .* joint 2"),
        ('key="joint" value="shoulder; elbow"', 'key="joint" value="shoulder; elbow;"', "2 parts .* joint 3"),
        ('key="joint" value="shoulder; elbow"', 'key="joint" value="shoulder; "', "at least one between semicolons"),
        ('key="joint" value="shoulder; elbow"', 'key="joint" value="shoulder; shoulder"', "has friction already"),
        ('key="gms.coulomb" value="0.0045; 0.004"', 'key="gms.coulomb" value="; 0.004"', "gms.coulomb has no value"),
    ],
)
def test_parts_that_do_not_belong_together_are_refused(old, new, message):
    other = BEARING.replace(BEARING["gms"].replace(coulomb=4e-3))
    good = engine.attach(two_joint_arm(), {"shoulder": BEARING, "elbow": other}).to_xml()
    mujoco.MjData(mujoco.MjModel.from_xml_string(good))
    assert old in good
    with pytest.raises(ValueError, match=message):
        mujoco.MjModel.from_xml_string(good.replace(old, new))
    if "parts" in message:
        with pytest.raises(ModelError, match=message):
            Plant.from_mjcf(good.replace(old, new), "elbow")


def test_a_joint_with_a_blank_in_its_name():
    model = engine.attach(two_joint_arm("left elbow"), {"*": BEARING}).compile()
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 2]
    mujoco.mj_forward(model, data)
    assert engine.friction(model, data, "left elbow").torque == pytest.approx(-4e-5)


@pytest.mark.parametrize("change", ["part", "body", "joint", "name"])
def test_joints_that_share_friction_go_on_without_one_that_is_left_behind_and_that_is_told(change):
    other = BEARING.replace(BEARING["gms"].replace(coulomb=4e-3))
    spec = engine.attach(two_joint_arm(), {"shoulder": BEARING, "elbow": other})
    left, gone = ("r_elbow", "r_shoulder") if change == "part" else ("shoulder", "elbow")
    if change == "part":
        parent = mujoco.MjSpec()
        parent.worldbody.add_frame().attach_body(spec.body("lower"), "r_", "")
        spec = parent
    elif change == "name":
        spec.joint("elbow").name = "wrist"
    else:
        spec.delete(spec.body("lower") if change == "body" else spec.joint("elbow"))
    with pytest.warns(UserWarning, match=rf"friction of '{gone}' is left out: .*; the joints are .*{left}"):
        model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1
    for _ in range(20):
        mujoco.mj_step(model, data)
    reading, plant = engine.friction(model, data, left), other if change == "part" else BEARING
    assert reading.torque != 0 and len(reading.forces) == 4
    with warnings.catch_warnings(action="ignore"):
        assert plant_of_joint(spec, left)["gms"].values == plant["gms"].values
    if change == "name":
        with pytest.raises(ModelError, match="'wrist' has no friction"):
            engine.friction(model, data, "wrist")


def test_friction_whose_joints_are_all_gone_does_not_compile():
    spec = engine.attach(two_joint_arm(), {"*": BEARING})
    for name in "shoulder", "elbow":
        spec.joint(name).name += "_2"
    with pytest.raises(ValueError, match="no joint is called 'shoulder'; the joints are shoulder_2, elbow_2"):
        spec.compile()


def test_a_load_heavier_than_its_axis_is_refused_and_of_an_unknown_axis_warned_of_in_its_own_unit():
    slide = AXIS.replace('<joint name="shaft" axis="0 0 1"/>', '<joint name="shaft" type="slide" axis="0 0 1"/>')
    load = effects.Backlash(inertia=2.0, gap=1e-3, frequency=50.0, damping=0.1)
    with pytest.raises(ModelError, match=r"backlash must have less inertia than the axis, 1\.5"):
        engine.attach(slide, {"shaft": Plant.axis(1.5, "slide") + load})
    for source, kind, unit in ((slide, "slide", "2 kg,"), (AXIS, "hinge", "2 kg m\\^2,")):
        with pytest.warns(UserWarning, match=f"the load of backlash, {unit} is part of the inertia"):
            engine.attach(source, {"shaft": Plant.axis(None, kind) + load})
