"""A joint of a robot: the rigid-body torque is MuJoCo's, and what a fit finds beyond it is the joint's own."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import gms_mujoco as gms
from gms_mujoco import formats
from gms_mujoco.dataset import joints, load
from gms_mujoco.errors import DataError
from gms_mujoco.identification.between_samples import second_difference
from gms_mujoco.logs.robot import Payload, Robot, Setup
from gms_mujoco.record import Record

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
import arm

PENDULUM = """<mujoco><worldbody><body><joint name="hip" axis="0 1 0" armature="0.03" damping="5" frictionloss="2"/>
<geom type="sphere" size="0.01" pos="0 0 -0.5" mass="2"/>
<body pos="0 0 -0.5"><joint name="slider" type="slide" axis="0 0 1" range="-0.3 0.3"/>
<geom type="sphere" size="0.02" mass="1"/></body></body></worldbody></mujoco>"""


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM)
    return path


def motion(n=2000, h=1e-3):
    """Time, and smooth positions of two joints with their exact derivatives."""
    t = np.arange(n) * h
    q = {"hip": 0.7 * np.sin(3 * t) + 0.4, "slider": 0.1 * np.cos(5 * t)}
    v = {"hip": 2.1 * np.cos(3 * t), "slider": -0.5 * np.sin(5 * t)}
    a = {"hip": -6.3 * np.sin(3 * t), "slider": -2.5 * np.cos(5 * t)}
    return t, q, v, a


def test_rigid_torque_of_a_pendulum_with_a_sliding_mass_is_the_textbook_s(pendulum: Path) -> None:
    _, q, v, a = motion()
    rigid = Robot(pendulum, "hip").torque(q, v)
    r = 0.5 - q["slider"]  # the slider points at the pivot
    inertia = 0.03 + 2 * 0.5**2 + r**2 + 0.4 * 2 * 0.01**2 + 0.4 * 0.02**2
    weight = 9.81 * (2 * 0.5 + r) * np.sin(q["hip"])
    coriolis = -2 * r * v["slider"] * v["hip"]
    assert np.allclose(rigid.inertia["hip"], inertia, rtol=1e-6)
    assert np.allclose(rigid.bias, weight + coriolis, atol=1e-6), "damping and friction of the model stay out"
    assert np.allclose(rigid.inertia["slider"], 0, atol=1e-12)
    assert np.allclose(rigid.accelerating(a), inertia * a["hip"], rtol=1e-6)


@pytest.mark.parametrize("mass", [0.7, -0.7])
def test_a_payload_takes_what_a_geom_of_its_mass_does(pendulum: Path, mass: float) -> None:
    _, q, v, a = motion()
    q, v, a = ({k: x[::20] for k, x in part.items()} for part in (q, v, a))
    geom = f'<geom type="sphere" size="1e-3" pos="0.1 0.02 -0.3" mass="{abs(mass)}"/>'
    (pendulum.parent / "heavier.xml").write_text(PENDULUM.replace('mass="1"/>', f'mass="1"/>{geom}'))
    body = '<body pos="0 0 -0.5"><joint name="slider"'
    named = PENDULUM.replace(body, body.replace("<body", '<body name="bob"'))
    pendulum.write_text(named)
    bare = Robot(pendulum, "hip")
    loaded = bare.set_up(Setup(payload=Payload("bob", mass, (0.1, 0.02, -0.3))))
    heavier = Robot(pendulum.parent / "heavier.xml", "hip")
    assert heavier.model.body_mass.sum() == pytest.approx(bare.model.body_mass.sum() + 0.7)
    without, with_it, compiled = (r.torque(q, v) for r in (bare, loaded, heavier))
    sign = np.sign(mass)
    assert np.allclose(with_it.bias - without.bias, sign * (compiled.bias - without.bias), atol=1e-6)
    for joint in ("hip", "slider"):
        change = with_it.inertia[joint] - without.inertia[joint]
        assert np.allclose(change, sign * (compiled.inertia[joint] - without.inertia[joint]), atol=1e-6)
    with pytest.raises(DataError, match=r"no body 'hand'; pendulum\.xml has"):
        bare.set_up(Setup(payload=Payload("hand", 1.0, (0.0, 0.0, 0.0))))


def test_a_zero_and_gravity_are_those_of_a_model_that_has_them(pendulum: Path) -> None:
    _, q, v, _ = motion()
    q, v = ({k: x[::20] for k, x in part.items()} for part in (q, v))
    robot = Robot(pendulum, "hip")
    turned = robot.set_up(Setup(zero={"hip": 0.4})).torque(q, v)
    assert np.allclose(turned.bias, robot.torque({**q, "hip": q["hip"] + 0.4}, v).bias)
    # Gravity along -x is the world turned by a quarter about the joint.
    on_a_wall = robot.set_up(Setup(gravity=(-9.81, 0.0, 0.0))).torque(q, v)
    assert np.allclose(on_a_wall.bias, robot.torque({**q, "hip": q["hip"] - np.pi / 2}, v).bias, atol=1e-9)


def test_a_record_carries_all_of_the_torque_of_mj_inverse() -> None:
    rng = np.random.default_rng(3)
    robot = Robot(gms.MODELS / "arm.xml", "elbow")
    names, t = list(robot.kinds), np.arange(1500) * 1e-3
    w, phase = rng.uniform(2, 9, (7, 1)), rng.uniform(0, 6, (7, 1))
    q = 0.4 * np.sin(w * t + phase)
    model = mujoco.MjModel.from_xml_path(str(gms.MODELS / "arm.xml"))
    data, full = mujoco.MjData(model), []
    for k in range(len(t)):
        data.qpos, data.qvel = q[:, k], (0.4 * w * np.cos(w * t + phase))[:, k]
        data.qacc = (-0.4 * w**2 * np.sin(w * t + phase))[:, k]
        mujoco.mj_inverse(model, data)
        full.append(data.qfrc_inverse[model.joint("elbow").id])
    others = {name: q[i] for i, name in enumerate(names) if name != "elbow"}
    record = Record("elbow", t, {"torque": np.array(full), "position": q[names.index("elbow")]}, others=others)
    (found,), (note,) = robot.on([record])
    inertia = found.signals["inertia_change"] + robot.inertia
    total = inertia * second_difference(found.position, 1e-3) + found.signals["rigid_torque"]
    inside = slice(100, -100)
    assert np.abs(total - full)[inside].max() < 2e-4 * np.ptp(full)
    rotor = model.dof_armature[model.joint("elbow").id] * -(0.4 * w**2 * np.sin(w * t + phase))[names.index("elbow")]
    assert np.abs(found.get("load") - (full - rotor))[inside].max() < 2e-3 * np.ptp(full)
    assert (inertia < 1.001 * robot.inertia).all() and "elbow" in note


def test_load_means_the_same_in_a_record_and_in_mujoco(tmp_path: Path) -> None:
    """The log of an arm whose elbow has friction that grows with its load: its replay gives the plug-in's torque."""
    h, n, rotor = 1e-3, 3000, 2.0  # the rotor takes about a third of the torque
    spec = mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml"))
    spec.joint("elbow").armature = rotor
    (tmp_path / "arm.xml").write_text(spec.to_xml())
    grows = gms.effects.find("load_dependent_friction")(coefficient=0.05)
    (arm.friction("elbow") + grows).attach(spec, "elbow")
    spec.option.timestep = h
    model = spec.compile()
    data, names = mujoco.MjData(model), [j.name for j in spec.joints]
    k, inertia = names.index("elbow"), np.maximum(model.dof_armature, 0.1)
    data.qpos = start = np.array([0, 0.5, 0, 0.8, 0, 0.5, 0])
    target, speed = arm.references(np.random.default_rng(0), len(names), list(range(len(names))), n * h)
    q, torque, friction = np.empty((n, len(names))), np.empty(n), np.empty(n)
    for i in range(n):
        q[i] = data.qpos
        data.ctrl = data.qfrc_bias + inertia * (3600 * (start + target[i] - q[i]) + 120 * (speed[i] - data.qvel))
        mujoco.mj_step(model, data)
        torque[i], friction[i] = data.ctrl[k], gms.friction(model, data, "elbow").torque
    others = {name: q[:, j] for j, name in enumerate(names) if j != k}
    record = Record("elbow", np.arange(n) * h, {"torque": torque, "position": q[:, k]}, others=others)
    (found,), _ = Robot(tmp_path / "arm.xml", "elbow").on([record])
    motion = found.time, found.position, np.gradient(found.position, h), found.get("load")
    inside = slice(300, -300)

    def off(plant: gms.Plant) -> float:
        return float(np.std((plant.joint().replay(*motion).torque - friction)[inside]) / np.std(friction[inside]))

    assert off(arm.friction("elbow") + grows) < 5e-3
    assert off(arm.friction("elbow")) > 0.2


