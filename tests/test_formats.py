"""One contract over every file format: what is written comes back, and garbage ends in one line."""

import gzip
import importlib.util
import json
import sys
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet as pq

from gms_mujoco import formats
from gms_mujoco.errors import DataError

OPTIONAL = {  # library of a format, by the suffix
    ".uff": ("pyuff", "uff"), ".unv": ("pyuff", "uff"), ".tdms": ("nptdms", "tdms"), ".mcap": ("mcap", "mcap"),
    ".bag": ("rosbags", "ros"), ".db3": ("rosbags", "ros"),
}  # fmt: skip


def needs(module: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(importlib.util.find_spec(module) is None, reason=f"needs {module}")


SUFFIXES = [
    pytest.param(s, marks=needs(OPTIONAL[s][0])) if s in OPTIONAL else s for s in sorted(formats.suffixes())
]
COLUMNS = {
    "time": np.arange(40) / 1000,
    "torque": np.sin(np.arange(40)) * 1e-3,
    "position": np.cos(np.arange(40)) / 3,
}
anyhow = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


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
    path, whole = tmp_path / f"run{suffix}", tmp_path / f"whole{suffix}"
    if not whole.exists():
        formats.write(whole, COLUMNS)
    content = bytearray(whole.read_bytes())
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


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("t\tq [°]\n0\t1\n1\t2\n", "utf-16"),  # Excel's "Unicode text", PowerShell
        ("\ufefft;q [°]\r\n0;1\r\n1;2\r\n", "utf-8"),
        ("t;q [°]\r0;1\r1;2\r", "cp1252"),
        ("Messung … von gestern\nt;q [°]\n0;1\n1;2\n", "cp1252"),  # the dots end no line
        ("# rig 3\n# t  q [°]\n0 1\n1 2\n", "utf-8"),  # numpy.savetxt
        ("% t,q\n% s,°\n0,1\n1,2\n# pause\n", "utf-8"),
        ("t,q [°],\n0,1,\n1,2,\n", "utf-8"),
        ("t;q [°]\n0;1;\n1;2;\n", "utf-8"),
        ('"t","q [°]"\n"0,0","1,0"\n"1,0","2,0"\n', "utf-8"),
        ("t,q [°]\n0,1D+00\n1,0.2d1\n", "utf-8"),
        ("t   q [°]\n0   1\n1   2\n", "utf-8"),
        ("t:\t0\t1\nq [°]:\t1\t2\n", "utf-8"),
        ("t,s,0,1\nq [°],deg,1,2\n", "utf-8"),
    ],
)
def test_what_laboratories_write(text: str, encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    table = formats.read(tmp_path / "a.txt")
    assert table.named and np.array_equal(table.columns["t"], [0, 1])
    name = next(n for n in table.columns if n.startswith("q"))
    assert np.array_equal(table.columns[name], [1, 2]) and len(table.columns) == 2
    assert "°" in name + table.units.get(name, "")


@pytest.mark.parametrize(("bits", "form"), [(16, "0x{:04X}"), (32, "0x{:08x}"), (32, "0X{:X}")])
def test_numbers_in_hexadecimal_are_signed_as_frames_of_a_bus_have_them(bits: int, form: str, tmp_path: Path) -> None:
    torque = [-200, 5, 0, 32767, -1, -32768]
    rows = [f"{k},{form.format(x % 2**bits)}" for k, x in enumerate(torque)]
    path = tmp_path / "frames.csv"
    path.write_text("\n".join(["time_ms,torque_6077h", *rows]) + "\n")
    assert formats.read(path).columns["torque_6077h"].tolist() == torque


def test_marks_between_thousands_are_no_decimal_commas(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 2: '0.5' has a point and '1,000' in line 2 a comma"):
        formats.read(csv(tmp_path, "f\tq\n1,000\t0.5\n2,000\t0.6\n"))


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
        ("time,torque\n0,1\n1\n2,3\n", r"line 3: 1 columns; expected 2"),
        ("time,torque\n0,1\n\nEOF\nEOF\n", r"line 4: 1 columns; expected 2"),
        ("time,torque\n", r"header but no samples"),
        ("# only a comment\n", r"the file is empty"),
    ],
)
def test_broken_tables_name_the_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        formats.read(csv(tmp_path, text))


