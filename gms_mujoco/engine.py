"""Friction inside MuJoCo: the plug-in, its attachment to named joints, the control callback, the readout.

Importing this module registers the plug-in `gms`, so that a saved MJCF loads. All joints that are given friction at
once share one plug-in instance, which costs least: MuJoCo spends about as long on calling an instance as the
friction of a joint takes. It hangs on the bodies of its joints, so that it comes along when a model is attached to
another, or a part of it is: of joints that are not there, or deleted, the model is then compiled without the friction,
with a warning.
"""

from __future__ import annotations

import ctypes
import fnmatch
import os
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from . import native
from .effect import Effect
from .errors import EngineError, ModelError, listing
from .plant import Plant

PLUGIN = "gms"
SENSOR = "gms_mujoco.sensor"
READINGS = ("torque", "power", "states")


def _libmujoco() -> ctypes.CDLL:
    folder = Path(mujoco.__file__).parent
    for path in sorted((*folder.glob("libmujoco*"), *folder.glob("mujoco.dll"))):
        return ctypes.CDLL(str(path))  # loaded by mujoco already: this is another handle of it
    raise EngineError(f"no libmujoco in {folder}; reinstall with 'pip install \"mujoco>=4.0,<4.1\"'")


def register(libmujoco: ctypes.CDLL | None = None) -> None:
    """Registers the plug-in with the libmujoco of the `mujoco` package, or with the one given.

    Raises:
        EngineError: it is not of the 4.0 series. Nothing has been touched then.
    """
    lib = libmujoco or _libmujoco()
    n = ctypes.c_int()
    names = native.library.gms_engine_symbols(ctypes.byref(n))
    table = (ctypes.c_void_p * n.value)()
    for i in range(n.value):
        try:
            table[i] = ctypes.cast(getattr(lib, names[i].decode()), ctypes.c_void_p).value
        except AttributeError:
            table[i] = None  # the version is looked at first
    error = ctypes.create_string_buffer(200)
    if native.library.gms_engine_init(table, error, len(error)):
        found = error.value.decode()
        version = f"version {found}" if found.isdigit() else found
        raise EngineError(
            f"this build runs with MuJoCo 4.0.x; the libmujoco found says {version}: "
            "install it with 'pip install \"mujoco>=4.0,<4.1\"'"
        )


register()


def attach(
    model: mujoco.MjSpec | str | os.PathLike[str],
    plants: Mapping[str, Plant],
    integration: str = "auto",
    sensors: Collection[str] = (),
) -> mujoco.MjSpec:
    """Puts friction on joints of a MuJoCo model.

    Inertia and armature of the model stay as they are, but that the load of a `flexible_coupling` or a `backlash` is
    taken off the armature of its joint. Nor is the inertia of a plant put there: a servo (`position_loop`) on a joint
    without armature is unstable at usual time steps, of which a warning tells.

    Friction follows where a joint goes: setting `qpos` or `time` is motion too, but for the first after
    `mj_resetData`. From then to the first step two numbers of each joint in `plugin_state` are NaN: where it was last,
    which is not known yet.

    Args:
        model: an MjSpec, which is changed as a whole or not at all; or the path or the text of an MJCF file.
        plants: plant by joint name; a name may be a pattern such as "*_knee".
        integration: "explicit", "implicit" (backward Euler: stable and bounded at any time step), or "auto": implicit
            for the joints whose friction is so stiff for the time step that an explicit one may be unstable, with
            h^2 k + h sigma above twice the inertia. Below that explicit is cheaper, and more accurate where friction
            builds up over several steps. Where it does in a small part of one, as the bristle of a `lugre` that is
            damped and moves fast, an explicit step, like that of MuJoCo's own dcmotor, has its damping as a jolt: a
            joint that sets out at speed may come to rest 30 % early, 5 % with "implicit". The inertia is that of the
            model as it stands: ask for "implicit" where it falls to less in another pose, too.
        sensors: MuJoCo sensors for each of the joints, out of "torque" [N m], "power" [W] and "states": what
            `friction` gives after `mj_forward`, in `sensordata`. Sensor "JOINT_friction_torque" is the torque of JOINT.

    Returns:
        The MjSpec. `spec.compile()` makes the model, `spec.to_xml()` an MJCF that loads after
        `import gms_mujoco`.

    Raises:
        ModelError: no such joint, a ball or free joint, a joint that has friction already, a plant of another
            kind, with parameters that have no value, too many elements or a load heavier than its axis, a sensor of
            another name, twice or of a name that is taken.
    """
    spec = spec_of(model)
    if integration not in native.INTEGRATION:
        raise ModelError(f"integration must be one of {listing(native.INTEGRATION)}; {integration!r} given")
    if isinstance(sensors, str) or not all(reads in READINGS for reads in sensors):
        raise ModelError(f"sensors is a list out of {listing(READINGS)}; {sensors!r} given")
    if len(set(sensors)) < len(sensors):
        raise ModelError(f"a joint has each sensor once; {sensors!r} given")
    if not isinstance(plants, Mapping):
        given = type(plants).__name__
        raise ModelError(f'plants by the names of joints are expected, as {{"elbow": plant}}; {given} given')
    if isinstance(model, mujoco.MjSpec):
        with warnings.catch_warnings(action="ignore"):
            _put(model.copy(), plants, integration, sensors)
    _put(spec, plants, integration, sensors)
    return spec


