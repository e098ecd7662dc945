"""The mechanism behind the environments: a bare servo axis or a joint of a MuJoCo model, with the effects of a plant.

Units are those of a hinge; a slide has m for rad and N for N m.
"""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np

from . import engine
from .errors import ModelError, listing
from .files import MODELS
from .plant import Plant, plant_of

DRIVE = "gms_mujoco_drive"  # the motor


class Mechanism:
    """One hinge or slide with a motor, ready to be built with the effects of any plant.

    Args:
        plant: a Plant, the path of a model.toml or a preset of models/. On a joint of a model it needs no inertia.
        model: None, a bare axis with the inertia of the plant; or an MJCF file or MjSpec.
        joint: of that model. Its other joints are locked where the model begins, its actuators, tendons, equalities
            and contacts are gone, and so is friction that `attach` has put there; weight, limits, inertia and armature
            stay.

    Attributes:
        plant: complete, with the inertia of the joint.
        bare: whether it is a bare axis; a joint of a model has an inertia of its own.
        joint: name of it.
        start: position of the joint where the model begins [rad]; None where it may begin anywhere.
        limits: of the joint [rad].
        weight: largest torque of weight and springs of the model on the joint, over its range [N m].

    Raises:
        ModelError: no such model, joint or parameter value.
    """

    def __init__(
        self, plant: Plant | str | os.PathLike[str], model: mujoco.MjSpec | str | os.PathLike[str] | None = None,
        joint: str | None = None,
    ) -> None:
        found = plant_of(plant).torque_driven()
        if (model is None) != (joint is None):
            raise ModelError("model and joint go together: an MJCF file and the name of one of its joints")
        self._still: tuple[mujoco.MjModel, mujoco.MjData] | None = None  # of the model, without friction
        self.bare, self.limits = model is None, (-math.inf, math.inf)
        if model is None or joint is None:
            self.plant, self.joint = found.complete().light_loads(), "shaft"
            self.start = None if self.plant.kind == "hinge" else 0.0
            self.weight = 0.0
            self._spec = _bare(self.plant)
        else:
            self.joint = joint
            self._spec = _without_friction(engine.spec_of(model).copy())
            _isolate(self._spec, joint)
            bare = engine.compiled(self._spec.copy())
            data = mujoco.MjData(bare)
            mujoco.mj_forward(bare, data)
            mass = np.zeros((1, 1))
            mujoco.mj_fullM(bare, data, mass)
            self.plant = replace(found, inertia=float(mass[0, 0]), inertia_known=True)
            self.plant.complete().light_loads()
            self.start = float(data.qpos[0])
            self._still = bare, data
            low, high = self.start - math.pi, self.start + math.pi
            if bare.jnt_limited[0]:
                low, high = self.limits = (float(bare.jnt_range[0, 0]), float(bare.jnt_range[0, 1]))
            self.weight = max(abs(self.push(x)) for x in np.linspace(low, high, 73))

    def push(self, position: float) -> float:
        """Torque of weight and springs of the model on the joint where it stands still [N m]."""
        if self._still is None:
            return 0.0
        model, data = self._still
        data.qpos[0] = position
        mujoco.mj_forward(model, data)
        carried = data.qfrc_gravcomp[0] if model.jnt_actgravcomp[0] else 0.0  # else it is passive
        return float(data.qfrc_passive[0] + carried - data.qfrc_bias[0])

    def build(self, plant: Plant, timestep: float, torque_limit: float) -> mujoco.MjModel:
        """The model with the effects of a plant; qpos[0] is the joint, ctrl[0] the torque of the motor [N m].

        Args:
            plant: of the inertia of `self.plant`.
            timestep: of MuJoCo [s].
            torque_limit: of the drive [N m].
        """
        spec = self._spec.copy()
        spec.option.timestep = timestep
        spec.memory = 1 << 16  # an axis needs little, and thousands of them lie in memory
        spec.actuator(DRIVE).ctrlrange = [-torque_limit, torque_limit]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*acts on the measurement alone")  # the encoder sees to it
            return engine.compiled(engine.attach(spec, {self.joint: plant}))


def _bare(plant: Plant) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(MODELS / "servo_axis.xml"))
    _isolate(spec, "shaft")
    rotor, joint = spec.body("rotor"), spec.joint("shaft")
    if plant.kind == "slide":
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE
        rotor.mass = plant.driven_inertia
    else:
        rotor.inertia = [plant.driven_inertia] * 3
    assert plant.inertia is not None
    joint.armature = plant.inertia - plant.driven_inertia  # attach takes it off again
    return spec


def _without_friction(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Without what `attach` has put there: on locked joints it could not be, on the other one it would act twice."""
    ours = (engine.PLUGIN, engine.SENSOR)
    instances = {p.name for p in spec.plugins if p.plugin_name in ours}
    if not instances:
        return spec
    engine.compiled(spec)  # as text: MjSpec keeps pointers to an instance that is deleted
    root = ElementTree.fromstring(spec.to_xml())
    for parent in list(root.iter()):
        for child in parent.findall("plugin"):
            if child.get("plugin") in ours or child.get("instance") in instances:
                parent.remove(child)
    bare = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=spec.assets)
    bare.modelfiledir = spec.modelfiledir
    return bare


def _isolate(spec: mujoco.MjSpec, name: str) -> None:
    """Locks all joints but one and puts a motor on that."""
    if spec.joint(name) is None:
        names = listing(j.name for j in spec.joints if j.name)
        raise ModelError(f"no joint is called {name!r}; the joints are {names}")
    if spec.joint(name).type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise ModelError(f"joint {name!r} is a ball or free joint; a servo needs a hinge or a slide")
    for things in (spec.keys, spec.sensors, spec.actuators, spec.equalities, spec.tendons, spec.excludes):
        for thing in list(things):
            spec.delete(thing)
    for joint in list(spec.joints):
        if joint.name != name:
            spec.delete(joint)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.add_actuator(name=DRIVE, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrllimited=True, ctrlrange=[-1, 1])