def test_a_joint_at_the_end_of_its_range_is_told(pendulum: Path) -> None:
    t, q, *_ = motion()
    record = Record("run", t, {"torque": np.zeros_like(t), "position": q["slider"]})
    assert len(Robot(pendulum, "slider").on([record])[1]) == 1
    far = Record("far", t, {"torque": np.zeros_like(t), "position": 4 * q["slider"]})
    _, (_, said) = Robot(pendulum, "slider").on([record, far])
    assert "-0.3 to 0.3 m in far" in said


def test_a_joint_that_is_not_measured_stands_in_the_pose_given(pendulum: Path) -> None:
    q, still = {"hip": np.linspace(-1, 1, 50)}, {"hip": np.zeros(50)}
    for at in (0.0, 0.2):
        rigid = Robot(pendulum, "hip", Setup({"slider": at})).torque(q, still)
        assert np.allclose(rigid.bias, 9.81 * (2 * 0.5 + 0.5 - at) * np.sin(q["hip"]))


def write(folder: Path, axis: str, record: str, **columns: np.ndarray) -> Path:
    formats.write(folder / "run.csv", columns)
    text = f'[axis]\nmodel = "pendulum.xml"\n{axis}[[record]]\nfile = "run.csv"\n{record}'
    (folder / "dataset.toml").write_text(text)
    return folder


