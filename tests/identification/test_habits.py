"""Habits of a log, which are no physics: allowed for where they explain what is left, told, and kept with the plant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, REGIMES, SAMPLE_TIME, J, runs, slow

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit, fit_observations
from gms_mujoco.identification.habits import as_logged
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.time_steps import RESTS, TOLD, in_steps, steps_of
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

H = 2e-3  # s


def rigid(
    parts: int = 1, offset: float = 0.0, count: float = 0.0, seconds: float = 4.0, noise: float = 0.0
) -> Dataset:
    """Runs of an axis with Coulomb friction that does not bend, by a script that stops it in the step in which friction
    can: one to a row, or so many; read by an encoder, where that has counts, and noise so many times one."""
    out, drag = [], 5e-5
    for use in ("fit", "validate"):
        for i, (low, high, rms) in enumerate(REGIMES):
            rng = np.random.default_rng([i, len(use)])
            torque = multisine(round(seconds / H), H, low, high, rms * LEVEL, rng)
            q, v, h, position = 0.0, 0.0, H / parts, np.empty(len(torque))
            for k, u in enumerate(torque):
                position[k] = q
                for _ in range(parts):
                    free = v + h * (u + offset - drag * v) / J
                    v = free - np.clip(free, -h * LEVEL / J, h * LEVEL / J)
                    q += h * v
            loud = noise * rng.standard_normal(len(position))
            read = count * np.round(position / count + loud) if count else position
            signals = {"torque": torque, "position": read}
            out.append(Record(f"{use}_{i}", H * np.arange(len(torque)), signals, use, count or None))
    return Dataset(Path(), tuple(out), "hinge", J)


def test_the_log_of_a_bench_is_none_of_time_steps() -> None:
    found = fit(Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous(), runs(HEALTHY))
    assert steps_of(found.misfit.observations) is None and TOLD not in found.plant.provenance
    assert as_logged(found) is None


def test_torques_measured_after_they_acted_are_none_either() -> None:
    late = [replace(r, signals={**r.signals, "torque": np.append(r.torque[:1], r.torque[:-1])}) for r in runs(HEALTHY)]
    found = fit(Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous(), late)
    assert steps_of(found.misfit.observations) is None and "before their rows" in found.habit


@pytest.mark.parametrize("rows", [3, *slow(2, 5)])
def test_torques_that_came_late_over_a_bus_are_taken_when_they_acted(rows: int) -> None:
    def late(r: Record) -> Record:
        return replace(r, signals={**r.signals, "torque": np.append(np.full(rows, r.torque[0]), r.torque[:-rows])})

    plant = Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous()
    then, found = fit(plant, runs(HEALTHY)), fit(plant, [late(r) for r in runs(HEALTHY)])
    assert found.plant.provenance["clock_skew"] == pytest.approx(-rows * SAMPLE_TIME, abs=0.1 * SAMPLE_TIME)
    assert f"({rows:.2f} samples) before their rows say" in found.habit
    assert found.error < 1.2 * then.error


def test_friction_that_does_not_bend_holds_whatever_it_has_to_and_stops_the_axis_in_a_step() -> None:
    data = rigid()
    seen = in_steps(observe(data.fit, J), 0, (1, 0))
    assert all(o.rest.at_once.mean() > 0.01 for o in seen)
    found = fit_observations(Plant.axis(J) + effects.Coulomb() + effects.Viscous(), seen)
    assert found.error < 1e-9
    assert found.plant["coulomb"].coulomb == pytest.approx(LEVEL, rel=1e-9)
    assert found.plant["viscous"].coefficient == pytest.approx(5e-5, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("parts", [1, 10])
def test_what_is_hidden_behind_friction_that_does_not_bend_is_named(parts: int) -> None:
    """Where the axis rests it says nothing; a third of the torque had been left there, and a `backlash` named."""
    healthy = diagnose(rigid(parts=parts))
    assert healthy.verdict == "adequate" and not healthy.found and healthy.steps[-1].validate_error < 5e-3
    pushed = diagnose(rigid(parts=parts, offset=0.12 * LEVEL))
    assert [s.effect for s in pushed.steps[1:]] == ["torque_offset"] and pushed.steps[-1].validate_error < 5e-3
    assert pushed.plant["torque_offset"].torque == pytest.approx(0.12 * LEVEL, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("parts", "noise"), [(10, 2.0), (1, 0.0), (10, 0.0)])
def test_an_encoder_does_not_hide_what_friction_that_does_not_bend_does(
    parts: int, noise: float, tmp_path: Path
) -> None:
    """Within a count nobody knows by how much it bends: a quarter of the torque was left there, and taken for noise.
    Of one with noise of two counts a tenth was, and an `asymmetric_friction` named."""
    data = rigid(parts, 0.12 * LEVEL, 2 * np.pi / 2**18, noise=noise)
    d = diagnose(data)
    assert d.verdict == "explained" and [s.effect for s in d.steps[1:]] == ["torque_offset"]
    assert d.steps[-1].validate_error < 0.02 and "nothing is asked there" in str(d)
    assert d.plant["torque_offset"].torque == pytest.approx(0.12 * LEVEL, rel=0.02)
    d.plant.save(tmp_path / "axis.toml")
    again = compare(gms.Plant.load(tmp_path / "axis.toml"), data.validate)
    assert again.error == pytest.approx(d.steps[-1].validate_error, rel=0.01)


def test_what_bends_within_a_few_counts_is_asked_about() -> None:
    found = fit(HEALTHY, runs(HEALTHY, resolution=2 * np.pi / 2**14))
    assert RESTS not in found.plant.provenance
