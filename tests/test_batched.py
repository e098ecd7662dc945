"""The friction of a model laid out for many worlds, and the model without it."""

import mujoco
import numpy as np
import pytest
from axes import AXIS, BEARING, DRY, axis, gms

from gms_mujoco import batched, effects, engine
from gms_mujoco.errors import EngineError, ModelError
from gms_mujoco.plant import Plant

TWO = AXIS.replace("</worldbody>", '<body><joint name="second"/><geom size=".1" mass="5"/></body></worldbody>')


def test_the_numbers_of_each_joint_stand_where_the_layout_says():
    other = Plant.axis(1.0) + effects.Dahl(stiffness=3.0, coulomb=2.0) + effects.Cogging(harmonics=[4, 8])
    layout = batched.lay_out(engine.attach(TWO, {"shaft": BEARING, "second": other}).compile())
    assert layout.names == ("shaft", "second") and layout.dofs == (0, 1)
    for joint, plant in (("shaft", BEARING), ("second", other)):
        for effect in plant.effects:
            for name, value in effect.values.items():
                found = layout.parameters[layout.column(joint, f"{effect.name}.{name}")]
                np.testing.assert_array_equal(found, np.atleast_1d(value))
    places = [s for joint in layout.states.values() for s in joint.values()]
    assert sorted(places, key=lambda s: s.start) == places
    assert places[-1].stop == layout.n_state and [s.stop - s.start for s in places] == [8, 1]


def test_the_bare_model_steps_as_if_nothing_had_been_attached():
    model, _ = axis()
    bare, plain = batched.lay_out(model).bare, mujoco.MjModel.from_xml_string(AXIS)
    runs = [mujoco.MjData(m) for m in (bare, plain)]
    for m, d in zip((bare, plain), runs, strict=True):
        d.ctrl[:] = 1e-3
        for _ in range(50):
            mujoco.mj_step(m, d)
    assert runs[0].qpos == runs[1].qpos != 0
    assert model.nplugin == 1, "the model given is left alone"


@pytest.mark.parametrize(("plant", "integration", "implicit"), [
    (DRY, "auto", (0,)), (DRY, "explicit", ()), (BEARING, "auto", ()), (BEARING, "implicit", (0,)),
])  # fmt: skip
def test_joints_too_stiff_for_an_explicit_step_are_implicit(plant, integration, implicit):
    assert batched.lay_out(axis(plant, integration)[0]).implicit == implicit


def test_refuses_a_model_without_friction_and_one_with_other_plugins():
    with pytest.raises(ModelError, match=r"no joint of the model has friction of gms_mujoco"):
        batched.lay_out(mujoco.MjModel.from_xml_string(AXIS))
    with pytest.raises(EngineError, match="other plug-ins beside the friction, or sensors of it"):
        batched.lay_out(engine.attach(AXIS, {"shaft": BEARING}, sensors=["torque"]).compile())


@pytest.fixture
def layout():
    return batched.lay_out(axis(Plant.axis(1.0) + gms())[0])


def change(layout, joint, values, n=3):
    return batched.changed(layout, layout.parameters[None], joint, values, n)


def test_values_are_given_for_all_worlds_or_for_each(layout):
    column = layout.column("shaft", "gms.attraction")
    for given, rows in ((2.0, [2]), (np.arange(1.0, 4), [1, 2, 3]), (np.arange(1.0, 4)[:, None], [1, 2, 3])):
        table = change(layout, "shaft", {"gms.attraction": given})
        assert table[:, column].ravel().tolist() == rows
        rest = np.delete(table, column, axis=1)
        assert (rest == np.delete(layout.parameters, column)).all()
    table = batched.changed(layout, table, "shaft", {"gms.stiffness": [1, 2, 3, 4]}, 3)
    assert (table[:, layout.column("shaft", "gms.stiffness")] == [1, 2, 3, 4]).all()
    assert table[:, column].ravel().tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("joint", "parameter", "values", "says"),
    [
        ("elbow", "gms.coulomb", 1, "no joint with friction is called 'elbow'; they are shaft"),
        ("shaft", "dahl.coulomb", 1, "has no parameter 'dahl.coulomb'; its parameters are gms.attraction, gms.coulomb"),
        ("shaft", "gms.stiffness", [1, 2], r"has shape \(2,\); expected \(4,\) or \(3, 4\)"),
        ("shaft", "gms.coulomb", [1e-3, -1, 1e-3], r"gms.coulomb must lie in \[0, inf\) N m; -1 given"),
        ("shaft", "gms.coulomb", np.inf, r"gms.coulomb must lie in \[0, inf\) N m; inf given"),
        ("shaft", "gms.coulomb", np.nan, "gms.coulomb must lie in"),
        ("shaft", "gms.static", [1, 1, 1e-3], "gms.static must be at least coulomb in every world"),
        ("shaft", "gms.fraction", [0.1, 0.2, 0.3, 0.3], "gms.fraction must sum to 1 in every world"),
    ],
)
def test_says_what_is_wrong_with_values(layout, joint, parameter, values, says):
    with pytest.raises(ModelError, match=says):
        change(layout, joint, {parameter: values})
