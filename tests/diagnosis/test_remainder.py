"""What is left over: where it stands is said in words that fit the residual."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, SAMPLE_TIME, J, runs

from gms_mujoco import effects
from gms_mujoco.diagnosis.remainder import describe, loudest
from gms_mujoco.identification.frf_observation import Seen
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record


def _left(plant: Plant, records: list[Record]) -> tuple[list[Seen], list[np.ndarray]]:
    """The records as they are seen, and what the plant leaves of each."""
    misfit = Misfit(plant, observe(records, plant.inertia, 100.0))
    return list(misfit.observations), np.split(misfit.residual(misfit.vector(plant)), misfit.splits)


def _of(plant: Plant, records: list[Record]) -> str:
    return describe(plant, *_left(plant, records)).said


def _with(records: list[Record], torque: np.ndarray, which: tuple[int, ...] = (0, 1, 2)) -> list[Record]:
    """The records with something on the torque that nobody knows of."""
    return [
        replace(r, signals={**r.signals, "torque": r.torque + torque}) if i in which else r
        for i, r in enumerate(records)
    ]


def _velocity(r: Record) -> np.ndarray:
    return Observation(r, 100.0).velocity


T = SAMPLE_TIME * np.arange(3000)


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return runs(HEALTHY)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_the_loudest_record_is_the_one_that_something_was_put_into(records: list[Record], which: int) -> None:
    hum = _with(records, 0.1 * LEVEL * np.sin(2 * np.pi * 12 * T), (which,))
    assert loudest(*_left(HEALTHY, hum)) == records[which].name


@pytest.mark.parametrize("frequency", [3.0, 12.0, 47.0])
def test_a_line_in_time_is_said_with_its_frequency(records: list[Record], frequency: float) -> None:
    said = _of(HEALTHY, _with(records, 0.1 * LEVEL * np.sin(2 * np.pi * frequency * T)))
    found = float(said.split("periodic in time at ")[1].split(" Hz")[0])
    assert found == pytest.approx(frequency, abs=0.5)
    assert "instant" not in said and "revolution" not in said


@pytest.mark.parametrize("follows", [True, False])
def test_what_follows_another_joint_of_a_robot_is_said_with_its_name(records: list[Record], follows: bool) -> None:
    moved = 0.8 * np.sin(2 * np.pi * 0.7 * T) + 0.5 * np.sin(2 * np.pi * 1.9 * T + 1)
    pulled = _with(records, 0.2 * LEVEL * (moved if follows else np.sin(2 * np.pi * 12 * T)))
    said = _of(HEALTHY, [replace(r, others={"shoulder": moved, "wrist": np.cos(5 * T)}) for r in pulled])
    assert ("tied to the position of shoulder" in said) == follows and "wrist" not in said


def test_one_instant_is_said_with_its_time_and_record(records: list[Record]) -> None:
    hit = np.where(np.abs(T - 1.7) < 0.003, 2 * LEVEL, 0.0)
    said = _of(HEALTHY, _with(records, hit, which=(1,)))
    assert "at one instant, 1.7 s in fit_1" in said and "of its square in fit_1;" in said
    assert "periodic" not in said


def test_few_instants_are_said_with_their_times_and_records(records: list[Record]) -> None:
    hits = sum(np.where(np.abs(T - t) < 0.006, LEVEL, 0.0) for t in (0.4, 1.7, 2.6))
    said = _of(HEALTHY, _with(records, hits))
    assert "at few instants (" in said and "periodic" not in said
    for record in records:
        times = said.split(f" s in {record.name}")[0].split(": ")[-1].split(" s in ")[-1].split(", ")[-3:]
        assert [float(t) for t in times] == pytest.approx([0.4, 1.7, 2.6], abs=0.01)
    assert "instant" not in _of(HEALTHY, _with(records, 0.1 * LEVEL * np.random.default_rng(2).normal(size=len(T))))


def test_what_comes_seldom_is_tied_to_nothing_else(records: list[Record]) -> None:
    """At one instant the axis has one place, one speed, and one mean from there on."""
    hit = np.where(np.abs(T - 1.7) < 0.006, LEVEL, 0.0)
    said = _of(HEALTHY, _with(records, hit, which=(1,)))
    assert "instant" in said
    assert not any(other in said for other in ("tied to", "wanders", "a jump", "in waves", "another in each record"))


def test_a_line_in_friction_is_no_line_of_the_torque(records: list[Record]) -> None:
    """Each reversal turns it over: in the torque it stands at frequencies that nothing has."""
    pulse = 0.3 * LEVEL * np.sin(2 * np.pi * 6 * T)
    told = [replace(r, signals={**r.signals, "torque": r.torque + pulse * np.sign(_velocity(r))}) for r in records]
    said = _of(HEALTHY, told).split("periodic in time as a factor on friction at ")[1]
    assert float(said.split(" Hz")[0]) == pytest.approx(6, abs=0.3)


@pytest.mark.parametrize("harmonic", [2, 3])
def test_what_a_motion_does_itself_is_no_line(harmonic: int) -> None:
    """An axis that swings at 2 Hz leaves twice and three times that, where it is misread."""
    swing = np.sin(2 * np.pi * 2 * T)
    r = Record("swing", T, {"position": swing, "torque": LEVEL * np.sin(2 * np.pi * 2 * harmonic * T + 0.3)})
    o = Observation(r, 100.0)
    assert "periodic in time" not in describe(Plant.axis(J), [o], [o.applied(Plant.axis(J))]).said


@pytest.mark.parametrize("frequency", [0.4, 3.0])
def test_what_is_slower_than_four_periods_is_no_line(records: list[Record], frequency: float) -> None:
    """Its foot reaches to where one is looked for."""
    slow = 0.3 * LEVEL * np.sin(2 * np.pi * frequency * T + 0.7)
    assert ("periodic in time" in _of(HEALTHY, _with(records, slow))) == (frequency * T[-1] > 4)


def test_a_torque_that_the_axis_does_not_follow_is_said_and_no_delay_is(records: list[Record]) -> None:
    """A log that is slower than its controller shows every tenth of the torques by which that answers its encoder."""
    hiss = 2 * LEVEL * np.random.default_rng(0).standard_normal(len(T))
    assert "of what the torque reads" in _of(HEALTHY, _with(records, hiss))
    late = runs(HEALTHY + effects.Delay(time=2 * SAMPLE_TIME))
    assert "of what the torque reads" not in _of(HEALTHY, late)


def test_a_place_on_the_revolution_is_said(records: list[Record]) -> None:
    cogging = effects.Cogging(harmonics=[2], amplitude=[0.2 * LEVEL], phase=[0.4])
    said = _of(HEALTHY, runs(HEALTHY + cogging))
    assert "tied to the place on the revolution" in said
    assert "periodic in time" not in said and "instant" not in said


@pytest.mark.parametrize("kind, said", [("hinge", "0.299 rad, 21 to a revolution"), ("slide", "0.299 m")])
def test_waves_over_the_place_are_said_with_their_length(kind: str, said: str) -> None:
    records = runs(HEALTHY)
    waves = [0.1 * LEVEL * np.sin(21 * r.position) for r in records]
    plant = replace(HEALTHY, kind=kind)
    there = [_with([r], w, (0,))[0] for r, w in zip(records, waves, strict=True)]
    found = _of(plant, there)
    assert f"in waves over the place, one every {said}" in found
    assert kind == "hinge" or "revolution" not in found
    assert "a second record" not in found
    assert any("a second record to fit" in _of(plant, [r]) for r in there) == (kind == "slide")


def test_what_hangs_on_the_place_as_a_factor_is_said_with_what_it_multiplies(records: list[Record]) -> None:
    """A torque constant that ripples with seven poles, and a greased zone of the revolution."""
    ripple = [_with([r], 0.2 * r.torque * np.sin(7 * r.position), (0,))[0] for r in records]
    said = _of(HEALTHY, ripple).split("in waves over the place as a factor on the torque, one every ")[1]
    assert float(said.split(" rad, ")[1].split(" to a revolution")[0]) == pytest.approx(7, rel=0.05)
    speeds = [np.gradient(r.position, SAMPLE_TIME) for r in records]
    zones = [0.03 * LEVEL * v * (np.sin(r.position) > 0.8) for r, v in zip(records, speeds, strict=True)]
    there = [_with([r], drag, (0,))[0] for r, drag in zip(records, zones, strict=True)]
    assert "tied to the place on the revolution as a factor on the velocity" in _of(HEALTHY, there)


def test_a_part_of_the_range_is_said_with_its_ends(records: list[Record]) -> None:
    """A soft stop beyond the last tenth of the place."""
    at = float(np.quantile(np.concatenate([r.position for r in records]), 0.9))
    stops = [LEVEL * np.maximum(r.position - at, 0.0) for r in records]
    said = _of(replace(HEALTHY, kind="slide"), [_with([r], x, (0,))[0] for r, x in zip(records, stops, strict=True)])
    begin, end = said.split("most of it from ")[1].split(" m)")[0].split(" to ")
    assert at < float(begin) < float(end) == pytest.approx(max(r.position.max() for r in records), rel=0.01)


@pytest.mark.parametrize("share", [0.8, 0.9])
def test_a_stop_is_no_wave(records: list[Record], share: float) -> None:
    """It stands at places from one on, where waves as long would stand all over."""
    at = float(np.quantile(np.concatenate([r.position for r in records[:2]]), share))
    stops = [_with([r], 20 * LEVEL * np.maximum(r.position - at, 0.0), (0,))[0] for r in records[:2]]
    said = _of(HEALTHY, stops)
    assert "tied to the place" in said and "most of it from" in said and "waves" not in said


def test_velocity_is_said() -> None:
    said = _of(HEALTHY, runs(HEALTHY + effects.QuadraticDrag(coefficient=LEVEL / 30**2)))
    assert "tied to velocity" in said and "instant" not in said


def test_one_record_is_said(records: list[Record]) -> None:
    noise = np.random.default_rng(0).normal(0, 0.1 * LEVEL, len(T))
    one, all_ = (_of(HEALTHY, _with(records, noise, which)) for which in ((2,), (0, 1, 2)))
    assert "of its square in fit_2" in one and "of its square in" not in all_


def test_standstill_and_reversals_are_said() -> None:
    said = _of(HEALTHY.replace(HEALTHY["gms"].replace(static=3 * LEVEL, stribeck_velocity=0.02)), runs(HEALTHY))
    assert "standstill" in said


@pytest.mark.parametrize("sign, said", [(1, "while moving forward"), (-1, "while moving backward")])
def test_one_direction_is_said(records: list[Record], sign: int, said: str) -> None:
    def dragged(r: Record) -> Record:
        moving = sign * np.gradient(r.position) > 0
        noise = np.random.default_rng(1).normal(0, 0.3 * LEVEL, len(moving))
        return replace(r, signals={**r.signals, "torque": r.torque + noise * moving})

    text = _of(HEALTHY, [dragged(r) for r in records])
    assert said in text and text.count("while moving") == 1


def test_a_jump_is_said_with_its_time_and_record(records: list[Record]) -> None:
    said = _of(HEALTHY, _with(records, np.where(T > 1.1, 0.3 * LEVEL, 0.0), which=(1,)))
    at = float(said.split("a jump at ")[1].split(" s in fit_1")[0])
    assert at == pytest.approx(1.1, abs=0.02)


def test_what_is_another_in_one_record_is_said_with_how_much(records: list[Record]) -> None:
    """A payload, a temperature and a sensor's zero that nobody wrote down."""
    loaded = [*runs(replace(HEALTHY, inertia=1.3 * J))[:1], *records[1:]]
    assert "as by an inertia that is another in each record" in (said := _of(HEALTHY, loaded))
    assert said.split(" %, ")[1].split(" in fit_0")[0] in ("+29 %", "+30 %", "+31 %")
    gms = HEALTHY["gms"]
    stronger = HEALTHY.replace(gms.replace(coulomb=1.2 * gms.values["coulomb"], static=1.2 * gms.values["static"]))
    said = _of(HEALTHY, [*records[:2], *runs(stronger)[2:]])
    assert "as by friction that is another in each record" in said and said.endswith(" in fit_2)")
    said = _of(HEALTHY, _with(records, np.full(len(T), 0.2 * LEVEL), which=(1,)))
    assert f"an offset of the torque that is another in each record (100 %, {0.2 * LEVEL:+.2g} N m in fit_1)" in said
    assert "another in each record" not in _of(HEALTHY, _with(records, np.full(len(T), 0.2 * LEVEL)))


