"""Measurement sets: numbers reach SI untouched, and whatever is wrong ends in one line that names the place."""

import json
from dataclasses import replace
from pathlib import Path

import emps
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gms_mujoco import formats
from gms_mujoco.dataset import Dataset, files_of, load, save
from gms_mujoco.errors import DataError
from gms_mujoco.fit import baseline, fit
from gms_mujoco.record import Record

N = 200
TIME = np.arange(N) * 1e-3
RUN = {"time": TIME, "torque": np.sin(40 * TIME), "position": 0.1 * np.cos(30 * TIME)}
AXIS = "[axis]\ninertia = 2.4e-5\n"
RECORD = '[[record]]\nfile = "run.csv"\n'
anyhow = settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])


def dataset(folder: Path, text: str, **columns: np.ndarray) -> Dataset:
    """A measurement set with one file, `run.csv`."""
    formats.write(folder / "run.csv", columns or RUN)
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return load(folder)


def refuses(folder: Path, text: str, *words: str, **columns: np.ndarray) -> None:
    """The set is refused in one line that has all the words."""
    with pytest.raises(DataError) as caught:
        dataset(folder, text, **columns)
    message = str(caught.value)
    assert "\n" not in message and "dataset.toml" in message
    for word in words:
        assert word in message, message


# What comes in.


def test_a_plain_set_is_read_as_it_stands(tmp_path: Path) -> None:
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n' + RECORD + 'use = "validate"\n')
    assert (runs.kind, runs.inertia) == ("hinge", 2.4e-5)
    assert runs.notes == ("run.csv has the same samples as run.csv: errors on it prove nothing",)
    assert [r.use for r in runs.records] == ["fit", "validate"] and runs.select == ()
    for key, value in RUN.items():
        got = runs.fit[0].time if key == "time" else runs.fit[0].signals[key]
        assert np.array_equal(got, value)
    assert load(tmp_path / "dataset.toml").records[0].name == "run.csv"


@pytest.mark.parametrize("begins", [86.4, 1.7e9, -50.0])
def test_a_clock_that_began_long_before_counts_from_the_first_stamp(begins: float, tmp_path: Path) -> None:
    """What warms up with time would be over; records one after the other stay so."""
    later = {**RUN, "time": TIME + begins + 10.0}
    formats.write(tmp_path / "later.csv", later)
    both = RECORD + '[[record]]\nfile = "later.csv"\n'
    runs = dataset(tmp_path, AXIS + both, **{**RUN, "time": TIME + begins})
    assert [r.time[0] for r in runs.records] == pytest.approx([0.0, 10.0], abs=1e-6)
    assert f"the stamps begin at {begins:.15g} s: times count from there" in runs.notes


def test_a_clock_that_may_have_begun_with_the_axis_is_kept(tmp_path: Path) -> None:
    for text, begins in ((RECORD, 0.01), (RECORD + "span = [0.08, 0.2]\n", 0.08)):
        runs = dataset(tmp_path, AXIS + text, **{**RUN, "time": TIME + (begins if "span" not in text else 0.0)})
        assert runs.records[0].time[0] == pytest.approx(begins) and not [n for n in runs.notes if "stamps" in n]


def test_a_whole_set_in_the_place_of_its_records_is_told_what_to_give(tmp_path: Path) -> None:
    runs = dataset(tmp_path, AXIS + RECORD)
    with pytest.raises(DataError, match=r"given as one of its parts: \.fit, \.select, \.validate or \.all$"):
        fit(baseline(runs.inertia), runs)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("position", "deg", np.pi / 180),
        ("position", "rev", 2 * np.pi),
        ("position", "counts", 2 * np.pi / 4096),
        ("position", "mrad", 1e-3),
        ("torque", "mN m", 1e-3),
        ("torque", "Nmm", 1e-3),
        ("torque", "N*m", 1.0),
        ("time", "ms", 1e-3),
        ("time", "us", 1e-6),
        ("time", "\N{MICRO SIGN}s", 1e-6),
        ("position", "\N{DEGREE SIGN}", np.pi / 180),
        ("velocity", "1/min", 2 * np.pi / 60),
        ("velocity", "rpm", 2 * np.pi / 60),
        ("velocity", "counts/s", 2 * np.pi / 4096),
        ("load", "kgf cm", 0.0980665),
        ("position", "mdeg", np.pi / 180e3),
        ("position", "0.001\N{DEGREE SIGN}", np.pi / 180e3),
        ("position", "m\N{DEGREE SIGN}", np.pi / 180e3),
        ("position", "Umdr", 2 * np.pi),
        ("position", "Incr", 2 * np.pi / 4096),
        ("torque", "lbf\N{MIDDLE DOT}ft", 1.3558179483314),
        ("torque", "in-lb", 0.1129848290276),
        ("torque", "daNm", 10.0),
    ],
)
def test_units_become_si(column: str, unit: str, factor: float, tmp_path: Path) -> None:
    raw = {**RUN, "velocity": np.cos(TIME), "load": np.sin(TIME)}
    text = f'[axis]\nencoder_counts_per_rev = 4096\n{RECORD}use = "fit"\nunits = {{ {column} = "{unit}" }}\n'
    record = dataset(tmp_path, text, **raw).fit[0]
    got = record.time if column == "time" else record.signals[column]
    assert np.allclose(got, factor * raw[column], rtol=1e-12, atol=0)
    assert record.resolution == 2 * np.pi / 4096


HEAD = "Time [ms],Torque (mNm),POSITION [deg]\n"


HEADS = (
    HEAD, "bench 7\nof monday, again\n" + HEAD, "time,torque,position\nms,mNm,\N{DEGREE SIGN}\n",
    "time_ms,torque_mNm,position_deg\n", "time_msec,torque_mN-m,position_degrees\n",
    "Time / ms,Torque / (mNm),Position / deg\n",
)  # fmt: skip


@pytest.mark.parametrize("head", HEADS)
def test_what_a_header_states_is_read_and_said(head: str, tmp_path: Path) -> None:
    rows = [",".join(map(repr, row)) for row in np.array([*RUN.values()]).T.tolist()]
    (tmp_path / "stated.csv").write_text(head + "\n".join(rows), encoding="utf-8")
    text = AXIS + '[[record]]\nfile = "stated.csv"\nuse = "fit"\n'
    runs = dataset(tmp_path, text)
    assert np.allclose(runs.fit[0].time, 1e-3 * TIME) and np.allclose(runs.fit[0].torque, 1e-3 * RUN["torque"])
    assert np.allclose(runs.fit[0].position, np.radians(RUN["position"]))
    assert "time in ms" in runs.notes[0] and "torque in mN" in runs.notes[0]
    own = dataset(tmp_path, text + 'units = { torque = "Nm" }\nscale = { position = 1.0 }\n').fit[0]
    assert np.array_equal(own.torque, RUN["torque"]) and np.array_equal(own.position, RUN["position"])
    slide = text.replace("[axis]", '[axis]\nkind = "slide"')
    refuses(tmp_path, slide, "the file states a unit of", "slide joint", "scale")


