"""The viewer opens what is recorded: as a picture without a screen, and in a browser."""

import base64
import io
import json
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from told import tell

from gms_mujoco import view
from gms_mujoco.errors import GmsError
from gms_mujoco.views import scene, tour
from gms_mujoco.views.figure import COLOURS

PATIENCE = 120.0  # s until a picture shows what it should


@pytest.fixture(scope="module")
def recording(small_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("recording") / "recording.rrd"
    tour.write_recording(file, tell(small_set))
    return file


def _shows(png: bytes, colours: tuple[str, ...]) -> bool:
    """Whether each colour covers a part of the picture that can be seen."""
    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), int).reshape(-1, 3)
    wanted = [[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in colours]
    return all((np.abs(picture - w).max(1) < 24).sum() > 200 for w in wanted)


@contextmanager
def _running(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        yield process
    finally:
        scene.end(process)


def _listens(port: int) -> bool:
    with socket.socket() as s:
        return s.connect_ex(("127.0.0.1", port)) == 0


def test_a_picture_without_a_screen_shows_both_models(recording: Path, tmp_path: Path) -> None:
    if not list(Path("/usr/share/vulkan/icd.d").glob("*")):
        pytest.skip("no Vulkan driver; on Debian the package mesa-vulkan-drivers")
    pytest.importorskip("PIL")
    view.open_recording(recording, tmp_path / "view.png")
    png = (tmp_path / "view.png").read_bytes()
    assert _shows(png, (COLOURS[1], COLOURS[2]))
    assert _soon(lambda: not _viewers_of(recording))


def _viewers_of(recording: Path) -> list[str]:
    """Processes that show a recording."""
    lines = (p.read_bytes().decode(errors="replace") for p in Path("/proc").glob("[0-9]*/cmdline") if p.exists())
    return [line for line in lines if str(recording) in line]


def _soon(true: Callable[[], bool]) -> bool:
    """Whether that becomes so: the system ends the children of a process after it."""
    end = time.monotonic() + 10
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


@pytest.mark.slow
def test_a_browser_shows_both_models(recording: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium; on Debian the package chromium")
    pytest.importorskip("PIL")
    connect = pytest.importorskip("websockets.sync.client").connect
    data, pages = view.free_port(), view.free_port()
    serve = (sys.executable, "-m", "rerun", str(recording), "--serve-web", "--bind", "127.0.0.1", "--port", str(data),
             "--web-viewer-port", str(pages))  # fmt: skip
    address = f"http://127.0.0.1:{pages}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy"
    browse = (browser, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
              f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1400,900", "--remote-debugging-port=0",
              "--remote-allow-origins=*", "about:blank")  # fmt: skip
    end = time.monotonic() + PATIENCE
    with _running(*serve), _running(*browse):
        port = tmp_path / "profile" / "DevToolsActivePort"
        while not (port.exists() and port.read_text() and _listens(pages)):
            assert time.monotonic() < end, "viewer or browser did not start"
            time.sleep(0.2)
        with urllib.request.urlopen(f"http://127.0.0.1:{port.read_text().split()[0]}/json/list") as answer:
            tab = next(t for t in json.load(answer) if t["type"] == "page")
        with connect(tab["webSocketDebuggerUrl"], max_size=None) as page:

            def ask(number: int, method: str, **params: object) -> dict[str, str]:
                page.send(json.dumps({"id": number, "method": method, "params": params}))
                while (answer := json.loads(page.recv(60))).get("id") != number:
                    pass
                return answer["result"]

            ask(1, "Page.navigate", url=address)
            number, png = 2, b""
            while not (png and _shows(png, (COLOURS[1], COLOURS[2]))):
                assert time.monotonic() < end, "the page did not show the recording"
                time.sleep(2)
                png = base64.b64decode(ask(number, "Page.captureScreenshot")["data"])
                number += 1


def test_the_viewer_listens_on_this_machine_only(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []

    class Done:
        returncode = 0

    monkeypatch.setattr(view.subprocess, "run", lambda command, **_: started.append(command) or Done())
    view.open_recording(recording.parent)
    (command,) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1" and str(recording) in command


def test_a_viewer_opens_for_this_machine_and_ends_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The viewer is stood in for by a program that listens and, as `rerun` does, leaves the work to a child."""
    child = "import socket, sys, time; s = socket.create_server(('127.0.0.1', int(sys.argv[1]))); time.sleep(60)"
    commands: list[list[str]] = []

    def stand_in(port: int, *more: str) -> list[str]:
        commands.append(real(port, *more))
        inside = f"import subprocess; subprocess.call({[sys.executable, '-c', child, str(port), str(tmp_path)]})"
        return [sys.executable, "-c", inside]

    real = view._command
    monkeypatch.setattr(view, "_command", stand_in)
    process, port = view._viewer([])
    assert commands[0][commands[0].index("--bind") + 1] == "127.0.0.1" and _listens(port)
    assert not Path("/proc").is_dir() or _viewers_of(tmp_path)
    scene.end(process)
    assert _soon(lambda: not _listens(port) and not _viewers_of(tmp_path))


def test_a_viewer_that_does_not_start_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "_command", lambda *_: [sys.executable, "-c", "raise SystemExit(1)"])
    with pytest.raises(GmsError, match=r"give a \.rrd file"):
        view._viewer([])


@pytest.mark.parametrize("life", [0.0, 0.3])
def test_a_viewer_that_finds_no_screen_is_told_in_one_line(life: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it ends before or after the scene has been sent to it."""
    import mujoco

    import gms_mujoco as gms

    code = f"import socket, time; s = socket.create_server(('127.0.0.1', %d)); time.sleep({life} + 0.2)"
    command = [sys.executable, "-c"]
    monkeypatch.setattr(view, "_command", lambda port, *more: [*command, code % port])
    model = gms.attach(str(gms.MODELS / "arm.xml"), {"elbow": gms.Plant.load("arm_joint")}).compile()
    with pytest.raises(GmsError, match="does not start; it needs a screen") as error:
        view.stream(model, mujoco.MjData(model))
    assert "\n" not in str(error.value)