BOTH = (
    'joint = ["hip", "slider"]\ntorque_constant = { hip = 2.0, slider = 3.0 }\n'
    "encoder_counts_per_rev = { hip = 4096 }\n",
    'use = "fit"\ncolumns = { current = { hip = "i1", slider = "i2" }, position = { hip = "q1", slider = "q2" } }\n'
    'units = { position = { hip = "deg", slider = "mm" } }\n',
)


def test_a_set_of_several_joints_is_read_joint_by_joint(pendulum: Path) -> None:
    t, q, _, _ = motion()
    raw = {"q1": np.degrees(q["hip"]), "q2": 1000 * q["slider"], "i1": np.sin(t), "i2": np.cos(t)}
    folder = write(pendulum.parent, *BOTH, time=t, **raw)
    assert joints(folder) == ("hip", "slider")
    with pytest.raises(DataError, match=r"several joints, hip, slider: choose one"):
        load(folder)
    hip, slider = (load(folder, joint=name) for name in joints(folder))
    assert (hip.kind, slider.kind, hip.joint) == ("hinge", "slide", "hip") and hip.inertia is None
    assert np.allclose(hip.fit[0].torque, 2 * np.sin(t)) and np.allclose(slider.fit[0].torque, 3 * np.cos(t))
    assert np.allclose(hip.fit[0].position, q["hip"]) and np.allclose(slider.fit[0].position, q["slider"])
    assert hip.fit[0].resolution == pytest.approx(2 * np.pi / 4096) and slider.fit[0].resolution is None
    # The slider hangs on the hip: the centrifugal force of the measured swing is in its load.
    swing = 1.0 * (0.5 - q["slider"]) * (2.1 * np.cos(3 * t)) ** 2 + 9.81 * np.cos(q["hip"])
    slide = slider.fit[0].get("rigid_torque")
    assert slide is not None and np.allclose(slide[50:-50], swing[50:-50], atol=2e-2)