@pytest.mark.parametrize("word", ["elbow", "motor 1", "J1", "actual", "act", "2", "hip", "left arm", "UTC", "q"])
def test_a_name_in_brackets_that_is_no_unit_does_not_matter(word: str, tmp_path: Path) -> None:
    name = f"torque [{word}]"
    text = AXIS + RECORD + f'use = "fit"\ncolumns = {{ torque = "{name}" }}\n'
    record = dataset(tmp_path, text, **{"time": TIME, name: RUN["torque"], "position": RUN["position"]}).fit[0]
    assert np.array_equal(record.torque, RUN["torque"])
    whole = {"time": TIME, name: np.round(1000 * RUN["torque"]), "position": RUN["position"]}
    refuses(tmp_path, text, "torque has whole numbers only", **whole)


@pytest.mark.parametrize("unit", ["%", "% Mn", "%rated", "Mp", "V", "UU", "0.1%", "Umdr", "percent", "Nm/A", "Nm act"])
def test_a_unit_that_nobody_knows_is_refused_and_the_line_says_what_to_do(unit: str, tmp_path: Path) -> None:
    text = AXIS + RECORD + 'use = "fit"\n'
    raw = {"time": TIME, f"torque [{unit}]": RUN["torque"], "position (rad)": RUN["position"]}
    ways = "scale = { torque = ... } [Nm per raw number], or units = { torque = \"Nm\" }"
    refuses(tmp_path, text, "run.csv", "states a unit of torque", ways, **raw)
    assert len(dataset(tmp_path, text + "scale = { torque = 0.02 }\n", **raw).fit) == 1
    assert len(dataset(tmp_path, text + 'units = { torque = "Nm" }\n', **raw).fit) == 1


def test_a_load_that_acts_on_the_axis_is_a_torque(tmp_path: Path) -> None:
    raw = {**RUN, "load [%]": np.cos(TIME)}
    refuses(tmp_path, AXIS + "load_acts = 1\n" + RECORD, "states a unit of load", "'%'", **raw)


def test_amperes_of_a_sine_are_told_and_may_not_be_mixed(tmp_path: Path) -> None:
    text = "[axis]\ntorque_constant = 0.2\n"
    for i, unit in enumerate(("A rms", "mApk")):
        raw = {"time": TIME, f"current [{unit}]": RUN["torque"] + i, "position": RUN["position"]}
        formats.write(tmp_path / f"{i}.csv", raw)
        text += f'[[record]]\nfile = "{i}.csv"\n'
    runs = dataset(tmp_path, text)
    assert np.allclose(runs.records[1].torque, 0.2e-3 * (RUN["torque"] + 1))
    assert "0.csv: current in A rms: taken as A, and axis.torque_constant as one of A rms" in runs.notes
    assert any("currents are in A rms (0.csv) and A peak (1.csv)" in note for note in runs.notes)
    apart = dataset(tmp_path, text + "scale = { current = 0.0007 }\n")
    assert not any("no torque constant is right" in note for note in apart.notes)


@pytest.mark.parametrize("unit", ["%", "A", "N", "kg", "bar", "counts", "quux"])
def test_a_load_may_be_in_any_unit(unit: str, tmp_path: Path) -> None:
    text = AXIS + RECORD + 'use = "fit"\n'
    stated = dataset(tmp_path, text, **RUN, **{f"load [{unit}]": np.cos(TIME)})
    declared = dataset(tmp_path, f'{text}units = {{ load = "{unit}" }}\n', **RUN, load=np.cos(TIME))
    for runs in (stated, declared):
        assert np.array_equal(runs.fit[0].signals["load"], np.cos(TIME))
        assert runs.notes[:1] == (f"run.csv: load in {unit}: taken as it is, in that unit",)
    torque = dataset(tmp_path, text, **RUN, **{"load [mNm]": np.cos(TIME)}).fit[0]
    assert np.allclose(torque.signals["load"], 1e-3 * np.cos(TIME))


def test_a_word_behind_a_bar_is_no_unit(tmp_path: Path) -> None:
    """`position_in` goes in; `time_d` is desired."""
    columns_ = {"time": TIME, "torque_m": RUN["torque"], "position_in": RUN["position"]}
    text = AXIS + RECORD + 'use = "fit"\ncolumns = { torque = "torque_m", position = "position_in" }\n'
    runs = dataset(tmp_path, text, **columns_)
    assert runs.notes == () and np.array_equal(runs.fit[0].position, RUN["position"])


def test_a_rate_counts_time_where_the_file_has_none_or_a_coarse_one(tmp_path: Path) -> None:
    text = AXIS + RECORD + 'use = "fit"\n'
    without = {k: v for k, v in RUN.items() if k != "time"}
    refuses(tmp_path, text, "no column 'time'", "rate = ", **without)
    coarse = {**RUN, "time": np.floor(TIME * 200) / 200}
    refuses(tmp_path, text, "time does not run forward", "rate = ", **coarse)
    for raw in (without, coarse):
        assert np.allclose(dataset(tmp_path, text + "rate = 1000\n", **raw).fit[0].time, np.arange(N) / 1000)
    for size, name in ((1.0, "time"), (1.0, "time [s]"), (1e3, "time"), (1e3, "time [ms]")):
        same = {name: size * TIME, **without}
        assert np.allclose(dataset(tmp_path, text + "rate = 1000\n", **same).fit[0].time, np.arange(N) / 1000)
        refuses(tmp_path, text + "rate = 2000\n", "rate = 2000 [Hz]", "rows a second; leave rate out", **same)
    refuses(tmp_path, text + "rate = 1000000\n", "says 1000 rows", **{"time [s]": TIME, **without})
    refuses(tmp_path, text + "rate = -1000\n", "rate must be positive", **without)
    refuses(tmp_path, text + 'rate = 1000\ncolumns = { time = "time" }\n', "not both", **RUN)


@pytest.mark.parametrize(("unit", "celsius"), [("K", -273.15), ("degF", -160 / 9), ("degC", 0.0)])
def test_temperature_has_an_offset(unit: str, celsius: float, tmp_path: Path) -> None:
    text = AXIS + RECORD + f'use = "fit"\nunits = {{ temperature = "{unit}" }}\n'
    record = dataset(tmp_path, text, **RUN, temperature=np.zeros(N)).fit[0]
    assert np.allclose(record.signals["temperature"], celsius)


def test_a_temperature_that_some_records_lack_is_not_used_and_it_is_said() -> None:
    def logged(name: str, **more: np.ndarray) -> Record:
        return Record(name, np.arange(20.0), {"torque": np.ones(20), "position": np.arange(20.0), **more})

    warm = logged("warm", temperature=np.full(20, 30.0))
    whole = Dataset(Path(), (warm, warm))
    assert whole.with_temperature_of_all() is whole
    part = Dataset(Path(), (warm, logged("unknown"))).with_temperature_of_all()
    assert not any("temperature" in r.signals for r in part.records)
    assert part.notes == ("the temperature is not used: 1 of 2 records have one",)


def test_current_times_torque_constant_is_torque(tmp_path: Path) -> None:
    text = "[axis]\ntorque_constant = 0.2\n" + RECORD + 'use = "fit"\nunits = { current = "mA" }\n'
    record = dataset(tmp_path, text, time=TIME, current=RUN["torque"], position=RUN["position"]).fit[0]
    assert np.allclose(record.torque, 0.2e-3 * RUN["torque"]) and "current" not in record.signals


