"""The contract that every effect of the catalogue keeps; a new file in effects/ joins by being there."""

import itertools
import math
import pydoc
import types
import warnings

import mujoco
import numpy as np
import pytest

from gms_mujoco import effects, engine
from gms_mujoco.effect import KINDS, Effect
from gms_mujoco.errors import ModelError
from gms_mujoco.parameter import Parameter
from gms_mujoco.plant import Plant
from gms_mujoco.responses import harmonics
from gms_mujoco.responses.harmonics import ORDERS, SAMPLES

EVERY = pytest.mark.parametrize("name", effects.CATALOGUE)
NATIVE_NAMES = [n for n, c in effects.CATALOGUE.items() if c.is_native]
NATIVE = pytest.mark.parametrize("name", NATIVE_NAMES)


def example(name: str, elements: int = 3) -> Effect:
    """An effect with some value other than zero for every parameter, each above the one before."""
    kind = effects.find(name)
    values = {}
    for i, p in enumerate(kind.parameters):
        if p.share:
            continue  # equal shares
        low, high = max(p.lower, -1.0), min(p.upper, 10.0)
        value = low + (0.1 + 0.05 * i) * min(high - low, 4.0) if p.default != p.default or p.default == 0 else p.default
        values[p.name] = [value * (1 + 0.5 * j) for j in range(elements)] if p.per_element else value
    return kind(**values)


def unloaded(effect: Effect) -> Effect:
    """An effect that leaves drag as it is whatever the joint carries, which a replay has to be given."""
    return effect.replace(whole=0) if effect.name == "load_dependent_friction" else effect


@pytest.fixture(scope="module")
def motion():
    """(n,) time, position and velocity with reversals, rests and slow and fast parts."""
    t = np.arange(3000) * 1e-3
    q = 1.2 * np.sin(2 * np.pi * 1.7 * t) + 0.3 * np.sin(2 * np.pi * 0.31 * t + 1)
    q = np.where((t > 1) & (t < 1.2), q[1000], q)
    return t, q, np.gradient(q, t)


@EVERY
def test_says_what_it_is(name):
    kind = effects.find(name)
    assert kind.name == name and kind.kind in KINDS
    assert "Source" in kind.doc or "Yoon" in kind.doc, "names no source"
    assert kind.signature.endswith(".") and kind.experiment.endswith(".")
    assert kind.__name__ == "".join(w.title() for w in name.split("_")) or kind.__name__.isupper() or name == "lugre"
    assert getattr(effects, kind.__name__) is kind
    for p in kind.parameters:
        assert p.unit and p.doc
        assert p.lower < p.upper
        assert math.isnan(p.default) or p.lower <= p.default <= p.upper


@EVERY
def test_help_has_the_equation_and_every_parameter(name):
    kind = effects.find(name)
    shown = pydoc.plain(pydoc.render_doc(kind))
    assert kind.doc.splitlines()[0] in shown
    for p in kind.parameters:
        assert f" {p.name}: {p.doc} [{p.unit}]" in shown


def declared(**changed):
    """A module with one effect, as a file NAME.py of the catalogue, with some declarations changed or, None, left out.
    """
    whole = {"name": "mine", "kind": "drive", "doc": "d", "signature": "s", "experiment": "e"}
    whole |= {"parameters": (Parameter("k", "1", 0.0, lower=0.0, upper=1.0),)} | changed
    module = types.ModuleType("mine")
    module.Mine = type("Mine", (Effect,), {k: v for k, v in whole.items() if v is not None})
    return module


def test_a_file_with_an_effect_of_its_name_is_one():
    assert effects.of_module(declared(), "effects/mine.py", "mine").__name__ == "Mine"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"name": "other"}, "subclass of Effect with name = 'mine', that of the file, .* in it are other"),
        ({"kind": "bogus"}, "kind of an effect is one of controller, drive, .*; 'bogus' given"),
        *(({key: None}, f"Mine does not declare its {key}") for key in ("kind", "doc", "signature", "parameters")),
        ({"parameters": (Parameter("k", "1", 5.0, lower=0.0, upper=1.0),)}, r"of k must lie in \[0, 1\]; 5 given"),
        ({"parameters": (Parameter("k", "1", lower=1.0, upper=0.0),)}, r"k must have lower below upper; \[1, 0\]"),
        ({"parameters": (Parameter("k", "1", lower=math.nan),)}, "k must have lower below upper"),
        ({"parameters": (Parameter("k", "1"), Parameter("k", "1"))}, "'k' is no name of a parameter"),
        ({"parameters": (Parameter("values", "1"),)}, "'values' is no name of a parameter"),
        ({"parameters": (Parameter("read", "1"),)}, "'read' is no name of a parameter"),
    ],
)
def test_a_file_that_declares_no_whole_effect_is_named(changed, message):
    with pytest.raises(ModelError, match=f"effects/mine.py: .*{message}"):
        effects.of_module(declared(**changed), "effects/mine.py", "mine")


