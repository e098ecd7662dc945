"""Frequency responses against the closed form of a linear axis, which knows nothing of how they are estimated."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.dahl_resonance import identify_dahl
from gms_mujoco.errors import DataError, GmsError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.frf import FRF, estimate_frf, hold_factor, join_sines, response_unit, to_csv
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.responses.spectra import find_period
from gms_mujoco.simulate import simulate
from gms_mujoco.sweep import stepped_sine

J, SPRING, DRAG, H = 2.4e-5, 0.5, 1e-3, 5e-4
AXIS = Plant.axis(J) + effects.find("spring")(stiffness=SPRING) + effects.find("viscous")(coefficient=DRAG)
FINE = {"substeps": 64}


def closed_form(frequency: np.ndarray) -> np.ndarray:
    s = 2j * np.pi * frequency
    return 1 / (J * s**2 + DRAG * s + SPRING)


def run(torque: np.ndarray, **bench: object) -> Record:
    return simulate(AXIS, torque, H, **{**FINE, **bench})  # type: ignore[arg-type]


def misfit(frf: FRF) -> np.ndarray:
    return np.abs(frf.response / closed_form(frf.frequency) - 1)


def test_multisine_gives_the_closed_form_with_the_hold_taken_off() -> None:
    torque = np.tile(multisine(2000, H, 2, 700, 5e-3, np.random.default_rng(0)), 4)
    frf = estimate_frf(run(torque))
    assert "mean of 3 periods of 1 s" in frf.notes[0] and frf.frequency[-1] > 600
    assert misfit(frf.band(0, 400)).max() < 1e-3 and misfit(frf).max() < 4e-3
    held = estimate_frf(run(torque), hold=False)  # half a sample of delay, pi / 4 at half the sample rate
    assert np.angle(held.response / frf.response)[-1] == pytest.approx(-np.pi * frf.frequency[-1] * H, rel=1e-6)


def test_hold_factor_is_that_of_the_discrete_double_integrator() -> None:
    f = np.array([1.0, 100.0, 400.0, 900.0])
    z = np.exp(2j * np.pi * f * H)
    exact = H**2 / 2 * (z + 1) / (z - 1) ** 2  # zero-order hold of 1 / s^2
    assert np.allclose(hold_factor(f, H), exact * (2j * np.pi * f) ** 2, rtol=1e-9)


def test_a_velocity_has_a_hold_factor_of_its_own() -> None:
    """On the mass line it is exact, off it sigma says what it errs by."""
    torque = np.tile(multisine(2000, H, 2, 700, 5e-3, np.random.default_rng(0)), 4)
    for drag in (1e-12, 1e-2):
        decay, speed = math.exp(-drag / J * H), np.zeros(len(torque))
        for k in range(len(torque) - 1):
            speed[k + 1] = decay * speed[k] + (1 - decay) / drag * torque[k]
        record = Record("v", H * np.arange(len(torque)), {"torque": torque, "velocity": speed, "position": speed})
        frf = estimate_frf(record, output="velocity")
        exact, mass = (1 / (2j * np.pi * frf.frequency * J + d) for d in (drag, 0.0))
        share = 3.3 * (frf.frequency * H) ** 2
        assert np.all(np.abs(frf.response - exact) < 1.1 * share * np.abs(mass - exact) + 1e-4 * np.abs(exact))
        assert np.all(frf.sigma >= share * np.abs(frf.response))


def test_a_torque_that_was_read_at_the_samples_is_not_held() -> None:
    torque = np.tile(multisine(2000, H, 2, 400, 5e-3, np.random.default_rng(0)), 4)
    held = run(torque)
    read = replace(held, name="read", sensed=True)
    assert np.array_equal(estimate_frf(read).response, estimate_frf(held, hold=False).response)
    assert np.array_equal(estimate_frf(read, hold=True).response, estimate_frf(held).response)
    with pytest.raises(DataError, match=r"torque of read was read at the samples, that of .* is held"):
        estimate_frf([held, read])
    assert len(estimate_frf([held, read], hold=True)) == len(estimate_frf(held))


def test_a_period_that_is_not_that_of_the_input_is_refused() -> None:
    wave = np.tile(multisine(1000, H, 4, 200, 5e-3, np.random.default_rng(1), lines=30), 12)
    record = run(wave)
    for right in (0.5, 1.0):
        assert misfit(estimate_frf(record, period=right)).max() < 2e-3
    for wrong in (0.45, 0.75, 0.25):
        with pytest.raises(DataError, match=f"not repeat with a period of {wrong:g} s, but with one of 0.5 s"):
            estimate_frf(record, period=wrong)
    rng = np.random.default_rng(0)  # noise in a measured torque makes no period wrong
    noisy = replace(record, signals={**record.signals, "torque": wave + 3 * wave.std() * rng.standard_normal(12_000)})
    assert len(estimate_frf(noisy, period=0.5)) > 1
    with pytest.raises(DataError, match=r"not repeat with a period of 0\.5 s; leave it out"):
        estimate_frf(run(5e-3 * rng.standard_normal(12_000)), period=0.5)


def test_sigma_is_the_scatter_of_the_estimate() -> None:
    torque = np.tile(multisine(1000, H, 4, 200, 5e-3, np.random.default_rng(1), lines=30), 5)
    truth = estimate_frf(run(torque))
    noisy = [estimate_frf(run(torque, position_noise=1e-4, torque_noise=1e-4, seed=i)) for i in range(40)]
    z = np.array([np.abs(f.response - truth.response) / f.sigma for f in noisy])
    assert np.sqrt(np.median(z**2) / np.log(2)) == pytest.approx(1, abs=0.15)
    assert all(np.all((f.coherence <= 1) & (f.coherence > 0)) for f in noisy)


def test_noise_excitation_is_averaged_in_segments() -> None:
    torque = np.random.default_rng(2).standard_normal(40_000) * 5e-3
    frf = estimate_frf(run(torque, position_noise=1e-5, seed=9), segment=2.5).band(2, 300)
    assert "Hann" in frf.notes[0] and find_period(torque) is None
    z = np.abs(frf.response - closed_form(frf.frequency)) / frf.sigma
    assert np.median(misfit(frf)) < 0.03 and np.median(z) < 1.5
    assert np.median(frf.coherence) > 0.9


def test_realisations_are_pooled_and_distortion_is_told_from_noise() -> None:
    dry = Plant.axis(J) + effects.find("spring")(stiffness=SPRING) + effects.find("coulomb")(coulomb=2e-3)

    def runs(plant: Plant) -> list[Record]:
        waves = [multisine(1000, H, 4, 200, 8e-3, np.random.default_rng(i), lines=30) for i in range(6)]
        return [simulate(plant, np.tile(w, 4), H, position_noise=1e-5, seed=i) for i, w in enumerate(waves)]

    linear, distorted = estimate_frf(runs(AXIS), period=0.5), estimate_frf(runs(dry), period=0.5)
    assert np.median(linear.sigma / linear.sigma_noise) < 1.6
    assert np.median(distorted.sigma / distorted.sigma_noise) > 5


def test_indirect_estimate_has_not_the_bias_of_feedback() -> None:
    rng = np.random.default_rng(3)
    n = 60_000
    reference = rng.standard_normal(n) * 2e-3
    a, b = np.array([[1.0, H], [0.0, 1.0]]), np.array([H**2 / 2, H]) / J
    state, torque, reading = np.zeros(2), np.zeros(n), np.zeros(n)
    for k in range(n):  # double integrator under a PD loop, exact with the hold
        reading[k] = state[0] + 1e-3 * rng.standard_normal()
        torque[k] = reference[k] - 0.5 * reading[k] - 1.5e-3 * state[1]
        state = a @ state + b * torque[k]
    record = Record("loop", H * np.arange(n), {"torque": torque, "position": reading})
    ways: list[dict[str, object]] = [{}, {"method": "indirect", "reference": reference}]
    low = [estimate_frf(record, segment=1.0, **way).band(15, 60) for way in ways]  # type: ignore[arg-type]
    truth = -1 / (J * (2 * np.pi * low[0].frequency) ** 2)
    h1, indirect = (np.median((f.response / truth).real) - 1 for f in low)
    assert abs(indirect) < 0.02 and abs(h1) > 0.05


def test_stepped_sine_holds_the_amplitude() -> None:
    for held, amplitude in (("torque", 1e-3), ("position", 2e-3)):
        frf = stepped_sine(AXIS, np.geomspace(3, 300, 9), amplitude, held=held, **FINE)
        assert len(frf) == 9 and misfit(frf).max() < 2e-3
        reached = frf.excitation if held == "torque" else frf.amplitude
        assert np.allclose(reached, amplitude, rtol=2.1e-3)


@pytest.mark.parametrize("records", [None, 3.0, [None], "set"])
def test_what_is_no_record_is_told(records: object) -> None:
    with pytest.raises(DataError, match=r"records are expected, as those of gms\.load\(\.\.\.\)\.records; \w+ given"):
        estimate_frf(records)  # type: ignore[arg-type]


def test_units_with_one_letter_below_have_no_parentheses() -> None:
    units = {response_unit(i, "position", k) for i in ("torque", "current", "reference") for k in ("hinge", "slide")}
    assert units == {"rad/(N m)", "rad/A", "rad", "m/N", "m/A", "m"}


def test_a_stepped_sine_goes_up_to_a_quarter_of_the_sample_rate() -> None:
    assert "quarter of the sample rate" in (stepped_sine.__doc__ or "") and len(stepped_sine(AXIS, 480.0, 1e-3)) == 1
    with pytest.raises(DataError, match="less than 500 Hz, a quarter of the sample rate"):
        stepped_sine(AXIS, 520.0, 1e-3)


def test_a_stepped_sine_of_a_slide_joint_is_in_its_unit_and_mistakes_are_told() -> None:
    slide = stepped_sine(Plant(J, AXIS.effects, "slide"), 20.0, 1e-3, held="torque")
    assert slide.unit == "m/N" and slide.name == "torque 0.001 N"
    for change, words in (
        ({"sample_time": 0.0}, "sample_time must be positive; 0 given"),
        ({"amplitude": math.nan}, "amplitude must be positive; nan given"),
        ({"periods": 0}, "periods must be 1 or more; 0 given"),
        ({"transient": -1}, "transient must be 0 or more; -1 given"),
        ({"plant": Plant.axis(J) + effects.find("spring")(stiffness=SPRING) + effects.find("gms")(2)}, "no value yet"),
    ):
        with pytest.raises(GmsError, match=words):
            stepped_sine(**{"plant": AXIS, "frequency": [20.0], "amplitude": 1e-3, **change})  # type: ignore[arg-type]


def test_a_motion_on_its_way_through_the_jump_of_a_softening_resonance_is_not_held() -> None:
    """Where no steady motion of that amplitude exists a short run may pass it, and a long one finds none."""
    dry = Plant.axis(J) + effects.GMS(
        stiffness=[1.2, 0.2], fraction=[0.45, 0.55], coulomb=4.5e-3, static=5.4e-3, stribeck_velocity=0.6,
        attraction=0.4,
    )  # fmt: skip
    grid = np.geomspace(11, 40, 6)
    short, long_ = (stepped_sine(dry, grid, 6e-3, transient=n) for n in (2, 60))
    assert np.array_equal(short.frequency, long_.frequency) and 3 <= len(short) < len(grid)
    assert "not held within 0.2 %" in short.notes[-1]
    assert np.allclose(short.response, long_.response, rtol=5e-3)


def test_sines_of_one_amplitude_are_one_response() -> None:
    step = 2 * np.pi * np.arange(4000) * H
    records = [run(a * np.sin(f * step)) for a in (1e-3, 3e-3) for f in (10, 5, 40)]
    points = [estimate_frf(r) for r in records]
    assert all(p.sine and len(p) == 1 for p in points)
    many = estimate_frf(run(np.tile(multisine(1000, H, 4, 200, 5e-3, np.random.default_rng(1)), 4)))
    assert many.sine is False
    joined = join_sines([*points, many])
    assert [len(f) for f in joined] == [len(many), 3, 3] and misfit(joined[1]).max() < 2e-3
    assert np.allclose(joined[2].excitation, 3e-3, rtol=1e-3)


def test_a_drift_of_the_position_leaks_into_no_line() -> None:
    torque = np.tile(multisine(1000, H, 4, 200, 5e-3, np.random.default_rng(4), lines=30), 5)
    still = run(torque)
    position = still.position + 0.3 * still.time
    moved = Record("drift", still.time, {"torque": still.torque, "position": position})
    assert np.allclose(estimate_frf(moved).response, estimate_frf(still).response, rtol=1e-6)


@pytest.mark.parametrize("n", [40, 333, 1000])
def test_the_period_is_found(n: int) -> None:
    wave = multisine(n, H, 1, 400, 1.0, np.random.default_rng(n), lines=6)
    noisy = np.tile(wave, 5) + 1e-3 * np.random.default_rng(0).standard_normal(5 * n)
    assert find_period(noisy) == n and find_period(noisy[: n + n // 2]) is None
    assert find_period(np.ones(100)) is None


@pytest.mark.parametrize(("frequency", "n"), [(28.0, 500), (60.0, 100), (40.0, 50), (13.3, 1053)])
def test_of_a_sine_several_periods_make_whole_samples(frequency: float, n: int) -> None:
    sine = np.sin(2 * np.pi * frequency * np.arange(4000) * H)
    found = find_period(sine + 0.04 * np.random.default_rng(0).standard_normal(4000))
    assert found is not None
    cycles = frequency * found * H
    assert found == n or abs(cycles - round(cycles)) < 0.01 * round(cycles) / 5


def test_responses_to_velocity_and_acceleration_become_compliances() -> None:
    f = np.array([1.0, 10.0])
    for power, output in enumerate(("position", "velocity", "acceleration")):
        frf = FRF("a", f, closed_form(f) * (2j * np.pi * f) ** power, output=output, excitation=np.array([1.0, 2.0]))
        found = frf.compliance()
        assert np.allclose(found.response, closed_form(f)) and found.unit == "rad/(N m)"
        assert np.allclose(found.amplitude, np.abs(closed_form(f)) * [1, 2])
    with pytest.raises(DataError, match="torque to position is needed"):
        FRF("a", f, closed_form(f), input="voltage").compliance()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequency": [0.0, 1.0]}, "must be positive and rise"),
        ({"frequency": [2.0, 1.0]}, "must be positive and rise"),
        ({"response": [1.0, np.nan]}, "not a finite number at 2 Hz"),
        ({"response": [1.0]}, "response has shape"),
        ({"response": [1.0, 0.0]}, "0 at 2 Hz"),
        ({"input": "effort"}, "input must be one of .*torque"),
        ({"use": "test"}, "use must be one of"),
        ({"sigma": [1.0]}, "sigma has shape"),
        ({"frequency": 1.0, "response": 1.0}, "frequency must be a row of numbers; 0 dimensions given"),
        ({"frequency": ["a", "b"]}, r"frequency must be numbers; \['a', 'b'\] given"),
        ({"excitation": "a"}, "excitation must be numbers"),
        ({"excitation": 1j}, "excitation must be numbers"),
        ({"excitation": 0.0}, "excitation must be positive; 0 given"),
        ({"excitation": -1e-3}, "excitation must be positive; -0.001 given"),
        ({"sigma": -1.0}, "sigma must be 0 or more; -1 given"),
        ({"coherence": 2.0}, "coherence must be from 0 to 1; 2 given"),
        ({"unit": "deg/(N m)"}, r"given in SI, rad/\(N m\) or of a slide joint m/N; 'deg/\(N m\)' given"),
    ],
)
def test_a_response_that_cannot_be_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(DataError, match=words):
        FRF(**{"name": "a", "frequency": [1.0, 2.0], "response": [1.0, 1.0], **change})  # type: ignore[arg-type]


def test_the_unit_of_a_response_says_the_kind_of_its_joint() -> None:
    f = np.array([1.0, 2.0])
    for unit, output, kind, spelled in (
        ("", "position", "hinge", "rad/(N m)"), ("rad/Nm", "position", "hinge", "rad/(N m)"),
        ("m/(N)", "position", "slide", "m/N"), ("m/s^2/N", "acceleration", "slide", "m/s^2/N"),
    ):  # fmt: skip
        frf = FRF("a", f, [1.0, 0.5], output=output, unit=unit)
        assert (frf.kind, frf.unit) == (kind, spelled) and frf.compliance().kind == kind
    hinge, slide = FRF("h", f, [1.0, 0.5], excitation=1.0), FRF("s", f, [1.0, 0.5], excitation=1.0, unit="m/N")
    for given, plant in ((slide, AXIS), (hinge, Plant(J, AXIS.effects, "slide"))):
        for verb in (lambda p, d: fit(p, d), compare):
            with pytest.raises(DataError, match=f"of a {given.kind} joint, where a {plant.kind} joint is asked for"):
                verb(plant, [given])
        with pytest.raises(DataError, match=f"of a {given.kind} joint"):
            identify_dahl([given], kind=plant.kind)


def test_mistakes_of_the_estimate_are_told() -> None:
    record = run(np.tile(multisine(200, H, 5, 300, 5e-3, np.random.default_rng(0)), 4))
    for change, words in (
        ({"method": "h2"}, "method must be one of h1, indirect"),
        ({"method": "indirect"}, "needs the reference"),
        ({"output": "velocity"}, "no signal 'velocity'"),
        ({"period": 0.1003}, "not a whole number of samples"),
        ({"period": 0.4}, "periods of 800 are needed"),
        ({"segment": 1.0}, "a segment of 2000 samples"),
        ({"kind": "x"}, "kind must be one of hinge, slide"),
        ({"segment": math.nan}, "segment must be a positive time .*; nan given"),
        ({"period": math.nan}, "period must be a positive time .*; nan given"),
        ({"transient": 1.5}, "transient must be a number of whole periods, 0 or more; 1.5 given"),
        ({"transient": -1}, "transient must be .*; -1 given"),
        ({"reference": np.ones(3)}, "reference has shape"),
    ):
        with pytest.raises(DataError, match=words):
            estimate_frf(record, **change)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="no records"):
        estimate_frf([])


def test_table_of_responses_has_a_row_per_point() -> None:
    f = np.array([1.0, 10.0])
    text = to_csv([FRF("a", f, closed_form(f)), FRF("b", f, closed_form(f))]).splitlines()
    assert text[0].startswith("# 1: a: position over torque [rad/(N m)]") and len(text) == 2 + 1 + 4
    assert text[2] == "response,frequency [Hz],magnitude [abs],phase [rad]"
