"""One contract over every file format: what is written comes back, and garbage ends in one line."""

import gzip
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gms_mujoco import formats
from gms_mujoco.errors import DataError

HAS_UFF = importlib.util.find_spec("pyuff") is not None
NEEDS_UFF = pytest.mark.skipif(not HAS_UFF, reason="universal files need pyuff: pip install 'gms-mujoco[uff]'")
SUFFIXES = [
    pytest.param(s, marks=NEEDS_UFF) if s in (".uff", ".unv") else s for s in sorted(formats.suffixes())
]
COLUMNS = {
    "time": np.arange(40) / 1000,
    "torque": np.sin(np.arange(40)) * 1e-3,
    "position": np.cos(np.arange(40)) / 3,
}
anyhow = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def csv(tmp_path: Path, text: str, name: str = "run.csv") -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


# The contract.


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_columns_come_back_to_the_last_bit(suffix: str, tmp_path: Path) -> None:
    formats.write(tmp_path / f"run{suffix}", COLUMNS)
    table = formats.read(tmp_path / f"run{suffix}")
    assert list(table.columns) == (list(COLUMNS) if table.named else ["0", "1", "2"])
    for given_, read in zip(COLUMNS.values(), table.columns.values(), strict=True):
        assert read.dtype == np.float64 and np.array_equal(read, given_)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_suffix_in_capitals_is_the_same_format(suffix: str, tmp_path: Path) -> None:
    formats.write(tmp_path / f"RUN{suffix.upper()}", COLUMNS)
    assert len(formats.read(tmp_path / f"RUN{suffix.upper()}").columns) == 3


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file_is_named(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"run{suffix}").touch()
    with pytest.raises(DataError, match=rf"run{suffix}: the file is empty"):
        formats.read(tmp_path / f"run{suffix}")


@pytest.mark.parametrize("suffix", SUFFIXES)
@anyhow
@given(content=st.binary(min_size=1, max_size=400))
def test_garbage_is_a_data_error_of_one_line(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(gzip.compress(content) if suffix.endswith(".gz") else content)
    try:
        formats.read(path)
    except DataError as error:
        assert f"run{suffix}" in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("suffix", SUFFIXES)
@anyhow
@given(cut=st.floats(0, 0.99), flip=st.integers(0, 10_000))
def test_truncated_or_damaged_file_is_a_data_error(suffix: str, cut: float, flip: int, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    formats.write(path, COLUMNS)
    content = bytearray(path.read_bytes())
    content[flip % len(content)] ^= 0x55
    path.write_bytes(content[: int(cut * len(content))] if cut < 0.8 else content)
    try:
        formats.read(path)
    except DataError as error:
        assert "\n" not in str(error)


def test_unknown_suffix_names_the_known() -> None:
    with pytest.raises(DataError, match=r"run\.xlsx: no reader .*\.csv\.gz.*\.parquet"):
        formats.read("run.xlsx")


def test_missing_file_is_named() -> None:
    with pytest.raises(DataError, match=r"nowhere\.csv: no such file"):
        formats.read("nowhere.csv")


# CSV.


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("time,torque\n0,1\n1,2\n", ["time", "torque"]),
        ("0,1\n1,2\n", ["0", "1"]),
        ("# a comment\n\n% another\ntime\ttorque\n0\t1\n\n1\t2\n", ["time", "torque"]),
        ("time;torque\n0;1,0\n1;2,0\n", ["time", "torque"]),
        ("  0   1\n  1   2\n", ["0", "1"]),
        ('\ufeff"time" , "torque"\r\n0, 1\r\n1, 2\r\n', ["time", "torque"]),
    ],
)
def test_dialects_of_text_tables(text: str, names: list[str], tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, text))
    assert list(table.columns) == names and table.named == (names[0] != "0")
    assert np.array_equal(list(table.columns.values()), [[0, 1], [1, 2]])


