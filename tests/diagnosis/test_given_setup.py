"""A setup that contradicts the model of a robot: a payload, the way that it hangs, its zeros; each with its numbers."""

from pathlib import Path

import numpy as np
import pytest
from bench import slow

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.given_setup import corrected_setup
from gms_mujoco.errors import DataError
from gms_mujoco.identification.between_samples import second_difference
from gms_mujoco.logs.robot import Payload, Robot, Setup
from gms_mujoco.record import Record

ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1.5"/>
<body name="fore" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.025" mass="0.8"/></body></body></worldbody></mujoco>"""
HEALTHY = gms.Plant.axis(1.0) + gms.effects.Dahl(stiffness=300.0, coulomb=0.3) + gms.effects.Viscous(coefficient=0.05)
START = gms.Plant.axis() + gms.effects.Dahl() + gms.effects.Viscous()


def measured(folder: Path, truth: Setup, hidden: gms.Plant | None = None, uses: str = "fit fit validate") -> Dataset:
    """Logs of the elbow of an arm that was set up in some way, read with the model of another."""
    path = folder / "arm.xml"
    path.write_text(ARM)
    machine, h, rng = Robot(path, "elbow", truth), 2e-3, np.random.default_rng(4)
    t, records = h * np.arange(2500), []
    friction = (hidden or HEALTHY).joint()
    for i, use in enumerate(uses.split()):
        q = {}
        for joint in ("shoulder", "elbow"):
            f, phase = rng.uniform(0.2, 1.6, 5), rng.uniform(0, 6, 5)
            q[joint] = 0.35 * np.sin(2 * np.pi * f[:, None] * t + phase[:, None]).sum(0) + 0.3
        v = {k: np.gradient(x, h) for k, x in q.items()}
        rigid = machine.torque(q, v)
        moved = rigid.bias + rigid.accelerating({k: second_difference(x, h) for k, x in q.items()})
        dragged = friction.replay(t, q["elbow"], v["elbow"]).torque
        torque = moved - dragged + rng.normal(0, 0.02, len(t))
        read = {k: x + rng.normal(0, 2e-6, len(t)) for k, x in q.items()}
        signals = {"torque": torque, "position": read["elbow"]}
        records.append(Record(f"r{i}", t, signals, use, others={"shoulder": read["shoulder"]}))
    known = Robot(path, "elbow")
    return Dataset(folder, tuple(known.on(records)[0]), robot=known, joint="elbow")


def test_a_robot_as_its_model_has_it_is_left_alone(tmp_path: Path) -> None:
    runs = measured(tmp_path, Setup())
    assert corrected_setup(runs, START) == (runs, "")


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.5, *slow(-0.3)])
def test_a_payload_is_found_with_its_moment(tmp_path: Path, mass: float) -> None:
    runs, said = corrected_setup(measured(tmp_path, Setup(payload=Payload("fore", mass, (0.25, 0.0, 0.0)))), START)
    assert runs.robot is not None
    found = runs.robot.setup.payload
    assert found is not None
    moment = found.mass * np.array(found.position)
    assert moment[0] == pytest.approx(0.25 * mass, rel=0.03) and abs(moment[2]) < 0.01 * abs(mass)
    assert found.mass == pytest.approx(mass, rel=0.3)  # told from its moment by the other joint's motion alone
    assert 'payload = { body = "fore"' in said and ("more" if mass > 0 else "less") in said


def test_gravity_and_zeros_are_found(tmp_path: Path) -> None:
    runs, said = corrected_setup(measured(tmp_path, Setup(zero={"shoulder": -1.2})), START)
    assert runs.robot is not None and runs.robot.setup.zero["shoulder"] == pytest.approx(-1.2, abs=0.01)
    assert "zero = { shoulder = -1.2" in said
    assert "or as if gravity were" in said, "in a plane a turned base is a turned first joint"


@pytest.mark.slow
@pytest.mark.parametrize("joint", ["shoulder", "elbow"])
def test_a_joint_that_counts_backwards_is_found(tmp_path: Path, joint: str) -> None:
    runs, said = corrected_setup(measured(tmp_path, Setup(reversed=(joint,))), START)
    assert runs.robot is not None and runs.robot.setup == Setup(reversed=(joint,))
    assert f'reversed = ["{joint}"]' in said


@pytest.mark.slow
def test_an_effect_is_found_beside_a_setup(tmp_path: Path) -> None:
    # As stiff either way: Dahl friction that is stronger as a whole one way is the same with a constant torque.
    dragged = HEALTHY + gms.effects.AsymmetricFriction(level=0.25, stiffening=0.0)
    found = diagnose(measured(tmp_path, Setup(payload=Payload("fore", 0.5, (0.25, 0.0, 0.0))), dragged), START)
    assert [e.name for e in found] == ["asymmetric_friction"] and found.verdict == "explained"
    assert found.steps[0].evidence.startswith("The records contradict arm.xml: it is as if fore had")
    assert found.found[0].values["level"] == pytest.approx(0.25, rel=0.05)


@pytest.mark.slow
def test_a_payload_is_weighed_again_beside_the_law_of_friction_that_was_found(tmp_path: Path) -> None:
    """Beside another law it makes up for what that lacks: by a hundredth here, by a third where less is moved."""
    lugre = gms.effects.LuGre(stiffness=1e3, coulomb=6.0, static=12.0, stribeck_velocity=0.5, stribeck_exponent=2.0)
    truth = gms.Plant.axis(1.0) + lugre + gms.effects.Viscous(coefficient=0.05)
    found = diagnose(measured(tmp_path, Setup(payload=Payload("fore", 0.5, (0.25, 0.0, 0.0))), truth))
    assert found.verdict == "adequate" and "lugre" in found.plant
    assert float(found.steps[0].evidence.split("mass = ")[1].split(",")[0]) == pytest.approx(0.5, abs=5e-4)


@pytest.mark.slow
def test_an_effect_of_the_axis_is_no_setup(tmp_path: Path) -> None:
    turned = HEALTHY + gms.effects.Cogging(harmonics=[3.0], amplitude=[0.4], phase=[0.5])
    found = diagnose(measured(tmp_path, Setup(), turned), START)
    assert [e.name for e in found] == ["cogging"]
    assert "contradict" not in found.steps[0].evidence


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("payload = { body = 'fore', mass = 'a' }", "axis.payload must be a table as in"),
        ("payload = { body = 'fore', mass = 1.0, position = [0.0] }", "axis.payload must be a table as in"),
        ("payload = { mas = 1.0 }", "axis.payload.mas"),
        ("payload = { body = 'hand', mass = 1.0 }", "no body 'hand'; arm.xml has fore, upper, world"),
        ("gravity = [0.0, 1.0]", "axis.gravity must be three numbers"),
        ("zero = { wrist = 0.1 }", "axis.zero: no hinge or slide joint 'wrist'"),
        ("reversed = 'elbow'", "axis.reversed must be a list of joints"),
        ("reversed = ['wrist']", "axis.reversed: no hinge or slide joint 'wrist'"),
        ("zero = { elbow = true }", "axis.zero.elbow must be a number"),
    ],
)
def test_a_setup_that_cannot_be_is_refused(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    np.savetxt(tmp_path / "a.csv", np.ones((100, 3)), delimiter=",", header="time,torque,position", comments="")
    text = f'[axis]\nmodel = "arm.xml"\njoint = "elbow"\n{line}\n[[record]]\nfile = "a.csv"\n'
    (tmp_path / "dataset.toml").write_text(text)
    with pytest.raises(DataError) as error:
        gms.load(tmp_path)
    assert said in str(error.value)
