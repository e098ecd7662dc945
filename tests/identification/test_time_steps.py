"""Logs of simulations, a row for every time step: followed as they were taken, to the last digit."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from bench import HEALTHY, LEVEL, REGIMES, TORQUE_NOISE, J, in_mujoco, runs, slow

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit, fit_observations
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.time_steps import as_fitted, in_steps, steps_of
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

H = 2e-3  # s, of MuJoCo by default
COGS = f'<dcmotor joint="shaft" input="none" motorconst="0" resistance="1" cogging="{0.2 * LEVEL} 7 0.3"/>'
COGGING = effects.Cogging(harmonics=[7], amplitude=[0.1 * LEVEL], phase=[0.0])  # to begin with
LAWS = {"frictionloss": effects.Frictionloss(), "gms": effects.GMS(elements=2)}
# MuJoCo takes its constraints and damping at the end of a step, our explicit friction at the beginning.
AHEAD = {"frictionloss": (1, 1), "gms": (0, 1)}


def model(law: str, more: str = "") -> mujoco.MjModel:
    """An axis with MuJoCo's own friction, with ours, or bare."""
    own = 'damping="2e-5"' + (f' frictionloss="{LEVEL}"' if law == "frictionloss" else "")
    xml = (
        f'<mujoco><option timestep="{H}" gravity="0 0 0"/><worldbody><body><joint name="shaft" axis="0 0 1" {own}/>'
        f'<inertial pos="0 0 0" mass="1e-6" diaginertia="{J} {J} {J}"/></body></worldbody>'
        f'<actuator><motor joint="shaft"/>{more}</actuator></mujoco>'
    )
    if law != "gms":
        return mujoco.MjModel.from_xml_string(xml)
    return gms.attach(xml, {"shaft": HEALTHY.without("viscous")}, integration="explicit").compile()


def logged(m: mujoco.MjModel, after: bool = False, seconds: float = 4.0, noise: float = 0.0) -> Dataset:
    """Runs of it, every step a row, with the position before the step or after it."""
    out = []
    for use in ("fit", "validate"):
        for i, (low, high, rms) in enumerate(REGIMES):
            rng = np.random.default_rng([i, len(use)])
            torque = multisine(round(seconds / H), H, low, high, rms * LEVEL, rng)
            position = in_mujoco(m, torque)[int(after) :][: len(torque)]
            signals = {"torque": torque + noise * rng.standard_normal(len(torque)), "position": position}
            out.append(Record(f"{use}_{i}", H * np.arange(len(torque)), signals, use))
    return Dataset(Path(), tuple(out), "hinge", J)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("after", [False, True])
def test_the_steps_of_a_simulation_are_followed_to_the_last_digits(law: str, after: bool) -> None:
    seen = in_steps(observe(logged(model(law, COGS), after).fit, J), int(after), AHEAD[law])
    found = fit_observations(Plant.axis(J) + LAWS[law] + effects.Viscous() + COGGING, seen)
    assert found.error < 1e-6
    assert found.plant["cogging"].amplitude == pytest.approx([0.2 * LEVEL], rel=1e-4)
    assert found.plant[law].coulomb == pytest.approx(LEVEL, rel=1e-4)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("after", [True, *slow(False)])
def test_a_fit_finds_out_that_rows_are_time_steps_and_tells_it(law: str, after: bool) -> None:
    data = logged(model(law), after, noise=TORQUE_NOISE)
    found = fit(Plant.axis(J) + LAWS[law] + effects.Viscous(), data.fit)
    late, (friction, _) = steps_of(found.misfit.observations)  # type: ignore[misc]
    assert (late, friction) == (int(after), AHEAD[law][0])  # noise hides when so little damping is taken
    assert found.error < 1.2 * found.floor
    assert "is a time step" in found.habit and ("after it" in found.habit) == after
    held_out = compare(found.plant, data.validate)
    assert held_out.error < 1.2 * held_out.noise_floor and held_out.simulation_error < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["", "cogging"])
def test_what_a_simulation_hides_is_named_and_nothing_is_left(hidden: str) -> None:
    d = diagnose(logged(model("frictionloss", COGS if hidden else ""), after=True))
    assert [e.name for e in d] == [hidden] * bool(hidden) and d.verdict == ("explained" if hidden else "adequate")
    assert d.steps[-1].validate_error < 1e-4 and "time step" in str(d)


def test_a_plant_keeps_how_it_was_logged_and_is_compared_with_other_logs_as_they_are(tmp_path: Path) -> None:
    data = logged(model("gms"))
    plant = fit(Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous(), data.fit).plant
    plant.save(tmp_path / "model.toml")
    loaded = Plant.load(tmp_path / "model.toml")
    assert steps_of(as_fitted(observe(data.fit, J), loaded.provenance)) == (0, AHEAD["gms"])
    assert compare(loaded, data.validate).error < 1e-3
    measured = compare(loaded, runs(HEALTHY, "validate"))
    assert measured.error < 1.5 * measured.noise_floor


def test_a_script_that_takes_all_at_the_beginning_of_a_step_is_followed_too() -> None:
    """Smoothed Coulomb friction and drag of the velocity that a step begins with, logged after the step."""
    out, creep, drag = [], 0.3, 5e-5
    for i, (low, high, rms) in enumerate(REGIMES):
        torque = multisine(2000, H, low, high, rms * LEVEL, np.random.default_rng(i))
        q, v, position = 0.0, 0.0, np.empty(2000)
        for k, u in enumerate(torque):
            v += H * (u - LEVEL * np.tanh(v / creep) - drag * v) / J
            q += H * v
            position[k] = q
        out.append(Record(f"run_{i}", H * np.arange(2000), {"torque": torque, "position": position}, "fit"))
    found = fit(Plant.axis(J) + effects.Stribeck(creep_velocity=np.nan) + effects.Viscous(), out)
    assert steps_of(found.misfit.observations) == (1, (0, 0)) and found.error < 1e-4
    assert found.plant["stribeck"].creep_velocity == pytest.approx(creep, rel=1e-3)
    assert found.plant["viscous"].coefficient == pytest.approx(drag, rel=1e-3)


@pytest.mark.slow
def test_a_bristle_that_mujoco_integrates_is_followed_to_a_hundredth() -> None:
    """The state that an actuator integrates is that of the step before."""
    bristle = f'lugre="{100 * LEVEL} {0.1 * np.sqrt(100 * LEVEL * J)} {LEVEL} {1.2 * LEVEL} 0.2"'
    m = model("none", f'<dcmotor joint="shaft" input="none" motorconst="0" resistance="1" {bristle}/>')
    d = diagnose(logged(m, after=True))
    assert d.verdict == "adequate" and not d.found and "lugre" in d.plant and d.steps[-1].validate_error < 0.01
    assert d.plant["lugre"].coulomb == pytest.approx(LEVEL, rel=0.02)


def test_steps_stay_steps() -> None:
    (seen, *_) = in_steps(observe(logged(model("gms"), seconds=1.0).fit, J), 0, (0, 1))
    assert steps_of([seen.opening(0.5)]) == steps_of([seen.again(seen.record.position)]) == (0, (0, 1))
    assert seen.acting_early() is seen