def test_columns_are_renamed_and_scaled(tmp_path: Path) -> None:
    text = '[axis]\nkind = "slide"\n' + RECORD + (
        'use = "fit"\ncolumns = { time = "t", torque = "vir", position = "qm" }\nscale = { torque = 35.1507 }\n'
    )
    runs = dataset(tmp_path, text, t=TIME, vir=RUN["torque"], qm=RUN["position"])
    assert runs.kind == "slide" and runs.inertia is None
    assert np.allclose(runs.fit[0].torque, 35.1507 * RUN["torque"])


def test_columns_without_names_are_counted_from_zero(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "bare.csv", np.array(list(RUN.values())).T, delimiter=",")
    text = AXIS + '[[record]]\nfile = "bare.csv"\nuse = "fit"\n'
    refuses(tmp_path, text, "bare.csv", "does not name its 3 columns", "columns = {")
    record = dataset(tmp_path, text + "columns = { time = 0, torque = 1, position = 2 }\n").fit[0]
    assert np.allclose(record.position, RUN["position"])
    refuses(tmp_path, text + "columns = { time = 0, torque = 1, position = 3 }\n", "no column 3", "there are 3")


def test_text_column_that_is_not_asked_for_does_not_matter(tmp_path: Path) -> None:
    rows = [f"{t!r},{u!r},{q!r},idle" for t, u, q in zip(*(v.tolist() for v in RUN.values()), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time,torque,position,mode", *rows]))
    assert len(dataset(tmp_path, AXIS + '[[record]]\nfile = "log.csv"\nuse = "fit"\n').records) == 1


def test_an_optional_column_is_read_unless_it_is_left_out(tmp_path: Path) -> None:
    raw = {**RUN, "load": np.ones(N)}
    text = AXIS + RECORD + 'use = "fit"\n'
    assert "load" in dataset(tmp_path, text, **raw).fit[0].signals
    assert "load" not in dataset(tmp_path, text + "columns = { load = false }\n", **raw).fit[0].signals
    refuses(tmp_path, text + "columns = { torque = false }\n", "columns.torque", **raw)


def test_an_optional_column_without_numbers_does_not_matter_and_one_with_few_says_how_to_do_without(
    tmp_path: Path,
) -> None:
    text = AXIS + RECORD + 'use = "fit"\n'
    empty = np.full(N, np.nan)
    assert "temperature" not in dataset(tmp_path, text, **RUN, temperature=empty).fit[0].signals
    empty[::50] = 25.0
    refuses(tmp_path, text, "temperature is nan", "columns = { temperature = false }", **RUN, temperature=empty)


def test_a_dataset_toml_of_a_text_editor_of_windows_is_read(tmp_path: Path) -> None:
    assert len(dataset(tmp_path, "\ufeff" + AXIS + RECORD).records) == 2
    refuses(tmp_path, AXIS + RECORD.replace("run", "c:\\logs\\run"), "not TOML", "write / in the place of")
    refuses(tmp_path, AXIS + RECORD.replace("run", "data\\run"), r"file = 'data\run.csv'", "write / in its place")
    refuses(tmp_path, '[axis]\nmodel = "robots\\tall.xml"\njoint = "a"\n' + RECORD, r"axis.model = 'robots\tall.xml'")


def test_a_clock_in_another_unit_than_its_header_says_is_doubted(tmp_path: Path) -> None:
    raw = {"time [ms]": TIME, "torque": RUN["torque"], "position": RUN["position"]}
    notes = dataset(tmp_path, AXIS + RECORD, **raw).notes
    assert any('in s (1000 rows a second), say units = { time = "s" }' in note for note in notes)


def test_what_is_missing_is_told_with_what_may_stand_in_its_place(tmp_path: Path) -> None:
    refuses(tmp_path, AXIS + RECORD, "current = ... in the place of torque", time=TIME, iq=TIME, position=TIME)
    refuses(tmp_path, AXIS + RECORD, "current = ... in the place of torque", a=TIME, b=TIME, position=TIME)
    refuses(tmp_path, "[axis]\nfoo = 1\n" + RECORD, "unknown key axis.foo", "controller")


def test_frequency_responses_come_beside_records_or_alone(tmp_path: Path) -> None:
    (tmp_path / "level.csv").write_text("f [Hz],real,imag\n1,2.0,0.5\n2,1.0,0.5\n")
    frf = '[[frf]]\nfile = "level.csv"\ninput = "torque"\noutput = "position"\namplitude = 1e-3\nuse = "validate"\n'
    runs = dataset(tmp_path, AXIS + RECORD + frf)
    assert len(runs.records) == 2 and [f.use for f in runs.frfs] == ["validate"] and "level.csv" in runs.notes[0]
    alone = dataset(tmp_path, AXIS + frf)
    assert alone.records == () and alone.frfs[0].response[0] == 2 + 0.5j and "responses: 1" in alone.split


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_saved_records_come_back_to_the_last_bit(suffix: str, tmp_path: Path) -> None:
    signals = {"torque": RUN["torque"], "position": RUN["position"], "load": TIME, "reference": TIME[::-1]}
    records = [Record("slow", TIME, signals, "fit", 1e-3), Record("fast.csv", TIME, signals, "validate", 1e-3)]
    save(tmp_path / "set", records, "slide", 95.0, suffix)
    runs = load(tmp_path / "set")
    assert (runs.kind, runs.inertia) == ("slide", 95.0)
    for given_, read in zip(records, runs.records, strict=True):
        assert (read.use, read.resolution) == (given_.use, 1e-3) and np.array_equal(read.time, given_.time)
        assert all(np.array_equal(read.signals[k], v) for k, v in given_.signals.items())
    save(tmp_path / "read", [replace(records[0], sensed=True), records[1]], "slide", suffix=suffix)
    assert [r.sensed for r in load(tmp_path / "read").records] == [True, False]
    with pytest.raises(DataError, match="two records are called 'slow"):
        save(tmp_path / "set", [records[0], records[0]])


# The split.


def test_one_record_is_cut_in_time(tmp_path: Path) -> None:
    runs = dataset(tmp_path, AXIS + RECORD)
    assert [(r.use, len(r)) for r in runs.records] == [("fit", 120), ("validate", 80)]
    assert "60 %" in runs.split and runs.validate[0].time[0] == TIME[120]


@pytest.mark.parametrize(("n", "uses"), [(2, "fv"), (3, "ffv"), (7, "ffvffvf")])
def test_several_records_are_split_evenly_and_it_is_said(n: int, uses: str, tmp_path: Path) -> None:
    runs = dataset(tmp_path, n * RECORD)
    assert "".join(r.use[0] for r in runs.records) == uses
    assert "no use was given" in runs.split


def test_a_record_without_use_beside_others_fits_and_it_is_said(tmp_path: Path) -> None:
    runs = dataset(tmp_path, AXIS + RECORD + RECORD + 'use = "validate"\n')
    assert [r.use for r in runs.records] == ["fit", "validate"] and "run.csv: no use given, so fit" in runs.split


def test_records_to_score_a_plant_by_need_none_beside_them_and_a_fit_refuses_them(tmp_path: Path) -> None:
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "validate"\n')
    assert runs.fit == () and runs.split == "records: 1 to validate (as given)"
    with pytest.raises(DataError, match='use = "fit"'):
        fit(baseline(runs.inertia), runs.fit)


# Time.


def test_small_jitter_is_left_alone(tmp_path: Path) -> None:
    time = TIME + 5e-6 * np.sin(np.arange(N))
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{**RUN, "time": time})
    assert np.array_equal(runs.fit[0].time, time) and runs.notes == ()


def test_rounded_stamps_get_their_grid_back_and_samples_stay(tmp_path: Path) -> None:
    grid = np.arange(N) / 2048
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{**RUN, "time": np.round(grid, 4)})
    assert np.abs(runs.fit[0].time - grid).max() < 1e-4 and "rounded to 0.0001 s" in runs.notes[0]
    assert np.array_equal(runs.fit[0].position, RUN["position"])


