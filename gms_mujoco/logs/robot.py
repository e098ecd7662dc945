"""Joints of a MuJoCo model as the axis of a measurement: the torque that the rigid bodies take along the motion.

On joint i of a robot the torque u of the drive and the torque f of the effects move the rigid bodies,

    u + f = M_ii(q) q''_i + sum_j M_ij(q) q''_j + c_i(q, q') + g_i(q)

(Siciliano et al., Robotics (2009), chapter 7). The model knows all but f and its own errors. So a record of the joint
carries the last three terms as the signal `rigid_torque` and M_ii(q) - J as `inertia_change`, with one constant J, the
largest M_ii in the joint ranges: J is what a fit identifies, and J less the model's is the error of the model (most
often the rotor behind its gear). Accelerations come from second differences of the measured positions, which are the
triangular means that the inverse dynamics of an axis is exact for; whatever multiplies them varies slowly.

The torque that its gear transmits to the link, |L| of the load-dependent friction, is the right-hand side without
what the rotor takes, M_ii q''_i less armature times q''_i in the place of M_ii q''_i: the same in the plug-in, which
has it from the other side, as the torque of the drive and of friction less what the rotor takes.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, listing
from ..identification.between_samples import second_difference, smooth_mean
from ..identification.inverse import Observation
from ..identification.noise import choose_bandwidth
from ..record import Record

Array = NDArray[np.float64]

_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}
_POSES = 300  # in which the largest inertia is looked for
_ROTOR = 1.0  # kg m^2
_GLANCES = 50  # poses of a record that say how large its inertia is


@dataclass(frozen=True)
class Payload:
    """A point mass on a body of the model that the model lacks; a negative one where it has too much.

    Attributes:
        body: its name.
        mass: [kg].
        position: in the frame of the body [m].
    """

    body: str
    mass: float
    position: tuple[float, float, float]


@dataclass(frozen=True)
class Setup:
    """How a robot was set up, where that is not as its model has it.

    Attributes:
        pose: positions of joints that are not measured [rad or m].
        payload: what it carries.
        gravity: in the frame of the world [m/s^2], None for the model's: of a robot on a wall.
        zero: where joints stand in the model when their encoders read zero [rad or m].
        reversed: names of joints whose encoders count backwards; the torque of such a joint counts so too.
    """

    pose: Mapping[str, float] = field(default_factory=dict)
    payload: Payload | None = None
    gravity: tuple[float, float, float] | None = None
    zero: Mapping[str, float] = field(default_factory=dict)
    reversed: tuple[str, ...] = ()

    def sense(self, joint: str) -> float:
        """1, or -1 of a joint that counts backwards."""
        return -1.0 if joint in self.reversed else 1.0


@dataclass(frozen=True)
class RigidTorque:
    """What the rigid bodies take from one joint along a motion.

    Attributes:
        bias: (n,) gravity, Coriolis and centrifugal torque, springs of the model [N m].
        inertia: (n,) M_ij of each measured joint j, by name [kg m^2].
    """

    bias: Array
    inertia: Mapping[str, Array]

    def accelerating(self, acceleration: Mapping[str, Array]) -> Array:
        """(n,) torque for accelerations (n,) of joints by name [N m]."""
        return np.asarray(sum((self.inertia[j] * a for j, a in acceleration.items()), np.zeros(len(self.bias))))


class Robot:
    """A MuJoCo model of which one joint is the axis; the model's own friction, damping and contacts are left aside.

    Args:
        path: MJCF (or .mjb) file.
        joint: name of a hinge or slide joint.
        setup: how it was set up, where that is not as the model has it.

    Raises:
        DataError: no such file, joint or body, or a joint that is neither hinge nor slide.
    """

    def __init__(self, path: str | Path, joint: str, setup: Setup | None = None) -> None:
        self.path, self.joint, self.setup = Path(path), joint, setup or Setup()
        if not self.path.is_file():
            raise DataError(f"axis.model: no such file: {path}")
        try:
            load = mujoco.MjModel.from_binary_path if self.path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
            self.model = load(str(self.path))
        except ValueError as error:
            raise DataError(f"axis.model ({path}): MuJoCo cannot load it ({' '.join(str(error).split())})") from None
        self.model.opt.disableflags |= int(
            mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_SENSOR
        )
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self._index = {
            self.model.joint(i).name: i for i in range(self.model.njnt) if int(self.model.jnt_type[i]) in _KINDS
        }
        if joint not in self._index:
            raise DataError(f"axis.joint: {self.path.name} has no hinge or slide joint {joint!r}; it has "
                            f"{listing(self._index)}")
        for key in ("pose", "zero", "reversed"):
            for name in getattr(self.setup, key):
                if name not in self._index:
                    known = listing(self._index)
                    raise DataError(f"axis.{key}: no hinge or slide joint {name!r}; the model has {known}")
        self._rest = np.array(self.model.qpos0)
        for name, value in self.setup.pose.items():
            self._rest[self._address(name)] = value
        if self.setup.gravity is not None:
            self.model.opt.gravity = self.setup.gravity
        self._bodies = [(self.model, 1.0)]  # what adds up to the bodies of the robot
        if (payload := self.setup.payload) is not None:
            self._bodies.append((self._alone(payload), math.copysign(1.0, payload.mass)))

    def _address(self, name: str) -> int:
        return int(self.model.jnt_qposadr[self._index[name]])

    def _dof(self, name: str) -> int:
        return int(self.model.jnt_dofadr[self._index[name]])

    @property
    def kinds(self) -> dict[str, str]:
        """Kind of every hinge and slide joint by name."""
        return {name: _KINDS[int(self.model.jnt_type[i])] for name, i in self._index.items()}

    @cached_property
    def inertia(self) -> float:
        """J: the largest inertia about the joint in the joint ranges, without a payload [kg m^2]."""
        rng = np.random.default_rng(0)
        poses = np.tile(self._rest, (_POSES, 1))
        for name, i in self._index.items():
            if self.model.jnt_limited[i]:
                low, high = self.model.jnt_range[i]
            elif self.kinds[name] == "hinge":
                low, high = -math.pi, math.pi
            else:
                continue
            poses[1:, self._address(name)] = rng.uniform(low, high, _POSES - 1)
        data, largest = mujoco.MjData(self.model), 0.0
        for q in poses:
            data.qpos = q
            mujoco.mj_fwdPosition(self.model, data)
            largest = max(largest, float(self._row(self.model, data)[self._dof(self.joint)]))
        return largest

    def _row(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """(nv,) row of the inertia matrix that belongs to the joint, for a pose whose kinematics are known."""
        unit, row = np.zeros(model.nv), np.empty(model.nv)
        unit[self._dof(self.joint)] = 1.0
        mujoco.mj_mulM(model, data, row, unit)
        return row - (0.0 if model is self.model else _ROTOR) * unit

    @cached_property
    def moved(self) -> tuple[str, ...]:
        """Names of the bodies that the joint moves, its own first; those without a name are left out."""
        own, m = int(self.model.jnt_bodyid[self._index[self.joint]]), self.model
        found = [own]
        for b in range(own + 1, m.nbody):  # parents come before their children
            found += [b] if int(m.body_parentid[b]) in found else []
        return tuple(name for b in found if (name := m.body(b).name))

    def _alone(self, payload: Payload) -> mujoco.MjModel:
        """The model with a payload, of the size of its mass, as the only body that weighs anything."""
        names = [self.model.body(b).name for b in range(self.model.nbody)]
        if payload.body not in names:
            known = listing([n for n in names if n])
            raise DataError(f"axis.payload: no body {payload.body!r}; {self.path.name} has {known}")
        alone, here = copy.deepcopy(self.model), names.index(payload.body)
        for of_others in (
            alone.body_mass, alone.body_inertia, alone.body_gravcomp, alone.jnt_stiffness, alone.tendon_stiffness,
            alone.tendon_armature,
        ):  # fmt: skip
            of_others[:] = 0.0
        alone.opt.density = alone.opt.viscosity = 0.0
        alone.dof_armature[:] = _ROTOR  # MuJoCo knows no joint without inertia
        alone.body_mass[here], alone.body_ipos[here] = abs(payload.mass), payload.position
        mujoco.mj_setConst(alone, mujoco.MjData(alone))
        return alone

    def torque(self, position: Mapping[str, Array], velocity: Mapping[str, Array]) -> RigidTorque:
        """The rigid-body torque along a motion, from `mj_inverse`; joints that are not given stand still.

        Args:
            position, velocity: (n,) by name of the joint, as its encoder reads [rad], [rad/s].
        """
        n, dof = len(position[self.joint]), self._dof(self.joint)
        qpos, qvel = np.tile(self._rest, (n, 1)), np.zeros((n, self.model.nv))
        for name in position:
            sense, zero = self.setup.sense(name), self.setup.zero.get(name, 0.0)
            qpos[:, self._address(name)] = sense * position[name] + zero
            qvel[:, self._dof(name)] = sense * velocity[name]
        row, bias = np.zeros((n, self.model.nv)), np.zeros(n)
        for model, sign in self._bodies:
            data = mujoco.MjData(model)
            for k in range(n):
                data.qpos, data.qvel = qpos[k], qvel[k]  # and no acceleration
                mujoco.mj_inverse(model, data)
                # Friction is what is to be found: of the passive torques only those of rigid bodies and springs count.
                friction = data.qfrc_passive[dof] - data.qfrc_spring[dof] - data.qfrc_gravcomp[dof]
                bias[k] += sign * (data.qfrc_inverse[dof] + friction)
                row[k] += sign * self._row(model, data)
        own = self.setup.sense(self.joint)
        senses = {name: own * self.setup.sense(name) for name in position}
        return RigidTorque(own * bias, {name: sense * row[:, self._dof(name)] for name, sense in senses.items()})

    def on(self, records: Sequence[Record]) -> tuple[list[Record], list[str]]:
        """Records of the joint with their rigid-body torque, and its transmitted torque where no load was recorded.

        Args:
            records: of the joint, with the measured positions of others.

        Returns:
            The records, and a sentence about the inertia along them, and one on those that reach an end stop.
        """
        glance = []
        for r in records:
            few = {k: q[:: max(len(q) // _GLANCES, 1)] for k, q in self.measured(r).items()}
            glance.append(self.torque(few, {k: np.zeros_like(q) for k, q in few.items()}).inertia[self.joint])
        bandwidth = choose_bandwidth(records, float(np.mean(np.concatenate(glance))))
        found = [self._with(r, bandwidth) for r in records]
        along = np.concatenate([r.signals["inertia_change"] for r in found]) + self.inertia
        unit = "kg m^2" if self.kinds[self.joint] == "hinge" else "kg"
        ends = dict.fromkeys(f"{x:.4g}" for x in (along.min(), along.max()))
        bare = " without its payload" if self.setup.payload else ""
        note = (
            f"{self.path.name} gives {self.joint} an inertia of {' to '.join(ends)} {unit} along these records; "
            f"that of a plant is the largest which the model has{bare}, {self.inertia:.4g} {unit}"
        )
        return found, [note, *self._at_stops(records)]

    def _at_stops(self, records: Sequence[Record]) -> list[str]:
        """A sentence where the joint was driven to the ends of its range, whose torque no effect has."""
        i = self._index[self.joint]
        if not self.model.jnt_limited[i]:
            return []
        low, high = self.model.jnt_range[i]
        names = [r.name for r in records if r.position.min() < low or r.position.max() > high]
        if not names:
            return []
        unit = "rad" if self.kinds[self.joint] == "hinge" else "m"
        return [
            f"{self.joint} goes beyond its range of {low:.4g} to {high:.4g} {unit} in {', '.join(names)}: the torque "
            "of an end stop is no friction; leave that part out, as in span = [1.0, 9.5]"
        ]

    def set_up(self, setup: Setup) -> Robot:
        """The same, set up in another way."""
        return Robot(self.path, self.joint, setup)

    def along(self, o: Observation) -> Array:
        """(m,) band-limited torque of the bodies, but for that of the joint's own acceleration by an inertia that does
        not change, along a record that is seen through a band [N m].
        """
        position, velocity = self._smooth(o)
        position, velocity = ({k: x[o.index] for k, x in part.items()} for part in (position, velocity))
        h, motion = o.record.sample_time, self.measured(o.record)
        rigid = self.torque(position, velocity)
        return rigid.bias + rigid.accelerating({k: o.band(second_difference(q, h)) for k, q in motion.items()})

    def alone(self, payload: Payload) -> Robot:
        """A robot of which a payload is all that weighs anything."""
        out = self.set_up(replace(self.setup, payload=payload))
        out._bodies = out._bodies[1:]
        return out

    def measured(self, record: Record) -> dict[str, Array]:
        """(n,) measured position of each joint by name."""
        return {self.joint: record.position, **record.others}

    def _smooth(self, seen: Observation) -> tuple[dict[str, Array], dict[str, Array]]:
        """(n,) position and velocity of each joint by name, as smooth as those of an axis."""
        smooth = {name: seen.again(q) for name, q in self.measured(seen.record).items()}
        return {k: o.position for k, o in smooth.items()}, {k: o.velocity for k, o in smooth.items()}

    def _among(self, record: Record, rigid: RigidTorque) -> Array:
        """(n,) torque of the bodies but for what the joint's own acceleration takes.

        Accelerations enter linearly: those of the measured positions pass the band of whoever looks at the record.
        """
        h, motion = record.sample_time, self.measured(record)
        others = {name: second_difference(q, h) for name, q in motion.items() if name != self.joint}
        return smooth_mean(rigid.bias) + rigid.accelerating(others)

    def _with(self, record: Record, bandwidth: float) -> Record:
        position, velocity = self._smooth(Observation(record, bandwidth))
        rigid = self.torque(position, velocity)
        signals = {
            **record.signals,
            "rigid_torque": self._among(record, rigid),
            "inertia_change": rigid.inertia[self.joint] - self.inertia,
        }
        # Friction takes the absolute value of a load: noise of the measured positions would add up.
        acceleration = {k: second_difference(q, record.sample_time) for k, q in position.items()}
        rotor = float(self.model.dof_armature[self._dof(self.joint)]) * acceleration[self.joint]
        signals["transmitted_torque"] = rigid.bias + rigid.accelerating(acceleration) - rotor
        return replace(record, signals=signals)
