"""Runs of a servo: logs that are read, sets of them that are split, and what repeats what."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from servos import bench, run

from gms_mujoco import formats
from gms_mujoco.dataset import load, save
from gms_mujoco.errors import DataError
from gms_mujoco.servo_run import read_run, repetitions


@pytest.mark.parametrize(
    "change, said",
    [
        ({"mass": None}, r"mass must be a positive number \[kg\]"),
        ({"kp": True}, r"gain \(kp in the file\) must be a positive number"),
        ({"entries": []}, "no column"),
        ({"back": True}, "sample 5: time does not run forward"),
        ({"few": True}, "8 samples; at least 12"),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_with_the_reason(change, said, tmp_path) -> None:
    with pytest.raises(DataError, match=said):
        read_run(log(tmp_path, **change))


def log(folder: Path, few: bool = False, back: bool = False, wild: bool = False, **change) -> Path:
    entries = [
        {"timestamp": 1 + 0.01 * k, "position": 0.01 * k, "goal_position": 0.5, "torque_enable": k < 20, "load": 0}
        for k in range(8 if few else 30)
    ]
    if back:
        entries[5]["timestamp"] = 1.0
    if wild:
        entries[12]["position"] = -3.0
    (folder / "log.json").write_text(json.dumps({"mass": 0.5, "length": 0.1, "kp": 16, "entries": entries} | change))
    return folder / "log.json"


def test_a_glitch_of_the_sensor_is_replaced_and_said(tmp_path) -> None:
    r = read_run(log(tmp_path, wild=True))
    assert r.position[12] == pytest.approx(0.12, abs=0.02)
    assert r.notes == ("1 readings of the position were glitches: the median of their neighbours is taken",)
    assert (r.time[0], r.gain, r.weight, r.inertia) == (0, 16, pytest.approx(0.4905), pytest.approx(0.005))
    assert r.powered.sum() == 20
    text = log(tmp_path, wild=True).read_text()
    (tmp_path / "marked.json").write_text(text, encoding="utf-8-sig")
    assert np.array_equal(read_run(tmp_path / "marked.json").position, r.position)
    with pytest.raises(DataError, match="no such file"):
        read_run(tmp_path / "other.json")


def test_a_set_of_servo_logs_is_read_through_dataset_toml(tmp_path) -> None:
    log(tmp_path, wild=True)
    t = 0.01 * np.arange(40)
    formats.write(tmp_path / "sweep.csv", {"ms": 1e3 * t, "asked": np.degrees(t), "q": np.degrees(0.9 * t)})
    (tmp_path / "dataset.toml").write_text("""
        [axis]
        controller = "position"
        [[record]]
        file = "log.json"
        use = "validate"
        [[record]]
        file = "sweep.csv"
        gain = 8
        mass = 0.5
        length = 0.2
        columns = { time = "ms", goal = "asked", position = "q" }
        units = { time = "ms", goal = "deg", position = "deg" }
        """)
    runs = load(tmp_path)
    (swept,), (logged,) = runs.fit, runs.validate
    assert logged.name == "log.json" and logged.gain == 16 and runs.notes == (f"log.json: {logged.notes[0]}",)
    assert np.allclose(swept.time, t) and np.allclose(swept.goal, t) and np.allclose(swept.position, 0.9 * t)
    assert swept.powered.all() and (swept.gain, swept.inertia) == (8, pytest.approx(0.02))
    assert runs.controller == "position" and runs.split == "records: 1 to fit, 1 to validate (as given)"


SERVO = '[axis]\ncontroller = "position"\n{}[[record]]\nfile = "log.csv"\ngain = 16\nmass = 0.5\nlength = 0.1\n{}'


def table(folder: Path, names: str, *columns: np.ndarray, axis: str = "", more: str = ""):
    rows = [",".join(map(repr, row)) for row in np.stack(columns, 1).tolist()]
    (folder / "log.csv").write_text("\n".join([names, *rows]))
    (folder / "dataset.toml").write_text(SERVO.format(axis, more))
    return load(folder)


def test_a_log_of_a_servo_is_read_with_the_care_of_any_other(tmp_path) -> None:
    t = 0.01 * np.arange(100)
    goal, q = np.sign(np.sin(9 * t)), np.sin(9 * t)
    plain = table(tmp_path, "time,goal,position", t, goal, q, more='use = "fit"\n').fit[0]
    more = 'use = "fit"\n'
    units = table(tmp_path, "Time [ms],goal_deg,position_deg", 1e3 * t, np.degrees(goal), np.degrees(q), more=more)
    ticks = [np.round(2048 + x * 4096 / (2 * np.pi)) for x in (goal, q)]
    with pytest.raises(DataError, match="position has whole numbers only"):
        table(tmp_path, "time,goal,position", t, goal, ticks[1])
    counted = table(tmp_path, "time,goal,position", t, *ticks, axis="encoder_counts_per_rev = 4096\n",
                    more=more + 'units = { goal = "counts", position = "counts" }\n')  # fmt: skip
    timed = table(tmp_path, "goal,position", goal, q, more=more + "rate = 100\n")
    with pytest.raises(DataError, match=r"rate = 50 \[Hz\], but the time of the file says 100 rows a second"):
        table(tmp_path, "time,goal,position", t, goal, q, more=more + "rate = 50\n")
    assert "time in ms, " in units.notes[0]
    for runs, zero in ((units, 0.0), (counted, np.pi), (timed, 0.0)):
        np.testing.assert_allclose(runs.fit[0].time, plain.time, atol=1e-12)
        np.testing.assert_allclose(runs.fit[0].position - zero, plain.position, atol=1e-3)
        np.testing.assert_allclose(runs.fit[0].goal - zero, plain.goal, atol=1e-3)
    hole = np.where(np.arange(100) == 50, np.nan, q)
    with pytest.raises(DataError, match=r"line 52: position is nan, .* span = \[0, 0.49\] and span = \[0.51, 0.99\]"):
        table(tmp_path, "time,goal,position", t, goal, hole)
    part = table(tmp_path, "time,goal,position", t, goal, hole, more=more + "span = [0.51, 9]\n").fit[0]
    assert len(part.time) == 49 and part.time[0] == 0 and part.name == "log.csv 0.51 to 9 s"
    with pytest.raises(DataError, match=r"samples are 10 s apart; if its time is in ms \(100 rows a second\)"):
        table(tmp_path, "time,goal,position", 1e3 * t, goal, q)


@pytest.mark.parametrize(("unit", "turn"), [("rad", 2 * np.pi), ("deg", 360.0), ("counts", 4096.0)])
@pytest.mark.parametrize("shape", ["sine", "steps", "several turns"])
def test_a_position_that_wraps_is_unwrapped_and_its_goal_stays_beside_it(unit, turn, shape, tmp_path) -> None:
    t = 0.01 * np.arange(400)
    goal = {"sine": 6 + np.sin(3 * t), "steps": 2.5 + 2.5 * np.floor(t), "several turns": 9 * np.sin(t)}[shape]
    q = scipy.signal.lfilter([0.1], [1, -0.9], goal, zi=[0.9 * goal[0]])[0]
    noise = 0.03 * np.random.default_rng(0).standard_normal(len(t))
    units = f'units = {{ goal = "{unit}", position = "{unit}" }}\nuse = "fit"\n'
    axis = "encoder_counts_per_rev = 4096\n"

    def logged(goal: np.ndarray, position: np.ndarray):
        raw = (x / (2 * np.pi) * turn for x in (goal, position))
        return table(tmp_path, "time,goal,position", t, *raw, axis=axis, more=units).fit[0]

    read = logged(goal if shape == "several turns" else np.mod(goal, 2 * np.pi), np.mod(q + noise, 2 * np.pi))
    away = round((read.position[0] - q[0]) / (2 * np.pi)) * 2 * np.pi
    np.testing.assert_allclose(read.position, q + noise + away, atol=1e-6)
    np.testing.assert_allclose(read.goal, goal + away, atol=1e-6)
    assert "jumps by a whole revolution" in read.notes[0] and len(read.notes) == 1
    glitch = q + noise + 2.0 * (np.arange(len(t)) == 150)
    both = logged(np.mod(goal, 2 * np.pi), np.mod(glitch, 2 * np.pi))
    assert abs(both.position[150] - q[150] - away) < 0.5 and "1 readings of the position" in both.notes[-1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[axis]\ncontroller = "speed"\n', "axis.controller must be position; 'speed' given"),
        ('[axis]\ncontroller = "position"\ninertia = 1.0\n', "unknown key axis.inertia; expected controller"),
        ('[axis]\ncontroller = "position"\n', "at least one"),
        ('[axis]\ncontroller = "position"\n[[record]]\nfile = "log.json"\nuse = "test"\n', "use must be one of"),
        ('[axis]\ncontroller = "position"\n[[frf]]\nfile = "a.uff"\n', r"\[\[frf\]\] has no place"),
        ('[axis]\ncontroller = "position"\n[[record]]\nfile = "log.json"\nmass = -1\n', "record 1: .*mass must be"),
        ('[axis]\ncontroller = "position"\n[[record]]\nfile = "log.json"\ncolumns = { goal = "g" }\n',
         "no column 'g' for goal"),
    ],
)  # fmt: skip
def test_a_servo_set_that_cannot_be_understood_is_refused_with_file_and_key(text, said, tmp_path) -> None:
    log(tmp_path)
    (tmp_path / "dataset.toml").write_text(text)
    with pytest.raises(DataError, match=said) as refused:
        load(tmp_path)
    assert "dataset.toml" in str(refused.value) and "\n" not in str(refused.value)


def test_a_set_comes_back_as_it_was_saved(tmp_path) -> None:
    made = bench(delay=0.0)[:3]
    save(tmp_path, made)
    back = load(tmp_path).servos
    for one, other in zip(made, back, strict=True):
        assert one.name == other.name and one.use == other.use and one.gain == other.gain
        assert (one.inertia, one.weight) == pytest.approx((other.inertia, other.weight))
        for key in ("time", "goal", "powered", "position"):
            assert np.allclose(getattr(one, key), getattr(other, key))
    with pytest.raises(DataError, match="two records are called"):
        save(tmp_path, [made[0], made[0]])


def test_a_repetition_has_the_same_goal_payload_and_gain() -> None:
    t = 0.01 * np.arange(100)
    one = run(np.sin(9 * t))
    others = [run(np.sin(9 * t) + 1e-4), run(np.sin(8 * t)), run(np.sin(9 * t), gain=8.0), run(np.sin(9 * t), load=2.0)]
    assert repetitions([one, *others]) == [[0, 1], [2], [3], [4]]
    off = replace(one, powered=np.where(t > 0.5, 0.0, 1.0))
    assert repetitions([one, off]) == [[0], [1]]


def test_where_nobody_says_it_whole_motions_validate(tmp_path) -> None:
    made = bench(delay=0.0)
    save(tmp_path, made)
    text = (tmp_path / "dataset.toml").read_text()
    without = "\n".join(line for line in text.splitlines() if not line.startswith("use"))
    (tmp_path / "dataset.toml").write_text(without)
    runs = load(tmp_path)
    assert [r.name for r in runs.validate] == ["run 2a.csv", "run 2b.csv", "run 5a.csv", "run 5b.csv"]
    assert "every third motion validates with its repetitions" in runs.split


def test_a_single_run_is_cut(tmp_path) -> None:
    save(tmp_path, [replace(bench(delay=0.0)[0], name="only.csv")])
    file = tmp_path / "dataset.toml"
    file.write_text(file.read_text().replace('use = "fit"\n', ""))
    runs = load(tmp_path)
    (first,), (rest,) = runs.fit, runs.validate
    assert (first.judged, rest.judged) == ((0, 60), (60, 100))
    assert "first 60 %" in runs.split


def test_a_use_that_nobody_knows_is_refused() -> None:
    with pytest.raises(DataError, match="use must be one of fit, select"):
        replace(run(np.zeros(20)), use="test")