def test_columns_of_one_name_are_told_apart(tmp_path: Path) -> None:
    """TwinCAT writes the name and the time of a channel before each."""
    table = formats.read(csv(tmp_path, "Name,Value,Name,Value\n0,1,2,3\n"))
    assert list(table.columns) == ["Name (1)", "Value (1)", "Name (2)", "Value (2)"]


@pytest.mark.parametrize(
    "text",
    [
        "rig,7,\nby,Anna,\nrate,1000,Hz\nt,q,x\n0,1,5\n1,2,5\n",  # as wide as the table
        "Length,2,,\n,,,\nt,q,x,\n0,1,5,\n1,2,5,\n",
        "t;q;x\n0;1;5\n1;2;5\n" + ";;\n" * 3000,
        "LabVIEW\t\nDate\t2024\n***\t\t\t\nt\tq\tx\tnote\n0\t1\t5\t\n1\t2\t5\t\n",
    ],
)
def test_rows_that_are_not_of_the_table_are_left_out(text: str, tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, text))
    there = {k: v.tolist() for k, v in table.columns.items() if k != "note"}
    assert there == {"t": [0, 1], "q": [1, 2], "x": [5, 5]}


def test_a_row_that_was_cut_has_no_numbers(tmp_path: Path) -> None:
    """What stands in it may be the beginning of a longer number."""
    for text in ("t,q,x\n0,1,5\n1,2,5\n2,3", "t,q,x\n0,1,5\n1,2,5\n2\n", "t q x\n0 1 5\n1 2 5\n2 3"):
        table = formats.read(csv(tmp_path, text))
        for name, numbers in (("t", [0, 1]), ("q", [1, 2]), ("x", [5, 5])):
            assert np.array_equal(table.columns[name], [*numbers, np.nan], equal_nan=True)


STAMPS = {
    "2024-03-05T14:30:59.500Z": ("2024-03-05T14:30:59.750Z", 0.25),
    "2024-03-05 14:30:59": ("2024-03-05T15:31:00+01:00", 1.0),
    "2024-03-05 14:30:59.123456789": ("2024-03-05 14:30:59.123457789", 1e-6),
    "05.03.2024 23:59:59,5": ("06.03.2024 00:00:00,25", 0.75),
    "05-Mar-2024 14:30:59.500": ("05-Mar-2024 14:30:59.501", 1e-3),
    "31/01/2024 23:59:59": ("01/02/2024 00:00:01", 2.0),  # a log lasts no months
    "1/31/2024 11:59:59 PM": ("2/1/2024 12:00:01 AM", 2.0),
    "3/5/2024 12:59:59 PM": ("3/5/2024 1:00:00 PM", 1.0),
    "23:59:59.900": ("00:00:00.100", 0.2),
    "59:59.5": ("00:00.1", 0.6),
    "14:30:59:500": ("14:31:00:250", 0.75),
}


@pytest.mark.parametrize(("first", "second"), STAMPS.items())
def test_dates_and_times_of_day_are_seconds_from_the_first(
    first: str, second: tuple[str, float], tmp_path: Path
) -> None:
    for text in (f"when;q\n{first};1\n{second[0]};2\n;3\n", f"{first};1\n{second[0]};2\n;3\n"):  # header or none
        time, *_ = formats.read(csv(tmp_path, text)).columns.values()
        np.testing.assert_allclose(time, [0, second[1], np.nan], rtol=1e-9)


def test_what_only_begins_like_a_time_stamp_is_none(tmp_path: Path) -> None:
    table = formats.read(csv(tmp_path, "when,q\n2024-03-05T14:30:59,1\nlater,2\n"))
    assert list(table.columns) == ["q"] and "is not a number" in table.unusable["when"]


def test_columns_of_dates_are_seconds_in_tables_with_types(tmp_path: Path) -> None:
    stamps = np.array(["2024-03-05T14:30:59.5", "2024-03-05T14:31:00.25", "NaT"], "datetime64[us]")
    spans = np.array([500, 1250, "NaT"], "timedelta64[ms]")
    pq.write_table(pa.table({"when": stamps, "there": pa.array(stamps, pa.timestamp("ns", "Europe/Berlin")),
                             "span": spans, "clock": pa.array([1000, 1750, None], pa.time32("ms"))}),
                   tmp_path / "a.parquet")  # fmt: skip
    np.savez(tmp_path / "a.npz", when=stamps, span=spans)
    for file, names in (("a.parquet", ("when", "there", "clock")), ("a.npz", ("when",))):
        columns = formats.read(tmp_path / file).columns
        np.testing.assert_allclose(columns["span"], [0.5, 1.25, np.nan])
        for name in names:
            np.testing.assert_allclose(columns[name], [0, 0.75, np.nan])