def test_an_offset_that_wanders_is_said(records: list[Record]) -> None:
    said = _of(HEALTHY, _with(records, 0.2 * LEVEL * np.sin(2 * np.pi * T / T[-1])))
    assert "as by an offset of the torque that wanders in the course of a record" in said
    assert "wanders" not in _of(HEALTHY, _with(records, np.full(len(T), 0.2 * LEVEL), which=(1,)))


@pytest.mark.parametrize("later, said", [(True, "growing with time"), (False, "fading with time")])
def test_growth_with_time_is_said(records: list[Record], later: bool, said: str) -> None:
    size = T / T[-1] if later else 1 - T / T[-1]
    noise = np.random.default_rng(2).normal(0, 0.3 * LEVEL, len(T))
    assert said in _of(HEALTHY, _with(records, noise * size**2))


def test_what_lies_below_the_encoder_is_said(records: list[Record]) -> None:
    """The axis stands still and the torque swings: no motion says what holds it."""
    still = replace(records[0], signals={**records[0].signals, "position": np.full(len(T), records[0].position[0])})
    assert "less than its encoder resolves" in _of(HEALTHY, [still])


def test_white_noise_is_nothing_in_particular(records: list[Record]) -> None:
    noise = np.random.default_rng(0).normal(0, 0.1 * LEVEL, len(T))
    assert _of(HEALTHY, _with(records, noise)) == ""


