"""Frequency responses, alone and beside records, through fit, compare and diagnose."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import run, slow

import gms_mujoco as gms
from gms_mujoco import cli, effects
from gms_mujoco.dahl_resonance import identify_dahl, virgin_curve
from gms_mujoco.dataset import Dataset, load
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.judgement import is_told
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.frf import FRF, to_csv
from gms_mujoco.identification.frf_observation import FrfObservation
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant
from gms_mujoco.responses.resonance import find_antiresonance
from gms_mujoco.sweep import stepped_sine

J, LEVEL, COUNT = 2.4e-5, 4.5e-3, 2 * np.pi / 1e6
GMS = effects.GMS(
    stiffness=[1.2, 0.3, 0.12], fraction=[0.25, 0.35, 0.4], coulomb=LEVEL, static=1.2 * LEVEL, stribeck_velocity=0.6,
    attraction=0.4,
)  # fmt: skip
AXIS = Plant.axis(J) + GMS + effects.Viscous(coefficient=4e-5)
UNKNOWN = Plant.axis() + effects.GMS(elements=3) + effects.Viscous()


def sweep(plant: Plant, levels: int = 7, points: int = 14, **bench: object) -> list[FRF]:
    """Stepped sines in the time domain at 2 kHz, from pre-sliding to turning."""
    out = []
    for i, torque in enumerate(np.geomspace(0.08, 3, levels) * LEVEL):
        grid = np.geomspace(9, 350, points)
        good = {"resolution": COUNT, "torque_noise": 2e-5, "seed": 100 * i, **bench}
        out.append(stepped_sine(plant, grid, torque, held="torque", **good))  # type: ignore[arg-type]
    return [replace(f, use="validate" if i in (2, 4) else "fit") for i, f in enumerate(out)]


@pytest.fixture(scope="module")
def healthy() -> list[FRF]:
    return sweep(AXIS)


@pytest.fixture(scope="module")
def fitted(healthy: list[FRF]) -> gms.FitResult:
    return fit(UNKNOWN, [f for f in healthy if f.use == "fit"])


def curve(plant: Plant, x: np.ndarray) -> np.ndarray:
    gms_ = plant["gms"]
    k = np.array(gms_.stiffness)
    return virgin_curve(k, np.array(gms_.fraction) * gms_.static / k, x)


def test_every_parameter_comes_back_from_responses_alone(fitted: gms.FitResult) -> None:
    """Inertia, the Stribeck curve and its lag too, which no describing function of Maxwell-slip knows."""
    found = fitted.plant
    truth = {"inertia": J, "gms.coulomb": LEVEL, "gms.static": 1.2 * LEVEL, "viscous.coefficient": 4e-5}
    for name, value in truth.items():
        assert found.numbers()[name][0] == pytest.approx(value, rel=0.1 if "viscous" in name else 0.02), name
        assert name in found.uncertainty
    assert found.inertia == pytest.approx(J, rel=2e-3) and not found.inertia_known
    assert found["gms"].stribeck_velocity == pytest.approx(0.6, rel=0.15)
    assert fitted.error < 1.2 * fitted.floor < 0.02


def test_points_without_coherence_do_not_ruin_a_fit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    entries = ""
    for i, f in enumerate(sweep(AXIS, levels=4)):
        bad = np.flatnonzero(f.frequency > 90)[1:4]
        response, coherence = f.response.copy(), rng.uniform(0.99, 0.9999, len(f))
        response[bad] *= 1 + rng.normal(size=3) + 1j * rng.normal(size=3)
        coherence[bad] = 0.2
        table = np.column_stack([f.frequency, response.real, response.imag, coherence])
        np.savetxt(tmp_path / f"{i}.csv", table, delimiter=",", header="f [Hz],real,imag,coherence", comments="")
        entries += (f'[[frf]]\nfile = "{i}.csv"\ninput = "torque"\noutput = "position"\nuse = "fit"\n'
                    f"amplitude = {float(np.median(f.excitation))}\n")
    (tmp_path / "dataset.toml").write_text(entries)
    found = fit(UNKNOWN, load(tmp_path).fit).plant
    assert found.inertia == pytest.approx(J, rel=0.01) and found["gms"].coulomb == pytest.approx(LEVEL, rel=0.02)


FOUR = effects.GMS(
    stiffness=[0.8, 0.4, 0.2, 0.1], fraction=[0.1, 0.2, 0.3, 0.4], coulomb=LEVEL, static=5.2e-3, stribeck_velocity=0.3,
    attraction=0.5,
)  # fmt: skip


@pytest.mark.parametrize(("spring", "seeds"), [(0.05, (0, 2, 4)), *slow((None, (2, 3, 5)), (0.3, (1, 3, 4)))])
def test_each_element_finds_its_work(spring: float | None, seeds: tuple[int, ...]) -> None:
    """A fit had left one element without a share, or made it a spring beside that of the plant, in half of such sets
    of noise, and had ended four times above the floor."""
    sprung = () if spring is None else (effects.Spring(stiffness=spring),)
    plant, unknown = Plant.axis(J), gms.baseline(elements=4)
    for e in (FOUR, effects.Viscous(coefficient=2e-5), *sprung):
        plant = plant + e
    for _ in sprung:
        unknown = unknown + effects.Spring()
    grid = np.geomspace(5, 150, 14)
    clean = [stepped_sine(plant, grid, u * LEVEL, held="torque") for u in (0.05, 0.2, 0.5, 0.9, 1.5)]
    for seed in seeds:
        rng = np.random.default_rng(seed)
        noise = [0.005 * (rng.normal(size=14) + 1j * rng.normal(size=14)) for _ in clean]
        frfs = [
            replace(f, response=f.response * (1 + n), sigma=0.005 * abs(f.response))
            for f, n in zip(clean, noise, strict=True)
        ]
        found = fit(unknown, frfs)
        assert found.is_near_floor, seed
        law = found.plant["gms"]
        order = np.argsort(np.asarray(law.fraction))
        assert np.allclose(np.asarray(law.stiffness)[order], [0.8, 0.4, 0.2, 0.1], rtol=0.08)
        assert np.allclose(np.asarray(law.fraction)[order], [0.1, 0.2, 0.3, 0.4], rtol=0.08)
        if spring is not None:
            assert found.plant["spring"].stiffness == pytest.approx(spring, rel=0.02)


EIGHT = Plant.load("servo_axis")


def responses(plant: Plant, seed: int) -> list[FRF]:
    """Of the eight elements of `servo_axis` with something more, at seven amplitudes; two are kept."""
    frequency, bench = np.geomspace(5, 150, 14), {"resolution": COUNT, "torque_noise": 2e-5}
    torques = LEVEL * np.geomspace(0.03, 2.5, 7)
    found = [stepped_sine(plant, frequency, u, held="torque", seed=100 * i + seed, **bench)  # type: ignore[arg-type]
             for i, u in enumerate(torques)]  # fmt: skip
    return [replace(f, use="validate" if i in (1, 4) else "fit") for i, f in enumerate(found)]


@pytest.mark.parametrize("seed", [0, *slow(4, 9, 12)])
def test_eight_elements_part_where_there_is_most_to_do(seed: int) -> None:
    """In half of such sets of noise three elements had stood where there are four, and one far out, of no use: the fit
    was at its noise floor by four parts in a thousand of the torque, and off what was kept by eleven."""
    frfs = responses(EIGHT, seed)
    found = fit(gms.baseline(), [f for f in frfs if f.use == "fit"])
    assert found.error < 0.9 * found.floor
    kept = gms.compare(found.plant, [f for f in frfs if f.use == "validate"])
    assert kept.error < 1.2 * kept.noise_floor


def test_a_harmonic_that_meets_the_resonance_of_a_coupling_is_not_trusted() -> None:
    """One of a sine at 11 Hz, beside a coupling of 60 Hz, had bent all of friction: a fit that began at the truth had
    left four times as much."""
    coupling = effects.FlexibleCoupling(inertia=8e-6, frequency=60.0, damping=0.03)
    frfs = responses(EIGHT + coupling, 7)
    found = fit(EIGHT + coupling, [f for f in frfs if f.use == "fit"])
    assert found.error < found.floor
    kept = gms.compare(found.plant, [f for f in frfs if f.use == "validate"])
    assert kept.error < 1.2 * kept.noise_floor
    assert found.plant["flexible_coupling"].frequency == pytest.approx(60, rel=1e-3)


def test_the_virgin_curve_is_right_where_the_reading_ignores_stribeck(
    fitted: gms.FitResult, healthy: list[FRF]
) -> None:
    x = np.linspace(0, 0.02, 200)[1:]
    true = curve(AXIS, x)

    def error(y: np.ndarray) -> float:
        return float(np.sqrt(np.mean((y - true) ** 2) / np.mean(true**2)))

    assert error(curve(fitted.plant, x)) < 0.02 < 0.08 < error(identify_dahl(healthy).virgin_curve(x))


def test_a_comparison_tells_the_noise_floor_of_the_fit(fitted: gms.FitResult, healthy: list[FRF]) -> None:
    found = gms.compare(fitted.plant, [f for f in healthy if f.use == "fit"])
    assert found.noise_floor == pytest.approx(fitted.floor, rel=0.03)
    assert all(r.noise_floor < 1.3 * r.torque_error for r in found.frfs)  # hardly more than what is left
    weighed = "of responses each point weighed by its deviation"
    assert weighed in fitted.status and weighed in str(found).splitlines()[0]
    for r in found.frfs:  # which the error of the torque itself is not
        share = np.abs(1 - r.response / r.model)  # of the torque that was applied at each point
        rows = np.concatenate([share, np.ones(len(share))]).reshape(2, -1) / r.deviation
        assert r.torque_error == pytest.approx(np.sqrt(np.mean(rows[0] ** 2) / np.mean(rows[1] ** 2)), rel=0.02)


def test_the_plant_gives_back_responses_it_was_not_fitted_to(fitted: gms.FitResult, healthy: list[FRF]) -> None:
    found = gms.compare(fitted.plant, [f for f in healthy if f.use == "validate"])
    assert found.records == () and len(found.frfs) == 2
    assert found.torque_error < 1.5 * found.noise_floor and found.simulation_error < 0.05
    for r in found.frfs:
        assert np.median(np.abs(r.magnitude_error)) < 0.1 and np.median(np.abs(r.phase_error)) < 0.5
        if r.resonance and r.model_resonance:
            assert r.model_resonance.frequency == pytest.approx(r.resonance.frequency, rel=0.02)
    assert "resonance [Hz]" in str(found)
    assert json.loads(json.dumps(found.to_dict()))["frfs"][0]["name"] == found.frfs[0].name


def test_compare_shows_a_delay_in_the_phase(fitted: gms.FitResult) -> None:
    late = stepped_sine(AXIS + effects.Delay(time=5e-4), [50.0, 100.0, 200.0], 4e-3, held="torque")
    phase = gms.compare(fitted.plant, [late]).frfs[0].phase_error
    assert np.allclose(phase, [-9, -18, -36], atol=3)


def test_records_and_responses_are_one_fit(healthy: list[FRF]) -> None:
    rng = np.random.default_rng(1)
    records = [run(AXIS, multisine(3000, 1e-3, 0.5, 40, 3 * LEVEL, rng), 1)]
    data = [*healthy[:3], *records, *healthy[3:]]
    seen = observe(data, J)
    assert [isinstance(o, FrfObservation) for o in seen] == [False] + [True] * 7
    misfit = Misfit(AXIS, seen)
    assert misfit.n_memory == 3 and misfit.size == misfit.coordinates.size + 1 + 3  # states of the record alone
    found = fit(UNKNOWN, data)
    assert found.plant.inertia == pytest.approx(J, rel=3e-3)
    assert found.error < 1.4 * found.floor
    assert found.plant["gms"].coulomb == pytest.approx(LEVEL, rel=0.02)


def test_a_response_that_cannot_be_used_is_left_out_beside_others_and_refused_alone(healthy: list[FRF]) -> None:
    blind = FRF("blind", np.array([1.0, 2.0]), np.array([1.0, 0.5]))
    assert len(observe([*healthy, blind])) == len(healthy)
    with pytest.raises(DataError, match="amplitude of the excitation is not known"):
        fit(UNKNOWN, [blind])


def test_a_healthy_axis_is_adequate(healthy: list[FRF]) -> None:
    found = diagnose(Dataset(Path(), (), "hinge", J, frfs=tuple(healthy)), UNKNOWN)
    assert found.verdict == "adequate" and found.steps[-1].validate_error is not None


def test_a_hidden_delay_is_named_through_files_and_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frfs = sweep(AXIS + effects.Delay(time=6e-4), levels=5, points=10)
    text = f"[axis]\ninertia = {J}\n"
    for i, f in enumerate(frfs):
        (tmp_path / f"level_{i}.csv").write_text(to_csv([f]))
        text += f'[[frf]]\nfile = "level_{i}.csv"\ninput = "torque"\noutput = "position"\n'
    (tmp_path / "dataset.toml").write_text(text)
    runs = load(tmp_path)
    assert [f.use for f in runs.frfs] == ["fit", "validate", "fit", "fit", "fit"] and "every third" in runs.split
    assert cli.main(["diagnose", str(tmp_path), "-o", str(tmp_path / "out")]) == 0
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert said["steps"][1]["effect"] == "delay"
    low, high = said["steps"][1]["parameters"]["delay.time"]["ci95"]
    half = (high - low) / 2
    assert half < 1e-5 and low - half < 6e-4 < high + half  # four standard errors: one interval in twenty misses
    assert "Frequency responses" in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "recording.rrd").stat().st_size > 1000
    assert cli.main(["compare", str(tmp_path / "out" / "model.toml"), str(tmp_path)]) == 0
    assert "damping ratio" in capsys.readouterr().out


@pytest.mark.slow
def test_the_coupling_of_a_measured_flexible_link_is_named(data: Path, tmp_path: Path) -> None:
    """Its loop, of gain 1.65, is a spring; the resonance of the link with the motor clamped is its antiresonance."""
    files = sorted((data / "flexlink_frf").glob("*07-May*.dat"))
    if not files:
        pytest.skip("no flexlink_frf there")
    (tmp_path / "dataset.toml").write_text(
        f'[[frf]]\nfile = "{files[0].as_posix()}"\ninput = "torque"\noutput = "position"\namplitude = 1.0\n'
        "columns = { frequency = 0, magnitude = 1, phase = 2 }\n"
        'units = { frequency = "rad/s", magnitude = "abs", phase = "rad" }\n'
    )
    runs = load(tmp_path)
    low, high = np.array(find_antiresonance(runs.frfs[0], 2, 8)[1:]) * 2 * np.pi
    assert low < 26 < high < 1.1 * low
    found = diagnose(runs, Plant.axis() + effects.Viscous() + effects.Spring())
    assert "flexible_coupling" in [e.name for e in found]
    assert low < 2 * np.pi * found.plant["flexible_coupling"].frequency < high
    assert found.plant["spring"].stiffness == pytest.approx(1.65, rel=0.02)


def test_a_response_tells_no_strength_of_what_varies_with_a_place_that_it_does_not_know(
    healthy: list[FRF], fitted: gms.FitResult
) -> None:
    """Strength and phase of a cogging make one stiffness of the place where the axis swings."""
    cogging = effects.Cogging(harmonics=[6], amplitude=[0.1 * LEVEL], phase=[0.4])
    seen = [f for f in healthy if f.use == "fit"]
    assert not is_told("cogging", fit(AXIS + cogging, seen))
    assert not is_told("delay", fit(AXIS + effects.Delay(time=1e-4), seen))  # there is none
    assert is_told("viscous", fitted)
