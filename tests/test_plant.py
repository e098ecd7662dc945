"""A Plant is a value: adding makes another, and a file of it is it."""

import tomllib
import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.errors import GmsError, ModelError
from gms_mujoco.files import MODELS
from gms_mujoco.parameter import Parameter
from gms_mujoco.plant import Plant

GMS = effects.find("gms")(
    stiffness=[0.8, 0.4], fraction=[0.3, 0.7], coulomb=4.5e-3, static=5.4e-3, stribeck_velocity=0.8, attraction=0.3
)
VISCOUS = effects.find("viscous")(coefficient=2e-5)
PLANT = Plant.axis(2.4e-5) + GMS + VISCOUS
VISCOUS_FILE = "[axis]\ninertia = 1.0\n[effects.viscous]\ncoefficient = 0.1\n"
anyhow = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_plus_makes_a_new_plant() -> None:
    bare = Plant.axis(2.4e-5)
    assert (bare + VISCOUS).effects == (VISCOUS,) and bare.effects == ()
    assert "gms" in PLANT and "cogging" not in PLANT and PLANT["viscous"] == VISCOUS
    assert PLANT.without("gms").effects == (VISCOUS,)
    assert PLANT.replace(VISCOUS.replace(coefficient=1.0))["viscous"].coefficient == 1.0


