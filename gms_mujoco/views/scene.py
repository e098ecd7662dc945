"""A model in motion in rerun: its bodies in 3-D, and of each joint with friction torque, element forces and slips."""

from __future__ import annotations

import contextlib
import io
import math
import os
import signal
import subprocess
import warnings
from collections import deque
from numbers import Real
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from .. import engine, native
from ..errors import ModelError
from .drawing import draw, part, recording, rgb, view
from .figure import Curve

_ROBOT, _FRICTION, _VALUES, _LOOP = "robot", "friction", "values", "loop"
_DRAWN, _KEPT = 100, 4000  # looks from one drawing of the loops to the next, and that they remember
_MOST_TABS = 12  # joints: more tabs cannot be read
_STILL = 1e-6  # rad or m: less is no motion
_AWAY = 1.2  # sizes of the model, of the camera
_CORNER = rrb.Corner2D.RightTop
# Joints and elements; told apart by the colour-blind too.
_COLOURS = ("#4c9be8", "#e8a33d", "#2ab58a", "#d66a6a", "#a98ee0", "#c9b458", "#8fb8c9", "#e08ec0")
_SLIPS = {-1: "slips backward", 0: "sticks", 1: "slips forward"}
_OF_SLIPS = ("#4c72b0", "#4a4a4a", "#c4704e")
_SHADES = rr.StateConfiguration(values=list(_SLIPS.values()), colors=[rgb(c) for c in _OF_SLIPS])


def _geometry(model: mujoco.MjModel) -> Any:
    """What logs the bodies of a model, an optional library."""
    try:
        from rerun_loader_mjcf import MJCFLogger
    except ImportError:
        raise ModelError("a model in 3-D needs rerun-loader-mjcf: pip install 'gms-mujoco[scene]'") from None
    return MJCFLogger(model, _ROBOT)


def expect_rate(rate: float) -> None:
    """Raises ModelError where there are no looks at that rate."""
    if not isinstance(rate, Real) or not rate > 0:
        raise ModelError(f"rate must be positive [1/s]; {rate!r} given")


