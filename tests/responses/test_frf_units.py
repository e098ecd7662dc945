"""Units of a frequency response: declared, stated, told by the values, or an error that says how to settle it."""

import numpy as np
import pytest

from gms_mujoco.errors import DataError
from gms_mujoco.formats import Table
from gms_mujoco.frf import FRF
from gms_mujoco.responses.frf_table import from_table
from gms_mujoco.responses.frf_units import plain, quantity_factor, response_factor

F = np.geomspace(1, 300, 40)
G = 1 / (0.5 + 1e-3j * 2 * np.pi * F - 2.4e-5 * (2 * np.pi * F) ** 2)
MAG, DB, DEG = np.abs(G), 20 * np.log10(np.abs(G)), np.degrees(np.angle(G))


def read(columns: dict[str, np.ndarray], kind: str = "hinge", **more: object) -> FRF:
    return from_table(Table(columns), "a", "torque", "position", kind=kind, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "word", "unit"),
    [
        ("Frequency [Hz]", "frequency", "Hz"), ("Frequency, Hz", "frequency", "Hz"), ("freq_hz", "freq", "hz"),
        ("mag (deg/(mN m))", "mag", "deg/(mN m)"), ("|G(jw)| [dB]", "|g(jw)|", "dB"), ("Phase:", "phase", ""),
        ("dB", "db", "dB"), ("ω", "ω", "rad/s"), ("H [rad/Nm].real", "real", "rad/Nm"), ("run.f", "f", ""),
        ("Freq. (Hz)", "freq", "Hz"),
    ],
)  # fmt: skip
def test_a_name_is_words_and_a_unit(name: str, word: str, unit: str) -> None:
    assert plain(name) == (word, unit)


@pytest.mark.parametrize(
    ("unit", "kind", "factor"),
    [
        ("rad/Nm", "hinge", 1), ("rad/(N m)", "hinge", 1), ("deg/mNm", "hinge", np.pi / 180e-3),
        ("(1/(mN m))*(deg)", "hinge", np.pi / 180e-3), ("um/N", "slide", 1e-6), ("mm", "slide", 1e-3),
        ("urad / (mN*m)", "hinge", 1e-3),
    ],
)  # fmt: skip
def test_the_unit_that_a_file_states_for_a_response_is_read(unit: str, kind: str, factor: float) -> None:
    for columns in (
        {"f [Hz]": F, f"real [{unit}]": G.real / factor, f"imag [{unit}]": G.imag / factor},
        {"f [Hz]": F, f"gain [{unit}]": MAG / factor, "phase [deg]": DEG},
        {"f [Hz]": F, f"gain [dB re 1 {unit}]": 20 * np.log10(MAG / factor), "phase [deg]": DEG},
    ):
        frf = read(columns, kind)
        assert np.allclose(frf.response, G, rtol=1e-9)
        assert factor == 1 or unit in frf.notes[0]
    # What the user says counts more than the file.
    assert np.allclose(read(columns, kind, scale=factor).response, G, rtol=1e-9)


def test_a_unit_of_something_else_is_refused() -> None:
    for unit, words in (("m/N", "slide"), ("parsec/Nm", "parsec"), ("Nm/rad", "not position over torque")):
        with pytest.raises(DataError, match=words):
            read({"f [Hz]": F, f"real [{unit}]": G.real, f"imag [{unit}]": G.imag})
    with pytest.raises(DataError, match="must have one unit"):
        read({"f [Hz]": F, "real [rad/Nm]": G.real, "imag [deg/Nm]": G.imag})
    raw = {"real": (G.real, "a [rad/s/A]"), "imag": (G.imag, "b [rad/s/A]")}
    assert response_factor(raw, {}, "current", "velocity", "hinge", None) == (1, "rad/s/A")
    raw = {"real": (G.real, "a [(m/s²)/(N)]"), "imag": (G.imag, "b [(m/s²)/(N)]")}
    assert response_factor(raw, {}, "torque", "acceleration", "slide", None)[0] == 1
    with pytest.raises(DataError, match="voltage of a hinge joint takes V"):
        quantity_factor("kV", "input", "voltage")


def test_the_excitation_has_the_unit_of_the_input() -> None:
    columns = {"f [Hz]": F, "magnitude [dB]": DB, "phase [deg]": DEG}
    assert np.allclose(read(columns | {"excitation [mNm]": 3 + 0 * F}).excitation, 3e-3)
    frf = read(columns | {"excitation": 3 + 0 * F}, unit={"input": "mNm"})
    assert np.allclose(frf.excitation, 3e-3) and np.allclose(frf.response, 1e3 * G)


def test_the_deviation_of_a_magnitude_in_decibels() -> None:
    rng = np.random.default_rng(0)
    columns = {"f [Hz]": F, "magnitude [dB]": DB, "phase [deg]": DEG}
    with pytest.raises(DataError, match="sigma: abs or dB"):
        read(columns | {"sigma": 0.1 + 0 * F})
    sigma = read(columns | {"sigma [dB]": 0.1 + 0 * F}).sigma
    noisy = 1 + 0.01 * (rng.standard_normal(4000) + 1j * rng.standard_normal(4000))
    in_db = np.std(20 * np.log10(np.abs(noisy)))
    assert np.allclose(sigma * in_db / 0.1, MAG * np.sqrt(np.mean(np.abs(noisy - 1) ** 2)), rtol=0.03)


@pytest.mark.parametrize(
    ("columns", "unit", "words"),
    [
        ({"f [1/s]": F, "magnitude [dB]": DB, "phase [deg]": DEG}, {}, "'1/s' is none of the units"),
        ({"f [Hz]": F, "magnitude [dB]": DB, "phase [mdeg]": 1e3 * DEG}, {}, "'mdeg' is none of the units"),
        ({"f [Hz]": F, "magnitude [dB]": DB, "phase [rad]": DEG}, {}, "28 turns; is it deg"),
        ({"f [Hz]": F, "magnitude [dB]": DB, "phase": DEG}, {"phase": "rad"}, "28 turns; is it deg"),
        ({"f [Hz]": F, "real": G.real, "imag": G.imag, "coherence": 97 + 0 * F}, {}, "in percent"),
    ],
)
def test_what_would_be_read_wrong_is_refused(columns: dict, unit: dict, words: str) -> None:
    with pytest.raises(DataError, match=words):
        read(columns, unit=unit)


def test_a_phase_that_may_be_in_radians_is_asked_about() -> None:
    frf = read({"f [Hz]": F, "magnitude [dB]": DB, "phase [deg]": np.radians(DEG)})
    assert "is it rad?" in frf.notes[-1]
    assert "is it rad?" not in read({"f [Hz]": F, "magnitude [dB]": DB, "phase [deg]": DEG}).notes[-1]


def test_coherence_in_percent() -> None:
    frf = read({"f [Hz]": F, "real": G.real, "imag": G.imag, "coherence [%]": 97 + 0 * F})
    assert np.allclose(frf.coherence, 0.97)