def _put(spec: mujoco.MjSpec, plants: Mapping[str, Plant], integration: str, sensors: Collection[str]) -> None:
    """What `attach` does to an MjSpec, which it may leave half changed where it raises."""
    chosen: dict[str, Plant] = {}
    for pattern, plant in plants.items():
        for joint in _matching(spec, pattern):
            if joint.name in chosen:
                raise ModelError(f"joint {joint.name!r} is named twice, by {pattern!r} the second time")
            _check(spec, joint, plant)
            chosen[joint.name] = plant
    alike: dict[tuple[Any, ...], list[Any]] = {}
    for name, plant in chosen.items():
        joint = spec.joint(name)
        _warn(joint, plant)
        _uncouple(joint, plant)
        natives = _natives(plant)
        if natives:
            alone = name if name.replace(";", " ").split() != [name] else ""  # cannot stand in a list of names
            alike.setdefault((alone, *_config(natives, integration).items()), []).append(joint)
    instances: dict[str, list[tuple[list[Any], dict[str, str]]]] = {}
    for (alone, *config), joints in alike.items():
        instances.setdefault(alone, []).append((joints, dict(config)))
    for parts in instances.values():
        _add_instance(spec, parts)
    for reads in sensors:
        _add_sensors(spec, reads, {name: plant for name, plant in chosen.items() if _natives(plant)})
    for name, plant in chosen.items():
        for e in sorted(plant.effects, key=lambda e: e.kind != "controller"):  # the actuators first
            e.edit(spec, name)