def test_two_effects_of_one_name_are_refused(monkeypatch):
    """A file beside a .cc file of that name, and a class of the name of another: one of them would be hidden."""
    found = [types.SimpleNamespace(name="viscous")]
    monkeypatch.setattr(effects.pkgutil, "iter_modules", lambda path: found)
    with pytest.raises(ModelError, match=r"effects/viscous.py: an effect of that name stands in effects/viscous.cc"):
        effects.catalogue()
    found[0].name, module = "mine", declared()
    module.Mine.__name__ = "Viscous"
    monkeypatch.setattr(effects.importlib, "import_module", lambda name: module)
    with pytest.raises(ModelError, match="mine and viscous have classes of one name, Viscous"):
        effects.catalogue()


@EVERY
def test_survives_model_toml(name, tmp_path):
    plant = Plant.axis(0.1) + example(name)
    plant.save(tmp_path / "model.toml")
    assert Plant.load(tmp_path / "model.toml") == plant


@EVERY
def test_refuses_what_it_does_not_know(name):
    with pytest.raises(ModelError, match="has no parameter 'wrong'"):
        effects.find(name)(wrong=1)
    for p in effects.find(name).parameters:
        if math.isfinite(p.lower):
            bad = p.lower - 1
            with pytest.raises(ModelError, match=f"{name}.{p.name} must"):
                effects.find(name)(**{p.name: [bad] if p.per_element else bad})


@EVERY
def test_delivers_a_constant_command_unchanged(name):
    time, command = np.arange(50) * 1e-3, np.full(50, 0.25)
    if effects.find(name).kind == "drive":
        assert np.allclose(example(name).deliver(time, command), command)
    else:
        assert example(name).deliver(time, command) is command


@NATIVE
def test_replay_is_finite_and_one_share(name, motion):
    r = (Plant.axis() + example(name)).joint().replay(*motion, parts=True, states=True)
    assert np.isfinite(r.torque).all() and np.isfinite(r.states).all()
    assert np.array_equal(r.parts[:, 0], r.torque)


@NATIVE
def test_standing_still_changes_no_state(name, motion):
    joint = (Plant.axis() + example(name)).joint()
    t, q, v = motion
    once = joint.replay(t, q, v, states=True)
    twice = joint.replay(np.repeat(t, 2), np.repeat(q, 2), np.repeat(v, 2), states=True)
    assert np.array_equal(once.states, twice.states[1::2])
    if joint.n_state > 2:  # the torque comes from the state, so it stands still with it
        assert np.array_equal(twice.torque[::2], twice.torque[1::2])


CUT_OFF = effects.LuGre(stiffness=1.6, damping=4e-3, coulomb=0.8, static=1.0, stribeck_velocity=1.2, plastic=1)


@pytest.mark.parametrize("effect", [*NATIVE_NAMES, CUT_OFF], ids=str)
def test_a_steady_cycle_is_the_last_of_many_periods(effect):
    """Also where half a period is enough (`turns_round`), and of an effect for which it is not."""
    plant = Plant.axis(1.0) + example("gms")
    if effect == "lugre":  # whose example, cut off, is damped so that it goes on for hundreds of periods
        effect = example(effect).replace(plastic=0)
    elif isinstance(effect, str):
        effect = example(effect, elements=1)
    plant = plant if effect.name == "gms" else plant + effect
    omega, n, periods = np.full(3, 9.0), SAMPLES, 60
    extra = np.zeros((3, len(ORDERS)), complex)
    extra[:, 0] = 0.04 * np.exp([0.3j, 1j, 2j])
    q, v = harmonics.motion(np.array([1.5, 3.0, 6.0]), omega, extra)
    found = plant.joint().cycle(2 * np.pi / omega, q, v)
    t = 1e4 + np.arange(n * periods) * 2 * np.pi / 9.0 / n
    for i in range(3):
        torque = plant.joint().replay(t, np.tile(q[i], periods), np.tile(v[i], periods)).torque[-n:]
        off = found[i] - torque  # an element that never slips keeps the offset it began with
        assert np.ptp(off) < 2e-4 * np.ptp(torque) + 1e-12


@NATIVE
def test_zero_memory_is_never_moved(name, motion):
    joint = (Plant.axis() + example(name)).joint()
    assert np.array_equal(
        joint.replay(*motion).torque, joint.replay(*motion, memory=np.zeros(joint.n_memory)).torque
    )


