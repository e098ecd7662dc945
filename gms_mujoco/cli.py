"""The command line: `gms-mujoco demo | fit | compare | diagnose | fleet | frf | attach | train | view`.

Exit codes: 0 done, 2 bad input (one line on stderr says which file, line or key, and what was expected),
130 interrupted. Files are written whole or not at all.
"""

from __future__ import annotations

import argparse
import errno
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from . import effects, files
from .dataset import Dataset, files_of, load
from .errors import DataError, GmsError, ModelError, listing
from .files import as_json
from .plant import Plant
from .progress import Bar
from .version import __version__

if TYPE_CHECKING:
    import mujoco

    from .dahl_resonance import DahlReading
    from .diagnosis.findings import Diagnosis

PROGRAM = "gms-mujoco"
_MOST_ELEMENTS = 32
_RESULTS = ("diagnosis.json", "baseline.toml", "model.toml", "report.html", "recording.rrd")  # of a diagnosis
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # errors of writing, here without a name: what is printed


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    warnings.showwarning = _say_warning
    try:
        options = _parser().parse_args(arguments)
        _expect_given(options)
        options.run(options)
        sys.stdout.flush()
    except GmsError as error:
        print(f"{PROGRAM}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output has left, as `head` does
        _print_no_more()
    except OSError as error:
        if error.filename is not None or error.errno not in _FULL:
            raise
        _print_no_more()
        print(f"{PROGRAM}: what it prints cannot be written ({error.strerror})", file=sys.stderr)
        return 2
    return 0


def _print_no_more() -> None:
    """Sends the rest nowhere, which would fail once more as the program ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"{PROGRAM}: warning: {' '.join(str(message).split())}", file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog=PROGRAM,
        description="Realistic joint friction for MuJoCo: fit it to a log of a servo drive, see where it fails, and "
        "find the physical effect that is missing.",
        epilog=f"{PROGRAM} COMMAND --help explains one command. Start with: {PROGRAM} demo",
    )
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)

    def command(name: str, run: Any, summary: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
            epilog=f"example:  {PROGRAM} {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.set_defaults(run=run)
        return sub

    def dataset(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("dataset", metavar="DATASET", help="folder with dataset.toml, or that file")
        sub.add_argument("--joint", metavar="NAME", help="which joint, where the set is of several joints of a robot")

    sub = command("demo", _demo, "simulate a servo axis with a hidden effect and find it", "demo --seed 3 -o demo")
    sub.add_argument("--seed", type=int, default=0, help="draws the axis and the effect it hides (default: 0)")
    sub.add_argument("-o", "--output", default="gms-mujoco-demo", metavar="DIR",
                     help="folder for data and results (default: gms-mujoco-demo)")

    sub = command("fit", _fit, "identify the parameters of a plant from measured records",
                  "fit measurements/ --effects gms,viscous,cogging -o model.toml")
    dataset(sub)
    sub.add_argument("-o", "--output", required=True, metavar="MODEL.toml", help="the identified plant")
    sub.add_argument("--effects", metavar="NAME,...", help="default: gms,viscous; of a servo that takes a goal: "
                     "coulomb,viscous")
    sub.add_argument("--elements", metavar="N", help="of gms; auto: as few as the data ask for "
                     "(default: auto from frequency responses alone, else 8)")

    sub = command("compare", _compare, "score a plant against measured records, one by one and pooled",
                  "compare model.toml measurements/ --report compare.html")
    sub.add_argument("model", metavar="MODEL.toml", help="plant to score")
    dataset(sub)
    sub.add_argument("--json", metavar="FILE", help="write the scores and every view of the residual to this file")
    sub.add_argument("--report", metavar="FILE.html", help="write a page that shows where the plant fails")

    sub = command("diagnose", _diagnose, "find the effects that a plant lacks, add them and fit again",
                  "diagnose measurements/ -o diagnosis")
    dataset(sub)
    sub.add_argument("--model", metavar="MODEL.toml", help="plant to start from (default: inertia, gms, viscous; of a "
                     "servo that takes a goal: inertia, loop and motor, coulomb, viscous)")
    sub.add_argument("-o", "--output", required=True, metavar="DIR",
                     help="gets diagnosis.json, baseline.toml, model.toml, recording.rrd and report.html")
    sub.add_argument("--without", metavar="NAME,...", default="", help="effects that you know not to be there")
    sub.add_argument("--effort", type=float, default=1.0, metavar="X",
                     help="times the usual limit of the work that the search may take; inf: none (default: 1)")
    sub.add_argument("--json", metavar="FILE", help="write diagnosis.json to this file too")

    sub = command("fleet", _fleet, "fit or diagnose many measurement sets, or refit one many times, on all processors",
                  "fleet robots/ --verb diagnose -o fleet")
    sub.add_argument("datasets", metavar="DATASET", nargs="+",
                     help="folders with dataset.toml, or folders that have such folders in them")
    sub.add_argument("-o", "--output", required=True, metavar="DIR",
                     help="gets a folder for each set and joint, summary.csv and summary.json; the same command again "
                     "goes on where a run was stopped")
    sub.add_argument("--verb", default="fit", choices=("fit", "diagnose", "bootstrap"),
                     help="bootstrap: 95 %% intervals of one set from refits to redrawn residuals (default: fit)")
    sub.add_argument("--model", metavar="MODEL.toml", help="plant to start from (default: inertia, gms, viscous)")
    sub.add_argument("--jobs", type=int, default=-1, metavar="N",
                     help="processes; -1: one for each processor (default: -1)")
    sub.add_argument("--cluster", metavar="ADDRESS", help="of a Dask scheduler whose workers do it instead")
    sub.add_argument("--refits", type=int, default=200, metavar="N", help="of a bootstrap (default: 200)")
    sub.add_argument("--seed", type=int, default=0, help="of a bootstrap (default: 0)")
    sub.add_argument("--joint", metavar="NAME", help="of a bootstrap, where the set is of several joints")

    sub = command("frf", _frf, "estimate frequency responses, inside a loop by its reference where that was logged, "
                  "and read friction from the Dahl resonance",
                  "frf measurements/ -o responses.csv")
    dataset(sub)
    sub.add_argument("-o", "--output", metavar="FILE.csv", help="write every response to this file")
    sub.add_argument("--period", type=float, metavar="SECONDS", help="of the excitation (default: found in the torque)")
    sub.add_argument("--segment", type=float, metavar="SECONDS",
                     help="for excitation without period: length of the averaged segments")

    sub = command("attach", _attach, "put the effects of a plant on joints of a MuJoCo model",
                  "attach model.toml robot.xml --joint elbow -o robot_with_friction.xml")
    sub.add_argument("model", metavar="MODEL.toml", help="plant whose effects the joints get")
    sub.add_argument("robot", metavar="ROBOT.xml", help="MJCF model, left as it is")
    sub.add_argument("--joint", required=True, action="append", metavar="NAME", help="hinge or slide; may be repeated")
    sub.add_argument("-o", "--output", required=True, metavar="OUT.xml", help="the model with friction")

    sub = command("train", _train, "train the learning baseline of friction compensation, and test it against a PID",
                  "train -o policy")
    sub.add_argument("-o", "--output", required=True, metavar="DIR",
                     help="gets policy.json, training.json and recording.rrd")
    sub.add_argument("--plant", default="servo_axis", metavar="MODEL.toml",
                     help="file, or preset by name (default: servo_axis)")
    sub.add_argument("--model", metavar="ROBOT.xml", help="MJCF model, to train on a joint of it")
    sub.add_argument("--joint", metavar="NAME", help="of that model")
    sub.add_argument("--seed", type=int, default=0, help="draws candidates and episodes (default: 0)")
    sub.add_argument("--generations", type=int, default=30, metavar="N", help="default: 30")
    sub.add_argument("--bandwidth", type=float, default=50.0, metavar="HZ", help="of the PID (default: 50)")

    sub = command("view", _view, "open a recording, draw the friction of a plant, or let a MuJoCo model go and look",
                  "view robot_with_friction.xml --seconds 5")
    sub.add_argument("path", metavar="PATH", help="a .rrd file; the folder that diagnose, demo or train wrote; a "
                     "model.toml or a plant by name, whose curves are drawn; or an MJCF model, which is let go where "
                     "it begins")
    sub.add_argument("--screenshot", metavar="OUT.png", help="write a picture instead of opening a window")
    sub.add_argument("--seconds", type=float, default=3.0, metavar="S", help="of a model's motion (default: 3)")
    sub.add_argument("-o", "--output", metavar="OUT.rrd", help="keep the recording of a model here")
    return parser


# The commands. Slow imports wait until a command needs them.


def _demo(options: argparse.Namespace) -> None:
    from .demo import run

    _expect_seed(options)
    folder = files.make_folder(options.output)
    with Bar() as bar:
        result = run(folder, options.seed, progress=bar)
        _write_diagnosis(folder, result.diagnosis)
    print(result)
    _say_results(folder)


def _fit(options: argparse.Namespace) -> None:
    from .compare import compare
    from .elements import choose_elements
    from .fit import baseline, fit
    from .identification.starts import of_one_law
    from .identification.undetermined import by_experiment

    output = _expect_suffix(options.output, ".toml")
    count = options.elements
    if count not in (None, "auto") and not (count.isdecimal() and 0 < int(count) <= _MOST_ELEMENTS):
        raise ModelError(f"--elements must be auto or a number from 1 to {_MOST_ELEMENTS}; {count!r} given")
    files.expect_apart([output], files_of(options.dataset))
    runs = _load(options)
    elements = int(count) if count not in (None, "auto") else 8
    plant = baseline(runs.inertia, runs.kind, elements, runs.controller)
    if options.effects is not None:
        plant = _chosen(plant, options.effects)
    if count is not None and "gms" not in plant:
        names = listing(e.name for e in plant.effects)
        raise ModelError(f"--elements is of gms, which is not among the effects; they are {names}")
    if said := of_one_law(plant):
        print(f"{PROGRAM}: warning: {said}", file=sys.stderr)
    auto = count == "auto" or (count is None and runs.frfs and not runs.records and "gms" in plant)
    with Bar() as bar:
        result = (choose_elements if auto else fit)(plant, runs.fit, progress=bar)
    result.plant.save(output)
    print(result.status)
    if runs.validate:
        scores = compare(result.plant, runs.validate)
        print(f"validate error {scores.score.told(scores.error)}")
    print(result.plant)
    for names, experiment in by_experiment(result.undetermined):
        print(f"not determined by these data: {names}; what would tell: {experiment}")
    print(f"wrote {output}")


def _compare(options: argparse.Namespace) -> None:
    from .compare import compare
    from .views.report import render_comparison

    output = files.expect_writable(options.json) if options.json else None
    page = _expect_suffix(options.report, ".html") if options.report else None
    files.expect_apart(filter(None, (output, page)), [options.model, *files_of(options.dataset)])
    plant = Plant.load(options.model).complete()
    runs = _load(options)
    _expect_kind(plant, runs, options.model)
    scores = compare(plant, runs.all)
    by_use = scores.by_use()
    if output:
        files.write_text(output, as_json({**scores.to_dict(), "by_use": by_use}))
    print(scores)
    for use, pooled in by_use.items():
        score = scores.score
        print(f"{use}: {score.name} {score.told(pooled[f'{score.of}_error'])}, "
              f"noise floor {score.told(pooled['noise_floor'])}")
    if page:
        files.write_text(page, render_comparison(scores, Path(options.model).stem))
    for written in filter(None, (output, page)):
        print(f"wrote {written}")


def _diagnose(options: argparse.Namespace) -> None:
    from .diagnose import diagnose

    extra = files.expect_writable(options.json) if options.json else None
    folder = files.expect_folder(options.output)
    written = [extra or folder / _RESULTS[0], *(folder / name for name in _RESULTS[1:])]
    files.expect_apart(written, [*filter(None, [options.model]), *files_of(options.dataset)])
    plant = Plant.load(options.model) if options.model else None
    runs = _load(options)
    if plant is not None:
        _expect_kind(plant, runs, options.model)
    with Bar() as bar:
        result = diagnose(runs, plant, without=_names(options.without), effort=options.effort, progress=bar)
        files.make_folder(folder)
        _write_diagnosis(folder, result)
    if extra:
        files.write_text(extra, as_json(result.to_dict()))
    print(result)
    _say_results(folder)
    if extra:
        print(f"wrote {extra}")


def _fleet(options: argparse.Namespace) -> None:
    from . import fleet

    plant = Plant.load(options.model) if options.model else None
    how: dict[str, Any] = {"jobs": options.jobs, "cluster": options.cluster}
    if options.verb == "bootstrap":
        if len(options.datasets) > 1:
            raise DataError(f"a bootstrap is of one measurement set; {len(options.datasets)} given")
        _expect_seed(options)
        inputs = [*filter(None, [options.model]), *files_of(fleet.find_sets(options.datasets)[0])]
        files.expect_apart([files.expect_folder(options.output) / "model.toml"], inputs)
        with Bar() as bar:
            found = fleet.bootstrap(options.datasets[0], options.output, plant, refits=options.refits,
                                    joint=options.joint, seed=options.seed, progress=bar, **how)  # fmt: skip
        print(found)
        print(f"wrote {options.output}/model.toml: intervals from {options.refits} refits")
        return
    if options.joint:
        raise DataError("--joint is for a bootstrap; a fleet takes every joint of its sets")
    with Bar() as bar:
        done = fleet.run_all(options.verb, options.datasets, options.output, plant, progress=bar, **how)
    print(done)
    print(f"wrote {options.output}/ ({', '.join(fleet.SUMMARY)}, and a folder for each)")
    if len(done.failed) == len(done.rows):
        raise GmsError(f"every measurement set failed, the first with: {done.failed[0]['error']}")


def _frf(options: argparse.Namespace) -> None:
    from .dahl_resonance import identify_dahl
    from .frf import estimate_frf, join_sines, to_csv
    from .responses.resonance import COHERENT, antiresonances, find_resonance
    from .responses.spectra import NO_PERIOD

    output = _expect_suffix(options.output, ".csv") if options.output else None
    for key in ("period", "segment"):
        if getattr(options, key) is not None and not 0 < getattr(options, key) < math.inf:
            raise DataError(f"--{key} must be a positive number of seconds; {getattr(options, key):g} given")
    if output:
        files.expect_apart([output], files_of(options.dataset))
    runs = _load(options)
    found = list(runs.frfs)
    for record in runs.records:
        way: Any = {"period": options.period, "segment": options.segment, "kind": runs.kind}
        if record.get("reference") is not None:
            way["method"] = "indirect"
        try:
            found.append(estimate_frf(record, **way))
        except DataError as error:
            print(f"{PROGRAM}: warning: left out: {error}", file=sys.stderr)
            continue
        if (note := found[-1].notes[0]).startswith(NO_PERIOD):
            print(f"{record.name}: {note}; say --period or --segment where you know one", file=sys.stderr)
    if not found:
        raise DataError(f"{options.dataset}: no record gives a frequency response")
    found = join_sines(found)
    if output:
        files.write_text(output, to_csv(found))
    unit = "rad" if runs.kind == "hinge" else "m"
    print(f"{'response':28} {'points':>6} {'from [Hz]':>10} {'to [Hz]':>10} {'amplitude [' + unit + ']':>22} "
          f"{'resonance [Hz]':>14} {'coherence':>9}")
    for f in found:
        resonance, size = None, "unknown"
        if f.amplitude is not None:
            size = f"{f.amplitude.min():.3g} to {f.amplitude.max():.3g}"
            resonance = find_resonance(f) if f.input in ("torque", "load") else None
        tuned = "none" if resonance is None else f"{resonance.frequency:.4g}"
        if resonance and f.coherence is not None:
            nearest = abs(f.frequency - resonance.frequency).argmin()
            tuned = tuned if f.coherence[nearest] > COHERENT else "unclear"
        coherence = "" if f.coherence is None else f"{sum(f.coherence) / len(f):.4f}"
        print(f"{f.name[:28]:28} {len(f):6} {f.frequency[0]:10.4g} {f.frequency[-1]:10.4g} {size:>22} {tuned:>14} "
              f"{coherence:>9}")
    for f in found:
        if dips := [f"{at:.4g} Hz ({low:.4g} to {high:.4g})" for at, low, high in antiresonances(f)]:
            print(f"{f.name}: antiresonance at {', '.join(dips)}, with 95 % intervals")
    print()
    try:
        print(_reading(identify_dahl([f for f in found if f.use == "fit"], runs.inertia, kind=runs.kind), runs.kind))
        print(f"For the final numbers, with the Stribeck curve and intervals: {PROGRAM} fit {options.dataset} "
              "-o model.toml")
    except DataError as error:
        print(f"no friction read from the resonance: {error}")
    if output:
        print(f"wrote {output}")


def _reading(reading: DahlReading, kind: str) -> str:
    """What the Dahl resonance says about friction, and beside it the two naive readings of it."""
    torque, size = ("N m", "rad") if kind == "hinge" else ("N", "m")
    lines = ["friction read from the Dahl resonance, by describing function:"]
    lines += [f"  {part}" for part in reading.status.split("; ")]
    if rows := reading.readings():
        heads = (f"amplitude [{size}]", f"J w^2 [{torque}/{size}]", "describing fn.", "as secant", "as slope")
        lines += ["", f"virgin curve [{torque}] at the amplitude of each resonance, and by the two naive readings:"]
        lines.append(" ".join(f"{h:>{w}}" for h, w in zip(heads, (16, 16, 14, 12, 12), strict=True)))
        lines += [f"{a:16.3g} {k:16.4g} {d:14.4g} {s:12.4g} {t:12.4g}" for a, k, d, s, t in rows]
    return "\n".join([*lines, ""])


def _attach(options: argparse.Namespace) -> None:
    from .engine import attach

    output = _expect_suffix(options.output, ".xml")
    files.expect_apart([output], [options.model, options.robot])
    plant = Plant.load(options.model)
    spec = attach(options.robot, {name: plant for name in options.joint})
    _keep_assets(spec, Path(options.robot), output)
    try:
        text = spec.to_xml()
    except ValueError as error:  # the model does not compile
        raise ModelError(f"{options.robot}: {error}") from None
    files.write_text(output, text)
    print(f"wrote {output}: {', '.join(e.name for e in plant.effects)} on {', '.join(options.joint)}")
    print("load it after `import gms_mujoco`, which registers the plug-in with MuJoCo")


def _train(options: argparse.Namespace) -> None:
    from .learn import train
    from .view import RECORDING, write_training

    _expect_seed(options)
    folder = files.expect_folder(options.output)
    with Bar() as bar:
        result = train(
            options.generations, seed=options.seed, bandwidth=options.bandwidth, progress=bar,
            plant=options.plant, model=options.model, joint=options.joint,
        )  # fmt: skip
        files.make_folder(folder)
        result.policy.save(folder / "policy.json")
        files.write_text(folder / "training.json", as_json(result.to_dict()))
        write_training(folder / RECORDING, result)
    print(result)
    print(f"wrote {folder}/ (policy.json; {PROGRAM} view {folder} opens the recording)")
    if all(r.policy_away.all() for r in result.runs):
        raise GmsError("the policy runs away in every test episode: nothing was learnt; try another --bandwidth")


def _view(options: argparse.Namespace) -> None:
    from .view import open_recording, record_motion, write_portrait

    picture = _expect_suffix(options.screenshot, ".png") if options.screenshot else None
    output = _expect_suffix(options.output, ".rrd") if options.output else None
    path = Path(options.path)
    kind = path.suffix.lower()
    if kind not in (".xml", ".toml") and not (files.MODELS / f"{path}.toml").is_file():
        if output:
            raise GmsError(f"-o keeps the recording of an MJCF model or of a model.toml; {path} is neither")
        open_recording(path, picture)
    else:
        with tempfile.TemporaryDirectory() as folder:
            recording = output or Path(folder) / "made.rrd"
            if kind == ".xml":
                record_motion(recording, _compiled(options.path), options.seconds)
            else:
                write_portrait(recording, Plant.load(path))
            if picture or not output:
                open_recording(recording, picture)
    for written in filter(None, (output, picture)):
        print(f"wrote {written}")


def _expect_suffix(path: str, suffix: str) -> Path:
    if Path(path).suffix.lower() != suffix:
        raise GmsError(f"{path}: expected the name of a {suffix} file")
    return files.expect_writable(path)


def _compiled(path: str) -> mujoco.MjModel:
    from .engine import compiled, spec_of

    try:
        return compiled(spec_of(path))
    except ModelError as error:
        raise ModelError(str(error) if path in str(error) else f"{path}: {error}") from None


# What the commands share.


def _expect_given(options: argparse.Namespace) -> None:
    """Raises GmsError where an empty text was given: a variable of the shell that is not set."""
    for key, value in vars(options).items():
        if value == "" and key not in ("effects", "elements", "without"):  # which say themselves what they want
            raise GmsError(f"{key} is empty; expected a name")


def _expect_seed(options: argparse.Namespace) -> None:
    if options.seed < 0:
        raise GmsError(f"the seed must not be negative; {options.seed} given")


def _load(options: argparse.Namespace) -> Dataset:
    runs = load(options.dataset, options.joint)
    for line in (runs.split, *runs.notes):
        print(line, file=sys.stderr)
    return runs


def _keep_assets(spec: Any, source: Path, output: Path) -> None:
    """Lets a model that is saved in another folder find its meshes and textures where they are."""
    here, there = output.resolve().parent, source.resolve().parent
    if here != there:
        spec.modelfiledir = str(here)
        for key in ("meshdir", "texturedir"):
            setattr(spec.compiler, key, Path(os.path.relpath(there / getattr(spec.compiler, key), here)).as_posix())


def _chosen(baseline: Plant, names: str) -> Plant:
    """The axis of the baseline with the named effects, set up as in the baseline where it has them."""
    plant = replace(baseline, effects=tuple(e for e in baseline.effects if e.kind == "controller"))
    chosen = _names(names)
    for name in chosen:
        if chosen.count(name) > 1:
            raise ModelError(f"--effects names {name} twice; an effect stands in a plant once")
        if name in plant:
            continue
        plant += baseline[name] if name in baseline else effects.find(name)()
    if not chosen:
        raise ModelError(f"--effects names none; the effects are {', '.join(effects.CATALOGUE)}")
    return plant


def _names(text: str) -> list[str]:
    """Names that commas part."""
    return [n.strip() for n in text.split(",") if n.strip()]


def _expect_kind(plant: Plant, runs: Dataset, file: str) -> None:
    if plant.kind != runs.kind:
        raise ModelError(f"{file}: the plant is a {plant.kind} joint, the measurement set is of a {runs.kind} joint")


def _write_diagnosis(folder: Path, diagnosis: Diagnosis) -> None:
    """The five files of a diagnosis, those that other programs read first."""
    from .views.report import render
    from .views.tour import write_recording

    table, baseline, plant, page, recording = (folder / name for name in _RESULTS)
    files.write_text(table, as_json(diagnosis.to_dict()))
    diagnosis.baseline.save(baseline)
    diagnosis.plant.save(plant)
    files.write_text(page, render(diagnosis))
    write_recording(recording, diagnosis)


def _say_results(folder: Path) -> None:
    print(f"wrote {folder}/ (report.html for people; {PROGRAM} view {folder} opens the recording)")