def spec_of(model: mujoco.MjSpec | str | os.PathLike[str]) -> mujoco.MjSpec:
    """An MjSpec as it is, or from the path or the text of an MJCF file; raises ModelError where that cannot be."""
    if isinstance(model, mujoco.MjSpec):
        return model
    if not isinstance(model, str | os.PathLike):
        given = type(model).__name__
        raise ModelError(f"an MjSpec, or the path or the text of an MJCF file is expected; {given} given")
    text = os.fspath(model)
    try:
        if text.lstrip().startswith("<"):
            return mujoco.MjSpec.from_string(text)
        if not Path(text).is_file():
            raise ModelError(f"{text}: no such file")
        return mujoco.MjSpec.from_file(text)
    except ValueError as error:
        name = "MJCF text" if text.lstrip().startswith("<") else text
        raise ModelError(f"{name}: {' '.join(str(error).split())}") from None


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of an MjSpec; raises ModelError with one line where it does not compile."""
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"the model does not compile: {' '.join(str(error).split())}") from None


def _matching(spec: mujoco.MjSpec, pattern: str) -> list[Any]:
    found = [j for j in spec.joints if j.name and (j.name == pattern or fnmatch.fnmatchcase(j.name, str(pattern)))]
    if not found:
        names = listing(j.name for j in spec.joints if j.name)
        raise ModelError(f"no joint is called {pattern!r}; the joints are {names}")
    return found


def _check(spec: mujoco.MjSpec, joint: Any, plant: Plant) -> None:
    if not isinstance(plant, Plant):
        given = repr(plant) if isinstance(plant, str) else type(plant).__name__
        raise ModelError(f"a Plant is expected for joint {joint.name!r}, as gms.Plant.load() reads one; {given} given")
    kinds = {mujoco.mjtJoint.mjJNT_HINGE: "hinge", mujoco.mjtJoint.mjJNT_SLIDE: "slide"}
    kind = kinds.get(mujoco.mjtJoint(joint.type))
    if kind is None:
        raise ModelError(f"joint {joint.name!r} is a ball or free joint; friction needs a hinge or a slide")
    if kind != plant.kind:
        raise ModelError(f"joint {joint.name!r} is a {kind}, the plant is for a {plant.kind}")
    unset = [f"{e.name}.{p}" for e in plant.effects for p in e.unset]
    if unset:
        raise ModelError(f"these parameters have no value yet: {listing(unset)}; give them, or fit first")
    plant.light_loads().joint()  # which has room for so many elements
    for p in spec.plugins:
        if p.plugin_name == PLUGIN and any(joint.name in names for names in _joints_of(p)):
            raise ModelError(f"joint {joint.name!r} has friction already, in plug-in instance {p.name!r}")
        if p.name == joint.name:
            raise ModelError(f"a {p.plugin_name} instance is called {p.name!r} as the joint is; rename one of them")


def _warn(joint: Any, plant: Plant) -> None:
    friction = [e.name for e in plant.effects if e.kind == "friction"]
    sensors = [e.name for e in plant.effects if e.kind == "sensor"]
    if sensors:
        warnings.warn(
            f"{', '.join(sensors)} acts on the measurement alone and is left out of joint {joint.name!r}: MuJoCo's "
            "positions are exact",
            stacklevel=4,
        )
    faceless = [e.name for e in plant.effects if type(e).edit is Effect.edit and not e.is_native and e.kind != "sensor"]
    if faceless:
        warnings.warn(
            f"{', '.join(faceless)} is left out of joint {joint.name!r}: it has no `edit`, which would make the same "
            "happen in MuJoCo",
            stacklevel=4,
        )
    twice = {"frictionloss": bool(friction), "damping": "viscous" in friction, "springdamper": "viscous" in friction}
    for key, counts in twice.items():
        value = np.abs(getattr(joint, key))
        if counts and np.any(value > 0):
            text = " ".join(f"{x:g}" for x in np.trim_zeros(np.atleast_1d(value), "b"))
            warnings.warn(
                f"joint {joint.name!r} has {key} {text} and gets {', '.join(friction)}: both act; "
                f"set {key} to 0 unless that is meant",
                stacklevel=4,
            )
    if joint.armature == 0 and any(e.kind == "controller" for e in plant.effects):
        inertia = "" if plant.inertia is None else f", {plant.inertia:g} {plant.mass_unit},"
        warnings.warn(
            f"joint {joint.name!r} has no armature, and its servo is unstable at usual time steps without its own "
            f"inertia{inertia} which attach adds nowhere: set `armature` of the joint to it",
            stacklevel=4,
        )


def _uncouple(joint: Any, plant: Plant) -> None:
    """Takes inertia that the plant has behind a coupling off the joint's armature."""
    hidden = sum(e.hidden_inertia for e in plant.effects)
    if hidden > joint.armature * (1 + 1e-9):  # it may be a difference of numbers that were rounded
        names = ", ".join(e.name for e in plant.effects if e.hidden_inertia)
        warnings.warn(
            f"the load of {names}, {hidden:g} {plant.mass_unit}, is part of the inertia of the axis, but joint "
            f"{joint.name!r} has only {joint.armature:g} of armature to take it from: take the rest off the body",
            stacklevel=4,
        )
    joint.armature = max(joint.armature - hidden, 0.0)


def _natives(plant: Plant) -> list[Effect]:
    return [e for e in plant.effects if e.is_native]


