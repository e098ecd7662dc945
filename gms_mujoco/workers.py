"""Workers: many tasks on this machine's processors or on a Dask cluster, through one joblib call.

A task is a frozen value with a `name`, its own `folder`, and a `digest` of all that its result depends on. It writes
`result.json` last and by renaming, so that what is there is whole: a run that was killed goes on with what is missing.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any, Protocol

from . import files
from .errors import GmsError
from .progress import Progress, silent
from .threads import alone, one_blas_thread

RESULT = "result.json"
_PATIENCE = 10.0  # s, for a scheduler to answer
_IDLE = 20.0  # s, after which a process without work ends, also where the one that asked was killed

Row = dict[str, Any]


class Task(Protocol):
    """One piece of work, small enough to be sent to another machine."""

    @property
    def name(self) -> str:
        """Of the task, unlike that of every other."""

    @property
    def folder(self) -> str:
        """That it writes."""

    @property
    def digest(self) -> str:
        """Of all that the result depends on."""


def run(
    tasks: Sequence[Task],
    do: Callable[[Any, Path], Row],
    jobs: int = -1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """The results of tasks, in their order; those that a run before has left are taken as they are.

    Args:
        tasks: with different names.
        do: what is done with a task in its folder; a function of a module, which can be sent.
        jobs: processes of this machine, 1: none but this one, -1: one for each processor.
        cluster: address of a Dask scheduler; its workers do it then.
        progress: called with the share done, which never falls, and a message.

    Returns:
        What `do` says, with `name`, `digest`, `seconds` and `status`: "done", or "failed" with `error`, one line.

    Raises:
        GmsError: joblib or dask is not installed, the cluster does not answer.
    """
    report = progress or silent
    rows = {t.name: row for t in tasks if (row := _finished(t)) is not None}
    todo = [t for t in tasks if t.name not in rows]
    failures = 0

    def tell(name: str) -> None:
        wrong = f", {failures} failed" if failures else ""
        report(len(rows) / len(tasks), f"{len(rows)} of {len(tasks)}{wrong}  {name}")

    if rows:
        tell("done before")
    if todo:
        with _Workers(jobs, cluster) as workers:
            for row in workers.map(do, todo):
                rows[row["name"]] = row
                failures += row["status"] != "done"
                tell(row["name"])
    return [rows[t.name] for t in tasks]


class _Workers(AbstractContextManager["_Workers"]):
    """The processes of joblib: this one, others of this machine, or those of a Dask cluster."""

    def __init__(self, jobs: int, cluster: str | None) -> None:
        try:
            import joblib
        except ImportError:
            raise GmsError("a fleet needs joblib: pip install 'gms-mujoco[fleet]'") from None
        if jobs != -1 and jobs < 1:
            raise GmsError(f"jobs must be a number of processes, or -1 for one on each processor; {jobs} given")
        self._joblib, self._jobs, self._cluster = joblib, jobs, cluster
        self._stack = ExitStack()

    def __enter__(self) -> _Workers:
        if self._cluster is None:
            self._stack.enter_context(self._joblib.parallel_config(backend="loky", idle_worker_timeout=_IDLE))
        else:
            try:
                from distributed import Client
            except ImportError:
                raise GmsError("a cluster needs dask: pip install 'gms-mujoco[fleet]'") from None
            try:
                self._stack.enter_context(Client(self._cluster, timeout=_PATIENCE))
            except (OSError, ValueError) as error:
                why = " ".join(str(error).split())
                raise GmsError(f"no Dask scheduler answers at {self._cluster!r} ({why})") from None
            self._stack.enter_context(self._joblib.parallel_config(backend="dask"))
        return self

    def map(self, do: Callable[[Any, Path], Row], tasks: Sequence[Task]) -> Iterable[Row]:
        """Results as they come."""
        jobs = -1 if self._cluster else self._jobs
        parallel = self._joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        found: Iterable[Row] = parallel(self._joblib.delayed(_work)(do, t) for t in tasks)
        return found

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def _finished(task: Task) -> Row | None:
    """The result that a run before has left of the very same task, unless it failed."""
    try:
        row = json.loads((Path(task.folder) / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    same = isinstance(row, dict) and row.get("digest") == task.digest and row.get("status") == "done"
    return row if same else None


def _work(do: Callable[[Any, Path], Row], task: Task) -> Row:
    """One task, wherever it is sent; whatever goes wrong becomes its result."""
    start = time.perf_counter()
    row: Row = {"name": task.name, "digest": task.digest}
    try:
        folder = files.make_folder(task.folder)
        with alone(), one_blas_thread():  # sums in another order would differ in the last bit
            row |= {"status": "done"} | do(task, folder)
    except GmsError as error:
        row |= {"status": "failed", "error": " ".join(str(error).split())}
    except Exception as error:  # of a fleet none stops the others
        row |= {"status": "failed", "error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    row["seconds"] = round(time.perf_counter() - start, 3)
    text = files.as_json(row)
    if Path(task.folder).is_dir():
        files.write_text(Path(task.folder) / RESULT, text)
    read: Row = json.loads(text)  # what a run that goes on finds
    return read
