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

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from .errors import DataError, listing
from .inverse import Observation, second_difference, smooth_mean
from .noise import choose_bandwidth
from .record import Record

Array = NDArray[np.float64]

_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}
_POSES = 300  # in which the largest inertia is looked for
_GLANCES = 50  # poses of a record that say how large its inertia is


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
        pose: positions of joints that are not measured [rad or m]; the others stand as the model has them.

    Raises:
        DataError: no such file or joint, or one that is neither hinge nor slide.
    """

    def __init__(self, path: str | Path, joint: str, pose: Mapping[str, float] | None = None) -> None:
        self.path, self.joint = Path(path), joint
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
        self._rest = np.array(self.model.qpos0)
        for name, value in (pose or {}).items():
            if name not in self._index:
                raise DataError(f"axis.pose: no hinge or slide joint {name!r}; the model has {listing(self._index)}")
            self._rest[self._address(name)] = value

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
        """J: the largest inertia about the joint in the joint ranges [kg m^2], for the pose in which it is largest."""
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
            largest = max(largest, float(self._row(data)[self._dof(self.joint)]))
        return largest

    def _row(self, data: mujoco.MjData) -> Array:
        """(nv,) row of the inertia matrix that belongs to the joint, for a pose whose kinematics are known."""
        unit, row = np.zeros(self.model.nv), np.empty(self.model.nv)
        unit[self._dof(self.joint)] = 1.0
        mujoco.mj_mulM(self.model, data, row, unit)
        return row

    def torque(self, position: Mapping[str, Array], velocity: Mapping[str, Array]) -> RigidTorque:
        """The rigid-body torque along a motion, from `mj_inverse`; joints that are not given stand still.

        Args:
            position, velocity: (n,) by name of the joint [rad], [rad/s].
        """
        n, m, data, dof = len(position[self.joint]), self.model, mujoco.MjData(self.model), self._dof(self.joint)
        qpos, qvel = np.tile(self._rest, (n, 1)), np.zeros((n, m.nv))
        for name in position:
            qpos[:, self._address(name)] = position[name]
            qvel[:, self._dof(name)] = velocity[name]
        row, bias = np.empty((n, m.nv)), np.empty(n)
        for k in range(n):
            data.qpos, data.qvel = qpos[k], qvel[k]  # and no acceleration
            mujoco.mj_inverse(m, data)
            # Friction is what is to be found: of the passive torques only those of rigid bodies and springs count.
            friction = data.qfrc_passive[dof] - data.qfrc_spring[dof] - data.qfrc_gravcomp[dof]
            bias[k] = data.qfrc_inverse[dof] + friction
            row[k] = self._row(data)
        return RigidTorque(bias, {name: row[:, self._dof(name)].copy() for name in position})

    def on(self, records: Sequence[Record], others: Sequence[Mapping[str, Array]]) -> tuple[list[Record], list[str]]:
        """Records of the joint with their rigid-body torque, and its transmitted torque where no load was recorded.

        Args:
            records: of the joint.
            others: for each record the (n,) measured positions of other joints by name [rad].

        Returns:
            The records, and a sentence about the inertia along them, and one on those that reach an end stop.
        """
        motions = [{self.joint: r.position, **more} for r, more in zip(records, others, strict=True)]
        glance = []
        for motion in motions:
            few = {k: q[:: max(len(q) // _GLANCES, 1)] for k, q in motion.items()}
            glance.append(self.torque(few, {k: np.zeros_like(q) for k, q in few.items()}).inertia[self.joint])
        bandwidth = choose_bandwidth(records, float(np.mean(np.concatenate(glance))))
        found = [self._with(r, motion, bandwidth) for r, motion in zip(records, motions, strict=True)]
        along = np.concatenate([r.signals["inertia_change"] for r in found]) + self.inertia
        unit = "kg m^2" if self.kinds[self.joint] == "hinge" else "kg"
        note = (
            f"{self.path.name} gives {self.joint} an inertia of {along.min():.4g} to {along.max():.4g} {unit} along "
            f"these records; the inertia of a plant stands for the pose where it is largest, "
            f"{self.inertia:.4g} {unit} in the model"
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

    def _with(self, record: Record, motion: Mapping[str, Array], bandwidth: float) -> Record:
        h = record.sample_time
        smooth = {name: Observation(record, bandwidth).again(q) for name, q in motion.items()}
        position = {name: o.position for name, o in smooth.items()}
        rigid = self.torque(position, {name: o.velocity for name, o in smooth.items()})
        # Accelerations enter linearly: those of the measured positions pass the band of whoever looks at the record.
        others = {name: second_difference(q, h) for name, q in motion.items() if name != self.joint}
        signals = {
            **record.signals,
            "rigid_torque": smooth_mean(rigid.bias) + rigid.accelerating(others),
            "inertia_change": rigid.inertia[self.joint] - self.inertia,
        }
        if "load" not in signals:  # friction takes its absolute value: here noise would add up
            acceleration = {k: second_difference(q, h) for k, q in position.items()}
            rotor = float(self.model.dof_armature[self._dof(self.joint)]) * acceleration[self.joint]
            signals["load"] = rigid.bias + rigid.accelerating(acceleration) - rotor
        return replace(record, signals=signals)