def _add_instance(spec: mujoco.MjSpec, parts: list[tuple[list[Any], dict[str, str]]]) -> None:
    """One instance, named after the only joint or the first. `parts`: joints with the same friction, and its config."""
    parts = sorted(parts, key=lambda part: _shape(part[1]))  # joints with the same effects are evaluated together
    joints = [j for some, _ in parts for j in some]
    name = joints[0].name
    config = {}
    for key in dict.fromkeys(key for _, part in parts for key in part):
        values = [part.get(key, "") for _, part in parts]
        config[key] = values[0] if len(set(values)) == 1 else "; ".join(values)
    if len(joints) > 1:
        name = _free_name(f"{name}_and_others", [*spec.plugins, *spec.joints])
        config |= {"joint": "; ".join(" ".join(j.name for j in some) for some, _ in parts), "name": name}
    spec.activate_plugin(PLUGIN)
    instance = spec.add_plugin(name=name, plugin_name=PLUGIN, active=True)
    instance.config = config
    # An instance that hangs nowhere is lost when the model is attached to another. A body holds one: where that
    # place is taken it hangs on an empty body inside.
    for k, joint in enumerate(joints):
        body = joint.parent
        if body.plugin.active:
            if k:
                continue
            body = body.add_body(name=_free_name(f"{joint.name}_friction", spec.bodies))
        body.plugin = instance


def _free_name(name: str, others: Iterable[Any]) -> str:
    """The name, with a number where one of the others has it."""
    taken = {other.name for other in others}
    return next(n for n in (name, *(f"{name}_{i}" for i in range(2, len(taken) + 3))) if n not in taken)


def _shape(config: dict[str, str]) -> list[tuple[str, int]]:
    """Effects and numbers of elements."""
    return [("effects " + config["effects"], 0), *((key, len(text.split())) for key, text in config.items())]


def _joints_of(instance: Any) -> list[list[str]]:
    """Names of the joints of an instance, those with the same friction together.

    A model that has joined another has brought a prefix and a suffix along.
    """
    if "joint" not in instance.config:
        return [[instance.name]]
    before, _, after = instance.name.partition(instance.config.get("name", instance.name))
    lists = instance.config["joint"].split(";")
    return [[f"{before}{name}{after}" for name in names.split()] for names in lists]


def served(instance: Any) -> list[tuple[list[str], dict[str, str]]]:
    """The joints of an instance and their config, those with the same friction together.

    Raises:
        ModelError: a value is given for another number of groups than there are.
    """
    joints, values = _joints_of(instance), {}
    for key, text in instance.config.items():
        parts = text.split(";")
        if key in ("joint", "name"):
            continue
        if len(parts) not in (1, len(joints)):
            given = f"{key} has {len(parts)} parts between semicolons, joint {len(joints)}"
            raise ModelError(f"plug-in instance {instance.name!r}: {given}")
        values[key] = parts * len(joints) if len(parts) == 1 else parts
    return [(names, {key: parts[i].strip() for key, parts in values.items()}) for i, names in enumerate(joints)]


def _add_sensors(spec: mujoco.MjSpec, reads: str, plants: Mapping[str, Plant]) -> None:
    """Sensors for joints, those of one size in one instance."""
    sizes: dict[int, list[str]] = {}
    for name, plant in plants.items():
        size = plant.joint().n_state - native.ANCHOR if reads == "states" else 1
        sizes.setdefault(size, []).append(name)
    for size, names in sizes.items():
        if not size:
            continue
        spec.activate_plugin(SENSOR)
        name = _free_name(f"{names[0]}_friction_{reads}", [*spec.plugins, *spec.joints])
        instance = spec.add_plugin(name=name, plugin_name=SENSOR, active=True)
        instance.config = {"reads": reads} | ({"size": str(size)} if reads == "states" else {})
        for name in names:
            if spec.sensor(f"{name}_friction_{reads}") is not None:
                raise ModelError(f"a sensor is called {f'{name}_friction_{reads}'!r} already; rename it")
            sensor = spec.add_sensor(
                name=f"{name}_friction_{reads}", type=mujoco.mjtSensor.mjSENS_PLUGIN,
                objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name,
            )  # fmt: skip
            sensor.plugin = instance


def _config(effects: list[Effect], integration: str) -> dict[str, str]:
    config = {"effects": " ".join(e.name for e in effects)}
    if integration != "auto":
        config["integration"] = integration
    for e in effects:
        for key, value in e.values.items():
            numbers = value if isinstance(value, tuple) else (value,)
            config[f"{e.name}.{key}"] = " ".join(map(repr, numbers))
    return config


# ctypes lets mujoco.set_mjcb_control, and with it mujoco.batch.Batch, take a C function.
_control = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(("gms_control", native.library))
_installed: Any = _control
_before: Any = None