def test_lines_that_begin_with_a_name_are_columns_on_their_side(tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, "f [Hz];0,5;1;2\nmag;1,5;2;3\n"))
    assert {k: v.tolist() for k, v in table.columns.items()} == {"f [Hz]": [0.5, 1, 2], "mag": [1.5, 2, 3]}
    with pytest.raises(DataError, match="line 2: two lines are called 'a'"):
        formats.read(csv(tmp_path, "a,1,2\na,3,4\n"))


def test_text_in_a_column_is_told_with_its_line(tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, "time,torque,mode\n0,1,idle\n\n1,x2,run\n2,3,run\n"))
    assert list(table.columns) == ["time"]
    assert table.unusable == {"torque": "line 4: 'x2' is not a number", "mode": "line 2: 'idle' is not a number"}
    assert table.place(1) == "line 4"


def test_missing_cell_is_not_a_number(tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, "time,torque\n0,1\n1,\n2,nan\n"))
    assert np.array_equal(table.columns["torque"], [1, np.nan, np.nan], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,torque\n0,1\n0.1,1,7\n", r"line 3: 3 columns; expected 2"),
        ("time,time\n0,1\n", r"line 1: two columns are called 'time'"),
        ("time,torque\n", r"header but no samples"),
        ("# only a comment\n", r"the file is empty"),
    ],
)
def test_broken_tables_name_the_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        formats.read(csv(tmp_path, text))


# The others.


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", time=np.array([{"a": 1}], dtype=object))
    np.save(tmp_path / "run.npy", np.array([{"a": 1}], dtype=object))
    for name in ("run.npz", "run.npy"):
        with pytest.raises(DataError, match="pickle"):
            formats.read(tmp_path / name)


def test_npy_of_rows_or_columns(tmp_path: Path) -> None:
    for rows in (np.ones((3, 50)), np.ones((50, 3))):
        np.save(tmp_path / "run.npy", rows)
        assert [len(c) for c in formats.read(tmp_path / "run.npy").columns.values()] == [50, 50, 50]


def test_mat_columns_and_structs_are_columns_and_scalars_are_not(tmp_path: Path) -> None:
    log = {"t": np.ones((20, 1)), "log": {"q": np.ones((1, 20))}, "gain": 3.0, "who": "me"}
    scipy.io.savemat(tmp_path / "run.mat", log)
    table = formats.read(tmp_path / "run.mat")
    assert {k: v.shape for k, v in table.columns.items()} == {"t": (20,), "log.q": (20,)}
    assert table.unusable == {"gain": "it is a single number", "who": "it holds no numbers"}


def test_mat_7_3_says_how_to_save(tmp_path: Path) -> None:
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(600))
    with pytest.raises(DataError, match="-v7"):
        formats.read(tmp_path / "run.mat")


def test_servo_log_fields_are_columns(tmp_path: Path) -> None:
    entries = [{"timestamp": i / 100, "position": 1.0, "torque_enable": True, "id": "a"} for i in range(20)]
    del entries[7]["position"]
    (tmp_path / "log.json").write_text(json.dumps({"mass": 1.0, "entries": entries}))
    table = formats.read(tmp_path / "log.json")
    assert set(table.columns) == {"timestamp", "torque_enable"}
    assert table.unusable["position"] == "sample 7: nothing is not a number"


def test_a_number_too_large_in_json_is_a_data_error(tmp_path: Path) -> None:
    (tmp_path / "log.json").write_text('{"t": [' + "9" * 400 + ", 1]}")
    with pytest.raises(DataError):
        formats.read(tmp_path / "log.json")


def test_measured_files_are_read(data: Path) -> None:
    for name, columns in {
        "emps/DATA_EMPS.mat": 4,
        "ur10e/ur-20_01_22-joint_1.csv": 31,
        "odrive_cogging/slow_nocomp_0.npy": 3,
        "dcmotor_bode/raw_motor_data.dat": 3,
    }.items():
        if (data / name).exists():
            assert len(formats.read(data / name).columns) == columns
