"""A plant from the joint of a MuJoCo model: the friction of its own elements, and what `attach` has put there.

    joint              plant                       law
    frictionloss       coulomb                     F sgn v, which holds; the effect `frictionloss` creeps as MuJoCo's
    damping b0 b1      viscous, quadratic_drag     b0 v + b1 v |v|
    dcmotor lugre      lugre, viscous              exponent 2; the same bristle, which MuJoCo integrates step by step
    dcmotor cogging    cogging
    our plug-in        as it was attached, to the last bit

With a gear g between joint and dcmotor, torques are g times the motor's and its angle is g times the joint's. Drive
effects are read from actuators and limits of the joint (delay, current_loop_lag, torque_saturation). Springs, weight,
limits and contacts are the mechanism's: they stay with the model, as they do in a measurement set with `[axis] model`.
Of a `springdamper` the damping is the joint's and the spring the mechanism's. Friction and damping of tendons stay too,
and are named.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from . import effects
from .effect import Effect
from .engine import PLUGIN, compiled, served, spec_of
from .errors import ModelError, listing
from .plant import Plant
from .version import __version__

_KINDS = {mujoco.mjtJoint.mjJNT_HINGE: "hinge", mujoco.mjtJoint.mjJNT_SLIDE: "slide"}
# Where a dcmotor keeps its parameters (mujoco 4.0): gainprm, biasprm, dynprm.
_RESISTANCE, _CONSTANT = 0, 1
_COGGING, _COULOMB, _STATIC, _STRIBECK = slice(0, 3), 3, 4, 5
_STIFFNESS, _DAMPING = 5, 6


def plant_of_joint(model: mujoco.MjSpec | str | os.PathLike[str], joint: str) -> Plant:
    """The effects that act on a joint of a MuJoCo model, and the inertia about it: a plant to start from.

    Args:
        model: an MjSpec, which is left as it is; or the path or the text of an MJCF file.
        joint: name of a hinge or slide joint.

    Returns:
        Plant with the inertia about the joint where the model begins (armature and what hangs on it included), which
        counts as known. A warning, and `left_out` in its provenance, name what no effect can express.

    Raises:
        ModelError: no such model or joint, the model does not compile, or one law acts on the joint twice.
    """
    spec = spec_of(model)
    if not isinstance(joint, str):
        raise ModelError(f"the name of a joint is expected; {joint!r} given")
    found = spec.joint(joint)
    if found is None:
        names = listing(j.name for j in spec.joints if j.name)
        raise ModelError(f"no joint is called {joint!r}; the joints are {names}")
    kind = _KINDS.get(mujoco.mjtJoint(found.type))
    if kind is None:
        raise ModelError(f"joint {joint!r} is a ball or free joint; a plant needs a hinge or a slide")
    now = compiled(spec.copy())
    dof = int(now.joint(joint).dofadr[0])
    left_out = _tendons(now, dof)
    damping = np.array([now.dof_damping[dof], *now.dof_dampingpoly[dof]])  # a springdamper is damping once compiled
    parts = [*_attached(spec, joint), *_own(spec, found, damping, left_out)]
    parts += [e for cls in effects.CATALOGUE.values() if (e := cls.found(spec, joint)) is not None]
    plant = Plant(None, (), kind)
    for e in parts:
        plant = _added(plant, e, joint)
    for line in left_out:
        warnings.warn(f"joint {joint!r}: {line}", stacklevel=3)
    name = model if not isinstance(model, mujoco.MjSpec) and not os.fspath(model).lstrip().startswith("<") else ""
    told: dict[str, Any] = {
        "source": f"joint {joint} of {Path(os.fspath(name)).name or spec.modelname or 'a MuJoCo model'}",
        "version": f"gms_mujoco {__version__}",
    }
    if left_out:
        told["left_out"] = left_out
    inertia = _inertia(now, dof) + sum(e.hidden_inertia for e in plant.effects)
    return Plant(inertia, plant.effects, kind, provenance=told)


def _inertia(model: mujoco.MjModel, dof: int) -> float:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return float(full[dof, dof])


def _tendons(model: mujoco.MjModel, dof: int) -> list[str]:
    """A line for each tendon that brakes a joint, which no effect of one joint is."""
    lines = []
    for i in range(model.ntendon):
        start = model.ten_J_rowadr[i]
        losses = {
            "frictionloss": float(model.tendon_frictionloss[i]),
            "damping": max(float(model.tendon_damping[i]), *map(float, model.tendon_dampingpoly[i])),
        }
        if dof in model.ten_J_colind[start : start + model.ten_J_rownnz[i]] and any(losses.values()):
            has = " and ".join(f"{key} {value:g}" for key, value in losses.items() if value)
            lines.append(f"tendon {model.tendon(i).name!r} with {has} acts on it and stays in the model")
    return lines


def _added(plant: Plant, effect: Effect, joint: str) -> Plant:
    """With the effect; strengths of laws that only add up are added."""
    if effect.name not in plant:
        return plant + effect
    if effect.name not in ("coulomb", "viscous", "quadratic_drag"):
        raise ModelError(f"{effect.name} acts on joint {joint!r} twice; a plant has each effect once")
    p = effect.parameters[0].name
    total = float(plant[effect.name].values[p]) + float(effect.values[p])  # type: ignore[arg-type]
    return plant.replace(effect.replace(**{p: total}))


def _attached(spec: mujoco.MjSpec, joint: str) -> list[Effect]:
    """The effects that the plug-in gives the joint."""
    ours = [part for p in spec.plugins if p.plugin_name == PLUGIN for part in served(p)]
    for config in (config for names, config in ours if joint in names):
        values: dict[str, dict[str, Any]] = {name: {} for name in config["effects"].split()}
        for key, text in config.items():
            name, _, parameter = key.partition(".")
            if name in values and parameter and text:
                numbers = [float(x) for x in text.split()]
                each = next((q.per_element for q in effects.find(name).parameters if q.name == parameter), True)
                values[name][parameter] = numbers if each else numbers[0]
        return [effects.find(name)(**given) for name, given in values.items()]
    return []


def _own(spec: mujoco.MjSpec, joint: Any, damping: NDArray[np.float64], left_out: list[str]) -> list[Effect]:
    """The effects that MuJoCo's own elements are; `damping` (3,) is the joint's, by powers of its velocity."""
    found: list[Effect] = []
    if joint.frictionloss > 0:
        found.append(effects.find("coulomb")(coulomb=joint.frictionloss))
    for actuator in spec.actuators:
        if actuator.target == joint.name and actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            gear = float(actuator.gear[0])
            damping = damping + gear**2 * np.asarray(actuator.damping)
            if actuator.biastype == mujoco.mjtBias.mjBIAS_DCMOTOR:
                found += _motor(actuator, gear, left_out)
                if actuator.ctrlspec == mujoco.mjtCtrlInput.mjINPUT_NONE:  # its windings are closed: they brake
                    constant, resistance = actuator.gainprm[_CONSTANT], actuator.gainprm[_RESISTANCE]
                    damping[0] += gear**2 * constant**2 / resistance
                elif np.any(actuator.gainprm[2:]):
                    left_out.append(f"the controller of dcmotor {actuator.name!r} stays in the model")
    if damping[0] > 0:
        found.append(effects.find("viscous")(coefficient=damping[0]))
    if damping[1] > 0:
        found.append(effects.find("quadratic_drag")(coefficient=damping[1]))
    if damping[2] != 0 or damping[0] < 0 or damping[1] < 0:
        left_out.append(f"no effect is a damping polynomial with coefficients {damping.tolist()}: left out are those "
                        "below 0 and that of the third power of velocity")  # fmt: skip
    return found


def _motor(motor: Any, gear: float, left_out: list[str]) -> list[Effect]:
    """LuGre friction and cogging of a dcmotor behind a gear."""
    found: list[Effect] = []
    bias, dynamic, ratio = motor.biasprm, motor.dynprm, abs(gear)
    if dynamic[_STIFFNESS] > 0:
        if not 0 < bias[_COULOMB] <= bias[_STATIC] or not bias[_STRIBECK] > 0:
            left_out.append(
                f"lugre of dcmotor {motor.name!r} is left out: it needs 0 < Coulomb <= static level and a Stribeck "
                f"velocity, {bias[_COULOMB]:g}, {bias[_STATIC]:g} and {bias[_STRIBECK]:g} given"
            )
        else:
            found.append(
                effects.find("lugre")(
                    stiffness=ratio**2 * dynamic[_STIFFNESS], damping=ratio**2 * dynamic[_DAMPING],
                    coulomb=ratio * bias[_COULOMB], static=ratio * bias[_STATIC],
                    stribeck_velocity=bias[_STRIBECK] / ratio, stribeck_exponent=2.0,
                )
            )  # fmt: skip
    amplitude, periods, phase = (float(x) for x in bias[_COGGING])
    if amplitude:
        try:
            cogging = effects.find("cogging")(harmonics=[periods * ratio], amplitude=[ratio * amplitude],
                                              phase=[phase if gear > 0 else -phase])  # fmt: skip
        except ModelError as error:
            left_out.append(f"cogging of dcmotor {motor.name!r} is left out: {error}")
        else:
            found.append(cogging)
    return found