class Scene:
    """What happens in a simulation, sent to a rerun stream. Call it after each step, or as often as it should look.

    Entities: `robot/...` (bodies and geometry); for each joint with friction `friction/JOINT/torque` [N m],
    `friction/JOINT/elements/K` (torque of element K of gms [N m]) and `friction/JOINT/slips/K` (state of element K);
    `values/NAME` for what the caller adds. All over the timeline `time` [s]. `loop/JOINT` is drawn once in a while: the
    friction torque against the position.

    Args:
        model: compiled.
        data: its state, read at each call.
        stream: that everything goes to.
        rate: of looks [1/s of simulated time]; calls in between do nothing.
        owned: whether `close` ends the stream.
        viewer: process to end with `close`, if one was started.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        stream: rr.RecordingStream,
        rate: float = 100.0,
        owned: bool = False,
        viewer: subprocess.Popen[bytes] | None = None,
    ) -> None:
        expect_rate(rate)
        self.model, self.data, self.stream, self.owned, self.viewer = model, data, stream, owned, viewer
        self.joints = joints_with_friction(model, data)
        self._period = 1 / rate
        self._began, self._last = 0.0, -1.0  # time of earlier episodes, and of the last look [s]
        self._values: set[str] = set()
        self._slips: dict[str, int] = {}
        self._most = dict.fromkeys(self.joints, 0.0)  # torque of each joint
        self._path: dict[str, deque[tuple[float, float]]] = {j: deque(maxlen=_KEPT) for j in self.joints}
        self._looks = 0
        for k, joint in enumerate(self.joints):
            root = f"{_FRICTION}/{part(joint)}"
            self._name(f"{root}/torque", joint, k)
            for i in range(len(engine.friction(model, data, joint).forces)):
                self._name(f"{root}/elements/{i + 1}", f"element {i + 1}", i)
                stream.log(f"{root}/slips/{i + 1}", _SHADES, static=True)
        self._robot = _geometry(model)
        stream.set_time("time", duration=0.0)
        with contextlib.redirect_stdout(io.StringIO()):  # it says which planes it leaves out
            self._robot.log_model(stream)
        stream.log(_ROBOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        solid = np.isfinite(model.geom_rbound) & (model.geom_rbound > 0)  # all but planes
        reach = model.geom_rbound[solid, None]
        low, high = data.geom_xpos[solid] - reach, data.geom_xpos[solid] + reach
        self._place = model.stat.center, float(model.stat.extent)  # centre and size of what is to be seen [m]
        if solid.any() and data.geom_xpos.any():
            low, high = low.min(0), high.max(0)
            self._place = 0.5 * (low + high), float(np.linalg.norm(high - low))
        self._arrange()

    def __call__(self, model: mujoco.MjModel | None = None, data: mujoco.MjData | None = None, **values: float) -> None:
        """One look, if it is time for it.

        Args:
            model, data: in place of those of the scene: the same mechanism, perhaps with another friction.
            **values: numbers of yours, plotted by their names.
        """
        model, data = model or self.model, data or self.data
        if data.time < self._last:  # a new episode
            self._began, self._last = self._began + self._last + self._period, -1.0
            for path in self._path.values():
                path.clear()
        if self._last >= 0 and data.time - self._last < self._period * (1 - 1e-6):
            return
        self._last = data.time
        self.stream.set_time("time", duration=self._began + data.time)
        self._robot.log_data(data, self.stream)
        for joint in self.joints:
            now = engine.friction(model, data, joint)
            self._path[joint].append((float(data.joint(joint).qpos[0]), -now.torque))
            self._look(joint, now)
        self._looks += 1
        if self._looks % _DRAWN == 0:
            self._draw_loops()
        for name, value in values.items():
            if name not in self._values:
                self._values.add(name)
                self._name(f"{_VALUES}/{part(name)}", name, len(self._values) - 1)
                self._arrange()
            self.stream.log(f"{_VALUES}/{part(name)}", rr.Scalars(float(value)))

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()

    def flush(self) -> None:
        """Shows the busiest joint and waits until everything has arrived. A window stays open until it is closed."""
        self._arrange()
        self._draw_loops()
        try:
            self.stream.flush()
        except RuntimeError:  # of Rerun; a window may have been closed, which is no mistake
            if self.viewer is None or self.viewer.poll() is None:
                raise

    def close(self) -> None:
        """The end of the stream, unless it is the caller's, and of the window that was opened for it."""
        self.flush()
        if self.owned:
            self.stream.disconnect()
        if self.viewer is not None:
            end(self.viewer)
            self.viewer = None

    def _look(self, joint: str, now: engine.Friction) -> None:
        root = f"{_FRICTION}/{part(joint)}"
        self.stream.log(f"{root}/torque", rr.Scalars(now.torque))
        self._most[joint] = max(self._most[joint], abs(now.torque))
        directions = now.states.get("gms", ())[1::2]
        for k, (force, direction) in enumerate(zip(now.forces, directions, strict=True), 1):
            self.stream.log(f"{root}/elements/{k}", rr.Scalars(-float(force)))
            place = f"{root}/slips/{k}"
            if self._slips.get(place) != int(direction):
                self._slips[place] = int(direction)
                self.stream.log(place, rr.StateChange(state=_SLIPS[int(direction)]))

    def _draw_loops(self) -> None:
        for k, joint in enumerate(self.joints):
            if len(path := np.array(self._path[joint])) > 1:
                torque, angle = self._units(joint)
                curve = Curve("friction", path[:, 0], path[:, 1], _COLOURS[k % len(_COLOURS)])
                draw(self.stream, f"{_LOOP}/{part(joint)}", [curve], "position", angle, "friction", torque)

    def _units(self, joint: str) -> tuple[str, str]:
        return ("N m", "rad") if self.model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_HINGE else ("N", "m")

    def _name(self, entity: str, name: str, k: int) -> None:
        colour = rgb(_COLOURS[k % len(_COLOURS)])
        self.stream.log(entity, rr.SeriesLines(names=[name], colors=[colour]), static=True)

    def _arrange(self) -> None:
        """Sends the arrangement: the robot on the left; all joints and below each by itself on the right."""
        unit = {j: self._units(j)[0] for j in self.joints}
        shown, shares, tabs = [], [], []
        if self._values:
            shown.append(rrb.TimeSeriesView(origin=_VALUES, name=", ".join(sorted(self._values))))
            shares.append(2)
        for joint in self.joints[:_MOST_TABS]:
            root = f"{_FRICTION}/{part(joint)}"
            alone = [rrb.TimeSeriesView(origin=f"{root}/torque", name=f"friction [{unit[joint]}]")]
            tabs.append(rrb.Vertical(
                *(alone if len(self.joints) == 1 else []),
                rrb.Horizontal(
                    rrb.TimeSeriesView(origin=f"{root}/elements", plot_legend=_CORNER,
                                       name=f"torque of each element of {joint} [{unit[joint]}]"),
                    view(f"{_LOOP}/{part(joint)}", f"friction of {joint} over its position"),
                    column_shares=[3, 2],
                ),
                rrb.StateTimelineView(origin=f"{root}/slips", name=f"which element of {joint} slips"),
                name=joint,
            ))  # fmt: skip
        if len(tabs) > 1:
            every = [f"{_FRICTION}/{part(j)}/torque" for j in self.joints]
            name = f"friction of each joint [{' or '.join(sorted(set(unit.values())))}]"
            shown.append(rrb.TimeSeriesView(origin=_FRICTION, contents=every, name=name, plot_legend=_CORNER))
            shares.append(2)
        if tabs:
            busiest = max(range(len(tabs)), key=lambda k: self._most.get(self.joints[k], 0.0))
            shown.append(rrb.Tabs(*tabs, active_tab=busiest) if len(tabs) > 1 else tabs[0])
            shares.append(3)
        robot = self._camera()
        right = rrb.Vertical(*shown, row_shares=shares) if shown else None
        whole = robot if right is None else rrb.Horizontal(robot, right, column_shares=[2, 3])
        panel = rrb.TimePanel(state="collapsed", timeline="time")
        self.stream.send_blueprint(rrb.Blueprint(whole, panel, collapse_panels=True))

    def _camera(self) -> rrb.Spatial3DView:
        """The whole model, from where it asks to be looked at."""
        look = self.model.vis.global_
        centre, size = self._place
        around, above = np.radians([look.azimuth, look.elevation])
        ahead = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
        eye = rrb.EyeControls3D(position=centre - _AWAY * size * ahead, look_target=centre,
                                eye_up=(0.0, 0.0, 1.0))  # fmt: skip
        return rrb.Spatial3DView(origin=_ROBOT, name="robot", eye_controls=eye, line_grid=True)