def test_true_and_false_are_numbers(tmp_path: Path) -> None:
    assert formats.read(csv(tmp_path, "t,on\n0,TRUE\n1,false\n")).columns["on"].tolist() == [1, 0]


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


@pytest.mark.parametrize("compressed", [False, True])
def test_a_mat_file_with_an_element_of_no_type_does_not_end_the_process(compressed: bool, tmp_path: Path) -> None:
    """SciPy looks such a type up beyond the end of a table."""
    nested = {"t": np.arange(9.0), "s": {"a": np.arange(3.0), "b": "text"}, "c": np.array([1.0, "x"], dtype=object)}
    scipy.io.savemat(tmp_path / "run.mat", nested, do_compression=compressed)
    content = (tmp_path / "run.mat").read_bytes()
    assert set(formats.read(tmp_path / "run.mat").columns) == {"t", "s.a"}
    if compressed:
        size = int.from_bytes(content[132:136], "little")
        inner = bytearray(zlib.decompress(content[136 : 136 + size]))
        place = inner.index(b"\x09\0\0\0\x48\0\0\0")  # 72 bytes of doubles
        inner[place] = 92
        packed = zlib.compress(bytes(inner))
        content = content[:132] + len(packed).to_bytes(4, "little") + packed
    else:
        place = content.index(b"\x09\0\0\0\x48\0\0\0")
        content = content[:place] + b"\x5c" + content[place + 1 :]
    (tmp_path / "run.mat").write_bytes(content)
    with pytest.raises(DataError, match=r"run.mat: cut or damaged: an element of type 92 and 72 bytes"):
        formats.read(tmp_path / "run.mat")


def mat_7_3(path: Path, arrays: dict[str, object]) -> Path:
    """A file laid out as MATLAB lays out version 7.3: HDF5 behind a block of text, dimensions in reverse."""
    h5py = pytest.importorskip("h5py")

    def put(group, name: str, value: object) -> None:
        if isinstance(value, dict):
            inner = group.create_group(name)
            for key, part in value.items():
                put(inner, key, part)
        elif isinstance(value, list):  # of structs: each field is an array of references
            inner = group.create_group(name)
            for key in value[0]:
                refer(inner, key, [part[key] for part in value])
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
            refer(group, name, value.tolist()).attrs["MATLAB_class"] = np.bytes_("cell")
        elif isinstance(value, str):
            item = group.create_dataset(name, data=np.array([[ord(c)] for c in value], np.uint16))
            item.attrs["MATLAB_class"] = np.bytes_("char")
        else:
            array = np.atleast_2d(value).T
            if np.iscomplexobj(array):
                pair = np.empty(array.shape, [("real", "f8"), ("imag", "f8")])
                pair["real"], pair["imag"] = array.real, array.imag
                array = pair
            group.create_dataset(name, data=array).attrs["MATLAB_class"] = np.bytes_("double")

    def refer(group, name: str, parts: list[object]):
        refs = group.file.require_group("#refs#")
        names = [f"{len(refs) + i}" for i in range(len(parts))]
        for label, part in zip(names, parts, strict=True):
            put(refs, label, part)
        return group.create_dataset(name, data=np.array([[refs[n].ref] for n in names], h5py.ref_dtype))

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in arrays.items():
            put(file, name, value)
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/x")
    content = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema 1.00 .".ljust(512) + content[512:])
    return path


def test_mat_7_3_is_read_like_the_older_ones(tmp_path: Path) -> None:
    log = {"t": np.arange(20.0)[:, None], "log": {"q": np.ones((1, 20)), "who": "me"}, "gain": 3.0}
    log |= {"m": np.arange(60.0).reshape(20, 3), "h": np.array([1 + 2j, 3, 4j])}
    new = formats.read(mat_7_3(tmp_path / "new.mat", log))
    scipy.io.savemat(tmp_path / "old.mat", log)
    old = formats.read(tmp_path / "old.mat")
    assert set(new.columns) == set(old.columns) == {"t", "log.q", "m.0", "m.1", "m.2", "h.real", "h.imag"}
    assert all(np.array_equal(new.columns[k], old.columns[k]) for k in new.columns)
    assert new.unusable == old.unusable


