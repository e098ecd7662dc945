"""The rerun viewer, with a window or for a picture, and the recording of a training."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from . import drawing, files
from .drawing import draw, series
from .errors import DataError, GmsError
from .figure import COLOURS, Curve

if TYPE_CHECKING:
    from .learn import Training

RECORDING = "recording.rrd"
_LOADING = 8.0  # s from the first frame until notices have gone and all data is drawn


def write_training(path: str | Path, training: Training) -> None:
    """Writes the recording of a training: `curve/...` drawn over generations, `test/position/...`, `test/error/...`.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    with files.whole(path) as temporary, rr.RecordingStream("gms_mujoco") as stream:
        stream.save(temporary)
        stream.log("summary", rr.TextDocument(str(training)), static=True)
        at = np.arange(1.0, len(training.curve) + 1)
        curves = [
            Curve(f"{name} candidate", at, 1 / training.curve[:, column], colour)
            for name, column, colour in (("mean", 0, COLOURS[1]), ("best", 1, COLOURS[2]))
        ]
        draw(stream, "curve", curves, "generation", "1", "PID error over its own", "1", log=(False, True))
        reference, *others = training.traces
        series(stream, "test/position/reference", "reference", training.time, reference, "#808080")
        for name, value, colour in zip(("PID", "policy"), others, (COLOURS[1], COLOURS[2]), strict=True):
            series(stream, f"test/position/{name}", name, training.time, value, colour)
            series(stream, f"test/error/{name}", name, training.time, reference - value, colour)
        curve = drawing.view("curve", "PID error over that of the candidates")
        runs = rrb.Vertical(
            rrb.TimeSeriesView(origin="test/position", name="first test episode, position"),
            rrb.TimeSeriesView(origin="test/error", name="tracking error"),
        )
        summary = rrb.TextDocumentView(origin="summary", name="test")
        left = rrb.Vertical(curve, summary, row_shares=[3, 1])
        stream.send_blueprint(rrb.Blueprint(rrb.Horizontal(left, runs), collapse_panels=True))
        stream.flush()
        stream.disconnect()


def open_recording(path: str | Path, screenshot: str | Path | None = None) -> None:
    """Opens a recording in the rerun viewer, bound to this machine only.

    Args:
        path: a `.rrd` file, or the folder of a diagnosis.
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
    port = free_port()
    command = [sys.executable, "-m", "rerun", str(file), "--bind", "127.0.0.1", "--port", str(port)]
    if screenshot is not None:
        files.write_bytes(screenshot, _picture(command, port))
    elif subprocess.run(command).returncode:
        raise GmsError("the rerun viewer ended with an error; its messages stand above")


def _picture(command: list[str], port: int) -> bytes:
    """PNG of a viewer without a window."""
    from rerun.experimental import ViewerClient

    command = [*command, "--headless", "--window-size", "1600x1000"]
    with tempfile.TemporaryFile() as log:
        viewer = subprocess.Popen(command, stdout=log, stderr=log)
        last = "no answer"
        try:
            for _ in range(40):  # until it listens
                time.sleep(0.5)
                if viewer.poll() is not None:
                    break
                try:
                    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                    client.take_screenshot(max_size=64)  # answers once the first frame is painted
                    time.sleep(_LOADING)
                    return client.take_screenshot()
                except Exception as error:  # whatever it is, the viewer is not up yet
                    last = str(error)
            log.seek(0)
            said = log.read().decode(errors="replace").strip().splitlines() or [last]
            raise GmsError(
                f"the rerun viewer made no picture ({said[-1][:160]}); it needs a Vulkan driver, "
                "on Debian the package mesa-vulkan-drivers"
            )
        finally:
            viewer.kill()
            viewer.wait()


def free_port() -> int:
    """A port of this machine that nothing listens on."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