def test_a_file_of_a_plant_is_the_plant(tmp_path: Path) -> None:
    told = replace(PLANT, uncertainty={"gms.coulomb": (4e-3, 5e-3)}, provenance={"records": ["a.csv"], "error": 0.1})
    told.save(tmp_path / "model.toml")
    read = Plant.load(tmp_path / "model.toml")
    assert read == PLANT and read.uncertainty == told.uncertainty and read.provenance == told.provenance
    (tmp_path / "marked.toml").write_text(told.to_toml(), encoding="utf-8-sig")
    assert Plant.load(tmp_path / "marked.toml") == read, "as text editors of Windows write it"
    slide = Plant.axis(kind="slide") + VISCOUS
    assert Plant.from_table(tomllib.loads(slide.to_toml())) == slide


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[axis]\ninertia = -1.0\n", "inertia must be a positive number"),
        ('[axis]\ninertia = "big"\n', "axis.inertia must be a number"),
        ('[axis]\nkind = "ball"\n', "hinge, slide"),
        ("[axis]\nmass = 1.0\n", "'mass'.*inertia"),
        ("[effects.frictoin]\n", "'frictoin'.*viscous"),
        ("[effects.viscous]\ndamping = 1.0\n", "viscous has no parameter 'damping'.*coefficient"),
        ("[effects.viscous]\ncoefficient = -1.0\n", r"viscous.coefficient must lie in \[0"),
        ('[effects.viscous]\ncoefficient = "x"\n', "viscous.coefficient must be a number"),
        ("[effects.gms]\nstiffness = [1.0, 1.0]\nfraction = [0.5, 0.4]\n", "gms.fraction must sum to 1.*0.9"),
        ("[effects.gms]\nstiffness = [1.0, 1.0]\nfraction = [1.0]\n", "equally many values"),
        ("effects = 3\n", "effects must be a table"),
        ("[effects]\nviscous = 3\n", "effects.viscous must be a table"),
        ("[axis\n", "not a readable TOML file"),
        ("[effects.viscous]\ncoefficient = true\n", "viscous.coefficient must be a number.*True given"),
        ('[effects.viscous]\ncoefficient = "0.1"\n', "viscous.coefficient must be a number.*'0.1' given"),
        (f"[effects.viscous]\ncoefficient = {'9' * 400}\n", "viscous.coefficient must be a number"),
        ("[effects.viscous]\ncoefficient = [0.1]\n", r"viscous.coefficient must be one number.*\[0.1\] given"),
        ("[effects.gms]\nstiffness = [true, 2.0]\n", "gms.stiffness must be a list of numbers"),
        ('[effects.gms]\nstiffness = ["1.0", "2.0"]\n', "gms.stiffness must be a list of numbers"),
        ("[effects.gms]\nstiffness = [[1.0], [1.0, 2.0]]\n", "gms.stiffness must be a list of numbers"),
        (f"[axis]\ninertia = {'9' * 400}\n", "inertia must be a positive number"),
        (f"[axis]\ninertia = {'9' * 9999}\n", "not a readable TOML file"),
        ('[axis]\ninertia = 1.0\ninertia_known = "no"\n', "inertia_known must be true or false; 'no' given"),
        ("[axis]\ninertia_known = true\n", r"inertia_known is true, but axis.inertia \[kg m\^2\] is not given"),
        ("[uncertainty]\ninertia = 3\n", "uncertainty.inertia must be an interval"),
        *(
            (f'{VISCOUS_FILE}[uncertainty]\n"viscous.coefficient" = {ends}\n', "must be an interval")
            for ends in ("[0.2, 0.1]", "[nan, nan]", "[true, true]", '["0.1", "0.2"]', '"12"', "[0.1, 0.2, 0.3]")
        ),
        (f'{VISCOUS_FILE}[uncertainty]\n"viscous.drag" = [0, 1]\n', "'viscous.drag'.*it has inertia, viscous"),
        (f'{VISCOUS_FILE}[uncertainty]\n"viscous.coefficient[7]" = [0, 1]\n', r"'viscous.coefficient\[7\]'"),
        (f'{VISCOUS_FILE}[covariance]\n"viscous.drag" = [1.0]\n', "covariance of 'viscous.drag'"),
        (f'{VISCOUS_FILE}[covariance]\n"viscous.coefficient" = [true]\n', "covariance must have 1 finite numbers"),
        (f'{VISCOUS_FILE}[covariance]\n"viscous.coefficient" = [1.0, 2.0]\n', "covariance must have 1 finite numbers"),
        ("[covariance]\ninertia = [1.0, 0.5]\nx = [0.1, 1.0]\n", "covariance must be a symmetric matrix"),
        ("[covariance]\ninertia = [1.0, 5.0]\nx = [5.0, 1.0]\n", "covariance must be positive semidefinite"),
        ("[covariance]\ninertia = [0.0, 5.0]\nx = [5.0, 1.0]\n", "covariance must be positive semidefinite"),
        ('[provenance]\nbandwidth = "high"\n', "provenance.bandwidth"),
        ('[provenance]\nclock_skew = "x"\n', "provenance.clock_skew must be a number"),
        ("[provenance]\nclock_skew = [1, 2]\n", "provenance.clock_skew must be a number"),
        ("[provenance]\ntime_steps = 3\n", "provenance.time_steps must be three numbers out of -1, 0, 1"),
        ('[provenance]\nrests_unasked = "no"\n', "provenance.rests_unasked must be true or false"),
    ],
)
def test_a_wrong_file_is_named_with_what_was_expected(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(text)
    with pytest.raises(ModelError, match=f"model.toml: .*{message}"):
        Plant.load(tmp_path / "model.toml")


def test_missing_file_and_missing_values_are_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        Plant.load(tmp_path / "model.toml")
    with pytest.raises(ModelError, match=r"gms.coulomb, gms.stiffness, inertia"):
        (Plant.axis() + effects.find("gms")(stribeck_velocity=1, static=1, attraction=1)).complete()


def test_an_effect_stands_in_a_plant_once() -> None:
    with pytest.raises(ModelError, match="viscous already"):
        PLANT + VISCOUS
    with pytest.raises(ModelError, match=r"no 'cogging'.*gms, viscous"):
        PLANT.without("cogging")


names = st.sampled_from(["axis", "effects.gms", "effects.viscous", "effects", "uncertainty", "provenance", "x"])
keys = st.sampled_from(["inertia", "kind", "coefficient", "stiffness", "fraction", "inertia_known", "viscous", "gms"])
numbers = st.sampled_from(["0", "-1.0", "nan", "1e400", '"x"', "[]", "[1.0, 2.0]", "[[1]]", '["x"]', "{}", "0.5"])
lines = st.tuples(keys, numbers).map(" = ".join) | names.map("[{}]".format)


@anyhow
@given(body=st.lists(lines, max_size=6))
def test_any_model_toml_is_read_or_refused_in_one_line(body: list[str], tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text("\n".join(body))
    try:
        assert isinstance(Plant.load(tmp_path / "model.toml"), Plant)
    except GmsError as error:
        assert "model.toml" in str(error) and "\n" not in str(error)


def test_a_plant_of_the_package_is_known_by_its_name():
    for file in MODELS.glob("*.toml"):
        assert Plant.load(file.stem) == Plant.load(file)
        assert Plant.load(file).provenance["source"], "every number says where it comes from"
    with pytest.raises(ModelError, match=r"plants that come with the package are .*servo_axis"):
        Plant.load("servo_axes")


def test_parameters_show_their_interval_and_unit() -> None:
    plant = Plant.axis(2.0, "slide") + effects.find("coulomb")(coulomb=20.0)
    intervals = {"coulomb.coulomb": (19.0, 21.0), "inertia": (1e-300, 1e300)}
    rows = replace(plant, uncertainty=intervals).rows()
    assert rows == [("inertia", "2", "undetermined", "kg"), ("coulomb.coulomb", "20", "[19, 21]", "N")]


def test_waves_on_a_slide_joint_have_a_wave_number_and_their_phase_is_an_angle() -> None:
    waves = effects.Cogging(harmonics=[196.3], amplitude=[4.0], phase=[0.1])
    units = {k: unit for k, (_, unit) in (Plant.axis(2.0, "slide") + waves).numbers().items()}
    assert units == {"inertia": "kg", "cogging.harmonics": "rad/m", "cogging.amplitude": "N", "cogging.phase": "rad"}
    assert "# rad/m, " in (Plant.axis(2.0, "slide") + waves).to_toml()
    assert (Plant.axis(2.0) + waves).numbers()["cogging.harmonics"][1] == "1/rev"


def test_printed_it_is_a_table_and_no_covariance() -> None:
    told = replace(PLANT, uncertainty={"gms.coulomb": (4e-3, 5e-3)}, covariance={"gms.coulomb": (1e-8,)})
    lines = str(told).splitlines()
    assert len(lines) == len(told.numbers()) and "[0.004, 0.005]" in str(told)
    assert "covariance" not in repr(told) and "GMS(" in repr(told)


def test_an_effect_with_one_element_shows_its_interval() -> None:
    plant = Plant.axis(1.0) + effects.find("cogging")(harmonics=[5], amplitude=[0.2], phase=[0.1])
    rows = replace(plant, uncertainty={"cogging.amplitude": (0.1, 0.3)}).rows()
    assert ("cogging.amplitude", "0.2", "[0.1, 0.3]", "N m") in rows


@given(st.floats(1e-9, 1e9), st.floats(1e-5, 1.0), st.booleans())
def test_a_value_is_told_inside_its_interval_with_ends_that_differ(value: float, half: float, negative: bool) -> None:
    value = -value if negative else value
    ends = sorted((value * (1 - half), value * (1 + half)))
    offset = Plant.axis(1.0) + effects.TorqueOffset(torque=value)
    plant = replace(offset, uncertainty={"torque_offset.torque": tuple(ends)})
    _, told, interval, _ = next(row for row in plant.rows() if row[0] == "torque_offset.torque")
    low, high = map(float, interval.strip("[]").split(", "))
    assert low < float(told) < high
    assert low == pytest.approx(ends[0], abs=0.1 * (ends[1] - ends[0]))


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    told = {"a b": np.float64(0.1), "c": np.arange(2), "d": "\x7f"}
    plant = replace(Plant.axis(np.float32(0.5)) + VISCOUS, provenance=told)
    plant.save(tmp_path / "model.toml")
    again = Plant.load(tmp_path / "model.toml")
    assert again == plant and again.provenance == {"a b": 0.1, "c": [0, 1], "d": "\x7f"}
    with pytest.raises(ModelError, match="inertia must be a number"):
        Plant.axis("heavy")  # type: ignore[arg-type]


@given(st.booleans() | st.text(max_size=4) | st.just("0.1") | st.lists(st.booleans(), min_size=1) | st.dates())
def test_what_is_no_number_is_not_taken_for_one(value: object) -> None:
    """NumPy takes text and True for numbers."""
    for build in (
        Plant.axis,
        lambda v: effects.Coulomb(coulomb=v),
        lambda v: effects.Coulomb(coulomb=np.asarray(v)),
        lambda v: GMS.replace(stiffness=[v, 2.0]),
    ):
        with pytest.raises(ModelError, match="must be a"):
            build(value)  # type: ignore[operator]


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int64, int, float, np.asarray])
def test_every_kind_of_number_is_one(kind: Callable[[int], object]) -> None:
    assert effects.Coulomb(coulomb=kind(2)) == effects.Coulomb(coulomb=2.0)
    for stiffness in ([kind(2), 1], np.array([2, 1]), (2.0, 1.0)):
        assert GMS.replace(stiffness=stiffness).stiffness == (2.0, 1.0)