def test_arrays_of_structs_and_cells_of_matlab_are_numbered_as_there(tmp_path: Path) -> None:
    runs = [{"t": np.arange(9.0) + i, "q": {"raw": np.ones(9) * i}} for i in range(2)]
    cell = np.empty(3, dtype=object)
    cell[:] = [np.arange(9.0), "text", np.arange(9.0) - 1]
    old_runs = np.empty(2, dtype=[("t", "O"), ("q", "O")])
    for i, run in enumerate(runs):
        old_runs[i] = tuple(run.values())
    scipy.io.savemat(tmp_path / "old.mat", {"run": old_runs, "c": cell})
    found = [formats.read(tmp_path / "old.mat")]
    if importlib.util.find_spec("h5py"):
        found.append(formats.read(mat_7_3(tmp_path / "new.mat", {"run": runs, "c": cell})))
    for table in found:
        assert set(table.columns) == {"run(1).t", "run(2).t", "run(1).q.raw", "run(2).q.raw", "c{1}", "c{3}"}
        assert np.array_equal(table.columns["run(2).t"], np.arange(9.0) + 1)
        assert np.array_equal(table.columns["c{3}"], np.arange(9.0) - 1) and list(table.unusable) == ["c{2}"]


@anyhow
@given(cut=st.floats(0, 1), flip=st.integers(600, 10_000))
def test_a_damaged_mat_7_3_is_a_data_error(cut: float, flip: int, tmp_path: Path) -> None:
    content = bytearray(mat_7_3(tmp_path / "run.mat", dict(COLUMNS)).read_bytes())
    content[flip % len(content)] ^= 0x55
    (tmp_path / "run.mat").write_bytes(content[: int(cut * len(content))] if cut < 0.8 else content)
    try:
        formats.read(tmp_path / "run.mat")
    except DataError as error:
        assert "\n" not in str(error) and "run.mat" in str(error)