@NATIVE
def test_modulating_effects_scale_the_friction_laws(name, motion):
    kind = effects.find(name)
    law = effects.Coulomb(coulomb=1.0)
    load = np.ones(len(motion[0]))
    alone = (Plant.axis() + law).joint().replay(*motion, load).torque
    if name == "coulomb":
        return
    parts = (Plant.axis() + law + example(name)).joint().replay(*motion, load, parts=True).parts
    assert kind.modulates == (not np.array_equal(parts[:, 0], alone))


@NATIVE
@pytest.mark.parametrize("joint_kind", ["hinge", "slide"])
def test_plugin_torque_is_the_replayed_torque_to_the_last_bit(name, joint_kind):
    """Along a driven motion with reversals, in MuJoCo, with a second law beside the effect."""
    plant = Plant.axis(kind=joint_kind) + unloaded(example(name))
    if name != "viscous":
        plant += effects.Viscous(coefficient=0.1)
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body><joint name="j" type="{joint_kind}" '
        f'armature="{example(name).hidden_inertia}" axis="0 0 1"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>'
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = engine.attach(spec, {"j": plant}, "explicit").compile()
    data = mujoco.MjData(model)
    rows = []
    for k in range(1500):
        data.qfrc_applied[0] = 12 * math.cos(0.012 * k) + 3 * math.cos(0.05 * k)
        mujoco.mj_forward(model, data)
        rows.append((data.time, data.qpos[0], data.qvel[0], data.qfrc_passive[0]))
        mujoco.mj_step(model, data)
    t, q, v, torque = np.array(rows).T
    assert np.ptp(np.sign(v)) == 2, "the motion must reverse"
    assert np.array_equal(plant.joint().replay(t, q, v).torque, torque)


@pytest.mark.parametrize("stiffening", [0, 1])
@pytest.mark.parametrize("law", [
    effects.GMS(stiffness=[5, 2], fraction=[0.7, 0.3], coulomb=1, static=1, stribeck_velocity=1, attraction=1e6),
    effects.LuGre(stiffness=7, damping=0, coulomb=1, static=1, stribeck_velocity=1),
    effects.LuGre(stiffness=7, damping=0, coulomb=1, static=1, stribeck_velocity=1, elastic=0.5),
    effects.Dahl(stiffness=7, coulomb=1, exponent=1),
], ids=lambda law: law.name)  # fmt: skip
def test_a_contact_that_is_stronger_as_a_whole_is_stiffer_too(law, stiffening):
    """Virgin stiffness forward and backward; at level 0.2 the levels are 1.2 and 0.8 either way."""
    joint = (Plant.axis() + law + effects.AsymmetricFriction(level=0.2, stiffening=stiffening)).joint()
    for way in (1, -1):
        q = way * np.array([0, 1e-6, 50])
        stuck, slid = -way * joint.replay(np.arange(3.0), q, np.gradient(q)).torque[1:]
        assert slid == pytest.approx(1 + 0.2 * way)
        assert stuck == pytest.approx((1 + 0.2 * way * stiffening) * 7e-6, rel=1e-4)


FRICTION = [n for n, c in effects.CATALOGUE.items() if c.is_native and c.kind == "friction" and not c.modulates]


