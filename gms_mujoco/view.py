"""The rerun viewer, with a window or for a picture; simulations streamed to it; the recording of a training or a plant.

    with gms.view.stream(model, data) as look:   # opens the viewer; with a third argument "arm.rrd" writes that
        while data.time < 5:
            mujoco.mj_step(model, data)
            look()
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from . import files
from .errors import DataError, GmsError
from .views import drawing
from .views.drawing import draw, series
from .views.figure import COLOURS, Curve
from .views.portrait import write_portrait
from .views.scene import Scene, end, expect_rate, record_motion

if TYPE_CHECKING:
    from .learn import Training

__all__ = ["RECORDING", "Scene", "open_recording", "record_motion", "stream", "write_portrait", "write_training"]

RECORDING = "recording.rrd"
_PATIENCE = 30.0  # s until a viewer listens
_OPENING = 1.0  # s in which a viewer that listens may find that it has no screen
_NO_VIEWER = (
    "the rerun viewer does not start; it needs a screen and a graphics driver. Without them write a recording: give a "
    ".rrd file"
)
_LOADING = 8.0  # s from the first frame until notices have gone and all data is drawn


def write_training(path: str | Path, training: Training) -> None:
    """Writes the recording of a training: `curve/...` drawn over generations, `test/position/...`, `test/error/...`.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    with drawing.recording(path) as stream:
        stream.log("summary", rr.TextDocument(str(training)), static=True)
        at = np.arange(1.0, len(training.curve) + 1)
        curves = [
            Curve(f"{name} candidate", at, 1 / training.curve[:, column], colour)
            for name, column, colour in (("mean", 0, COLOURS[1]), ("best", 1, COLOURS[2]))
        ]
        draw(stream, "curve", curves, "generation", "1", "PID error over its own", "1", log=(False, True))
        reference, *others = training.traces
        there = np.isfinite(reference)
        series(stream, "test/position/reference", "reference", training.time[there], reference[there], "#808080")
        for name, value, colour in zip(("PID", "policy"), others, (COLOURS[1], COLOURS[2]), strict=True):
            there = np.isfinite(value)  # until it ran away
            seconds, error = training.time[there], (reference - value)[there]
            series(stream, f"test/position/{name}", name, seconds, value[there], colour)
            series(stream, f"test/error/{name}", name, seconds, error, colour)
        curve = drawing.view("curve", "PID error over that of the candidates")
        runs = rrb.Vertical(
            rrb.TimeSeriesView(origin="test/position", name="first test episode, position"),
            rrb.TimeSeriesView(origin="test/error", name="tracking error"),
        )
        summary = rrb.TextDocumentView(origin="summary", name="test")
        left = rrb.Vertical(curve, summary, row_shares=[3, 1])
        stream.send_blueprint(rrb.Blueprint(rrb.Horizontal(left, runs), collapse_panels=True))


def stream(
    model: mujoco.MjModel, data: mujoco.MjData, to: str | Path | rr.RecordingStream | None = None, rate: float = 100.0
) -> Scene:
    """Shows a running simulation: the robot in 3-D, and of each joint with friction torque, elements and slips.

    Args:
        model: compiled.
        data: its state.
        to: None opens the viewer, which listens on this machine only; or a `.rrd` file to write, or a stream of rerun.
        rate: of looks [1/s of simulated time].

    Returns:
        To call after each step; `look(reference=0.1)` plots numbers of yours. A context manager.

    Raises:
        GmsError: the viewer cannot run, or the file cannot be written.
    """
    if isinstance(to, rr.RecordingStream):
        return Scene(model, data, to, rate)
    expect_rate(rate)  # before anything is opened
    opened = rr.RecordingStream("gms_mujoco")
    if to is not None:
        opened.save(files.expect_writable(to))
        return Scene(model, data, opened, rate, owned=True)
    viewer, port = _viewer([])
    try:
        opened.connect_grpc(_address(port))
        scene = Scene(model, data, opened, rate, owned=True, viewer=viewer)
        viewer.wait(_OPENING)
    except subprocess.TimeoutExpired:
        return scene
    except RuntimeError:  # of Rerun, which has lost the viewer
        pass
    end(viewer)
    raise GmsError(_NO_VIEWER)


def open_recording(path: str | Path, screenshot: str | Path | None = None) -> None:
    """Opens a recording in the rerun viewer, bound to this machine only.

    Args:
        path: a `.rrd` file, or the folder of a diagnosis or training.
        screenshot: a `.png` to write instead of opening a window.

    Raises:
        DataError: no recording there.
        GmsError: the viewer cannot run, for example without a graphics driver.
    """
    file = Path(path) / RECORDING if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise DataError(f"{file}: no such recording; expected a .rrd file or a folder with {RECORDING}")
    if file.suffix != ".rrd":
        raise DataError(f"{file}: not a recording; expected a .rrd file or a folder with {RECORDING}")
    if screenshot is not None:
        files.write_bytes(screenshot, _picture(file))
    elif subprocess.run(_command(free_port(), str(file))).returncode:
        raise GmsError("the rerun viewer ended with an error; its messages stand above")


def _command(port: int, *more: str) -> list[str]:
    return [sys.executable, "-m", "rerun", *more, "--bind", "127.0.0.1", "--port", str(port)]


def _address(port: int) -> str:
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _viewer(more: list[str], log: Any = subprocess.DEVNULL) -> tuple[subprocess.Popen[bytes], int]:
    """A viewer that listens, in a process group of its own, see `scene.end`; and its port."""
    port = free_port()
    viewer = subprocess.Popen(_command(port, *more), stdout=log, stderr=log, start_new_session=True)
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until and viewer.poll() is None:
        with socket.socket() as s:
            if s.connect_ex(("127.0.0.1", port)) == 0:
                return viewer, port
        time.sleep(0.1)
    end(viewer)
    raise GmsError(_NO_VIEWER)


def _picture(file: Path) -> bytes:
    """PNG of a viewer without a window."""
    from rerun.experimental import ViewerClient

    with tempfile.TemporaryFile() as log:
        last = "no answer"
        try:
            viewer, port = _viewer([str(file), "--headless", "--window-size", "1600x1000"], log)
        except GmsError as error:
            raise _no_picture(log, str(error)) from None
        try:
            for _ in range(40):  # until it paints
                time.sleep(0.5)
                if viewer.poll() is not None:
                    break
                try:
                    client = ViewerClient.connect(_address(port))
                    client.take_screenshot(max_size=64)  # answers once the first frame is painted
                    time.sleep(_LOADING)
                    return client.take_screenshot()
                except Exception as error:  # whatever it is, the viewer is not up yet
                    last = str(error)
            raise _no_picture(log, last)
        finally:
            end(viewer)


def _no_picture(log: Any, last: str) -> GmsError:
    log.seek(0)
    said = log.read().decode(errors="replace").strip().splitlines() or [last]
    return GmsError(
        f"the rerun viewer made no picture ({said[-1][:160]}); it needs a Vulkan driver, "
        "on Debian the package mesa-vulkan-drivers"
    )


def free_port() -> int:
    """A port of this machine that nothing listens on."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