@pytest.mark.parametrize(
    ("name", "content", "module", "extra"),
    [
        ("run.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(600), "h5py", "hdf5"),
        ("run.tdms", b"TDSm".ljust(60), "nptdms", "tdms"),
        ("run.mcap", b"x", "mcap.reader", "mcap"),
        ("run.uff", b"    -1\n", "pyuff", "uff"),
        ("run.bag", b"#ROSBAG V2.0\n", "rosbags.highlevel", "ros"),
        ("run.db3", b"SQLite format 3\0", "rosbags.highlevel", "ros"),
    ],
)
def test_a_missing_extra_is_named_in_one_line(
    name: str, content: bytes, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(content)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DataError, match=rf"need {module.split('.')[0]}: pip install 'gms-mujoco\[{extra}\]'"):
        formats.read(tmp_path / name)


# Logs of LabVIEW and of robots.


@needs("nptdms")
def test_tdms_channels_of_a_waveform_know_their_time(tmp_path: Path) -> None:
    import nptdms

    wave = {"wf_increment": 1e-3, "wf_start_offset": 0.5, "unit_string": "V"}
    texts = nptdms.ChannelObject("daq", "comment", ["a", "b"])
    for groups in (("daq",), ("daq", "slow")):
        with nptdms.TdmsWriter(str(tmp_path / "run.tdms")) as writer:
            channels = [nptdms.ChannelObject(g, "u", np.arange(5, dtype=np.int16), wave) for g in groups]
            writer.write_segment([*channels, texts])
        table = formats.read(tmp_path / "run.tdms")
        names = ["u"] if len(groups) == 1 else ["daq.u", "slow.u"]
        assert list(table.columns) == ["time", *names] and table.units[names[0]] == "V"
        assert np.allclose(table.columns["time"], 0.5 + 1e-3 * np.arange(5))
        assert np.array_equal(table.columns[names[0]], np.arange(5))
        assert list(table.unusable.values()) == ["it holds no numbers"]


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@needs("mcap_ros2")
def test_mcap_of_a_robot_names_its_joints(tmp_path: Path) -> None:
    from mcap_ros2.writer import Writer

    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for i in range(20):
            stamp = {"sec": 1_700_000_000 + i // 10, "nanosec": 100_000_000 * (i % 10) + 7}
            message = {
                "header": {"stamp": stamp, "frame_id": "base"}, "name": ["shoulder", "elbow"],
                "position": [0.1 * i, 0.2 * i], "velocity": [], "effort": [1.0, 2.0],
            }  # fmt: skip
            logged = 1_700_000_000 * 10**9 + 10**8 * i + 9
            writer.write_message("/joint_states", schema, message, logged, logged)
        writer.finish()
    table = formats.read(tmp_path / "run.mcap")
    assert np.allclose(table.columns["time"] - table.columns["time"][0], 0.1 * np.arange(20), atol=1e-8)
    assert np.array_equal(table.columns["position.elbow"], [0.2 * i for i in range(20)])
    assert np.array_equal(table.columns["effort.shoulder"], np.ones(20)) and "header.frame_id" in table.unusable


@needs("mcap")
def test_mcap_of_several_topics_keeps_them_apart(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = {t: writer.register_channel(t, e, 0) for t, e in (("/a", "json"), ("/b/c", "json"), ("/d", "ros1"))}
        for i in range(6):
            for topic, channel in channels.items():
                if topic != "/a" or i % 2:
                    data = f'{{"x": [{i}, {i + 0.5}], "mode": "on"}}'.encode()
                    writer.add_message(channel, log_time=10**18 + i * 10**6, publish_time=0, data=data)
        writer.finish()
    table = formats.read(tmp_path / "run.mcap")
    assert {k: len(v) for k, v in table.columns.items()} == {
        "a.x.0": 3, "a.x.1": 3, "a.time": 3, "b/c.x.0": 6, "b/c.x.1": 6, "b/c.time": 6,
    }  # fmt: skip
    assert np.allclose(table.columns["a.time"], [1e-3, 3e-3, 5e-3]) and "ros1" in table.unusable["/d"]


def test_servo_log_fields_are_columns(tmp_path: Path) -> None:
    entries = [{"timestamp": i / 100, "position": 1.0, "torque_enable": True, "id": "a"} for i in range(20)]
    del entries[7]["position"]
    (tmp_path / "log.json").write_text(json.dumps({"mass": 1.0, "entries": entries}))
    table = formats.read(tmp_path / "log.json")
    assert set(table.columns) == {"timestamp", "torque_enable", "position"} and "id" in table.unusable
    assert np.array_equal(np.flatnonzero(np.isnan(table.columns["position"])), [7])


def test_dates_as_text_are_seconds_in_every_format_that_has_text(tmp_path: Path) -> None:
    when = [f"2026-03-12T14:22:{59 + i / 4:09.6f}" for i in range(4)]
    rows = [{"when": t, "x": 1.0} for t in when]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, rows)))
    pq.write_table(pa.table({"when": when, "x": np.ones(4)}), tmp_path / "a.parquet")
    np.savez(tmp_path / "a.npz", when=when, x=np.ones(4))
    for suffix in (".json", ".jsonl", ".parquet", ".npz"):
        assert np.allclose(formats.read(tmp_path / f"a{suffix}").columns["when"], [0.0, 0.25, 0.5, 0.75])


def test_a_sample_keeps_its_number_where_others_are_left_out() -> None:
    table = formats.Table({"x": np.arange(9.0)})
    assert table.place(3) == "sample 3"
    assert table.rows(slice(2, 8)).rows(np.arange(6) > 2).place(1) == "sample 6"


@pytest.mark.parametrize("suffix", [".json", ".jsonl"])
def test_a_null_of_json_is_no_number_and_a_byte_order_mark_does_not_matter(suffix: str, tmp_path: Path) -> None:
    entries = [{"t": 0.1 * i, "q": None if i == 3 else 1.0 * i, "none": None, "in": [None, 2]} for i in range(5)]
    lines = "\n".join(map(json.dumps, entries))
    (tmp_path / f"log{suffix}").write_text(json.dumps(entries) if suffix == ".json" else lines, encoding="utf-8-sig")
    table = formats.read(tmp_path / f"log{suffix}")
    assert [*table.columns] == ["t", "q", "none", "in.0", "in.1"] and not table.unusable
    assert np.array_equal(table.columns["q"], [0, 1, 2, np.nan, 4], equal_nan=True) and table.columns["t"][3] == 0.1 * 3
    (tmp_path / "lists.json").write_text('{"t": [0, 1, 2], "q": [null, 1, 2]}')
    assert np.isnan(formats.read(tmp_path / "lists.json").columns["q"][0])


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


