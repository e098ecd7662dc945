"""Frequency responses from files, in the shapes that laboratories write, and what is ambiguous is refused."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet as pq

from gms_mujoco import formats
from gms_mujoco.dataset import Dataset, load
from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF, to_csv
from gms_mujoco.responses.frf_table import from_control, from_table
from gms_mujoco.responses.resonance import antiresonances

F = np.geomspace(1, 300, 40)
G = 1 / (0.5 + 1e-3j * 2 * np.pi * F - 2.4e-5 * (2 * np.pi * F) ** 2)
MAG, ARG = np.abs(G), np.angle(G)
ENTRY = '[[frf]]\nfile = "{}"\ninput = "torque"\noutput = "position"\namplitude = 1e-3\n'
POLAR = "columns = { frequency = 0, magnitude = 1, phase = 2 }\n"
needs_uff = pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff (gms-mujoco[uff])")
anyhow = settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])


def rows(header: str, *columns: np.ndarray, separator: str = ",") -> str:
    body = [separator.join(f"{v:.12g}" for v in row) for row in zip(*columns, strict=True)]
    return "\n".join(([header] if header else []) + body) + "\n"


def dataset(folder: Path, text: str, name: str = "level.csv", extra: str = "", axis: str = "") -> Dataset:
    (folder / name).write_text(text, encoding="utf-8")
    (folder / "dataset.toml").write_text(axis + ENTRY.format(name) + extra, encoding="utf-8")
    return load(folder)


def close(frf: FRF, response: np.ndarray = G) -> bool:
    return np.allclose(frf.frequency, F) and np.allclose(frf.response, response, rtol=1e-6)


# Shapes.


@pytest.mark.parametrize(
    ("text", "extra"),
    [
        (rows("frequency [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), ""),
        (rows("freq_hz,mag_db,phase_deg", F, 20 * np.log10(MAG), np.degrees(ARG)), ""),
        (rows("omega,gain (dB),phase (deg)", 2 * np.pi * F, 20 * np.log10(MAG), np.degrees(ARG)), ""),
        (rows("w [rad/s];|G| [abs];arg [rad]", 2 * np.pi * F, MAG, ARG, separator=";").replace(".", ","), ""),
        (rows("f (Hz)\treal\timag", F, G.real, G.imag, separator="\t"), ""),
        (rows("", F, MAG, ARG, separator=" "),
         POLAR + 'units = { frequency = "Hz", magnitude = "abs", phase = "rad" }\n'),
        ("\n".join(",".join(f"{v:.12g}" for v in line) for line in (2 * np.pi * F, MAG, ARG)),
         POLAR + 'units = { frequency = "rad/s", magnitude = "abs", phase = "rad" }\n'),
        ("\n".join(",".join([name, *(f"{v:.12g}" for v in line)])
                   for name, line in (("omega", 2 * np.pi * F), ("mag [abs]", MAG), ("phase [rad]", ARG))), ""),
        (rows("Hz,magnitude [dB],phase", F, 20 * np.log10(MAG), np.degrees(np.unwrap(ARG))), ""),
        (rows("frequency [Hz],magnitude [abs],phase [rad]", F[::-1], MAG[::-1], ARG[::-1]), ""),
    ],
)  # fmt: skip
def test_every_shape_is_the_same_response(text: str, extra: str, tmp_path: Path) -> None:
    runs = dataset(tmp_path, text, extra=extra)
    frf = runs.frfs[0]
    assert close(frf) and frf.unit == "rad/(N m)"
    assert np.allclose(frf.excitation, 1e-3) and np.allclose(frf.amplitude, 1e-3 * np.abs(G))
    assert "position over torque" in runs.notes[0] and "40 frequencies" in runs.notes[0]


def test_matlab_vectors_complex_and_not(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"f": F[:, None], "H": G[None, :]})
    columns = 'columns = { real = "H.real", imag = "H.imag" }\n'
    (tmp_path / "dataset.toml").write_text(ENTRY.format("a.mat") + columns + 'units = { frequency = "Hz" }\n')
    assert close(load(tmp_path).frfs[0])
    scipy.io.savemat(tmp_path / "a.mat", {"freq": F, "mag": MAG, "phase": ARG})
    text = ENTRY.format("a.mat") + 'units = { frequency = "Hz", magnitude = "abs", phase = "rad" }\n'
    (tmp_path / "dataset.toml").write_text(text)
    assert close(load(tmp_path).frfs[0])


@needs_uff
def test_universal_file_states_its_frequency(tmp_path: Path) -> None:
    formats.write(tmp_path / "a.uff", {"frequency": F, "real": G.real, "imag": G.imag})
    (tmp_path / "dataset.toml").write_text(ENTRY.format("a.uff"))
    assert close(load(tmp_path).frfs[0])


def test_universal_files_without_pyuff_say_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.uff").write_text("    -1\n    58\n")
    monkeypatch.setitem(__import__("sys").modules, "pyuff", None)
    with pytest.raises(DataError, match=r"pip install 'gms-mujoco\[uff\]'"):
        formats.read(tmp_path / "a.uff")


def test_units_of_both_ends_scale_and_torque_constant(tmp_path: Path) -> None:
    text = rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG)
    frf = dataset(tmp_path, text, extra='units = { input = "mNm", output = "deg" }\n').frfs[0]
    assert close(frf, G * np.pi / 180 / 1e-3)
    assert close(dataset(tmp_path, text, extra="scale = 2.0\n").frfs[0], 2 * G)
    entry = ENTRY.replace("torque", "current").format("level.csv")
    (tmp_path / "dataset.toml").write_text("[axis]\ntorque_constant = 0.2\n" + entry)
    frf = load(tmp_path).frfs[0]
    assert close(frf, G / 0.2) and frf.input == "torque" and np.allclose(frf.excitation, 0.2e-3)
    (tmp_path / "dataset.toml").write_text(entry)
    with pytest.raises(DataError, match="torque_constant"):
        load(tmp_path)


def test_responses_that_were_read_alike_are_told_in_one_line(tmp_path: Path) -> None:
    text = rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG)
    for name in "abcde":
        (tmp_path / f"{name}.csv").write_text(text)
    (tmp_path / "e.csv").write_text(rows("f [Hz],real,imag", F, G.real, G.imag))
    (tmp_path / "dataset.toml").write_text("".join(ENTRY.format(f"{name}.csv") for name in "abcde"))
    said = [note for note in load(tmp_path).notes if "position over torque" in note]
    assert [note.split(": ")[0] for note in said] == ["a.csv, b.csv and 2 more", "e.csv"]


def test_an_amplitude_is_in_si_or_in_a_unit_of_its_own(tmp_path: Path) -> None:
    """Beside an input in another unit it is told how it was taken, as nobody could see a factor of 1000 later."""
    text = rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG)
    for extra, size, told in (
        ("", 1e-3, False), ('units = { input = "N m" }\n', 1e-3, False), ('units = { input = "mNm" }\n', 1e-3, True),
        ('units = { input = "mNm", amplitude = "mNm" }\n', 1e-6, False), ('units = { amplitude = "kNm" }\n', 1, False),
    ):  # fmt: skip
        (frf,) = dataset(tmp_path, text, extra=extra).frfs
        assert frf.excitation is not None and np.allclose(frf.excitation, size)
        said = "taken as 0.001 N m; where it is 0.001 mNm, as the input is, say units = { amplitude = \"mNm\" }"
        assert (said in " ".join(frf.notes)) is told
    with pytest.raises(DataError, match=r"units\.amplitude: 'deg' measures"):
        dataset(tmp_path, text, extra='units = { amplitude = "deg" }\n')
    entry = ENTRY.replace("torque", "current").format("level.csv")
    (tmp_path / "dataset.toml").write_text(f'[axis]\ntorque_constant = 0.2\n{entry}units = {{ input = "mA" }}\n')
    (frf,) = load(tmp_path).frfs
    assert np.allclose(frf.excitation, 0.2e-3) and "taken as 0.001 A; where it is 0.001 mA" in " ".join(frf.notes)
    (tmp_path / "dataset.toml").write_text(entry.replace("current", "torque").replace("amplitude = 1e-3\n", "")
                                           + 'units = { amplitude = "mNm" }\n')
    with pytest.raises(DataError, match=r"units\.amplitude is of amplitude, which is not given"):
        load(tmp_path)


def test_what_we_write_comes_back(tmp_path: Path) -> None:
    read = dataset(tmp_path, to_csv([FRF("a", F, G)])).frfs[0]
    assert close(read)
    again = to_csv([read])  # what it is stands in its header once
    assert again.splitlines()[0].count("position over torque") == 1 and "from frequency [Hz], magnitude" in again


def test_several_responses_in_a_file_come_back_each_with_what_it_has(tmp_path: Path) -> None:
    few = slice(0, 20)
    given_ = [
        FRF("sines", F, G, excitation=np.full(40, 2e-3), sigma=0.01 * MAG, sine=True),
        FRF("multisine", F[few], 2 * G[few], coherence=np.full(20, 0.9), sine=False),
        FRF("unknown", F, 3 * G),
    ]
    (tmp_path / "all.csv").write_text(to_csv(given_))
    entry = '[[frf]]\nfile = "all.csv"\ninput = "torque"\noutput = "position"\n'
    (tmp_path / "dataset.toml").write_text(entry)
    read = load(tmp_path).frfs
    assert [f.name for f in read] == ["all.csv response 1", "all.csv response 2", "all.csv response 3"]
    for a, b in zip(given_, read, strict=True):
        assert a.sine is b.sine and np.array_equal(a.frequency, b.frequency)
        assert np.allclose(a.response, b.response, rtol=1e-12)
        for key in ("excitation", "sigma", "coherence", "amplitude"):
            x, y = getattr(a, key), getattr(b, key)
            assert (x is None and y is None) or np.allclose(x, y, rtol=1e-12)
    (tmp_path / "dataset.toml").write_text(entry + "response = 2\namplitude = 1e-3\n")
    (one,) = load(tmp_path).frfs
    assert len(one) == 20 and one.excitation is not None and np.allclose(one.excitation, 1e-3)
    for more, words in (("response = 4\n", "has 1, 2, 3"), ("amplitude = 1e-3\n", "the file holds 3 responses")):
        (tmp_path / "dataset.toml").write_text(entry + more)
        with pytest.raises(DataError, match=words):
            load(tmp_path)


def test_a_response_that_would_give_energy_is_refused(tmp_path: Path) -> None:
    """Conjugate, or of a torque with the other sign; a delay alone makes none of that. What is said helps."""
    late = G * np.exp(-2j * np.pi * F * 1e-3)
    for response, way_out in ((G, ""), (late, ""), (G.conj(), "conjugate = true"), (-G, "scale = -1")):
        for power, output in ((0, "position"), (1, "velocity")):
            by = (2j * np.pi * F) ** power
            h = response * (by.conj() if "conj" in way_out else by)
            (tmp_path / "level.csv").write_text(rows("f [Hz],real,imag", F, h.real, h.imag))
            entry = ENTRY.format("level.csv").replace("position", output)
            (tmp_path / "dataset.toml").write_text(entry)
            if way_out:
                with pytest.raises(DataError, match=f"no passive axis does; .*{way_out}$"):
                    load(tmp_path)
                (tmp_path / "dataset.toml").write_text(entry + way_out + "\n")
            (frf,) = load(tmp_path).frfs
            assert close(frf, (late if response is late else G) * (2j * np.pi * F) ** power)
            assert "passive" not in " ".join(frf.notes) and ("of exp(-i w t)" in frf.notes[0]) is ("conj" in way_out)
    (tmp_path / "dataset.toml").write_text(ENTRY.format("level.csv") + "conjugate = 1\n")
    with pytest.raises(DataError, match="conjugate must be true or false; 1 given"):
        load(tmp_path)


def test_the_sign_of_a_torque_constant_is_part_of_the_response(tmp_path: Path) -> None:
    entry = ENTRY.replace("torque", "current").format("level.csv")
    for constant, sign, wrong in ((-0.2, -1, False), (0.2, 1, False), (0.2, -1, True), (-0.2, 1, True)):
        (tmp_path / "level.csv").write_text(rows("f [Hz],real,imag", F, 0.2 * sign * G.real, 0.2 * sign * G.imag))
        (tmp_path / "dataset.toml").write_text(f"[axis]\ntorque_constant = {constant}\n{entry}")
        if wrong:
            with pytest.raises(DataError, match=rf"frf 1 \(level\.csv\): .* say axis\.torque_constant = {-constant}$"):
                load(tmp_path)
        else:
            assert close(load(tmp_path).frfs[0])


def test_a_file_that_says_what_it_is_is_taken_for_nothing_else(tmp_path: Path) -> None:
    """What `to_csv` wrote: of a velocity, of a slide joint, one of several; a unit that the user says counts more."""
    speed = FRF("v: [x]", F, G * 2j * np.pi * F, output="velocity", notes=("a", "b"))
    entry = '[[frf]]\nfile = "all.csv"\ninput = "torque"\noutput = "{}"\n'
    slide = FRF("s", F, G, unit="m/(N)")
    for given_, output, axis, words in (
        ([speed], "position", "", r"response 1 is velocity over torque \[rad/s/\(N m\)\]; position over torque"),
        ([speed], "velocity", "", ""),
        ([FRF("a", F, G), speed], "position", "", "response 2 is velocity over torque"),
        ([slide], "position", "", r"response 1 is position over torque \[m/N\]; .*axis.kind"),
        ([slide], "position", '[axis]\nkind = "slide"\n', ""),
        ([speed], "acceleration", "", "response 1 is velocity"),
    ):
        (tmp_path / "all.csv").write_text(to_csv(given_))
        (tmp_path / "dataset.toml").write_text(axis + entry.format(output))
        if words:
            with pytest.raises(DataError, match=words):
                load(tmp_path)
            (tmp_path / "dataset.toml").write_text(axis + entry.format(output) + "scale = 1.0\n")
        assert len(load(tmp_path).frfs) == len(given_)


@needs_uff
def test_a_universal_file_says_what_it_holds(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    one = {
        "type": 58, "binary": 0, "func_type": 4, "rsp_node": 1, "rsp_dir": 1, "ref_node": 1, "ref_dir": 1, "data": G,
        "x": F, "abscissa_spacing": 0, "id1": "a", "abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz",
    }  # fmt: skip
    for over, under, output, words in (
        (12, 13, "position", "it is acceleration over torque; position over torque was asked for"),
        (12, 13, "acceleration", ""), (8, 13, "position", ""), (11, 13, "velocity", ""), (0, 0, "position", ""),
        (8, 12, "position", "position over acceleration"), (13, 8, "position", "torque over position"),
    ):  # fmt: skip
        (tmp_path / "a.uff").unlink(missing_ok=True)
        pyuff.UFF(str(tmp_path / "a.uff")).write_sets(
            {**one, "ordinate_spec_data_type": over, "orddenom_spec_data_type": under}, "add")
        entry = ENTRY.format("a.uff").replace("position", output)
        (tmp_path / "dataset.toml").write_text(entry)
        if words:
            with pytest.raises(DataError, match=words):
                load(tmp_path)
            (tmp_path / "dataset.toml").write_text(entry + 'units = { output = "rad" }\n')
        assert close(load(tmp_path).frfs[0])


def test_an_inertia_that_cannot_be_is_refused_of_responses_too(tmp_path: Path) -> None:
    text = rows("f [Hz],real,imag", F, G.real, G.imag)
    for inertia, words in ((2.4e-5, ""), (2.4e-4, "10 times off"), (2.4e-1, "times off; leave axis.inertia out")):
        axis = f"[axis]\ninertia = {inertia}\n"
        if inertia > 0.1:
            with pytest.raises(DataError, match=words):
                dataset(tmp_path, text, axis=axis)
        else:
            notes = " ".join(dataset(tmp_path, text, axis=axis).notes)
            assert re.search(words, notes) if words else "times off" not in notes


def test_what_stands_at_0_hz_is_left_out(tmp_path: Path) -> None:
    for first in ("0,-inf,0", "0,nan,nan", "0,0,0"):
        text = rows("f [Hz],magnitude [dB],phase [deg]", F, 20 * np.log10(MAG), np.degrees(ARG))
        frf = dataset(tmp_path, text.replace("\n", f"\n{first}\n", 1)).frfs[0]
        assert close(frf) and "0 Hz is left out" in frf.notes[-1]


@pytest.mark.parametrize("form", ["{:.12g}{:+.12g}i", "({:.12e}{:+.12e}j)", "{:.12g} {:+.12g}*i"])
def test_complex_numbers_as_text(form: str, tmp_path: Path) -> None:
    cells = [f"{f:.12g};{form.format(g.real, g.imag)}" for f, g in zip(F, G, strict=True)]
    assert close(dataset(tmp_path, "\n".join(["f [Hz];H", *cells])).frfs[0])
    assert close(dataset(tmp_path, "\n".join(["f [Hz];H", *cells]).replace(".", ",")).frfs[0])
    numbered = 'columns = { frequency = 0, real = 1 }\nunits = { frequency = "Hz" }\n'
    assert close(dataset(tmp_path, "\n".join(cells), extra=numbered).frfs[0])


def test_a_complex_column_in_parquet(tmp_path: Path) -> None:
    table = pa.table({"f [Hz]": F, "H": [{"real": g.real, "imag": g.imag} for g in G]})
    pq.write_table(table, tmp_path / "a.parquet")
    (tmp_path / "dataset.toml").write_text(ENTRY.format("a.parquet"))
    assert close(load(tmp_path).frfs[0])


def test_several_responses_in_one_matrix_are_not_guessed(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"f": F, "H": np.stack([G, 2 * G], 1)})
    said = ENTRY.format("a.mat") + 'units = { frequency = "Hz" }\n'
    (tmp_path / "dataset.toml").write_text(said)
    with pytest.raises(DataError, match=r"H\.0\.real, H\.1\.real may each be the real"):
        load(tmp_path)
    (tmp_path / "dataset.toml").write_text(said + 'columns = { real = "H.1.real" }\n')
    assert close(load(tmp_path).frfs[0], 2 * G)


# Levels.


def test_levels_of_excitation_in_one_file_are_responses_of_their_own(tmp_path: Path) -> None:
    """Only by the column of the excitation are they told from repeats."""
    size = np.repeat([3e-3, 3e-4, 1e-3], len(F)) * np.random.default_rng(0).uniform(0.99, 1.01, 3 * len(F))
    h = np.concatenate([3 * G, G, 2 * G])
    header = "f [Hz],real,imag,excitation [mNm]"
    text = rows(header, np.tile(F, 3), h.real, h.imag, 1e3 * size)
    entry = ENTRY.replace("amplitude = 1e-3\n", "").format("level.csv")
    (tmp_path / "dataset.toml").write_text(entry)
    (tmp_path / "level.csv").write_text(text)
    found = load(tmp_path).frfs
    assert all(re.fullmatch(r"level.csv at [.\d]+ N m", f.name) for f in found) and len({f.name for f in found}) == 3
    for f, times, u in zip(found, (1, 2, 3), (3e-4, 1e-3, 3e-3), strict=True):
        assert close(f, times * G) and np.allclose(f.excitation, u, rtol=0.011)
        assert "one of 3 levels" in f.notes[-1]
    assert [f.use for f in found] == ["fit", "validate", "fit"]
    with pytest.raises(DataError, match="3 levels of excitation; levels_from_table"):
        from_table(formats.read(tmp_path / "level.csv"), "a", "torque", "position")
    # held at amplitudes of the motion, which nothing says
    (tmp_path / "level.csv").write_text(rows(header, np.tile(F, 3), h.real, h.imag, size / np.tile(MAG, 3)))
    with pytest.raises(DataError, match="number the responses from 1 in a column 'response'"):
        load(tmp_path)
    (tmp_path / "level.csv").write_text(rows("f [Hz],real,imag", np.tile(F, 3), h.real, h.imag))
    (tmp_path / "dataset.toml").write_text(entry + "amplitude = 1e-3\n")
    assert "are they levels of excitation? Name its column" in load(tmp_path).frfs[0].notes[1]
    (tmp_path / "level.csv").write_text(rows(header, F, G.real, G.imag, 1 + 0 * F))
    with pytest.raises(DataError, match=r"amplitude is given, and the file has the excitation in column 'excitation"):
        load(tmp_path)


# Any shape that a laboratory may choose, at random.


@st.composite
def layouts(draw: st.DrawFn) -> tuple[str, str, str, np.ndarray, np.ndarray]:
    """Text of a file, its ending, what dataset.toml says of it, and the response it holds."""
    n = draw(st.integers(8, 25))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    f = np.sort(np.exp(rng.uniform(np.log(0.3), np.log(900), n)))
    g = np.exp(rng.uniform(-9, 1, n) + 1j * np.cumsum(rng.uniform(-0.7, 0.3, n)))
    unit = {
        "frequency": draw(st.sampled_from(["Hz", "kHz", "rad/s", "rpm"])),
        "magnitude": draw(st.sampled_from(["abs", "dB", "log10"])),
        "phase": draw(st.sampled_from(["deg", "rad"])),
    }
    size = {"abs": np.abs(g), "dB": 20 * np.log10(np.abs(g)), "log10": np.log10(np.abs(g))}[unit["magnitude"]]
    angle = np.angle(g) if draw(st.booleans()) else np.unwrap(np.angle(g)) + 2 * np.pi * draw(st.integers(-2, 2))
    columns = [("frequency", f / {"Hz": 1, "kHz": 1e3, "rad/s": 0.5 / np.pi, "rpm": 1 / 60}[unit["frequency"]])]
    if draw(st.booleans()):
        columns += [("magnitude", size), ("phase", np.degrees(angle) if unit["phase"] == "deg" else angle)]
    else:
        columns += [("real", g.real), ("imag", g.imag)]
        unit = {"frequency": unit["frequency"]}
    columns = draw(st.permutations(columns))
    repeats, shuffled = draw(st.integers(1, 3)), draw(st.booleans())
    order = np.tile(np.arange(n), repeats) if draw(st.booleans()) else np.repeat(np.arange(n), repeats)
    order = rng.permutation(order) if shuffled else order
    columns = [(k, v[order]) for k, v in columns]
    named, lying = draw(st.booleans()), draw(st.booleans())
    separator = draw(st.sampled_from([",", ";", "\t", " "] if not named else [",", ";", "\t"]))
    comma = separator != "," and draw(st.booleans())
    style = draw(st.sampled_from(["{:.12g}", "{:.10e}", "{:+.11e}"]))
    names = [f"{k} [{unit[k]}]" if k in unit else k for k, _ in columns]
    cells = [[style.format(x).replace(".", "," if comma else ".") for x in v] for _, v in columns]
    if lying:
        table = [[*([name] if named else []), *line] for name, line in zip(names, cells, strict=True)]
    else:
        table = [*([names] if named else []), *map(list, zip(*cells, strict=True))]
    space = " " if draw(st.booleans()) and separator != "\t" else ""
    lines = [(separator + space).join(row) for row in table]
    lines = [draw(st.sampled_from(["# a comment", "% 2, 3; 4", ""]))] * draw(st.integers(0, 2)) + lines
    text = draw(st.sampled_from(["", "\ufeff"])) + draw(st.sampled_from(["\n", "\r\n"])).join(lines) + "\n"
    said = "" if named else "columns = {{ {} }}\nunits = {{ {} }}\n".format(
        ", ".join(f"{k} = {i}" for i, (k, _) in enumerate(columns)),
        ", ".join(f'{k} = "{v}"' for k, v in unit.items()),
    )
    return text, draw(st.sampled_from(["csv", "txt", "dat"])), said, f, g


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(layout=layouts())
def test_any_layout_gives_the_response_back(layout: tuple, tmp_path: Path) -> None:
    text, suffix, said, f, g = layout
    (tmp_path / f"level.{suffix}").write_bytes(text.encode())
    entry = ENTRY.format(f"level.{suffix}").replace("torque", "voltage")  # an axis that answers a torque is passive
    (tmp_path / "dataset.toml").write_text(entry + said)
    frf = load(tmp_path).frfs[0]
    assert np.allclose(frf.frequency, f, rtol=1e-7) and np.allclose(frf.response, g, rtol=1e-7)


def test_an_frd_of_python_control_is_a_response() -> None:
    class Frd:  # its shape, without the library
        omega, frdata, name = 2 * np.pi * F[::-1], np.array([[G[::-1], 2 * G[::-1]]]), "rig"

    frf = from_control(Frd(), amplitude=1e-3)
    assert close(frf) and frf.name == "rig" and frf.unit == "rad/(N m)" and frf.excitation is not None
    assert close(from_control(Frd(), entry=(0, 1)), 2 * G)
    for wrong, entry, words in ((Frd(), (1, 0), "entry"), (3.0, (0, 0), "expected an object of python-control")):
        with pytest.raises(DataError, match=words):
            from_control(wrong, entry=entry)
    control = pytest.importorskip("control")
    assert close(from_control(control.frd(G, 2 * np.pi * F)))
    mass = control.frd(control.tf([1], [2.4e-5, 1e-3, 0.5]), 2 * np.pi * F)
    assert close(from_control(mass))


# What is refused.


@pytest.mark.parametrize(
    ("text", "extra", "words"),
    [
        (rows("", F, MAG, ARG), "", ["3 columns", "columns = { frequency = 0"]),
        (rows("frequency,magnitude [abs],phase [rad]", F, MAG, ARG), "", ["Hz or rad/s", "units = { frequency"]),
        (rows("f [Hz],magnitude,phase [rad]", F, MAG, ARG), "", ["abs or dB", "units = { magnitude"]),
        (rows("f [Hz],magnitude [abs],phase", F, MAG, ARG), "", ["rad or deg", "units = { phase"]),
        (rows("f [Hz],magnitude [abs]", F, MAG), "", ["magnitude and phase"]),
        (rows("f [Hz],w [rad/s],magnitude [abs],phase [rad]", F, F, MAG, ARG), "", ["may each be the frequency"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, -MAG, ARG), "", ["abs is positive"]),
        (rows("f [Hz],magnitude [dB],phase [rad]", F, 1e4 * MAG, ARG), "", ["is it abs"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", -F, MAG, ARG), "", ["positive"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG * np.where(F > 100, np.nan, 1), ARG), "",
         ["line", "magnitude is nan", "leave them out of the file"]),
        (rows("f [Hz],magnitude [abs],phase [rad],excitation", F, MAG, ARG, np.arange(len(F)) - 2.0), "",
         ["line 2: excitation is -2.0, not a positive amplitude (3 such)"]),
        (rows("f [Hz],magnitude [abs],phase [rad],excitation", F, MAG, ARG, np.arange(len(F))[::-1]), "",
         [f"line {len(F) + 1}: excitation is 0.0, not a positive amplitude"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), 'units = { phase = "grad" }\n', ["units.phase"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), 'columns = { gain = "a" }\n', ["columns.gain"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), 'columns = { phase = "p" }\n', ["no column 'p'"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), "columns = { phase = 7 }\n", ["no column 7"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), "columns = { magnitude = 1, phase = 1 }\n",
         ["columns.magnitude and columns.phase are both column 'magnitude [abs]'"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), 'units = { input = "deg" }\n', ["units.input"]),
        (rows("f [Hz],magnitude [abs],phase [rad]", F, MAG, ARG), 'use = "test"\n', ["use must be"]),
        ("f [Hz],magnitude [abs],phase [rad]\n1,x,2\n", "", ["'x' is not a number"]),
        ("f [Hz],magnitude [abs],phase [rad]\n", "", ["no samples"]),
    ],
)  # fmt: skip
def test_ambiguity_says_how_to_settle_it(text: str, extra: str, words: list[str], tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        dataset(tmp_path, text, extra=extra)
    message = str(caught.value)
    assert "\n" not in message and "frf 1 (level.csv)" in message
    for word in words:
        assert word in message, message


def test_input_and_output_must_be_said(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows("f [Hz],real,imag", F, G.real, G.imag))
    for text, words in (
        ('[[frf]]\nfile = "a.csv"\noutput = "position"\n', 'input = "torque"'),
        ('[[frf]]\nfile = "a.csv"\ninput = "effort"\noutput = "position"\n', "input must be one of"),
        ('[[frf]]\nfile = "b.csv"\ninput = "torque"\noutput = "position"\n', "no such file"),
        ("[[frf]]\n", "file must be the name"),
    ):
        (tmp_path / "dataset.toml").write_text(text)
        with pytest.raises(DataError, match=words):
            load(tmp_path)


cell = st.sampled_from(["0", "1", "-1", "1e308", "nan", "", "x", "0.5", "1e-3", "2,5"])
header = st.sampled_from(["f [Hz]", "w", "mag", "phase [deg]", "real", "imag", "gain_db", "a", "response"])


@anyhow
@given(
    names=st.lists(header, min_size=1, max_size=4), body=st.lists(st.lists(cell, min_size=1, max_size=4), max_size=9)
)
def test_any_table_is_a_response_or_one_line(names: list[str], body: list[list[str]], tmp_path: Path) -> None:
    try:
        runs = dataset(tmp_path, "\n".join([",".join(names), *map(",".join, body)]))
        assert len(runs.frfs) == 1
    except DataError as error:
        assert "\n" not in str(error) and "level.csv" in str(error)


# Data that others measured.


def test_flexible_link_and_its_antiresonance(data: Path) -> None:
    files = sorted((data / "flexlink_frf").glob("*.dat"))
    if not files:
        pytest.skip("no flexlink_frf")
    columns = {"frequency": 0, "magnitude": 1, "phase": 2}
    unit = {"frequency": "rad/s", "magnitude": "abs", "phase": "rad"}
    for file in files:
        frf = from_table(formats.read(file), file.name, "voltage", "position", columns=columns, unit=unit)
        assert len(frf) == 100
        assert frf.sigma is None or "outliers without weight" in frf.notes[1]
        ends = 2 * np.pi * np.array(antiresonances(frf))
        assert any(24 < low < found < high < 32 for found, low, high in ends), file.name


def test_tabulated_motor_bode(data: Path) -> None:
    file = data / "dcmotor_bode/raw_motor_data.dat"
    if not file.exists():
        pytest.skip("no dcmotor_bode")
    columns = {"frequency": 0, "magnitude": 1, "phase": 2}
    unit = {"frequency": "Hz", "magnitude": "abs"}
    frf = from_table(formats.read(file), "bode", "voltage", "velocity", columns=columns, unit=unit)
    assert len(frf) == 36 and "phase [deg]" in frf.notes[0]
    assert np.angle(frf.response[0]) == pytest.approx(np.radians(-3))


@needs_uff
def test_measured_universal_files(data: Path) -> None:
    folder = data / "uff"
    if not folder.exists():
        pytest.skip("no uff")
    ascii_, binary = (formats.read(folder / n) for n in ("Sample_UFF58_ascii.uff", "Sample_UFF58b_bin.uff"))
    assert list(ascii_.columns) == ["time", "Pressure"] and ascii_.units["Pressure"] == "Pa"
    assert np.allclose(ascii_.columns["Pressure"], binary.columns["Pressure"], rtol=1e-5)
    frf = from_table(formats.read(folder / "non_ascii_header.uff"), "a", "torque", "acceleration", kind="slide")
    assert len(frf) == 5 and frf.response[0] == pytest.approx(-0.0599924 - 0.055326j)
    with pytest.raises(DataError, match="psd"):
        from_table(formats.read(folder / "sample_dataset58_psd.uff"), "a", "torque", "acceleration")