def test_a_clock_in_single_precision_gets_its_grid_back(tmp_path: Path) -> None:
    time = (TIME + 1000).astype(np.float32).astype(float)
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{**RUN, "time": time})
    assert np.abs(runs.fit[0].time - TIME).max() < 1e-4 and "rounded" in runs.notes[0]
    assert np.array_equal(runs.fit[0].position, RUN["position"])


def test_a_row_that_comes_twice_is_left_out(tmp_path: Path) -> None:
    twice = np.sort([*range(N), 70, 120])
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{k: v[twice] for k, v in RUN.items()})
    assert np.array_equal(runs.fit[0].time, TIME) and "2 rows repeat the one before: left out" in runs.notes[0]
    other = {k: v[twice] for k, v in RUN.items()}
    other["torque"][121] += 0.1  # two values of one time
    refuses(tmp_path, AXIS + RECORD, "line 73", "leave out the rows (2 such)", "rate = ", **other)


def test_dropped_samples_are_filled_torque_held(tmp_path: Path) -> None:
    kept = np.delete(np.arange(N), [50, 51, 120])
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{k: v[kept] for k, v in RUN.items()})
    record = runs.fit[0]
    assert len(record) == N and "resampled" in runs.notes[0]
    assert np.allclose(record.time, TIME, atol=1e-12)
    assert record.position == pytest.approx(RUN["position"], abs=1e-6)  # a chord would be off by 5e-5
    assert record.torque[[50, 51, 52]] == pytest.approx(RUN["torque"][[49, 49, 52]], rel=1e-9)


def test_rows_of_a_logger_that_comes_by_late_are_as_even_as_the_motion_says(tmp_path: Path) -> None:
    """The same stamps, of rows that were read at even times and of such that were not."""
    time = TIME + np.random.default_rng(0).uniform(-2e-4, 2e-4, N)
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **{**RUN, "time": time})
    assert np.abs(np.diff(runs.fit[0].time) - 1e-3).max() < 1e-5 and "stray from even steps by up to" in runs.notes[0]
    assert np.array_equal(runs.fit[0].position, RUN["position"])
    uneven = {"time": time, "torque": np.sin(40 * time), "position": 0.1 * np.cos(30 * time)}
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **uneven)
    there = runs.fit[0]
    assert "resampled" in runs.notes[0] and np.abs(there.position - 0.1 * np.cos(30 * there.time)).max() < 1e-4


def test_a_slow_record_is_read_as_a_fast_one_of_the_same_logger_shows(tmp_path: Path) -> None:
    """By itself it does not tell whether its stamps or its rows are even."""
    stamps = TIME + np.random.default_rng(0).uniform(-1e-4, 1e-4, N)
    slow = {**RUN, "time": stamps, "position": np.round(np.sin(3 * TIME) / 1e-2) * 1e-2}
    formats.write(tmp_path / "slow.csv", slow)
    second = '[[record]]\nfile = "slow.csv"\nuse = "validate"\n'
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n' + second, **{**RUN, "time": stamps})
    assert np.array_equal(runs.validate[0].position, slow["position"]) and "in other records" in runs.notes[1]
    alone = dataset(tmp_path, AXIS + second, **RUN)
    assert "resampled" in alone.notes[0]


def test_long_gap_is_refused_with_its_time(tmp_path: Path) -> None:
    kept = np.delete(np.arange(N), np.arange(50, 90))
    for start in (0.0, 1.7e9):  # since 1970
        raw = {**RUN, "time": start + TIME}
        said = f"span = [{start:.15g}, {start + 0.049:.15g}] and span = [{start + 0.09:.15g}, {start + 0.199:.15g}]"
        parts = {k: v[kept] for k, v in raw.items()}
        refuses(tmp_path, AXIS + RECORD, "record 1 (run.csv): a gap of 0.041 s", said, **parts)


def test_a_span_takes_a_part_of_a_file_and_leaves_out_what_is_wrong_with_the_rest(tmp_path: Path) -> None:
    torque = RUN["torque"].copy()
    torque[100] = np.nan
    first, second = ('use = "fit"\nspan = [0.0, 0.0995]\n', 'use = "validate"\nspan = [0.101, 9]\n')
    runs = dataset(tmp_path, AXIS + RECORD + first + RECORD + second, **{**RUN, "torque": torque})
    assert np.array_equal(runs.fit[0].torque, torque[:100]) and np.array_equal(runs.validate[0].time, TIME[101:])
    assert runs.fit[0].name == "run.csv 0 to 0.0995 s"
    whole = AXIS + RECORD + 'use = "fit"\n'
    refuses(tmp_path, whole + "span = [0.05, 1]\n", "line 102", "torque is nan", **{**RUN, "torque": torque})
    for wrong in ("[1.0]", "[2, 1]", '"1-2"', "[true, 3]", "[0.0, nan]"):
        refuses(tmp_path, whole + f"span = {wrong}\n", "span must be two rising times")
    refuses(tmp_path, whole + "span = [5, 6]\n", "nothing there", "from 0 to 0.199 s")


def test_time_backwards_or_standing_still_names_the_line(tmp_path: Path) -> None:
    for wrong in (0.005, 0.009):
        time = TIME.copy()
        time[10] = wrong
        refuses(tmp_path, AXIS + RECORD, "run.csv", "line 12", "time does not run forward", **{**RUN, "time": time})


# What is refused.


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_value_that_is_not_finite_names_the_line(value: float, tmp_path: Path) -> None:
    torque = RUN["torque"].copy()
    torque[7] = value
    refuses(tmp_path, AXIS + RECORD, "run.csv", "line 9", "torque", **{**RUN, "torque": torque})


def test_a_value_larger_than_any_is_not_called_infinite(tmp_path: Path) -> None:
    torque = RUN["torque"].copy()
    torque[7] = 1e300
    refuses(tmp_path, AXIS + RECORD, "line 9: torque is 1e+300, more than any axis has", **{**RUN, "torque": torque})


def test_the_line_of_a_mistake_is_right_after_rows_were_left_out(tmp_path: Path) -> None:
    torque = RUN["torque"].copy()
    torque[[0, 1, 2, 100]] = np.nan
    refuses(tmp_path, AXIS + RECORD, "line 102", "torque is nan", **{**RUN, "torque": torque})