@anyhow
@given(elements=st.integers(1, 8), seed=st.integers(0, 2**32 - 1), rank=st.integers(0, 3))
def test_the_covariance_of_a_fit_is_read_back(elements: int, seed: int, rank: int, tmp_path: Path) -> None:
    """Whatever its scales and its rank: rounding makes eigenvalues that are zero a little negative."""
    stiff = effects.find("gms")(elements, coulomb=1.0, static=1.0, stribeck_velocity=1.0, attraction=1.0)
    plant = Plant.axis(1.0) + stiff.replace(stiffness=[1.0] * elements)
    names = [name for name in plant.numbers() if name != "inertia"]
    rng = np.random.default_rng(seed)
    part = rng.standard_normal((len(names), rank)) * 10.0 ** rng.uniform(-12, 6, (len(names), 1))
    rows = dict(zip(names, map(tuple, (part @ part.T).tolist()), strict=True))
    replace(plant, covariance=rows).save(tmp_path / "model.toml")
    read = Plant.load(tmp_path / "model.toml").covariance
    assert list(read) == names and np.allclose([read[k] for k in names], [rows[k] for k in names], rtol=1e-11, atol=0)


def test_what_was_known_of_an_effect_goes_with_it(tmp_path: Path) -> None:
    rows = {"gms.coulomb": (2.0, 0.1, 0.5), "viscous.coefficient": (0.1, 3.0, 0.2), "gms.static": (0.5, 0.2, 4.0)}
    told = replace(PLANT, uncertainty={"gms.coulomb": (4e-3, 5e-3), "viscous.coefficient": (0, 1)}, covariance=rows)
    told.without("viscous").save(tmp_path / "model.toml")
    read = Plant.load(tmp_path / "model.toml")
    assert read.uncertainty == {"gms.coulomb": (4e-3, 5e-3)}
    assert read.covariance == {"gms.coulomb": (2.0, 0.5), "gms.static": (0.5, 4.0)}