@needs("rosbags")
@pytest.mark.parametrize("suffix", [".bag", ".db3"])
def test_rosbag_of_a_robot_names_its_joints(suffix: str, tmp_path: Path) -> None:
    path = ros_log(tmp_path, suffix)
    table = formats.read(path)
    assert np.allclose(table.columns["joint_states.time"], 0.1 * np.arange(20), atol=1e-8)
    assert np.array_equal(table.columns["joint_states.position.elbow"], [0.2 * i for i in range(20)])
    assert np.array_equal(table.columns["joint_states.effort.shoulder"], np.sin(np.arange(20)))
    assert "joint_states.velocity" not in table.columns and len(table.columns["load.wrench.force.x"]) == 10


@needs("rosbags")
def test_a_db3_from_before_iron_is_read_with_the_messages_of_ros(tmp_path: Path) -> None:
    """Such a bag does not say how its messages are laid out."""
    import sqlite3

    path = ros_log(tmp_path, ".db3")
    with sqlite3.connect(path) as base:
        base.execute("DROP TABLE message_definitions")
        base.execute("DROP TABLE schema")
        base.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
        base.execute("UPDATE topics SET type = 'acme_msgs/msg/Odd' WHERE name = '/load'")
        base.commit()
        base.execute("VACUUM")
    base.close()
    table = formats.read(path)
    assert np.array_equal(table.columns["position.elbow"], [0.2 * i for i in range(20)])
    assert "acme_msgs/msg/Odd, is not known" in table.unusable["/load"]