def test_spans_around_what_is_missing_are_named_and_serve(tmp_path: Path) -> None:
    position = RUN["position"].copy()
    position[80:90] = np.nan
    raw = {**RUN, "position": position}
    spans = ("[0, 0.079]", "[0.09, 0.199]")
    refuses(tmp_path, AXIS + RECORD, "line 82", "(10 such)", *(f"span = {s}" for s in spans), **raw)
    runs = dataset(tmp_path, AXIS + "".join(f'{RECORD}use = "fit"\nspan = {s}\n' for s in spans), **raw)
    assert [len(r) for r in runs.fit] == [80, 110]
    position[::2] = np.nan
    refuses(tmp_path, AXIS + RECORD, "every row needs a number", **raw)


def test_all_missing_columns_are_named_at_once(tmp_path: Path) -> None:
    refuses(tmp_path, AXIS + RECORD, "columns = { time = ..., position = ..., torque = ... }", "the file has q, t, u",
            t=TIME, u=TIME, q=TIME)  # fmt: skip


def test_missing_column_lists_the_columns(tmp_path: Path) -> None:
    refuses(tmp_path, AXIS + RECORD, "run.csv", "'torque'", "effort", time=TIME, effort=TIME, position=TIME)


def test_the_count_of_an_encoder_outlives_resampling(tmp_path: Path) -> None:
    uneven = TIME + 3e-4 * (np.arange(N) % 3 == 1)
    columns = {"time": uneven, "torque": RUN["torque"], "position": 1e-4 * np.round(1e3 * np.cos(30 * uneven))}
    runs = dataset(tmp_path, AXIS + RECORD + 'use = "fit"\n', **columns)
    assert "resampled" in runs.notes[0] and runs.fit[0].resolution == pytest.approx(1e-4)


@pytest.mark.parametrize("declared", [2**10, 2**14, 2**16])
def test_steps_finer_than_the_encoder_as_declared_are_said(declared: int, tmp_path: Path) -> None:
    """Coarser ones come of few digits, or of an axis that moves fast, and say nothing against it."""
    count = 2 * np.pi / 2**14
    read = {**RUN, "position": np.round(RUN["position"] / count) * count}
    runs = dataset(tmp_path, f"[axis]\nencoder_counts_per_rev = {declared}\n" + RECORD, **read)
    assert runs.fit[0].resolution == pytest.approx(2 * np.pi / declared)
    assert any("finer than the count" in note for note in runs.notes) == (declared < 2**14)


def test_a_current_in_rows_that_are_not_the_drive_s_is_read_and_not_held(tmp_path: Path) -> None:
    text = "[axis]\ntorque_constant = 2\n" + RECORD + 'use = "fit"\n'
    uneven = TIME + 3e-4 * (np.arange(N) % 3 == 1)
    for time, sensed in ((TIME, False), (np.round(TIME, 4), False), (uneven, True)):
        columns = {"time": time, "current": np.sin(40 * time), "position": 0.1 * np.cos(30 * time)}
        record = dataset(tmp_path, text, **columns).fit[0]
        assert record.sensed == sensed
        if sensed:
            assert np.allclose(record.torque, 2 * np.sin(40 * record.time), atol=1e-3)


def test_a_torque_constant_that_nothing_uses_is_told(tmp_path: Path) -> None:
    """Not where one record or response of several has a current."""
    formats.write(tmp_path / "amperes.csv", {"time": TIME, "current": np.cos(40 * TIME), "position": RUN["position"]})
    other, frf = '[[record]]\nfile = "amperes.csv"\n', '[[frf]]\nfile = "frf.csv"\noutput = "position"\n'
    (tmp_path / "frf.csv").write_text("f [Hz],real,imag\n1,2.0,-0.5\n2,1.0,-0.5\n30,-0.1,-0.01\n")
    unused = "axis.torque_constant is not used: no record and no response has a current"
    for entries, is_told in (
        (RECORD, True),
        (f'{RECORD}{frf}input = "torque"\n', True),
        (RECORD + other, False),
        (f'{RECORD}{frf}input = "current"\n', False),
    ):
        for constant in ("0.2", '"unknown"'):
            notes = dataset(tmp_path, f"[axis]\ntorque_constant = {constant}\n{entries}").notes
            assert (unused in notes) == is_told
            assert any("torque stays in A" in note for note in notes) == (constant != "0.2" and not is_told)


def test_the_files_of_a_set_are_those_that_it_names(tmp_path: Path) -> None:
    text = '[axis]\nmodel = "arm.xml"\n[[record]]\nfile = "a/run.csv"\n[[frf]]\nfile = "b.uff"\n[[record]]\nfile = 3\n'
    (tmp_path / "dataset.toml").write_text(text)
    named = [tmp_path / name for name in ("dataset.toml", "a/run.csv", "b.uff", "arm.xml")]
    assert set(files_of(tmp_path)) == set(files_of(tmp_path / "dataset.toml")) == set(named)
    (tmp_path / "dataset.toml").write_text("record = 3\n")
    with pytest.raises(DataError, match=r"dataset.toml: record must be written as \[\[record\]\]"):
        files_of(tmp_path)


def test_current_without_torque_constant_is_refused(tmp_path: Path) -> None:
    refuses(tmp_path, AXIS + RECORD, "torque_constant", time=TIME, current=TIME, position=TIME)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["[[record]]"]),
        ("[axis\n", ["not TOML", "line 1"]),
        ("[axis]\ninertia = 0\n" + RECORD, ["axis.inertia"]),
        ("[axis]\ninertia = -1.0\n" + RECORD, ["axis.inertia", "positive"]),
        ("[axis]\ninertia = nan\n" + RECORD, ["axis.inertia"]),
        ('[axis]\ninertia = "2e-5"\n' + RECORD, ["axis.inertia"]),
        ("[axis]\ninertia = true\n" + RECORD, ["axis.inertia"]),
        (f"[axis]\ninertia = {'9' * 400}\n" + RECORD, ["axis.inertia"]),
        ("[axis]\nmass = 1.0\n" + RECORD, ["axis.mass", "inertia"]),
        ('[axis]\nkind = "ball"\n' + RECORD, ["axis.kind", "hinge", "slide"]),
        ('[axis]\nmodel = "a.xml"\njoint = "j"\n' + RECORD, ["axis.model", "no such file", "a.xml"]),
        ('[axis]\nkind = "slide"\nencoder_counts_per_rev = 9\n' + RECORD, ["encoder_resolution"]),
        ("axis = 3\n", ["axis must be a table"]),
        ("record = 3\n", ["[[record]]"]),
        (AXIS + "[[recrod]]\n", ["recrod", "record"]),
        (AXIS + "[[record]]\n", ["record 1", "file"]),
        (AXIS + '[[record]]\nfile = "none.csv"\n', ["record 1", "none.csv", "no such file"]),
        (AXIS + '[[record]]\nfile = "dataset.toml"\n', ["no reader", ".csv"]),
        (AXIS + RECORD + 'use = "test"\n', ["use", "'test'", "validate"]),
        (AXIS + RECORD + 'name = "a"\n', ["name", "columns"]),
        (AXIS + RECORD + 'units = { position = "furlong" }\n', ["units.position", "furlong", "deg"]),
        (AXIS + RECORD + 'units = { position = "Nm" }\n', ["units.position", "'Nm' measures torque", "deg"]),
        (AXIS + RECORD + 'units = { position = "mm" }\n', ["units.position", "slide joint"]),
        (AXIS + RECORD + 'units = { position = "counts" }\n', ["encoder_counts_per_rev"]),
        (AXIS + RECORD + "units = { position = 3 }\n", ["units.position"]),
        (AXIS + RECORD + 'units = { velocity = "rpm" }\n', ["units.velocity", "no velocity"]),
        (AXIS + RECORD + 'units = { speed = "rpm" }\n', ["units.speed", "velocity"]),
        (AXIS + RECORD + "scale = { torque = 0 }\n", ["scale.torque"]),
        (AXIS + RECORD + 'scale = { torque = "2" }\n', ["scale.torque"]),
        (AXIS + RECORD + 'scale = { torque = 2 }\nunits = { torque = "mNm" }\n', ["torque", "unit and a scale"]),
        (AXIS + RECORD + 'columns = { torque = "effort" }\n', ["'effort'", "torque", "position"]),
        (AXIS + RECORD + 'columns = { effort = "torque" }\n', ["columns.effort"]),
        (AXIS + RECORD + "columns = { torque = 1.5 }\n", ["columns.torque"]),
        (AXIS + RECORD + "columns = { torque = 9 }\n", ["columns.torque", "9"]),
        (AXIS + RECORD + 'columns = { torque = "torque", current = "torque" }\n', ["not both"]),
    ],
)
def test_mistakes_name_the_key_and_what_was_expected(text: str, words: list[str], tmp_path: Path) -> None:
    refuses(tmp_path, text, *words)