plain = st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(st.characters(exclude_categories=["Cs"]))
dated = st.dates() | st.times() | st.datetimes(timezones=st.none() | st.just(UTC))
short_keys = st.text("ab .é", max_size=3)
toml_values = st.recursive(
    plain | dated, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(short_keys, inner, max_size=3)
)


@given(st.dictionaries(st.text("abc -", max_size=4), toml_values, max_size=4))
def test_the_provenance_is_kept_as_toml_can_hold_it(told: dict[str, object]) -> None:
    assert Plant.from_table(tomllib.loads(replace(PLANT, provenance=told).to_toml())).provenance == told


@pytest.mark.parametrize("given_back", [lambda command: command[:-1], lambda command: 0.5, lambda command: None])
def test_a_drive_that_gives_no_torque_for_each_sample_is_named(given_back: Callable[[object], object]) -> None:
    class Odd(Effect):
        name, kind, parameters = "odd", "drive", ()

        def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
            return given_back(command)  # type: ignore[return-value]

    with pytest.raises(ModelError, match=r"odd: deliver must give a number for each of the 20 samples; .* given"):
        (PLANT + Odd()).delivered(np.zeros(10), 1e-3, 2)


def test_friction_in_python_is_refused_for_nothing_would_evaluate_it() -> None:
    class Mine(Effect):
        name, kind, parameters = "mine", "friction", (Parameter("level", "N m", 0.0),)

    with pytest.raises(ModelError, match=r"mine is friction in Python, .* one \.cc file; CONTRIBUTING.md says how"):
        PLANT + Mine(level=1e-3)


def test_a_file_that_cannot_be_read_back_is_told(tmp_path: Path) -> None:
    class Mine(Effect):
        name, kind, parameters = "mine", "drive", (Parameter("share", "1", 0.0),)

        def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
            return command

    with pytest.warns(UserWarning, match=r"m\.toml cannot be read back: mine is not in the catalogue"):
        (PLANT + Mine()).save(tmp_path / "m.toml")
    with warnings.catch_warnings(action="error"):
        PLANT.save(tmp_path / "n.toml")


@pytest.mark.parametrize("path", [None, 3, PLANT])
def test_a_path_that_is_none_is_told(path: object) -> None:
    with pytest.raises(ModelError, match=r"the path of a model\.toml, or the name of a plant .* is expected"):
        Plant.load(path)  # type: ignore[arg-type]


def test_a_number_that_is_no_parameter_is_not_swallowed() -> None:
    with pytest.raises(ModelError, match=r"viscous: parameters are given by name, out of coefficient; 1\.0 given"):
        effects.find("viscous")(1.0)  # type: ignore[arg-type]
    for elements in (0, 2.5, "a"):
        with pytest.raises(ModelError, match="element"):
            effects.find("gms")(elements)  # type: ignore[arg-type]