def test_a_response_is_of_the_joint_that_it_names(pendulum: Path) -> None:
    folder = pendulum.parent
    f = np.geomspace(1, 100, 12)
    formats.write(folder / "r.csv", {"f [Hz]": f, "real": -1 / f**2, "imag": -0.1 / f})
    entry = '[axis]\nmodel = "pendulum.xml"\njoint = {}\n' + 2 * '[[frf]]\nfile = "r.csv"\ninput = "torque"\n' \
            'output = "position"\n{}\n'
    (folder / "dataset.toml").write_text(entry.format('["hip", "slider"]', 'joint = "slider"', 'joint = "hip"'))
    assert [load(folder, joint=name).frfs[0].unit for name in joints(folder)] == ["rad/(N m)", "m/N"]
    assert all(len(load(folder, joint=name).frfs) == 1 for name in joints(folder))
    for names, joint, words in (('["hip", "slider"]', "", "frf 2: joint must be given, .* several, hip, slider"),
                                ('["hip", "slider"]', 'joint = "knee"', "frf 2: joint must be among .*'knee'")):
        (folder / "dataset.toml").write_text(entry.format(names, 'joint = "hip"', joint))
        with pytest.raises(DataError, match=words):
            load(folder, joint="hip")
    (folder / "dataset.toml").write_text(entry.format('"hip"', "", ""))
    assert len(load(folder).frfs) == 2


@pytest.mark.parametrize("head", ["time,torque,q1 [deg],q2_mm\n", "time,torque,q1,q2\ns,-,deg,mm\n"])
def test_the_unit_that_a_file_states_for_a_position_counts_for_every_joint(head: str, pendulum: Path) -> None:
    t, q, _, _ = motion()
    rows = np.stack([t, np.sin(t), np.degrees(q["hip"]), 1000 * q["slider"]], 1).tolist()
    (pendulum.parent / "stated.csv").write_text(head + "\n".join(",".join(map(repr, row)) for row in rows))
    hip, slider = head.splitlines()[0].split(",")[2:]
    record = f'use = "fit"\ncolumns = {{ torque = {{ hip = "torque", slider = "torque" }}, ' \
             f'position = {{ hip = "{hip}", slider = "{slider}" }} }}\n'
    folder = write(pendulum.parent, 'joint = ["hip", "slider"]\n', record, time=t)
    file = folder / "dataset.toml"
    file.write_text(file.read_text().replace("run.csv", "stated.csv"))
    stated = {name: load(folder, joint=name) for name in joints(folder)}
    assert "position in deg, position of slider in mm" in stated["hip"].notes[0]
    file.write_text(file.read_text() + 'units = { position = { hip = "deg", slider = "mm" } }\n')
    for name, runs in stated.items():
        declared = load(folder, joint=name).fit[0]
        assert np.array_equal(runs.fit[0].position, declared.position)
        assert np.array_equal(runs.fit[0].signals["rigid_torque"], declared.signals["rigid_torque"])