@pytest.mark.parametrize("name", FRICTION)
def test_friction_that_is_multiplied_as_a_whole_is_what_it_would_be_times_the_factor(name, motion):
    """Of what it holds at rest and of drag, too; and so are the elements, but not a spring beside it."""
    t, q, v = motion
    load, law = np.abs(np.sin(3 * t)) + 0.1, example(name, 5)
    alone = Plant.axis() + law
    whole = alone + effects.LoadDependentFriction(coefficient=0.7, whole=1)
    factor = 1 + 0.7 * load
    torque = whole.joint().replay(t, q, v, load=load).torque
    assert np.allclose(torque, factor * alone.joint().replay(t, q, v).torque, rtol=1e-13, atol=0)
    beside = (whole + effects.Spring(stiffness=2.0)).joint().replay(t, q, v, load=load).torque
    assert np.allclose(beside, torque - 2.0 * q, rtol=1e-12, atol=1e-12)
    if any(p.per_element for p in law.parameters):
        apart, plain = whole.joint().elements(0, t, q, v, load=load), alone.joint().elements(0, t, q, v)
        assert np.allclose(apart, factor[:, None] * plain, rtol=1e-13, atol=0)
        assert np.allclose(apart.sum(1), torque, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", FRICTION)
def test_dry_friction_may_differ_between_directions_as_a_whole(name, motion):
    """By the sign of the motion, or of the torque itself; and so do the elements, but not drag."""
    t, q, v = motion
    law = example(name, 5)
    alone = (Plant.axis() + law).joint()
    plain, moved = alone.replay(t, q, v).torque, np.diff(q, prepend=q[0])
    for whole, sign in ((1, np.sign(moved)), (2, -np.sign(plain))):
        leaning = (Plant.axis() + law + effects.AsymmetricFriction(level=0.3, whole=whole)).joint()
        factor = np.ones(len(t)) if name in ("viscous", "quadratic_drag") else 1 + 0.3 * sign
        assert np.allclose(leaning.replay(t, q, v).torque, factor * plain, rtol=1e-13, atol=0)
        if any(p.per_element for p in law.parameters):
            apart = leaning.elements(0, t, q, v)
            assert np.allclose(apart, factor[:, None] * alone.elements(0, t, q, v), rtol=1e-13, atol=0)


@pytest.mark.parametrize("modulator", [
    effects.LoadDependentFriction(coefficient=0.7, whole=1, drag=0),
    effects.PositionDependentFriction(harmonics=[3], amplitude=[0.7], phase=[0.2], whole=1, drag=0),
], ids=lambda e: e.name)  # fmt: skip
@pytest.mark.parametrize("name", FRICTION)
def test_drag_may_be_left_out_of_what_is_multiplied_as_a_whole(name, modulator, motion):
    t, q, v = motion
    load, law = np.abs(np.sin(3 * t)) + 0.1, example(name, 5)
    factor = 1 + 0.7 * (load if modulator.name == "load_dependent_friction" else np.sin(3 * q + 0.2))
    drags = name in ("viscous", "quadratic_drag")
    alone = (Plant.axis() + law).joint().replay(t, q, v).torque
    torque = (Plant.axis() + law + modulator).joint().replay(t, q, v, load=load).torque
    assert np.allclose(torque, alone if drags else factor * alone, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", [n for n in FRICTION if (Plant.axis() + example(n)).joint().n_memory])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_friction_begins_with_up_to_what_it_holds_there_in_that_direction(name, side):
    """A joint at rest that something modulates holds as many times more as it does in slow motion."""
    law, load = example(name), 2.0
    if "creep_velocity" in law.values:
        law = law.replace(creep_velocity=0)
    alone = Plant.axis() + law
    plant = alone + effects.AsymmetricFriction(level=0.3) + effects.LoadDependentFriction(coefficient=0.4)
    there, back = np.zeros((2, 1)), np.full(alone.joint().n_memory, side)
    held = plant.joint().replay([0.0], *there, load=[load], memory=back).torque
    factor = (1 + 0.3 * side) * (1 + 0.4 * load)
    assert held == pytest.approx(factor * alone.joint().replay([0.0], *there, memory=back).torque)
    assert held[0] * side < 0


@pytest.mark.parametrize(
    ("name", "elements"), [*itertools.product(NATIVE.args[1], [1, 4, 5]), ("gms", 40), ("gms", 200)]
)
@pytest.mark.parametrize("modulated", [None, "level", "stiffness", "whole", "by its sign"])
def test_joints_with_the_same_friction_get_what_each_gets_alone(name, elements, modulated):
    """The plug-in takes joints together: to the last bit the replay of each, one effect alone or several, modulated by
    levels that pass through zero, with or without the stiffness, or as a whole, by the place or by its own sign."""
    joints, plant = 18, Plant.axis() + unloaded(example(name, elements))
    if modulated is not None:
        own_sign = 2 if modulated == "by its sign" else 0
        waves = {"harmonics": [1, 3], "amplitude": [0.9, 0.4], "phase": [0.3, 1.0]}
        scales = (
            effects.PositionDependentFriction(**waves, whole=int(modulated == "whole")),
            effects.AsymmetricFriction(level=0.3, stiffening=int(modulated != "level"), whole=own_sign),
            effects.Viscous(coefficient=0.1),
        )
        for effect in scales:
            if effect.name != name:
                plant += effect
    inertia = 1 + example(name, elements).hidden_inertia
    body = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    bodies = "".join(f'<body><joint name="j{i}" axis="0 0 1" armature="{inertia}"/>{body}' for i in range(joints))
    text = f'<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    model = engine.attach(text, {"*": plant}, "explicit").compile()
    assert model.nplugin == 1
    data, rng, rows = mujoco.MjData(model), np.random.default_rng(1), []
    for k in range(300):
        if k % 50 == 0:
            data.qfrc_applied[:] = rng.normal(size=joints) * 30
            data.qfrc_applied[3] = 0  # never moves
        mujoco.mj_forward(model, data)
        rows.append([np.full(joints, data.time), data.qpos.copy(), data.qvel.copy(), data.qfrc_passive.copy()])
        mujoco.mj_step(model, data)
    assert np.ptp(np.sign(np.array(rows)[:, 2])) == 2, "the motion must reverse"
    for *motion, torque in np.transpose(rows, (2, 1, 0)):
        assert np.array_equal(plant.joint().replay(*motion).torque, torque)