def test_a_file_that_is_missing_is_told_with_those_that_are_there(tmp_path: Path) -> None:
    formats.write(tmp_path / "b.json", RUN)
    servo = '[axis]\ncontroller = "position"\n[[record]]\nfile = "A.csv"\n'
    response = '[[frf]]\nfile = "A.csv"\ninput = "torque"\noutput = "position"\n'
    for text in (RECORD.replace("run", "A"), response, servo):
        refuses(tmp_path, text, "A.csv", "no such file", "; logs in that folder: b.json, run.csv")
        refuses(tmp_path, text.replace("A.csv", "other/A.csv"), "; logs in that folder: none")


def test_empty_and_short_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    refuses(tmp_path, AXIS + '[[record]]\nfile = "empty.csv"\n', "empty.csv", "is empty")
    refuses(tmp_path, AXIS + RECORD, "run.csv", "5 samples", **{k: v[:5] for k, v in RUN.items()})


def test_an_axis_that_never_moves_or_is_never_driven_is_refused(tmp_path: Path) -> None:
    refuses(tmp_path, AXIS + RECORD, "position never changes in any record", **{**RUN, "position": np.ones(N)})
    refuses(tmp_path, AXIS + RECORD, "torque is zero", **{**RUN, "torque": np.zeros(N)})


def test_a_record_that_never_moves_is_left_out_beside_others(tmp_path: Path) -> None:
    formats.write(tmp_path / "still.csv", {**RUN, "position": np.ones(N)})
    runs = dataset(tmp_path, AXIS + '[[record]]\nfile = "still.csv"\nuse = "validate"\n' + RECORD, **RUN)
    assert [r.name.partition(" ")[0] for r in runs.records] == ["run.csv", "run.csv"], "cut as if it were alone"
    assert any("still.csv: position never changes: left out" in note for note in runs.notes)


def test_records_to_fit_that_do_not_move_are_refused(tmp_path: Path) -> None:
    """The axis sets out after the part that fits."""
    position = np.maximum(TIME - 0.15, 0.0)
    runs = dataset(tmp_path, AXIS + RECORD, **{**RUN, "position": position})
    with pytest.raises(DataError, match=r"run.csv \(first 60 %\): the position never changes"):
        fit(baseline(runs.inertia), runs.fit)


@pytest.mark.parametrize("torque", [0.0, 0.5])
def test_a_torque_that_never_changes_tells_no_inertia(torque: float, tmp_path: Path) -> None:
    steps = np.where(TIME < 0.15, torque, 1.0)
    runs = dataset(tmp_path, RECORD, **{**RUN, "torque": steps})
    with pytest.raises(DataError, match=r"60 %\): the torque never changes, and no inertia is given"):
        fit(baseline(), runs.fit)

def test_columns_of_different_length_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", time=TIME, torque=TIME[:50], position=TIME)
    refuses(tmp_path, AXIS + '[[record]]\nfile = "run.npz"\n', "torque has 50")


def test_folder_without_dataset_toml_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no dataset\.toml in this folder"):
        load(tmp_path)
    with pytest.raises(DataError, match=r"nowhere: no such file or folder"):
        load(tmp_path / "nowhere")
    formats.write(tmp_path / "bench.csv", RUN)
    for given_, said in ((tmp_path, "no dataset.toml in this folder"), (tmp_path / "bench.csv", "bench.csv: is a log")):
        with pytest.raises(DataError, match=said + r'.* one beside it with \[\[record\]\] and file = "bench.csv"'):
            load(given_)


values = st.recursive(
    st.sampled_from(['"x"', "0", "-1", "1e400", "nan", "true", "[]", "{}", '"run.csv"', '"deg"', '"fit"', '"\\u0000"'])
    | st.integers().map(str),
    lambda inner: st.lists(inner, max_size=2).map(lambda v: f"[{', '.join(v)}]"),
    max_leaves=3,
)
keys = st.sampled_from(["inertia", "kind", "file", "use", "columns", "units", "scale", "torque_constant", "x", "joint"])
lines = st.tuples(keys, values).map(" = ".join) | st.sampled_from(["[axis]", "[[record]]", "[[frf]]", "[record]", '"'])


@anyhow
@given(body=st.lists(lines, max_size=8))
def test_any_dataset_toml_is_read_or_refused_in_one_line(body: list[str], tmp_path: Path) -> None:
    try:
        assert isinstance(dataset(tmp_path, "\n".join(body)), Dataset)
    except DataError as error:
        assert "\n" not in str(error) and "dataset.toml" in str(error)


column = st.lists(st.sampled_from(["0", "1", "-1", "1e308", "nan", "", "x", "0.5", "1e-3"]), min_size=3, max_size=3)


@anyhow
@given(rows=st.lists(column, min_size=1, max_size=30), start=st.booleans())
def test_any_table_is_read_or_refused_in_one_line(rows: list[list[str]], start: bool, tmp_path: Path) -> None:
    good = [f"{k},{k % 7},{k % 3}" for k in range(20)]
    text = "\n".join(["time,torque,position", *(good if start else []), *map(",".join, rows)])
    (tmp_path / "odd.csv").write_text(text)
    try:
        dataset(tmp_path, AXIS + '[[record]]\nfile = "odd.csv"\n')
    except DataError as error:
        assert "\n" not in str(error) and "odd.csv" in str(error)


# Data that others measured.