def test_nothing_is_nothing(records: list[Record]) -> None:
    still = [replace(r, signals={"torque": 0 * r.torque, "position": 0 * r.position}) for r in records]
    assert _of(Plant.axis(1.0), still) == ""


def test_what_fades_as_the_torque_does_is_not_said_to(records: list[Record]) -> None:
    """A chirp that is driven less and less leaves less and less of what hangs on its torque."""
    fading = np.exp(-3 * T / T[-1])
    noise = np.random.default_rng(0).normal(0, 0.1 * LEVEL, len(T))
    assert "fading with time" in _of(HEALTHY, _with(records, fading * noise))
    driven = [replace(r, signals={**r.signals, "torque": fading * r.torque}) for r in records]
    assert "fading with time" not in _of(HEALTHY, driven)


@pytest.mark.parametrize(
    ("torque", "subject"),
    [
        (lambda r, k: 0.2 * LEVEL * np.sin(2 * np.pi * 12 * T), "what is periodic in time"),
        (lambda r, k: 0.3 * LEVEL * np.sin(38 * T) * np.sign(_velocity(r)), "what is periodic in time and turns"),
        (lambda r, k: 0.2 * LEVEL * np.sin(20 * r.position), "what is tied to the place"),
        (lambda r, k: 0.5 * LEVEL * (T > 1.6) * (k == 1), "what jumps"),
        (lambda r, k: 0.1 * np.where(np.abs(r.torque) < LEVEL, r.torque, 0.0), "what is tied to the torque"),
        (lambda r, k: np.full(len(T), 0.2 * LEVEL), "what is the same everywhere"),
    ],
)
def test_what_it_looks_like_says_what_to_measure(
    records: list[Record], torque: Callable[[Record, int], np.ndarray], subject: str
) -> None:
    told = [replace(r, signals={**r.signals, "torque": r.torque + torque(r, k)}) for k, r in enumerate(records)]
    left = describe(HEALTHY, *_left(HEALTHY, told))
    assert left.experiment.startswith(subject) and left.share > 0.25