def install_callback() -> None:
    """Has MuJoCo's control callback evaluate the friction of models that are driven without actuators.

    Stiff and static friction answers the torque of its own step. Where a model has actuators, the plug-in evaluates
    it once their forces are known, whatever sets the controls. Where it has none, the plug-in alone does so
    together with the passive forces, before a control callback sets `qfrc_applied` or `xfrc_applied`; with this
    callback, after that. Where no callback sets any, the results are the same. `mj_inverse`, which calls nothing but
    the passive forces, has the friction of the acceleration in `qacc` with actuators or this callback; without both
    it has that of the torque applied, as the last `mj_forward` found it.

    It is a C function, so that threads and `mujoco.batch.Batch` take it. A Python callback that is installed already
    runs first; the two are one Python callback then. Setting another callback later on replaces this one, and the
    plug-in is alone again.

    Raises:
        EngineError: a C function of another is installed.
    """
    global _before, _installed
    now = mujoco.get_mjcb_control()
    if now is _installed:
        return
    if hasattr(now, "argtypes"):  # of ctypes
        raise EngineError(
            "another C function is installed as control callback: remove it with mujoco.set_mjcb_control(None)"
        )
    _before, _installed = now, _control if now is None else _after(now)
    mujoco.set_mjcb_control(_installed)


def remove_callback() -> None:
    """Undoes `install_callback`: the callback from before is back. One that was set later on stays."""
    global _before, _installed
    if mujoco.get_mjcb_control() is _installed:
        mujoco.set_mjcb_control(_before)
    _before, _installed = None, _control


def _after(control: Callable[[mujoco.MjModel, mujoco.MjData], object]) -> Any:
    def callback(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        control(model, data)
        _control(model._address, data._address)

    return callback


@dataclass(frozen=True)
class Friction:
    """What the effects of a joint do, after `mj_forward` at the instant of the data, after `mj_step` over that step.

    Attributes:
        torque: on the joint [N m].
        power: torque times the velocity in the data [W]; negative where friction eats it. After `mj_step` that is the
            velocity at the end of the step, with which Euler's step moves: power times the time step is the work.
        states: (n_state,) inner state of each effect that has one. For gms, force and slip direction of each
            element in turn [N m, -1, 0 or 1]. After `mj_step` as they are at its end; after `mj_forward` as they are
            where the step to come begins, while the torque is that over it.
    """

    torque: float
    power: float
    states: Mapping[str, NDArray[np.float64]]

    @property
    def forces(self) -> NDArray[np.float64]:
        """(n,) force of each element of gms [N m], positive where it opposes positive motion; empty for other laws."""
        return self.states.get("gms", np.empty(0))[::2]

    @property
    def slips(self) -> NDArray[np.bool_]:
        """(n,) whether each element slips."""
        return self.states.get("gms", np.empty(0))[1::2] != 0


def friction(model: mujoco.MjModel, data: mujoco.MjData, joint: str) -> Friction:
    """Torque and element states of a joint, as of the last `mj_forward` or `mj_step`.

    Takes some microseconds, for a look now and then. `attach(..., sensors=["torque"])` puts the same into `sensordata`
    in every step, as all of MuJoCo's sensors with velocity and states of where the step begins: after `mj_step` power
    and states differ from those here by that step.

    Raises:
        ModelError: no such joint, or it has no friction of ours.
    """
    if not isinstance(joint, str):  # MuJoCo ends the process over None
        raise ModelError(f"the name of a joint is expected; {joint!r} given")
    id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if id < 0:
        names = (model.joint(i).name for i in range(model.njnt))
        raise ModelError(f"no joint is called {joint!r}; the joints are {listing(filter(None, names))}")
    if len(data.plugin_data) != model.nplugin or len(data.plugin_state) != model.npluginstate:
        raise ModelError("the data was made for a model with other friction; make it with mujoco.MjData(model)")
    reading = native.reading(model._address, data._address, id)
    if reading is None:
        raise ModelError(f"joint {joint!r} has no friction of gms_mujoco; attach a plant to it")
    dof = model.jnt_dofadr[id]
    states = {name: data.plugin_state[start:stop].copy() for name, start, stop in reading.states}
    value = float(data.plugin_state[reading.torque])
    return Friction(value, value * float(data.qvel[dof]), states)