def joints_with_friction(model: mujoco.MjModel, data: mujoco.MjData) -> list[str]:
    """Names of the joints that have friction of gms_mujoco."""
    found = (i for i in range(model.njnt) if native.reading(model._address, data._address, i) is not None)
    return [name for name in (model.joint(i).name for i in found) if name]


def record_motion(path: str | Path, model: mujoco.MjModel, seconds: float) -> None:
    """Writes the recording of a model that is let go where it begins (its first keyframe, if it has one).

    Raises:
        ModelError: no such time.
        GmsError: the file cannot be written.
    """
    if not 0 <= seconds < math.inf:
        raise ModelError(f"seconds must not be negative; {seconds!r} given")
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    with recording(path) as stream:
        scene = Scene(model, data, stream)
        scene()
        begin, furthest = data.qpos.copy(), 0.0
        while data.time < seconds:
            mujoco.mj_step(model, data)
            scene()
            furthest = max(furthest, float(np.abs(data.qpos - begin).max(initial=0.0)))
        scene.close()
    if seconds and furthest < _STILL:
        warnings.warn("nothing moves: the model stands where it is let go; give it a keyframe from which it falls "
                      "(gms_mujoco.view.stream shows a simulation of yours)", stacklevel=2)


def end(process: subprocess.Popen[bytes]) -> None:
    """Ends a viewer that leads its own process group; the `rerun` command is a script that starts the viewer proper."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