def test_emps_is_a_measurement_set(data: Path, tmp_path: Path) -> None:
    if not (data / "emps").is_dir():
        pytest.skip(f"no {data / 'emps'}")
    runs = load(emps.write(tmp_path, data / "emps"))
    assert [len(r) for r in (*runs.fit, *runs.validate)] == [24841, 24841] and runs.notes == ()
    assert runs.fit[0].sample_time == pytest.approx(1e-3) and np.ptp(runs.fit[0].torque) > 100


def test_uneven_measured_logs_are_made_even_and_it_is_said(data: Path, tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(
        "[axis]\nencoder_counts_per_rev = 8192\ntorque_constant = 0.1\n[[record]]\n"
        f'file = "{(data / "odrive_cogging/slow_nocomp_0.npy").as_posix()}"\n'
        'columns = { time = 0, position = 1, current = 2 }\nunits = { position = "counts" }\n'
    )
    runs = load(tmp_path)
    assert "resampled" in runs.notes[0] and np.ptp(np.diff(runs.fit[0].time)) < 1e-9


def test_practice_sets_are_read(practice: Path) -> None:
    for folder in sorted(p for p in practice.iterdir() if (p / "dataset.toml").exists()):
        runs = load(folder)
        assert runs.fit and runs.validate and runs.notes == () and runs.fit[0].resolution == 2 * np.pi / 1e6


# Logs of robots.


def test_a_bag_of_a_robot_becomes_a_record_of_each_joint(tmp_path: Path) -> None:
    rosbags = pytest.importorskip("rosbags.rosbag1")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    t = store.types
    with rosbags.Writer(tmp_path / "log.bag") as writer:
        topic = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for i in range(N):
            stamp = t["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=i * 10**6)
            message = t["sensor_msgs/msg/JointState"](
                header=t["std_msgs/msg/Header"](seq=i, stamp=stamp, frame_id=""), name=["hip", "knee"],
                position=np.array([RUN["position"][i], 2 * RUN["position"][i]]), velocity=np.array([]),
                effort=np.array([RUN["torque"][i], 3 * RUN["torque"][i]]),
            )  # fmt: skip
            encoded = store.serialize_ros1(message, "sensor_msgs/msg/JointState")
            writer.write(topic, 1_700_000_000 * 10**9 + i * 10**6, encoded)
    (tmp_path / "leg.xml").write_text(
        '<mujoco><worldbody><body><joint name="hip"/><geom size="0.1"/>'
        '<body><joint name="knee"/><geom size="0.1"/></body></body></worldbody></mujoco>'
    )
    axis = '[axis]\nmodel = "leg.xml"\njoint = ["hip", "knee"]\n'
    record = '[[record]]\nfile = "log.bag"\n[record.columns]\n'
    record += 'position = { hip = "position.hip", knee = "position.knee" }\n'
    for drive, constant, factor in (("torque", "", 1.0), ("current", "torque_constant = 0.5\n", 0.5)):
        columns = f'{drive} = {{ hip = "effort.hip", knee = "effort.knee" }}\n'
        (tmp_path / "dataset.toml").write_text(axis + constant + record + columns)
        for joint, times in (("hip", (1, 1)), ("knee", (3, 2))):
            runs = load(tmp_path, joint=joint)
            torque = np.concatenate([r.torque for r in runs.records])
            assert np.allclose(torque, factor * times[0] * RUN["torque"], atol=1e-12)
            assert np.allclose(np.concatenate([r.position for r in runs.records]), times[1] * RUN["position"])


def test_an_episode_of_a_lerobot_file_is_a_record(tmp_path: Path) -> None:
    index = np.repeat([0.0, 4.0], N)
    columns = {"timestamp": np.tile(TIME, 2), "effort": np.append(RUN["torque"], -RUN["torque"]),
               "angle": np.rad2deg(np.append(RUN["position"], -RUN["position"])), "episode_index": index}  # fmt: skip
    formats.write(tmp_path / "file-000.parquet", columns)
    entry = (
        '[[record]]\nfile = "file-000.parquet"\nunits = { position = "deg" }\n'
        'columns = { time = "timestamp", torque = "effort", position = "angle" }\n'
    )
    (tmp_path / "dataset.toml").write_text(AXIS + entry + 'episode = 0\nuse = "fit"\n' + entry + "episode = 4\n")
    first, second = load(tmp_path).records
    assert (first.name, second.name) == ("file-000.parquet episode 0", "file-000.parquet episode 4")
    assert np.allclose(first.torque, RUN["torque"]) and np.allclose(second.position, -RUN["position"])
    for wrong, message in (
        ("", r"record 1 \(file-000.parquet\): the file has 2 episodes, 0, 4: choose one, as in episode = 0"),
        ("episode = 1\n", "the file has 2 episodes, 0, 4: 1 is none of them"),
        ("episode = 0.5\n", "episode must be a whole number; 0.5 given"),
    ):
        (tmp_path / "dataset.toml").write_text(AXIS + entry + wrong)
        with pytest.raises(DataError, match=message):
            load(tmp_path)
    refuses(tmp_path, AXIS + RECORD + "episode = 1\n", "episode = 1 needs a column 'episode_index'")


def test_numbers_count_the_columns_that_are_text_too(tmp_path: Path) -> None:
    rows = [f"{t},can0,{u!r},RUN,{q!r}" for t, u, q in zip(*(v.tolist() for v in RUN.values()), strict=True)]
    columns = "columns = { time = 0, torque = 2, position = 4 }\n"
    for head in ("t,bus,tau,state,q\n", ""):
        (tmp_path / "run.csv").write_text(head + "\n".join(rows))
        (tmp_path / "dataset.toml").write_text(f'[[record]]\nfile = "run.csv"\n{columns}')
        record = load(tmp_path).records[0]
        assert len(record) + len(load(tmp_path).records[1]) == N, "a first row with text in it is no header"
        assert np.array_equal(record.torque, RUN["torque"][: len(record)])
    (tmp_path / "dataset.toml").write_text(f'[[record]]\nfile = "run.csv"\n{columns.replace("2", "1")}')
    with pytest.raises(DataError, match="line 1: 'can0' is not a number"):
        load(tmp_path)


@pytest.mark.parametrize("name", [1, 2])
@pytest.mark.parametrize("stamp", ["shared", "one after another"])
def test_the_rows_of_one_of_several_motors_are_chosen(name: int, stamp: str, tmp_path: Path) -> None:
    t = np.repeat(TIME, 2) + (np.tile([0, 5e-4], N) if stamp != "shared" else 0)
    torque = np.tile([1.0, 0.3], N) * np.repeat(RUN["torque"], 2)
    position = np.tile([0.0, 0.1], N) + np.repeat(RUN["position"], 2)
    columns = {"time": t, "motor": np.tile([1.0, 2.0], N), "torque": torque, "position": position}
    text = '[[record]]\nfile = "run.csv"\n'
    refuses(tmp_path, text, "rows of 2 axes in turns, by motor", "where = { motor = 1 }", **columns)
    del columns["motor"]
    refuses(tmp_path, text, "continues every 2 rows", "write a file of each", **columns) if stamp != "shared" else None
    columns["motor"] = np.tile([1.0, 2.0], N)
    runs = dataset(tmp_path, f"{text}where = {{ motor = {name} }}\n", **columns)
    record = runs.records[0]
    assert np.array_equal(record.torque, ([1.0, 0.3][name - 1] * RUN["torque"])[: len(record)])
    assert record.name.startswith(f"run.csv motor {name}")
    refuses(tmp_path, text + "where = { motor = 3 }\n", "no row in which motor is 3; it is 1, 2", **columns)
    refuses(tmp_path, text + "where = { axis = 3 }\n", "where: no column 'axis'", **columns)


def test_a_bit_that_toggles_with_every_row_is_no_second_motor(tmp_path: Path) -> None:
    runs = dataset(tmp_path, '[[record]]\nfile = "run.csv"\n', **RUN, alive=np.arange(N) % 2.0)
    assert sum(map(len, runs.records)) == N


@pytest.mark.parametrize(
    ("torque", "position"),
    [("torque_mnm", "position in deg"), ("Torque|mNm", "position{deg}"), ("TORQUE (MNM)", "PositionDeg"),
     ("torque:mNm", "position-deg"), ("torque.mNm", "position_deg_filtered")],
)  # fmt: skip
def test_units_are_read_wherever_a_name_has_them(torque: str, position: str, tmp_path: Path) -> None:
    raw = {"time": TIME, torque: 1e3 * RUN["torque"], position: np.degrees(RUN["position"])}
    text = f'[[record]]\nfile = "run.csv"\ncolumns = {{ torque = "{torque}", position = "{position}" }}\n'
    runs = dataset(tmp_path, text, **raw)
    record = runs.records[0]
    assert np.allclose(record.torque, RUN["torque"][: len(record)])
    assert np.allclose(record.position, RUN["position"][: len(record)])
    assert "torque in" in " ".join(runs.notes) and "position in" in " ".join(runs.notes)


@pytest.mark.parametrize("name", ["Moment", "moment", "Moment [mNm]"])
def test_a_column_may_be_called_without_its_unit(name: str, tmp_path: Path) -> None:
    raw = {"Zeit [s]": TIME, "Moment [mNm]": 1e3 * RUN["torque"], "Lage [deg]": np.degrees(RUN["position"])}
    text = f'[[record]]\nfile = "run.csv"\ncolumns = {{ time = "Zeit", torque = "{name}", position = "lage" }}\n'
    record = dataset(tmp_path, text, **raw).records[0]
    assert np.allclose(record.torque, RUN["torque"][: len(record)])


def test_a_name_that_two_columns_could_mean_is_asked_for(tmp_path: Path) -> None:
    raw = {"time": TIME, "M [Nm]": RUN["torque"], "M [A]": RUN["torque"], "position": RUN["position"]}
    text = '[[record]]\nfile = "run.csv"\ncolumns = { torque = "M" }\n'
    refuses(tmp_path, text, "no column 'M' for torque; the file has M [A], M [Nm], position, time", **raw)


def test_whole_numbers_of_a_current_ask_for_their_size(tmp_path: Path) -> None:
    raw = {"time": TIME, "current": np.round(900 * RUN["torque"]), "position": RUN["position"]}
    text = '[axis]\ntorque_constant = 0.1\n[[record]]\nfile = "run.csv"\n'
    refuses(tmp_path, text, "current has whole numbers only", "scale = { current = ... } [A per count]", **raw)
    assert dataset(tmp_path, text + 'units = { current = "mA" }\n', **raw).records


def test_a_unit_in_a_line_above_the_names_is_told(tmp_path: Path) -> None:
    rows = "\n".join(f"{t},{u},{q}" for t, u, q in zip(*RUN.values(), strict=True))
    for above, word in (("inDegrees=yes\nendheader\n", "Degrees"), ("# angles in deg\n", "deg")):
        (tmp_path / "run.csv").write_text(f"{above}time,torque,position\n{rows}\n")
        (tmp_path / "dataset.toml").write_text('[[record]]\nfile = "run.csv"\n')
        assert f"speaks of {word}" in " ".join(load(tmp_path).notes)
        (tmp_path / "dataset.toml").write_text('[[record]]\nfile = "run.csv"\nunits = { position = "deg" }\n')
        assert "speaks of" not in " ".join(load(tmp_path).notes)


def test_sources_with_clocks_of_their_own_meet_at_the_rows_of_the_position(tmp_path: Path) -> None:
    def cells(values: np.ndarray, here: np.ndarray) -> list[str]:
        return [repr(float(x)) if there else "" for x, there in zip(values, here, strict=True)]

    mine = np.arange(N) % 2 == 0
    rows = zip(map(repr, TIME.tolist()), cells(RUN["torque"], ~mine), cells(RUN["position"], mine), strict=True)
    (tmp_path / "run.csv").write_text("time,torque,position\n" + "\n".join(map(",".join, rows)))
    (tmp_path / "dataset.toml").write_text('[[record]]\nfile = "run.csv"\n')
    runs = load(tmp_path)
    record = runs.records[0]
    assert np.array_equal(record.position, RUN["position"][2::2][: len(record)])
    assert np.array_equal(record.torque, RUN["torque"][1::2][: len(record)]), "held from one command to the next"
    assert "torque stands in other rows than position" in " ".join(runs.notes)


def test_seconds_and_nanoseconds_of_a_stamp_are_one_time(tmp_path: Path) -> None:
    whole, rest = np.divmod(1e9 + 1e6 * np.arange(N) + 5e8, 1e9)
    raw = {"stamp.secs": whole, "stamp.nsecs": rest, "torque": RUN["torque"], "position": RUN["position"]}
    record = dataset(tmp_path, '[[record]]\nfile = "run.csv"\ncolumns = { time = "stamp.secs" }\n', **raw).records[0]
    assert record.sample_time == pytest.approx(1e-3)


def test_a_clock_that_may_be_in_milliseconds_is_doubted(tmp_path: Path) -> None:
    slow = {k: np.tile(v, 100) for k, v in RUN.items()} | {"time": 0.1 * np.arange(100 * N)}
    assert "if its time is in ms" in " ".join(dataset(tmp_path, '[[record]]\nfile = "run.csv"\n', **slow).notes)
    counted = RUN | {"time": np.arange(N)}
    refuses(tmp_path, '[[record]]\nfile = "run.csv"\n', "if it counts rows, say rate = ... [Hz]", **counted)


def test_fields_inside_fields_of_json_are_columns_by_their_path(tmp_path: Path) -> None:
    lines = [
        json.dumps({"t": t, "motors": {"elbow": {"tau": u}}, "q": [0.0, q]})
        for t, u, q in zip(*(v.tolist() for v in RUN.values()), strict=True)
    ]
    (tmp_path / "run.jsonl").write_text("\n".join(lines))
    columns = 'columns = { time = "t", torque = "motors.elbow.tau", position = "q.1" }'
    (tmp_path / "dataset.toml").write_text(f'[[record]]\nfile = "run.jsonl"\n{columns}\n')
    record = load(tmp_path).records[0]
    assert np.array_equal(record.torque, RUN["torque"][: len(record)])


def test_what_no_reader_knows_says_so_and_not_that_it_is_no_toml(tmp_path: Path) -> None:
    (tmp_path / "log.xlsx").write_bytes(b"PK\x03\x04")
    with pytest.raises(DataError, match=r"log\.xlsx: no reader for this kind of file; readable are .* once its"):
        load(tmp_path / "log.xlsx")