def ros_log(folder: Path, suffix: str) -> Path:
    """A log of 20 joint states and 10 wrenches, as a robot of ROS 1 or ROS 2 writes it."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    old = suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    t = store.types
    encode = store.serialize_ros1 if old else store.serialize_cdr

    def header(seconds: float):
        whole, part = divmod(round(seconds * 1e9), 10**9)
        stamp = t["builtin_interfaces/msg/Time"](sec=1_700_000_000 + whole, nanosec=part)
        seq = {"seq": 0} if old else {}
        return t["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **seq)

    path = folder / f"log{suffix}"
    writer = rosbag1.Writer(path) if old else rosbag2.Writer(folder / "log", version=9)
    with writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        loads = writer.add_connection("/load", "geometry_msgs/msg/WrenchStamped", typestore=store)
        for i in range(20):
            state = t["sensor_msgs/msg/JointState"](
                header=header(0.1 * i), name=["shoulder", "elbow"], position=np.array([0.1 * i, 0.2 * i]),
                velocity=np.array([]), effort=np.array([np.sin(i), 2.0]),
            )  # fmt: skip
            logged = 1_700_000_000 * 10**9 + 10**8 * i
            writer.write(states, logged, encode(state, "sensor_msgs/msg/JointState"))
            if i % 2:
                vector = t["geometry_msgs/msg/Vector3"](x=float(i), y=0.0, z=0.0)
                wrench = t["geometry_msgs/msg/Wrench"](force=vector, torque=vector)
                load = t["geometry_msgs/msg/WrenchStamped"](header=header(0.1 * i), wrench=wrench)
                writer.write(loads, logged, encode(load, "geometry_msgs/msg/WrenchStamped"))
    return path if old else (folder / "log" / "log.db3").rename(path)


@needs("rosbags")
@pytest.mark.parametrize("suffix", [".bag", ".db3"])
@anyhow
@given(cut=st.floats(0, 1), flips=st.lists(st.integers(0, 100_000), max_size=3))
def test_a_damaged_log_of_a_robot_is_a_data_error(suffix: str, cut: float, flips: list[int], tmp_path: Path) -> None:
    whole = tmp_path / f"log{suffix}"
    content = bytearray((whole if whole.exists() else ros_log(tmp_path, suffix)).read_bytes())
    for flip in flips:
        content[flip % len(content)] ^= 0x55
    path = tmp_path / f"run{suffix}"
    path.write_bytes(content[: int(cut * len(content))] if cut < 0.8 else content)
    try:
        formats.read(path)
    except DataError as error:
        assert "\n" not in str(error) and f"run{suffix}" in str(error)


def lerobot(folder: Path, names: object, episodes: int, kind: object = None) -> Path:
    """A data set in the layout of LeRobot: two joints at 30 Hz, 20 samples in each episode."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    n = 20 * episodes
    kind = kind or pa.list_(pa.float32())
    state = np.stack([np.arange(n), -np.arange(n)], axis=1).astype(np.float32)
    frame = np.tile(np.arange(20), episodes)
    table = pa.table(
        {
            "observation.state": pa.array(state.tolist(), kind),
            "action": pa.array((state + 1).tolist(), kind),
            "timestamp": pa.array((frame / 30).astype(np.float32)),
            "frame_index": pa.array(frame),
            "episode_index": pa.array(np.repeat(np.arange(episodes), 20)),
        }
    )
    path = folder / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    (folder / "meta").mkdir()
    pq.write_table(table, path)
    feature = {"dtype": "float32", "shape": [2], "names": names}
    info = {"codebase_version": "v3.0", "fps": 30, "features": {"observation.state": feature, "action": feature}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return path


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["pan.pos", "lift.pos"], ["pan.pos", "lift.pos"]),
        ({"motors": ["pan", "lift"]}, ["pan", "lift"]),
        (None, ["0", "1"]),
        (["only one"], ["0", "1"]),
        (["twice", "twice"], ["0", "1"]),
    ],
)
def test_lerobot_says_what_the_places_of_a_list_are(names: object, found: list[str], tmp_path: Path) -> None:
    import pyarrow as pa

    for i, kind in enumerate((pa.list_(pa.float32()), pa.list_(pa.float32(), 2), pa.large_list(pa.float64()))):
        table = formats.read(lerobot(tmp_path / str(i), names, 1, kind))
        assert [k for k in table.columns if k.startswith("action.")] == [f"action.{k}" for k in found]
        assert np.array_equal(table.columns[f"observation.state.{found[1]}"], -np.arange(20.0))


def test_an_episode_is_chosen_and_never_guessed(tmp_path: Path) -> None:
    table = formats.read(lerobot(tmp_path, ["a", "b"], 3))
    one = table.episode(2)
    assert np.array_equal(one.columns["action.a"], np.arange(41.0, 61.0))
    assert np.allclose(one.columns["timestamp"], np.arange(20) / 30, atol=1e-6)
    with pytest.raises(DataError, match="the file has 3 episodes, 0, 1, 2: choose one, as in episode = 0"):
        table.episode(None)
    with pytest.raises(DataError, match="3 episodes, 0, 1, 2: 7 is none of them"):
        table.episode(7)
    assert one.episode(None) is one
    with pytest.raises(DataError, match="episode = 1 needs a column 'episode_index'; the file has time"):
        formats.Table({"time": np.arange(3.0)}).episode(1)


def test_lists_that_are_no_columns_are_told(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = {"ragged": [[1.0], [1.0, 2.0]], "hole": [[1.0], None], "text": [["a"], ["b"]], "x": [1, 2]}
    rows |= {"none": pa.array([[], []], pa.list_(pa.float32()))}
    pq.write_table(pa.table(rows), tmp_path / "run.parquet")
    table = formats.read(tmp_path / "run.parquet")
    assert list(table.columns) == ["x"]
    assert table.unusable == {
        "ragged": "its lists have different lengths", "hole": "its lists have different lengths",
        "text": "it holds lists of string, not of numbers", "none": "its lists are empty",
    }  # fmt: skip


@pytest.mark.parametrize("content", ["", "{", "[]", '{"features": 3}', '{"features": {"action": []}}', "[" * 100_000])
def test_a_damaged_description_of_a_lerobot_set_leaves_numbers(content: str, tmp_path: Path) -> None:
    path = lerobot(tmp_path, ["a", "b"], 1)
    (tmp_path / "meta" / "info.json").write_text(content)
    assert "action.0" in formats.read(path).columns
