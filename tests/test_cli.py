"""The command line: what it writes is whole, and a user's mistake is one line and exit code 2."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gms_mujoco import cli, effects, files, formats
from gms_mujoco.bench import measure
from gms_mujoco.control import PID
from gms_mujoco.dataset import load, save
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import Excitation
from gms_mujoco.frf import estimate_frf
from gms_mujoco.plant import Plant
from gms_mujoco.responses.frf_table import from_table
from gms_mujoco.simulate import simulate

ROBOT = """<mujoco><worldbody><body>
  <joint name="elbow" axis="0 1 0"/><geom size="0.1"/>
  <body><joint name="wrist" axis="0 1 0"/><geom size="0.1"/>
    <body><joint name="ball" type="ball"/><geom size="0.1"/></body>
  </body></body></worldbody></mujoco>"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A plant on file."""
    text = "[axis]\ninertia = 2.4e-5\n[effects.coulomb]\ncoulomb = 4e-3\n[effects.viscous]\ncoefficient = 2e-5\n"
    (tmp_path / "model.toml").write_text(text)
    return tmp_path / "model.toml"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(ROBOT)
    return tmp_path / "robot.xml"


def refuses(capsys: pytest.CaptureFixture[str], *words: str, argv: list[object]) -> None:
    """The command ends with exit code 2 and one line on stderr that has all the words."""
    assert cli.main([str(a) for a in argv]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    said = [s for s in lines if s.startswith("gms-mujoco: ")]
    assert len(said) == 1 and "Traceback" not in "".join(lines), lines
    for word in words:
        assert word in said[0], said[0]


# What it does.


def test_fit_then_compare(small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, scores = tmp_path / "model.toml", tmp_path / "scores.json"
    assert cli.main(["fit", str(small_set), "--effects", "coulomb, viscous", "-o", str(model)]) == 0
    printed = capsys.readouterr()
    assert "coulomb.coulomb" in printed.out and "1 to fit, 1 to validate" in printed.err
    plant = Plant.load(model)
    assert plant["coulomb"].coulomb == pytest.approx(4e-3, rel=0.05)
    assert "coulomb.coulomb" in plant.uncertainty and "fit.csv" in plant.provenance["records"]
    page = tmp_path / "page.html"
    assert cli.main(["compare", str(model), str(small_set), "--json", str(scores), "--report", str(page)]) == 0
    assert "Where this model fails" in page.read_text()
    table = json.loads(scores.read_text())
    assert {r["use"] for r in table["records"]} == set(table["by_use"]) == {"fit", "validate"}
    for pooled in (table, *table["records"], *table["by_use"].values()):
        assert 0 < pooled["torque_error"] < 0.5 and pooled["simulation_error"] > 0
    said = capsys.readouterr().out
    assert table["simulation_window_s"] > 0 and "pooled" in said and f"wrote {scores}\nwrote {page}\n" in said


def test_two_laws_of_friction_are_warned_of(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["fit", str(small_set), "--effects", "stribeck,frictionloss", "-o", str(tmp_path / "model.toml")]
    assert cli.main(argv) == 0
    assert "warning: frictionloss, stribeck are each a law of all the friction" in capsys.readouterr().err


def test_attach_writes_a_model_that_loads_with_its_friction(
    model: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.xml"
    argv = ["attach", str(model), str(robot), "--joint", "elbow", "--joint", "wrist", "-o", str(out)]
    assert cli.main(argv) == 0 and "elbow, wrist" in capsys.readouterr().out
    assert robot.read_text() == ROBOT
    loaded = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(loaded)
    data.qvel[:] = 1.0
    mujoco.mj_forward(loaded, data)
    assert loaded.nplugin > 0 and (data.qfrc_passive[:2] < 0).all()


def test_attach_takes_a_preset_by_name(robot: Path, tmp_path: Path) -> None:
    """The inertia of a preset may be open: that of the model stays."""
    out = tmp_path / "out.xml"
    assert cli.main(["attach", "arm_joint", str(robot), "--joint", "elbow", "-o", str(out)]) == 0
    assert mujoco.MjModel.from_xml_path(str(out)).nplugin == 1


def test_attach_into_another_folder_finds_the_meshes(model: Path, tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "elsewhere").mkdir()
    corners = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    faces = ["1 2 3", "1 2 4", "1 3 4", "2 3 4"]
    lines = [*(f"v {c}" for c in corners), *(f"f {f}" for f in faces)]
    (tmp_path / "assets" / "arm.obj").write_text("\n".join(lines))
    (tmp_path / "robot.xml").write_text(
        '<mujoco><compiler meshdir="assets"/><asset><mesh name="arm" file="arm.obj"/></asset><worldbody><body>'
        '<joint name="elbow"/><geom type="mesh" mesh="arm"/></body></worldbody></mujoco>'
    )
    out = tmp_path / "elsewhere" / "out.xml"
    assert cli.main(["attach", str(model), str(tmp_path / "robot.xml"), "--joint", "elbow", "-o", str(out)]) == 0
    assert mujoco.MjModel.from_xml_path(str(out)).nmesh == 1


@pytest.mark.parametrize("command", ["", "demo", "fit", "compare", "diagnose", "fleet", "attach", "view"])
def test_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main([command, "--help"] if command else ["--help"])
    out = capsys.readouterr().out
    assert caught.value.code == 0 and (f"example:  gms-mujoco {command} " in out if command else "diagnose" in out)


def test_python_m_is_the_same_program(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gms_mujoco", "fit", "nowhere", "-o", "model.toml"],
        cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "nowhere" in done.stderr, done.stderr


# What it refuses.


def test_bad_sets_are_one_line(tmp_path: Path, model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    refuses(capsys, "nowhere", argv=["fit", tmp_path / "nowhere", "-o", tmp_path / "out.toml"])
    refuses(capsys, "no dataset.toml", argv=["diagnose", tmp_path, "-o", out])
    (tmp_path / "dataset.toml").write_text("[axis]\ninertia = -1\n")
    refuses(capsys, "dataset.toml", "axis.inertia", argv=["compare", model, tmp_path])
    assert not out.exists()


def test_bad_models_are_one_line(model: Path, small_set: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refuses(capsys, "none.toml", "no such file", argv=["compare", "none.toml", small_set])
    refuses(capsys, "is a measurement set; expected a plant", argv=["compare", small_set, model])
    for text, word in {
        "[effects.frictoin]\n": "frictoin",
        "[axis]\ninertia = 0\n": "inertia",
        "[effects.gms]\nstiffness = [1, 2]\nfraction = [0.5, 0.6]\n": "sum to 1",
        '[axis]\nkind = "slide"\ninertia = 1.0\n': "slide",
        "[effects.viscous]\ncoefficient = nan\n": "no value yet",
    }.items():
        model.write_text(text)
        refuses(capsys, word, argv=["compare", model, small_set])


def test_unknown_effects_and_joints_are_named(
    model: Path, robot: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, found = tmp_path / "out.xml", tmp_path / "out.toml"
    refuses(capsys, "'frictoin'", "viscous", argv=["fit", small_set, "--effects", "gms,frictoin", "-o", found])
    refuses(capsys, "--effects names none", argv=["fit", small_set, "--effects", ",", "-o", found])
    refuses(capsys, "'knee'", "elbow", argv=["attach", model, robot, "--joint", "knee", "-o", out])
    refuses(capsys, "'ball'", argv=["attach", model, robot, "--joint", "ball", "-o", out])
    refuses(capsys, "none.xml", argv=["attach", model, "none.xml", "--joint", "elbow", "-o", out])
    robot.write_text("<mujoco><worldbody>")
    refuses(capsys, "robot.xml", argv=["attach", model, robot, "--joint", "elbow", "-o", out])
    assert not out.exists() and not found.exists()


def test_a_place_that_cannot_be_written_is_told_before_the_work(
    model: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuses(capsys, "nowhere", argv=["fit", small_set, "-o", tmp_path / "nowhere" / "model.toml"])
    refuses(capsys, "is a folder", argv=["compare", model, small_set, "--json", tmp_path])
    refuses(capsys, "model.toml", argv=["diagnose", small_set, "-o", model])
    assert model.read_text().startswith("[axis]")


@pytest.mark.parametrize(
    "argv",
    [
        "fit SET -o SET/dataset.toml",
        "compare SET/model.toml SET --json SET/model.toml",
        "compare SET/model.toml SET --report SET/link.html",
        "frf SET -o SET/validate.csv",
        "attach SET/model.toml SET/robot.xml --joint elbow -o SET/robot.xml",
        "diagnose SET --model SET/model.toml -o SET",
        "diagnose SET -o SET/out --json SET/dataset.toml",
        "fleet SET --verb bootstrap --model SET/model.toml -o SET",
    ],
)
def test_what_is_read_is_not_written_over(
    argv: str, small_set: Path, model: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "set"
    shutil.copytree(small_set, folder)
    shutil.copy(model, folder), shutil.copy(robot, folder)
    (folder / "link.html").symlink_to("dataset.toml")
    before = {p: p.read_bytes() for p in folder.iterdir()}
    refuses(capsys, "is read here, and would be lost", argv=argv.replace("SET", str(folder)).split())
    assert {p: p.read_bytes() for p in folder.iterdir()} == before


def test_two_results_go_into_two_files(
    model: Path, small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both.html"
    for argv in (
        ["compare", model, small_set, "--json", both, "--report", both],
        ["diagnose", small_set, "-o", tmp_path, "--json", tmp_path / "report.html"],
    ):
        refuses(capsys, "is given for two files to write", argv=argv)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.toml"]


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ("compare MODEL SET --json EMPTY", "json is empty; expected a name"),
        ("diagnose SET -o EMPTY", "output is empty; expected a name"),
        ("compare MODEL SET --report page.png", "page.png: expected the name of a .html file"),
        ("fit SET -o out.json", "out.json: expected the name of a .toml file"),
        ("frf SET -o out.json", "out.json: expected the name of a .csv file"),
        ("attach MODEL robot.xml --joint elbow -o out.urdf", "out.urdf: expected the name of a .xml file"),
        ("fit SET --effects coulomb,viscous,coulomb -o out.toml", "--effects names coulomb twice"),
        ("fit SET --effects coulomb --elements 3 -o out.toml", "--elements is of gms, which is not among the effects"),
    ],
)
def test_no_argument_is_passed_over(
    argv: str, words: str, model: Path, small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    given = {"MODEL": model, "SET": small_set, "EMPTY": ""}
    refuses(capsys, words, argv=[given.get(a, a) for a in argv.split()])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.toml"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_disk_that_is_full_is_one_line(unbuffered: str, model: Path, small_set: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gms_mujoco", "compare", str(model), str(small_set)],
            stdout=full, stderr=subprocess.PIPE, text=True, env=environment, cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[1:] == ["gms-mujoco: what it prints cannot be written (No space left on device)"]


@pytest.mark.parametrize(
    "argv",
    [
        ["demo", "--seed", "-1"],
        ["train", "--generations", "0"],
        ["train", "--plant", "nope"],
        ["fleet", "nowhere"],
        ["fleet", "nowhere", "--verb", "bootstrap"],
    ],
    ids=" ".join,
)
def test_what_is_refused_leaves_no_folder(argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refuses(capsys, "", argv=[*argv, "-o", tmp_path / "out"])
    assert not (tmp_path / "out").exists()


def test_view_writes_what_the_name_says(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refuses(capsys, "a.txt: expected the name of a .rrd file", argv=["view", model, "-o", tmp_path / "a.txt"])
    refuses(capsys, "b.jpg: expected the name of a .png file", argv=["view", model, "--screenshot", tmp_path / "b.jpg"])


def test_commands_that_do_not_exist_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for argv in (["explain"], [], ["fit"], ["fit", "a", "-o", "b", "--speed"]):
        with pytest.raises(SystemExit) as caught:
            cli.main(argv)
        err = capsys.readouterr().err
        assert caught.value.code == 2 and err.count("\n") == 1 and "--help" in err


def test_frf_prints_resonances_and_reads_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plant = Plant.axis(2.4e-5) + effects.find("gms")(
        stiffness=[1.0, 0.5], fraction=[0.5, 0.5], coulomb=4e-3, static=4e-3, stribeck_velocity=1.0, attraction=1.0
    )
    records = []
    for i, level in enumerate((5e-4, 2e-3, 3.5e-3)):
        for f in (4, 8, 12, 16, 20, 28, 40, 60, 100):
            wave = level * np.sin(2 * np.pi * f * np.arange(4000) * 5e-4)
            records.append(simulate(plant, wave, 5e-4, name=f"level_{i}_{f}", use="fit"))
    save(tmp_path / "set", records, inertia=2.4e-5)
    out = tmp_path / "out.csv"
    assert cli.main(["frf", str(tmp_path / "set"), "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "level_0_4.csv and 8 more" in printed and "resonance [Hz]" in printed and "elements, stiffness" in printed
    assert out.read_text().count("\n") == 3 + 1 + 27 and "frequency [Hz]" in out.read_text()
    assert ",excitation [N m],amplitude [rad],sine\n" in out.read_text()


def test_frf_of_a_closed_loop_is_the_indirect_one_where_its_reference_was_logged(tmp_path: Path) -> None:
    axis = Plant.axis(2.4e-5) + effects.Spring(stiffness=0.5) + effects.Viscous(coefficient=1e-3)
    wave = Excitation.multisine(5e-4, 0.5, 10, 200, 2e-3, 0, lines=12)
    loop = measure(axis, wave, controller=lambda: PID(2.4e-5, 5e-4, bandwidth=30.0), position_noise=3e-4, seed=1)
    r = loop.records[0]
    table = {"time": r.time, "torque": r.torque, "position": r.position, "asked": loop.excitations[0]}
    formats.write(tmp_path / "loop.csv", table)
    entry = '[[record]]\nfile = "loop.csv"\nuse = "fit"\n'
    found = {}
    for name, columns in (("plain", ""), ("loop", 'columns = { reference = "asked" }\n')):
        (tmp_path / "dataset.toml").write_text("[axis]\n" + entry + columns)
        assert cli.main(["frf", str(tmp_path), "--period", "0.5", "-o", str(tmp_path / f"{name}.out.csv")]) == 0
        found[name] = from_table(formats.read(tmp_path / f"{name}.out.csv"), name, "torque", "position")
    with_reference = load(tmp_path).records[0]
    exact = estimate_frf(with_reference, method="indirect", period=0.5)
    assert np.allclose(found["loop"].response, exact.response)
    assert np.allclose(exact.response, loop.frf().response, rtol=1e-6)
    assert len(found["loop"]) == 12 == len(found["plain"])  # noise that is fed back excites nothing
    with pytest.raises(DataError, match="needs the reference of the loop"):
        estimate_frf(r, method="indirect", period=0.5)


def test_frf_says_where_it_found_no_period(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis = Plant.axis(2.4e-5) + effects.Spring(stiffness=0.5) + effects.Viscous(coefficient=1e-3)
    save(tmp_path, [simulate(axis, 1e-3 * np.random.default_rng(1).normal(size=8000), 5e-4, name="random")])
    for more, said in (([], True), (["--segment", "0.5"], False)):
        assert cli.main(["frf", str(tmp_path), *more]) == 0
        line = "no period was found in the input: 15 half-overlapped Hann segments of 0.5 s; say --period or --segment"
        assert (line in capsys.readouterr().err) is said


def test_frf_of_a_folder_with_responses_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("f [Hz],real,imag\n1,2.0,-0.5\n2,1.0,-0.5\n30,-0.1,-0.01\n")
    entry = '[[frf]]\nfile = "a.csv"\ninput = "torque"\noutput = "position"\n'
    (tmp_path / "dataset.toml").write_text(entry)
    assert cli.main(["frf", str(tmp_path)]) == 0
    assert "amplitude of the excitation is not known" in capsys.readouterr().out
    refuses(capsys, "amplitude of the excitation is not known", argv=["fit", tmp_path, "-o", tmp_path / "m.toml"])
    refuses(capsys, "nowhere", argv=["frf", tmp_path, "-o", tmp_path / "nowhere" / "a.csv"])
    refuses(capsys, "--period", argv=["frf", tmp_path, "--period", "-1"])
    refuses(capsys, "no such file or folder", argv=["frf", tmp_path / "none"])


def test_frf_prints_the_antiresonance_of_a_flexible_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    f = np.geomspace(1, 30, 60)
    curve = (7.3**2 - f**2 + 0.2j * f) / (20**2 - f**2 + 2j * f)
    rows = "".join(f"{a:.9g},{g.real:.9g},{g.imag:.9g}\n" for a, g in zip(f, curve, strict=True))
    (tmp_path / "a.csv").write_text("f [Hz],real,imag\n" + rows)
    (tmp_path / "dataset.toml").write_text('[[frf]]\nfile = "a.csv"\ninput = "voltage"\noutput = "position"\n')
    assert cli.main(["frf", str(tmp_path)]) == 0
    assert "a.csv: antiresonance at 7.298 Hz (7.2" in capsys.readouterr().out


def test_view_wants_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refuses(capsys, "recording.rrd", argv=["view", tmp_path])
    (tmp_path / "data.csv").touch()
    refuses(capsys, "not a recording", argv=["view", tmp_path / "data.csv"])
    refuses(capsys, "no such file", argv=["view", tmp_path / "robot.xml"])
    refuses(capsys, "is neither", argv=["view", tmp_path / "data.csv", "-o", tmp_path / "out.rrd"])
    (tmp_path / "robot.xml").write_text("<mujoco><worldbody><body/></worldbody></mujoco>")
    refuses(capsys, "must not be negative", argv=["view", tmp_path / "robot.xml", "--seconds", "-1"])


def test_view_draws_a_plant(tmp_path: Path) -> None:
    for plant in ("servo_axis", files.MODELS / "servo_axis.toml"):
        kept = tmp_path / "plant.rrd"
        assert cli.main(["view", str(plant), "-o", str(kept)]) == 0
        assert kept.stat().st_size > 1e4
        kept.unlink()


def test_view_keeps_the_motion_of_a_model(tmp_path: Path) -> None:
    arm, kept = str(files.MODELS / "arm.xml"), tmp_path / "arm.rrd"
    assert cli.main(["view", arm, "--seconds", "0.05", "-o", str(kept)]) == 0
    assert kept.stat().st_size > 1000


def test_interrupting_is_no_traceback(
    small_set: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(path: str, joint: str | None) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "load", interrupted)
    assert cli.main(["fit", str(small_set), "-o", "y.toml"]) == 130
    assert capsys.readouterr().err == "gms-mujoco: interrupted\n"


# Small things.


def test_json_is_strict() -> None:
    text = cli.as_json({"a": float("nan"), "b": [1.0, float("inf")], "c": (True, "x")})
    assert json.loads(text) == {"a": None, "b": [1.0, None], "c": [True, "x"]}


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["--version"])
    project = Path(__file__).parent.parent / "pyproject.toml"
    printed = capsys.readouterr().out.split()[1]
    assert printed in (tomllib.loads(project.read_text())["project"]["version"], "0.0.0")
