"""Fleets: many measurement sets fitted or diagnosed, and many refits of one, through one joblib call.

    done = fit_all(["robots/"], "fleet", jobs=16)                  # processes of this machine
    done = fit_all(["robots/"], "fleet", cluster="10.0.0.5:8786")  # the workers of a Dask cluster
    print(done)

Each task writes its own folder, the file `result.json` last and by renaming: what is there is whole. So a run that was
killed is started again with the same call and goes on with what is missing; tasks that had failed are tried again, and
one whose measurement set has changed is done anew. Every task works on one thread, so that the numbers do not depend on
where it runs. Workers on other machines need the same paths.

joblib, and dask for a cluster, come with the extra: pip install 'gms-mujoco[fleet]'.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import files
from .compare import compare
from .comparison.score import POSITION, TORQUE, Score
from .dataset import FILE, Dataset, joints, load
from .diagnose import diagnose
from .errors import DataError, GmsError, listing
from .fit import baseline, fit
from .identification.bootstrap import BLOCK, redrawn, refit, residuals, with_intervals
from .plant import Plant
from .progress import Progress, part, silent
from .record import Record
from .version import __version__
from .workers import Row, run

Array = NDArray[np.float64]

SUMMARY = ("summary.csv", "summary.json")
VERBS = ("fit", "diagnose")
_COLUMNS = ("name", "status", "verdict", "effects", "fit_error", "validate_error", "noise_floor", "error_unit",
            "seconds", "dataset", "joint", "error")  # fmt: skip
_SHOWN = 40  # rows in the printed table, beside those that failed


@dataclass(frozen=True)
class Task:
    """One piece of work, small enough to be sent to another machine.

    Attributes:
        verb: "fit", "diagnose" or "refit".
        name: of its folder.
        folder: that it writes.
        dataset: folder of the measurement set.
        joint: of the set, None for its only axis.
        plant: text of the model.toml to begin with; None: the baseline.
        digest: of all that the result depends on.
        draw: of a refit, seed and number: they draw its residuals.
        block: of a refit, length of the blocks [s].
    """

    verb: str
    name: str
    folder: str
    dataset: str
    joint: str | None = None
    plant: str | None = None
    digest: str = ""
    draw: tuple[int, int] = (0, 0)
    block: float = 0.0


@dataclass(frozen=True)
class Fleet:
    """What became of a fleet.

    Attributes:
        folder: that holds a folder for each task, and the summary.
        rows: results in the order of the tasks, as `result.json` has them.
    """

    folder: Path
    rows: tuple[Mapping[str, Any], ...]

    @property
    def failed(self) -> tuple[Mapping[str, Any], ...]:
        """Rows of the tasks that failed, each with its `error`, one line."""
        return tuple(r for r in self.rows if r["status"] != "done")

    def plant(self, name: str) -> Plant:
        """The plant that a task has found."""
        return Plant.load(self.folder / name / "model.toml")

    def __str__(self) -> str:
        lines = [f"{'name':32} {'result':18} {'fit':>9} {'validate':>9} {'floor':>9}  effects"]
        shown = [*self.rows[:_SHOWN], *(r for r in self.rows[_SHOWN:] if r["status"] != "done")]
        for r in shown:
            if r["status"] != "done":
                lines.append(f"{r['name'][:32]:32} failed: {r['error']}")
                continue
            score = POSITION if r.get("error_unit") == POSITION.unit else TORQUE
            errors = " ".join(_told(score, r.get(k)) for k in ("fit_error", "validate_error", "noise_floor"))
            lines.append(f"{r['name'][:32]:32} {r.get('verdict') or 'fitted':18} {errors}  {', '.join(r['effects'])}")
        if len(shown) < len(self.rows):
            lines.append(f"... and {len(self.rows) - len(shown)} more that are done, see {SUMMARY[0]}")
        return "\n".join([*lines, f"{len(self.rows) - len(self.failed)} done, {len(self.failed)} failed"])


def _told(score: Score, x: float | None) -> str:
    return f"{'' if x is None else score.told(x):>9}"


def fit_all(
    datasets: Iterable[str | Path] | str | Path, out: str | Path, plant: Plant | None = None, **how: Any
) -> Fleet:
    """`fit` on every joint of many measurement sets; see `run_all`."""
    return run_all("fit", datasets, out, plant, **how)


def diagnose_all(
    datasets: Iterable[str | Path] | str | Path, out: str | Path, plant: Plant | None = None, **how: Any
) -> Fleet:
    """`diagnose` on every joint of many measurement sets; see `run_all`."""
    return run_all("diagnose", datasets, out, plant, **how)


def run_all(
    verb: str,
    datasets: Iterable[str | Path] | str | Path,
    out: str | Path,
    plant: Plant | None = None,
    *,
    jobs: int = -1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Fleet:
    """One verb on every joint of many measurement sets.

    One that fails does not stop the others: its row has the status "failed" and the error, one line.

    Args:
        verb: "fit" or "diagnose".
        datasets: folders with `dataset.toml`, or folders that have such folders in them.
        out: gets a folder for each task (`model.toml`, of a diagnosis `diagnosis.json` and `baseline.toml` too,
            `result.json`), `summary.csv` and `summary.json`.
        plant: to begin with; None: the baseline of each set.
        jobs: processes of this machine, 1: none but this one, -1: one for each processor. On a cluster it has no
            influence.
        cluster: address of a Dask scheduler, such as "tcp://10.0.0.5:8786".
        progress: called with the share done, which never falls, and a message.

    Raises:
        GmsError: no such verb or set, joblib or dask is not installed, the cluster does not answer, `out` cannot be
            written.
    """
    if verb not in VERBS:
        raise GmsError(f"verbs for a fleet are {listing(VERBS)}; {verb!r} given")
    text = None if plant is None else plant.to_toml()
    folder = files.expect_folder(out)
    tasks = []
    for path in find_sets(datasets):
        try:
            names: Sequence[str | None] = joints(path) or (None,)
        except GmsError:
            names = (None,)  # the task itself will say what is wrong
        tasks += [task_of(verb, folder, path, joint, text) for joint in names]
    fleet = Fleet(folder, tuple(run(tasks, _do, jobs, cluster, progress)))
    files.make_folder(folder)
    write_summary(fleet)
    return fleet


def find_sets(datasets: Iterable[str | Path] | str | Path) -> list[Path]:
    """Folders of measurement sets, each once: those given, or all below those given.

    Raises:
        DataError: there is no such folder, or no set in it.
    """
    given = [datasets] if isinstance(datasets, str | Path) else list(datasets)
    found: dict[Path, None] = {}
    for path in map(Path, given):
        path = path.parent if path.name == FILE else path
        below = [path] if (path / FILE).exists() else sorted(p.parent for p in path.rglob(FILE))
        if not path.exists():
            raise DataError(f"{path}: no such folder")
        if not below:
            raise DataError(f"{path}: no {FILE} in this folder or below it")
        found |= dict.fromkeys(p.resolve() for p in below)
    if not found:
        raise DataError("a fleet needs at least one measurement set; none given")
    return list(found)


def task_of(verb: str, folder: Path, dataset: Path, joint: str | None, plant: str | None, **more: Any) -> Task:
    """The task on one joint of a set, in a folder whose name stays the same whatever else the fleet has in it."""
    place = hashlib.sha256(str(dataset).encode()).hexdigest()[:6]
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in f"{dataset.name}{f'.{joint}' if joint else ''}")
    name = f"{safe}-{place}" if "name" not in more else more.pop("name")
    task = Task(verb, name, str(folder.resolve() / name), str(dataset), joint, plant, **more)
    sizes = sorted((p.name, p.stat().st_size) for p in dataset.iterdir() if p.is_file() and p.name != FILE)
    toml = (dataset / FILE).read_bytes() if (dataset / FILE).is_file() else b""
    told = repr((verb, joint, plant, task.draw, task.block, __version__, sizes)).encode()
    return replace(task, digest=hashlib.sha256(toml + told).hexdigest())


def _do(task: Task, folder: Path) -> Row:
    where = {"dataset": task.dataset, "joint": task.joint}
    try:
        return where | _DO[task.verb](task, folder)
    except GmsError as error:
        return where | {"status": "failed", "error": " ".join(str(error).split())}


def _start(task: Task, runs: Dataset) -> Plant:
    if task.plant is None:
        return baseline(runs.inertia, runs.kind, controller=runs.controller)
    plant = plant_of_text(task.plant)
    if plant.kind != runs.kind:
        raise GmsError(f"the plant is a {plant.kind} joint, the measurement set is of a {runs.kind} joint")
    return plant


def plant_of_text(text: str) -> Plant:
    """A plant from the text of a `model.toml`."""
    return Plant.from_table(tomllib.loads(text))


def _fit(task: Task, folder: Path) -> Row:
    runs = load(task.dataset, task.joint)
    found = fit(_start(task, runs), runs.fit)
    found.plant.save(folder / "model.toml")
    scored = compare(found.plant, runs.validate).error if runs.validate else None
    return _row(found.plant, found.error, scored, found.floor)


def _diagnose(task: Task, folder: Path) -> Row:
    runs = load(task.dataset, task.joint)
    found = diagnose(runs, _start(task, runs) if task.plant else None)
    last = found.steps[-1]
    files.write_text(folder / "diagnosis.json", files.as_json(found.to_dict()))
    found.baseline.save(folder / "baseline.toml")
    found.plant.save(folder / "model.toml")
    row = _row(found.plant, last.result.error, last.validate_error, found.noise_floor)
    return row | {"verdict": found.verdict, "added": [s.effect for s in found.steps if s.effect]}


def _row(plant: Plant, fit_error: float, validate_error: float | None, floor: float) -> Row:
    score = POSITION if "position_loop" in plant else TORQUE
    return {
        "effects": [e.name for e in plant.effects],
        "fit_error": fit_error,
        "validate_error": validate_error,
        "noise_floor": floor,
        "error_unit": score.unit,
        "parameters": {k: v for k, (v, _) in plant.numbers().items()},
        "uncertainty": {k: list(v) for k, v in plant.uncertainty.items()},
    }


def _refit(task: Task, folder: Path) -> Row:
    assert task.plant is not None
    plant, records, left = _fitted(task.dataset, task.joint, task.plant)
    drawn = redrawn(records, left, task.block, np.random.default_rng(task.draw))
    found = refit(plant, drawn, plant.provenance["bandwidth"])
    found.plant.save(folder / "model.toml")
    return _row(found.plant, found.error, None, found.floor)


@lru_cache(maxsize=1)
def _fitted(dataset: str, joint: str | None, plant: str) -> tuple[Plant, list[Record], list[Array]]:
    """What the refits of one set share: the fit, its records and their residuals."""
    records = [r for r in load(dataset, joint).fit if isinstance(r, Record)]
    start = plant_of_text(plant)
    found = refit(start, records, start.provenance["bandwidth"])
    return start, records, residuals(found, records)


_DO: Mapping[str, Callable[[Task, Path], Row]] = {"fit": _fit, "diagnose": _diagnose, "refit": _refit}


def bootstrap(
    dataset: str | Path,
    out: str | Path,
    plant: Plant | None = None,
    *,
    refits: int = 200,
    block: float = BLOCK,
    joint: str | None = None,
    seed: int = 0,
    jobs: int = -1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Plant:
    """A fit whose 95 % intervals come from refits to redrawn residuals, see `gms_mujoco.bootstrap`.

    Args:
        dataset: folder with `dataset.toml`.
        out: gets `model.toml`, and a folder for each refit; a run that was killed goes on there.
        plant: to begin with; None: the baseline.
        refits: how many.
        block: time over which residuals are alike [s].
        joint: of the set, where it has several.
        seed: draws the signs.
        jobs, cluster, progress: as for `run_all`.

    Returns:
        The plant fitted to all records, with intervals and covariance from the refits.

    Raises:
        GmsError: as for `run_all`; the fit itself or more than half of the refits fail; the set has frequency
            responses, or records that are too short.
    """
    if refits < 2:
        raise GmsError(f"a bootstrap needs at least 2 refits; {refits} given")
    report = progress or silent
    folder, path = files.expect_folder(out), find_sets(dataset)[0]
    if any(not isinstance(r, Record) for r in load(path, joint).fit):
        raise DataError(f"{path}: a bootstrap redraws torque residuals in time; the set has frequency responses or "
                        "runs of a servo")
    if not 0 < block < math.inf:
        raise GmsError(f"block must be a positive number of seconds; {block!r} given")
    text = None if plant is None else plant.to_toml()
    whole = task_of("fit", folder, path, joint, text, name="fit")
    row = run([whole], _do, 1)[0]
    if row["status"] != "done":
        raise GmsError(row["error"])
    fitted = Plant.load(Path(whole.folder) / "model.toml")
    tasks = [
        task_of("refit", folder, path, joint, fitted.to_toml(), name=f"refit-{k:05d}", draw=(seed, k), block=block)
        for k in range(refits)
    ]
    rows = run(tasks, _do, jobs, cluster, part(report, 1 / (1 + refits), 1.0))
    good = [t for t, r in zip(tasks, rows, strict=True) if r["status"] == "done"]
    if len(good) < max(refits / 2, 2):
        error = next(r["error"] for r in rows if r["status"] != "done")
        raise GmsError(f"{refits - len(good)} of {refits} refits failed, the first with: {error}")
    found = with_intervals(fitted, [Plant.load(Path(t.folder) / "model.toml") for t in good])
    found.save(folder / "model.toml")
    return found


def write_summary(fleet: Fleet) -> None:
    """`summary.csv`, a line for each task, and `summary.json` with every parameter."""
    text = io.StringIO()
    table = csv.DictWriter(text, _COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for row in fleet.rows:
        table.writerow({**row, "effects": " ".join(row.get("effects", ()))})
    files.write_text(fleet.folder / SUMMARY[0], text.getvalue())
    files.write_text(fleet.folder / SUMMARY[1], files.as_json({"schema": 1, "rows": list(fleet.rows)}))