@pytest.mark.parametrize(
    ("axis", "record", "words"),
    [
        ('joint = "knee"\n', "", "no hinge or slide joint 'knee'; it has hip, slider"),
        ("", "", "axis.model needs axis.joint"),
        ('joint = "hip"\nkind = "slide"\n', "", "'hip' is a hinge in axis.model"),
        ('joint = "hip"\ninertia = 2.0\n', "", 'beside axis.model only "model"'),
        ('joint = "hip"\npose = { knee = 1.0 }\n', "", "axis.pose: no hinge or slide joint 'knee'"),
        ('joint = "hip"\n', 'columns = { position = { knee = "position" } }\n', "no hinge or slide joint 'knee'"),
        ('joint = "hip"\n', 'columns = { position = { slider = "nope" } }\n', "no column 'nope' for position.slider"),
        ('joint = "hip"\n', 'joint = "slider"\n', "joint must be among those of the axis, hip"),
        ('joint = ["hip", "slider"]\n', 'columns = { torque = "torque" }\n', "a column for each"),
    ],
)
def test_mistakes_name_the_joints_that_exist(axis: str, record: str, words: str, pendulum: Path) -> None:
    t, q, _, _ = motion()
    folder = write(pendulum.parent, axis, record, time=t, torque=np.sin(t), position=q["hip"])
    with pytest.raises(DataError) as caught:
        load(folder, joint="hip" if axis.startswith("joint = [") else None)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_model_that_mujoco_cannot_load_is_named(tmp_path: Path) -> None:
    (tmp_path / "pendulum.xml").write_text("<mujoco><worldbody><body></mujoco>")
    t, q, _, _ = motion()
    with pytest.raises(DataError, match=r"pendulum\.xml.*MuJoCo cannot load it"):
        load(write(tmp_path, 'joint = "hip"\n', "", time=t, torque=np.sin(t), position=q["hip"]))


@pytest.fixture(scope="module")
def elbow(tmp_path_factory: pytest.TempPathFactory) -> gms.Dataset:
    """The elbow of an arm that moves in all joints, with a mean friction and nothing hidden."""
    folder = tmp_path_factory.mktemp("elbow")
    arm.write(folder, "elbow", hidden=arm.Hidden("nothing"), uses=("fit", "fit", "validate"), duration=5.0)
    return load(folder)


def test_inertia_and_friction_of_a_moving_arm_s_joint_come_back(elbow: gms.Dataset) -> None:
    found = gms.fit(gms.baseline(elbow.inertia), elbow.fit).plant
    true = arm.friction("elbow")
    assert found.inertia == pytest.approx(Robot(gms.MODELS / "arm.xml", "elbow").inertia, rel=0.01)
    assert found["gms"].coulomb == pytest.approx(true["gms"].coulomb, rel=0.02)
    assert found["viscous"].coefficient == pytest.approx(true["viscous"].coefficient, rel=0.03)
    scores = gms.compare(found, elbow.validate)
    assert scores.torque_error < 1.6 * scores.noise_floor and scores.torque_error < 0.02
    assert scores.simulation_error < 0.01, "forward, with gravity and the other joints' torque"


def test_a_rotor_that_the_model_forgets_is_found_in_the_inertia(elbow: gms.Dataset, tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml"))
    spec.joint("elbow").armature = 0.1  # of 0.4
    path = tmp_path / "light.xml"
    path.write_text(spec.to_xml())
    names = [j.name for j in spec.joints]
    text = (elbow.path / "dataset.toml").read_text().replace((gms.MODELS / "arm.xml").as_posix(), path.as_posix())
    (elbow.path / "light.toml").write_text(text)
    light = load(elbow.path / "light.toml")
    found = gms.fit(gms.baseline(light.inertia), light.fit).plant
    assert names[3] == "elbow" and found.inertia - Robot(path, "elbow").inertia == pytest.approx(0.3, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("joint", ["elbow", "wrist_flex"])
def test_the_hidden_effect_of_a_joint_of_an_arm_is_named(joint: str, tmp_path: Path) -> None:
    found = gms.diagnose(load(arm.write(tmp_path, joint)))
    assert [e.name for e in found][:1] == [arm.HIDDEN[joint].name]
    assert found.comparisons[-1].torque_error < 0.5 * found.comparisons[0].torque_error
