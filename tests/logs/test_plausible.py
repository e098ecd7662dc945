"""Logs in odd shapes: what is harmless is put right and said, what cannot be right is refused or pointed out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gms_mujoco import effects, formats
from gms_mujoco.compare import compare
from gms_mujoco.dataset import Dataset, load
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.logs.plausible import filled
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

INERTIA = 0.02
PLANT = Plant.axis(INERTIA) + effects.find("coulomb")(coulomb=0.4) + effects.find("viscous")(coefficient=0.02)


def measured(plant: Plant = PLANT, rms: float = 1.0, high: float = 20.0) -> Record:
    command = multisine(3000, 1e-3, 0.3, high, rms, np.random.default_rng(1))
    return simulate(plant, command, 1e-3, resolution=2 * np.pi / 2**18, torque_noise=5e-3, seed=1)


RUN = measured()


def logged(folder: Path, axis: str = "", entry: str = "", run: Record = RUN, **change: Callable) -> Dataset:
    """The set of one record, some of whose columns are changed."""
    columns = {"time": run.time, "torque": run.torque, "position": run.position}
    columns |= {k: f(columns[k]) for k, f in change.items()}
    formats.write(folder / "run.csv", columns)
    text = f'[axis]\n{axis}\n[[record]]\nfile = "run.csv"\nuse = "fit"\n{entry}'
    (folder / "dataset.toml").write_text(text)
    return load(folder)


def test_a_healthy_log_raises_no_doubt(tmp_path: Path) -> None:
    assert logged(tmp_path, f"inertia = {INERTIA}").notes == ()
    assert logged(tmp_path).notes == ()


@pytest.mark.parametrize("axis", ["", f"inertia = {INERTIA}"])
@pytest.mark.parametrize("wrong", ["torque", "position"])
def test_a_wrong_sign_is_refused(axis: str, wrong: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"torque or position has the wrong sign, try scale = \{ torque = -1 \}"):
        logged(tmp_path, axis, **{wrong: np.negative})
    assert logged(tmp_path, axis, "scale = { torque = -1 }\n", torque=np.negative).notes == ()


@pytest.mark.parametrize("seed", range(4))
def test_what_a_passive_joint_does_is_no_wrong_sign(seed: int, tmp_path: Path) -> None:
    """Weight, spring and load behind a coupling give torque back for a while; slow motion hides the inertia."""
    hidden = (
        effects.find("gravity")(amplitude=2.0, phase=1.0), effects.find("spring")(stiffness=6.0),
        effects.find("flexible_coupling")(inertia=0.014, frequency=8.0),
        effects.find("delay")(time=2e-3),
    )[seed]  # fmt: skip
    logged(tmp_path, run=measured(PLANT + hidden))
    logged(tmp_path, run=measured(PLANT + hidden, high=2.0))


def test_degrees_taken_for_radians_show_in_a_known_inertia(tmp_path: Path) -> None:
    (note,) = logged(tmp_path, f"inertia = {INERTIA}", position=np.degrees).notes
    assert "0.02 kg m^2 is given" in note and "deg read as rad" in note


def test_rows_without_numbers_are_left_out_at_the_ends_only(tmp_path: Path) -> None:
    def cut(at: slice) -> Callable:
        def change(q: np.ndarray) -> np.ndarray:
            q = q.copy()
            q[at] = np.nan
            return q

        return change

    runs = logged(tmp_path, position=cut(slice(-9, None)))
    assert len(runs.fit[0]) == len(RUN) - 9 and "9 at the end are not all numbers" in runs.notes[0]
    for at in (slice(1000, 1002), slice(-900, None)):
        with pytest.raises(DataError, match="position is nan"):
            logged(tmp_path, position=cut(at))


def test_a_position_that_wraps_is_unwrapped(tmp_path: Path) -> None:
    turning = measured(PLANT + effects.find("torque_offset")(torque=0.7))
    assert np.ptp(turning.position) > 4 * np.pi, "several turns"
    runs = logged(tmp_path, run=turning, position=lambda q: np.mod(q, 2 * np.pi))
    assert np.allclose(np.diff(runs.fit[0].position), np.diff(turning.position), atol=1e-9)
    assert "unwrapped" in runs.notes[0]
    with pytest.raises(DataError, match=r"line 703: position leaps from .* rad in one sample, as no joint does"):
        logged(tmp_path, run=turning, position=lambda q: q + 5.0 * (np.arange(len(q)) > 700))
    degrees = {"run": turning, "position": lambda q: np.degrees(np.mod(q, 2 * np.pi))}
    with pytest.raises(DataError, match=r'jumps by 360 rad .* degrees do: say units = { position = "deg'):
        logged(tmp_path, **degrees)
    said = logged(tmp_path, entry='units = { position = "deg" }\n', **degrees)
    assert np.allclose(np.diff(said.fit[0].position), np.diff(turning.position), atol=1e-9)


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_a_counter_that_runs_over_is_unwrapped(kind: str, tmp_path: Path) -> None:
    count = 2 * np.pi / 2**18
    axis, entry = f'kind = "{kind}"\nencoder_resolution = {count!r}', 'units = { position = "counts" }\n'
    position = {"position": lambda q: np.mod(np.round(q / count), 2**12)}
    runs = logged(tmp_path, axis, entry, **position)
    assert np.allclose(np.diff(runs.fit[0].position), np.diff(RUN.position), atol=1e-9)
    assert "as a counter of 12 bits does" in " ".join(runs.notes)


def misread(value: float, *rows: int) -> Callable:
    """Positions of which some rows read another."""
    return lambda q: np.where(np.isin(np.arange(len(q)), rows), value, q)


@pytest.mark.parametrize("wrong", [-9999.0, 30.0])
@pytest.mark.parametrize("samples", [4, 40])
def test_a_reading_that_failed_is_refused_with_its_line(wrong: float, samples: int, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 702: position leaps"):
        logged(tmp_path, position=misread(wrong, *range(700, 700 + samples)))


@pytest.mark.parametrize("axis", ["", f"inertia = {INERTIA}"])
@pytest.mark.parametrize("wrong", [-9999.0, 30.0, 0.5])
@pytest.mark.parametrize("samples", [1, 3])
def test_a_position_that_leaps_and_comes_back_is_filled_in(
    axis: str, wrong: float, samples: int, tmp_path: Path
) -> None:
    rows = [k + i for k in (300, 700, 2500) for i in range(samples)]
    off = np.abs(RUN.position[rows] - wrong)
    runs = logged(tmp_path, axis, position=misread(wrong, *rows))
    assert f"the position leaps and comes back in {len(rows)} rows, first at 0.3 s" in " ".join(runs.notes)
    assert np.abs(runs.fit[0].position - RUN.position).max() < 1e-3 * off.max()


def test_a_position_that_leaps_and_comes_back_is_refused_where_nothing_says_what_that_takes(tmp_path: Path) -> None:
    still = replace(RUN, signals={**RUN.signals, "torque": np.full(len(RUN), 0.1)})
    with pytest.raises(DataError, match=r"leaps from -0.200616 to 30 and back at 0.7 s, as no"):
        logged(tmp_path, run=still, position=misread(30.0, 700))


def test_an_axis_that_is_hit_or_moves_as_the_torque_may_move_it_does_not_leap(tmp_path: Path) -> None:
    """Against a stop it turns round within a sample; and to and fro in two rows of a slow log."""
    bounces = np.round(np.abs(np.arange(len(RUN)) - 1500.2) * 2e-3, 6)
    slow = RUN.time * 20
    taps = 5e-3 * slow + np.where(np.arange(len(RUN)) % 300 == 150, 0.003, 0.0)
    for change in ({"position": lambda _: bounces}, {"position": lambda _: taps, "time": lambda _: slow}):
        assert not [n for n in logged(tmp_path, f"inertia = {INERTIA}", **change).notes if "leaps" in n]


def test_a_quick_move_is_no_leap(tmp_path: Path) -> None:
    """A second at rest, a move of a radian in the time of four samples, and rest again."""
    move = np.interp(np.arange(len(RUN)), [1000, 1004], [0.0, 1.0])
    assert len(logged(tmp_path, position=lambda q: np.round(move, 6)).fit) == 1


@pytest.mark.parametrize("counts", [2**8, 2**12, 2**16])
def test_a_slow_move_behind_a_coarse_encoder_is_no_leap(counts: int, tmp_path: Path) -> None:
    """It rests for hundreds of samples and then steps by a count, of which nobody says how large it is."""
    count, steps = 2 * np.pi / counts, len(RUN) // 300
    creep = np.linspace(0, steps * count, len(RUN))
    assert len(logged(tmp_path, position=lambda q: np.round(creep / count) * count).fit) == 1


def test_positions_in_counts_that_nobody_called_counts_are_refused(tmp_path: Path) -> None:
    counts = {"position": lambda q: np.round(q * 2**18 / (2 * np.pi))}
    with pytest.raises(DataError, match=r'whole numbers only, .* say units = { position = "counts" }'):
        logged(tmp_path, **counts)
    said = logged(tmp_path, f"encoder_counts_per_rev = {2**18}", 'units = { position = "counts" }\n', **counts)
    assert np.allclose(said.fit[0].position, RUN.position, atol=2e-5)


def test_a_torque_that_never_changes_and_an_axis_that_hardly_moves_are_doubted(tmp_path: Path) -> None:
    same = logged(tmp_path, torque=lambda u: np.full_like(u, 0.1))
    assert "the torque is 0.1 throughout; is it the right column?" in " ".join(same.notes)
    still = logged(tmp_path, position=lambda q: 1e-3 * (np.arange(len(q)) % 7 == 0))
    assert "changes by less than 4 counts of the encoder in all" in " ".join(still.notes)


def test_a_velocity_in_another_unit_than_the_position_is_doubted(tmp_path: Path) -> None:
    slope = np.gradient(RUN.position, RUN.sample_time)
    for factor, doubt in (
        (1.0, ""), (0.9, ""), (30 / np.pi, 'units = { velocity = "rpm" }'), (180 / np.pi, 'velocity = "deg/s"'),
        (np.pi / 180, 'units = { position = "deg" }'), (-1.0, "one of them counts the other way"),
        (10.0, "a gear of 10 to 1"), (-0.02, "a gear of 50 to 1, or in another unit? And one of them counts"),
    ):  # fmt: skip
        columns = {"time": RUN.time, "torque": RUN.torque, "position": RUN.position, "velocity": factor * slope}
        formats.write(tmp_path / "run.csv", columns)
        (tmp_path / "dataset.toml").write_text('[axis]\n[[record]]\nfile = "run.csv"\nuse = "fit"\n')
        notes = " ".join(load(tmp_path).notes)
        assert doubt in notes and ("times the slope" in notes) is bool(doubt)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1 / 86400, "d")])
def test_a_clock_that_no_log_has_is_refused_with_the_unit_that_it_may_have(
    factor: float, unit: str, tmp_path: Path
) -> None:
    said = rf'if its time is in {unit} \(1000 rows a second\).*, say units = {{ time = "{unit}" }}, or '
    with pytest.raises(DataError, match=said):
        logged(tmp_path, time=lambda t: factor * t)
    right = logged(tmp_path, entry=f'units = {{ time = "{unit}" }}\n', time=lambda t: factor * t)
    assert not right.notes and np.allclose(right.fit[0].time, RUN.time)
    insisted = logged(tmp_path, entry='units = { time = "s" }\n', time=lambda t: factor * t)
    assert "s apart" in insisted.notes[0]


def test_few_samples_are_called_few(tmp_path: Path) -> None:
    short = RUN.slice(0, 120)
    assert "only 120 samples to fit" in " ".join(logged(tmp_path, run=short).notes)


def test_more_inertia_behind_a_coupling_than_there_is_is_refused() -> None:
    too_much = PLANT + effects.find("flexible_coupling")(inertia=0.03, frequency=8.0)
    with pytest.raises(ModelError, match="flexible_coupling must have less inertia than the axis"):
        compare(too_much, [RUN])


def held(run: Record, starts: range, samples: int) -> tuple[Record, np.ndarray]:
    """The run with its encoder holding its reading now and then, and (n,) where."""
    position, where = run.position.copy(), np.zeros(len(run), bool)
    for start in starts:
        position[start : start + samples] = position[start - 1]
        where[start : start + samples] = True
    return replace(run, signals={**run.signals, "position": position}), where


@pytest.mark.parametrize("samples", [2, 9])
def test_readings_that_were_held_while_the_axis_moves_are_put_where_it_was(samples: int) -> None:
    broken, where = held(RUN, range(200, 2800, 170), samples)
    mended, n = filled(broken)
    off, left = (np.abs(r.position - RUN.position) for r in (broken, mended))
    assert n > 0 and not np.any(left[~where])  # what was read is kept
    assert left[where].max() < 0.15 * off[where].max()


def test_readings_that_were_held_while_the_axis_sets_out_or_stops_are_put_where_it_was_too() -> None:
    leaps, left = 0, 0
    for start in range(60, 2900, 7):
        broken = held(RUN, range(start, start + 1), 12)[0]
        here = slice(start - 20, start + 32)
        usual, leap = np.abs(np.diff(RUN.position[here])).max(), np.abs(np.diff(broken.position[here])).max()
        if leap > 4 * usual:  # no axis does that
            leaps += 1
            left += filled(broken)[1] == 0
    assert leaps > 100 and left < 0.03 * leaps


def test_two_holds_with_one_reading_between_them_are_one() -> None:
    broken, where = held(RUN, range(800, 826, 13), 12)
    mended, n = filled(broken)
    off, left = (np.abs(r.position - RUN.position)[where] for r in (broken, mended))
    assert n == 25 and left.max() < 0.02 * off.max()


def test_an_axis_that_rests_or_an_encoder_that_is_slow_is_left_alone(tmp_path: Path) -> None:
    slow, _ = held(RUN, range(4, 2996, 4), 3)
    sticking = measured(PLANT.replace(effects.find("coulomb")(coulomb=2.0)), rms=2.0)  # moves now and then
    assert np.mean(np.diff(sticking.position) == 0) > 0.1
    for run in (RUN, sticking, slow):
        assert filled(run) == (run, 0)


def test_readings_that_were_held_are_told(tmp_path: Path) -> None:
    broken, _ = held(RUN, range(200, 2800, 170), 9)
    note = next(n for n in logged(tmp_path, run=broken).notes if "repeats its last reading" in n)
    assert "filled in" in note


@pytest.mark.parametrize("wrong", [1e2, 1e4, 1e20])
def test_a_torque_that_was_read_wrong_says_nothing_of_the_inertia(wrong: float, tmp_path: Path) -> None:
    """By which the answer of the axis is judged where none is given."""
    runs = logged(tmp_path, torque=lambda u: np.where(np.arange(len(u)) == 601, wrong, u))
    assert "leaps and comes back in 1 rows" in " ".join(runs.notes) and np.abs(runs.fit[0].torque).max() < wrong / 10


@pytest.mark.parametrize("axis", ["", f"inertia = {INERTIA}"])
@pytest.mark.parametrize("wrong", [-30.0, 30.0])
def test_a_torque_that_the_axis_does_not_answer_was_read_wrong(axis: str, wrong: float, tmp_path: Path) -> None:
    """A frame that was lost; one that did act moves the axis on at another speed."""
    clean = logged(tmp_path, axis)
    at = [i for i in range(300, 2800, 500) if abs(RUN.torque[i]) > 0.5] + [601]

    def broken(u: np.ndarray) -> np.ndarray:
        return np.where(np.isin(np.arange(len(u)), at), wrong, u)

    runs = logged(tmp_path, axis, torque=broken)
    assert any(f"leaps and comes back in {len(at)} rows" in n and "failed, filled in" in n for n in runs.notes)
    assert np.abs(runs.fit[0].torque - clean.fit[0].torque).max() < 1.5
    for late in ((), (effects.CurrentLoopLag(time=3e-3),), (effects.Delay(time=4e-3),)):  # as a drive may be
        follows = replace(PLANT, effects=(*PLANT.effects, *late))
        acted = simulate(follows, broken(RUN.torque), 1e-3, resolution=2 * np.pi / 2**18, seed=1)
        assert not [n for n in logged(tmp_path, axis, run=acted).notes if "leaps" in n]


def test_a_torque_that_does_not_come_back_within_a_few_rows_is_left_as_it_is(tmp_path: Path) -> None:
    """A kink of what is asked for leaps by far the furthest, and fades."""
    kink = RUN.torque.copy()
    kink[1000:1010] = -9.0 * 0.7 ** np.arange(10)
    notes = logged(tmp_path, torque=lambda u: kink).notes
    assert not any("leaps" in n for n in notes)
    spike = np.where(np.arange(len(kink)) == 1000, -9.0, RUN.torque)
    assert any("the torque leaps and comes back in 1 rows" in n for n in logged(tmp_path, torque=lambda u: spike).notes)


def test_what_may_be_wrong_with_a_log_is_said(tmp_path: Path) -> None:
    clipped = logged(tmp_path, torque=lambda u: np.clip(u, -2.0, 2.0))
    assert any("the torque stands at 2 in" in note for note in clipped.notes)
    badly = logged(tmp_path, torque=lambda u: np.clip(u, *np.quantile(np.abs(u), 0.5) * np.array([-1, 1])))
    assert any("in 50 % of the rows; where that is the end" in note for note in badly.notes)
    switched = logged(tmp_path, torque=lambda u: np.clip(50 * u, -2.0, 2.0))
    moves = logged(tmp_path, torque=lambda u: np.clip(np.round(np.abs(u)) * np.round(u), -2.0, 2.0))
    assert not any("the torque stands at" in note for runs in (switched, moves) for note in runs.notes)
    slow = logged(tmp_path, torque=lambda u: np.repeat(u[::10], 10)[: len(u)])
    assert any("the torque changes at every 10 rows only" in note and "sensed = true" in note for note in slow.notes)
    read = logged(tmp_path, entry="sensed = true\n", torque=lambda u: np.repeat(u[::10], 10)[: len(u)])
    assert len(read.fit[0]) == len(RUN) / 10 - 1 and np.array_equal(read.fit[0].torque, RUN.torque[:-10:10])
    with pytest.raises(DataError, match=r"200 kg m\^2 is given: .* times off; leave axis.inertia out"):
        logged(tmp_path, "inertia = 200.0")
    again = {"time": RUN.time, "torque": RUN.torque, "position": RUN.position}
    for name in ("one.csv", "two.csv"):
        formats.write(tmp_path / name, again)
    uses = {"one": "fit", "two": "validate"}
    entries = "".join(f'[[record]]\nfile = "{name}.csv"\nuse = "{use}"\n' for name, use in uses.items())
    (tmp_path / "dataset.toml").write_text(entries)
    assert "two.csv has the same samples as one.csv: errors on it prove nothing" in load(tmp_path).notes
    formats.write(tmp_path / "one.csv", {**again, "velocity": RUN.position})
    assert any("position and velocity are the same numbers" in note for note in load(tmp_path).notes)


OF_ONE_AXIS = [measured(rms=rms, high=high) for rms, high in ((1.0, 20.0), (1.5, 10.0), (0.8, 5.0))]


def several(folder: Path, axis: str = "", uses: str = "fit fit validate", **change: Callable) -> Dataset:
    """The set of three records, of which the second has columns changed."""
    entries = []
    for i, (run, use) in enumerate(zip(OF_ONE_AXIS, uses.split(), strict=True)):
        columns = {"time": run.time, "torque": run.torque, "position": run.position}
        columns |= {k: f(columns[k]) for k, f in change.items()} if i == 1 else {}
        formats.write(folder / f"{i}.csv", columns)
        entries.append(f'[[record]]\nfile = "{i}.csv"\nuse = "{use}"\n')
    (folder / "dataset.toml").write_text(f"[axis]\n{axis}\n" + "\n".join(entries))
    return load(folder)


@pytest.mark.parametrize("uses", ["fit fit validate", "fit validate fit"])
@pytest.mark.parametrize("axis", ["", f"inertia = {INERTIA}"])
def test_one_record_with_another_sign_or_unit_than_the_others_is_told_by_its_name(
    axis: str, uses: str, tmp_path: Path
) -> None:
    """Together with the others it says nothing, and nothing was asked of what is not fitted."""
    assert not several(tmp_path, axis, uses).notes
    for wrong in ("torque", "position"):
        with pytest.raises(DataError, match=r"1\.csv: the torque works against the motion.* wrong sign, try scale"):
            several(tmp_path, axis, uses, **{wrong: np.negative})
    for wrong, factor, text in (("position", np.degrees, "deg read as rad"), ("torque", lambda u: 1e3 * u, "1000")):
        (note,) = several(tmp_path, axis, uses, **{wrong: factor}).notes
        assert note.startswith("1.csv by itself looks like an inertia of") and text in note


def test_a_torque_that_answers_late_in_pre_sliding_is_no_wrong_sign(tmp_path: Path) -> None:
    """A spring looks like a negative inertia, and behind a delay like friction that drives the axis."""
    stiff = Plant.axis(INERTIA) + effects.find("dahl")(stiffness=2e3, coulomb=0.4) + PLANT["viscous"]
    late = stiff + effects.find("delay")(time=4e-3)
    entries = []
    for i, (plant, rms, high) in enumerate(((late, 0.05, 60.0), (late, 1.0, 20.0), (late, 1.5, 10.0))):
        run = measured(plant, rms, high)
        formats.write(tmp_path / f"{i}.csv", {"time": run.time, "torque": run.torque, "position": run.position})
        entries.append(f'[[record]]\nfile = "{i}.csv"\nuse = "fit"\n')
    (tmp_path / "dataset.toml").write_text("\n".join(entries))
    load(tmp_path)


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_an_axis_that_gathers_speed_without_a_torque_was_moved(noise: float, tmp_path: Path) -> None:
    hand = slice(1000, 1800)
    off = np.zeros_like(RUN.torque)
    off[hand] = noise * np.random.default_rng(0).standard_normal(800)
    idle = np.zeros(len(off), bool)
    idle[hand] = True
    (note,) = logged(tmp_path, torque=lambda u: np.where(idle, off, u)).notes
    assert "gathers speed without a torque from 1 to 1.799 s" in note and "with span" in note
    coasts = np.where(np.arange(len(off)) < 150, 1.5, 0.0)
    run = simulate(PLANT, coasts, 1e-3, resolution=2 * np.pi / 2**18, torque_noise=noise, seed=2)
    assert not any("gathers" in n for n in logged(tmp_path, run=run).notes)
