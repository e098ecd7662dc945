"""How a robot was set up, where the records contradict its model: a payload, the way that its base hangs, its zeros.

On every joint that takes a torque which no friction and no effect of one axis has, as soon as other joints move too.

- A payload, or a link of another mass than its drawing, is one point mass on one body. Its torque is linear in ten
  moments: mass, mass times place, and mass times the products of place (Siciliano et al., Robotics (2009), 7.2.2).
- Gravity as the base sees it: the torque is linear in its three components.
- Where the joints stand in the model when their encoders read zero, and whether one counts backwards.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..dataset import Dataset
from ..fit_result import FitResult
from ..identification.held_out import HeldOut, p_value
from ..identification.inverse import Observation
from ..identification.linear_model import LinearModel
from ..identification.observe import observe
from ..identification.tall import squared
from ..logs.robot import Payload, Robot, Setup
from ..plant import Plant
from ..progress import silent
from .judgement import MUCH_LESS, floor_of, leaves_much_less, left_of
from .search import Search

Array = NDArray[np.float64]

_ARM = 0.1  # m; places that far from the origin of a body tell its ten moments
_PLACES = _ARM * np.array([
    [0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 1, 0], [1, 0, 1], [0, 1, 1],
], float)  # fmt: skip
_ON_EARTH = 9.81  # m/s^2
_STEP = 1e-4  # rad or m
_TURNS = (np.pi / 2, np.pi, -np.pi / 2)  # by which a zero may be off
_STEPS = 8  # from a zero to a better one
_ROUNDS = 4  # of a fit with a setup, and the setup beside that fit
_BY_CHANCE = 0.05  # p value, beside a baseline that has bent far, above which a setup is not looked at
_LOOSE = 1e-2  # of the noise of a sample, that a place away from the origin of its body by `_ARM` counts for
_MOST = 0.1  # of the squared error, that may be left: what a wrong setup takes is gone with it
_HARDLY_MORE = 1.1  # times the error that another leaves
_SETTLED = 0.99  # of the error, that is left by a further round, ends them


def corrected_setup(runs: Dataset, start: Plant) -> tuple[Dataset, str]:
    """The measurements with the setup that they ask for, and a sentence on it; as they are, and "", without one.

    It is taken where it leaves hardly anything of the error, and much less than the best effect of the catalogue does,
    which does not reach the noise floor; of several that leave hardly more than another that of the fewest unknowns.
    """
    if runs.robot is None or not runs.fit:
        return runs, ""
    search = _begun(runs, start)
    before = search.steps[0].result
    if search.at_floor:
        return runs, ""
    floor, left = floor_of(before), left_of(before.misfit, before.vector)
    reach = search.within_reach()
    asked = _Asked(search, runs.robot)
    promising = [f for f in asked.each() if f.p_value <= _BY_CHANCE and f.left < min(reach, left)]
    if not promising:
        return runs, ""
    held_out = search.held_out.total
    search.add_one(silent)
    if search.at_floor:
        return runs, ""
    reach = left_of(search.steps[-1].result.misfit, search.steps[-1].result.vector)
    enough = floor + min(MUCH_LESS * max(reach - floor, 0.0), _MOST * max(left - floor, 0.0))
    ends = [_settled(runs, start, found) for found in promising]
    ends = [e for e in ends if left_of(e.result.misfit, e.result.vector) <= enough]
    ends = [e for e in ends if e.search.held_out.total <= MUCH_LESS * held_out]
    if not ends:
        return runs, ""
    least = min(e.result.error for e in ends)
    first, *others = (_beside_an_effect(runs, start, e) for e in ends if e.result.error <= _HARDLY_MORE * least)
    return first.runs, _said(runs.robot, first, [e for e in others if e.found.kind != first.found.kind], before)


class _End(NamedTuple):
    """The measurements with a setup that was refitted in turn with the plant, and the search that fitted it."""

    runs: Dataset
    found: _Found
    search: Search

    @property
    def result(self) -> FitResult:
        return self.search.steps[0].result


def _settled(runs: Dataset, start: Plant, found: _Found) -> _End:
    """The end of a setup that is refitted in turn with the plant."""
    ends: list[_End] = []
    for _ in range(_ROUNDS):
        now = runs.set_up(found.setup)
        search = _begun(now, start)
        ends.append(_End(now, found, search))
        if len(ends) > 1 and ends[-1].result.error > _SETTLED * ends[-2].result.error:
            break
        assert now.robot is not None
        found = _Asked(search, now.robot).again(found)
    return min(ends, key=lambda e: e.result.error)


def _beside_an_effect(runs: Dataset, start: Plant, end: _End) -> _End:
    """The same kind of setup beside the effect that is likeliest there, where that leaves much less.

    A part of what an effect does looks like a setup, as an offset of the torque does like a mass on one side. The
    effect has to be found again beside the setup that is left then.
    """
    assert end.runs.robot is not None
    if end.search.at_floor:
        return end
    asked = _Asked(end.search, end.runs.robot)
    effect = end.search.likeliest_beside(asked.tangents(end.found))
    if effect is None or effect.name in start:
        return end
    other = _settled(runs, start + effect, end.found)
    return other if leaves_much_less(end.result, other.result) else end


def _begun(runs: Dataset, start: Plant) -> Search:
    """A search that has fitted its baseline."""
    search = Search(observe(runs.fit, start.inertia), [], start)
    search.first(silent)
    return search


@dataclass(frozen=True)
class _Found:
    """A setup that a fit asks for.

    Attributes:
        kind: "payload", "gravity", "zeros" or "backwards".
        of: names of a body, or of joints.
        setup: with it.
        left: squared residual with it [N^2 m^2].
        p_value: of the hypothesis that it does not help.
    """

    kind: str
    of: Sequence[str]
    setup: Setup
    left: float
    p_value: float


class _Asked:
    """What a baseline asks for beside it, by refits that are linear but for the setup."""

    def __init__(self, search: Search, robot: Robot) -> None:
        self.robot, self.now = robot, search.steps[-1]
        self.misfit, self.vector = self.now.result.misfit, self.now.result.vector
        self.model = LinearModel(self.misfit, self.vector, self.misfit.residual(self.vector))
        self.seen = [o for o in self.misfit.observations if isinstance(o, Observation)]
        self.delivered = self.misfit.delivered(self.vector)
        self.as_it_is = self._torque(robot)

    def each(self) -> list[_Found]:
        """Setups of every kind, those of few unknowns first."""
        joints, bodies = [*self.robot.measured(self.seen[0].record)], self.robot.moved
        singles = [min(map(of, joints), key=lambda f: f.left) for of in (self.backwards, lambda k: self.zeros([k]))]
        payloads = [self.payload(body) for body in dict.fromkeys((*bodies[:1], *bodies[-1:]))]
        together = [self.zeros(joints)] if len(joints) > 1 else []
        return [*singles, self.gravity(), *sorted(payloads, key=lambda f: f.left)[:1], *together]

    def again(self, found: _Found) -> _Found:
        """The same kind of setup beside this baseline."""
        if found.kind == "gravity":
            return self.gravity()
        if found.kind == "backwards":
            return found
        return self.payload(*found.of) if found.kind == "payload" else self.zeros(found.of)

    def tangents(self, found: _Found) -> Array:
        """(m, k) what the bodies would take more with a little more of each unknown of a setup."""
        if found.kind == "backwards":
            return np.empty((len(self.as_it_is), 0))
        if found.kind == "gravity":
            return self._ones()[1]
        if found.kind == "zeros":
            return np.hstack([self._turned([k], self._zeros([k]) + _STEP) / _STEP for k in found.of])
        (own,) = (p for p in [self.robot.setup.payload] if p is not None)
        place = np.array(own.position)
        moved = [_products(place[None] + _STEP * unit) - _products(place[None] - _STEP * unit) for unit in np.eye(3)]
        slopes = np.vstack([_products(place[None]), *(own.mass * m / (2 * _STEP) for m in moved)])
        return self._moments(own.body) @ slopes.T

    def _moments(self, body: str) -> Array:
        """(m, 10) torque of each moment of a point mass on a body, for 1 kg at 1 m."""
        taken = self._columns(*(self._torque(self.robot.alone(_at(body, 1.0, place))) for place in _PLACES))
        return np.asarray(taken @ np.linalg.inv(_products(_PLACES)).T)

    def payload(self, body: str) -> _Found:
        """A payload on a body, in the place of that of the robot."""
        moments = self._moments(body)
        free, wanted = self.model.without(moments), self.model.target
        if (own := self.robot.setup.payload) is not None:
            wanted = wanted + self.model.without(self._columns(self._torque(self.robot.alone(own))))[:, 0]
        q, r = np.linalg.qr(free)
        along = q.T @ wanted
        beside = squared(wanted) - squared(along)
        loose = _LOOSE * np.sqrt(squared(wanted) / len(wanted)) / _ARM  # where it is along an axis nothing tells

        def left(u: Array) -> Array:
            return np.append(along - u[0] * (r @ _products(u[None, 1:])[0]), loose * u[1:])

        begun = [np.append(along @ column / max(column @ column, 1e-300), place)
                 for place, column in zip(_PLACES, _products(_PLACES) @ r.T, strict=True)]
        fits = [scipy.optimize.least_squares(left, u, x_scale=(max(abs(u[0]), 1e-3), *3 * (_ARM,))) for u in begun]
        best = min(fits, key=lambda f: f.cost)
        setup = replace(self.robot.setup, payload=_at(body, best.x[0], best.x[1:]))
        return self._found("payload", [body], setup, 2 * best.cost + beside, moments)

    def gravity(self) -> _Found:
        """Another gravity: of any direction, and as strong as on earth where it is more."""
        none, columns = self._ones()
        free = self.model.without(columns)
        wanted = self.model.target + self.model.without(self._columns(self.as_it_is - none))[:, 0]
        found = np.linalg.lstsq(free, wanted, rcond=1e-6)[0]
        found *= min(_ON_EARTH / max(float(np.linalg.norm(found)), 1e-300), 1.0)
        x, y, z = map(float, found)
        setup = replace(self.robot.setup, gravity=(x, y, z))
        return self._found("gravity", [], setup, squared(wanted - free @ found), columns)

    def _ones(self) -> tuple[Array, Array]:
        """(m,) torque without gravity, and (m, 3) what 1 m/s^2 along each axis of the world adds."""

        def under(*gravity: float) -> Array:
            x, y, z = gravity
            return self._torque(self.robot.set_up(replace(self.robot.setup, gravity=(x, y, z))))

        none, *ones = under(0.0, 0.0, 0.0), *(under(*axis) for axis in np.eye(3))
        return none, self._columns(*(one - none for one in ones))

    def backwards(self, joint: str) -> _Found:
        """An encoder that counts the other way."""
        setup = replace(self.robot.setup, reversed=(*self.robot.setup.reversed, joint))
        change = self._columns(self._torque(self.robot.set_up(setup)) - self.as_it_is)
        left = squared(self.model.target - self.model.without(change)[:, 0])
        return self._found("backwards", [joint], setup, left, change)

    def zeros(self, joints: Sequence[str]) -> _Found:
        """Other zeros of some of the measured joints."""

        def left(zero: Array) -> Array:
            return self.model.target - self.model.without(self._turned(joints, zero))[:, 0]

        own = self._zeros(joints)
        begun = [own, *(own + turn * unit for unit in np.eye(len(joints)) for turn in _TURNS)]
        fit = scipy.optimize.least_squares(left, min(begun, key=lambda z: squared(left(z))), max_nfev=_STEPS)
        return self._found("zeros", joints, self._with(joints, fit.x), 2 * fit.cost, self._turned(joints, fit.x))

    def _zeros(self, joints: Sequence[str]) -> Array:
        return np.array([self.robot.setup.zero.get(n, 0.0) for n in joints])

    def _with(self, joints: Sequence[str], zeros: Array) -> Setup:
        new = zip(joints, map(float, np.remainder(zeros + np.pi, 2 * np.pi) - np.pi), strict=True)
        return replace(self.robot.setup, zero={**self.robot.setup.zero, **dict(new)})

    def _turned(self, joints: Sequence[str], zeros: Array) -> Array:
        """(m, 1) torque that other zeros of some joints add."""
        return self._columns(self._torque(self.robot.set_up(self._with(joints, zeros))) - self.as_it_is)

    def _torque(self, robot: Robot) -> Array:
        """(m,) that the bodies of a robot would take [N m]."""
        return np.concatenate([robot.along(o) for o in self.seen])

    def _columns(self, *torques: Array) -> Array:
        """(m, k) of torques (m,) where the motion says what friction does."""
        return np.stack(torques, 1) * self.model.determined[:, None]

    def _found(self, kind: str, of: Sequence[str], setup: Setup, left: float, columns: Array) -> _Found:
        held_out = HeldOut(self.model.held_out(columns) / np.sqrt(self.delivered), self.misfit.observations)
        return _Found(kind, of, setup, left / self.delivered, p_value(self.now.held_out, held_out))


def _at(body: str, mass: float, place: Array) -> Payload:
    x, y, z = map(float, place)
    return Payload(body, float(mass), (x, y, z))


def _products(places: Array) -> Array:
    """(k, 10) of places (k, 3): one, the coordinates, and their products."""
    x, y, z = places.T
    return np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], 1)


def _said(robot: Robot, end: _End, others: Sequence[_End], before: FitResult) -> str:
    """What was set up in another way than a model says, or that would look the same, and how to say so."""
    name, told = robot.path.name, before.score.told
    what, line = _told(robot, end.found)
    same = "".join(f", or as if {_told(robot, other.found)[0]}" for other in others)
    counted = "The first" if same else "That"
    return (
        f"The records contradict {name}: it is as if {what}{same}. {counted} is counted in: without it the "
        f"{before.score.name} is {told(before.error)}, with it {told(end.result.error)}. Correct {name}, or add "
        f"{line} to [axis]"
    )


def _told(robot: Robot, found: _Found) -> tuple[str, str]:
    """A setup in words, and as a line of `dataset.toml`."""
    setup, name = found.setup, robot.path.name
    if found.kind == "payload" and (p := setup.payload) is not None:
        x, y, z = p.position
        what = f"{p.body} had {abs(p.mass):.3g} kg {'more' if p.mass > 0 else 'less'} than in {name}, around"
        line = f'payload = {{ body = "{p.body}", mass = {p.mass:.4g}, position = [{x:.4g}, {y:.4g}, {z:.4g}] }}'
        return f"{what} ({x:.3g}, {y:.3g}, {z:.3g}) m in its frame", line
    if found.kind == "gravity" and setup.gravity is not None:
        x, y, z = setup.gravity
        return f"gravity were ({x:.3g}, {y:.3g}, {z:.3g}) m/s^2 in its world", f"gravity = [{x:.4g}, {y:.4g}, {z:.4g}]"
    if found.kind == "backwards":
        return f"{found.of[0]} counted the other way", f"reversed = {json.dumps(setup.reversed)}"
    zeros = {k: setup.zero[k] for k in found.of}
    units = {k: "rad" if robot.kinds[k] == "hinge" else "m" for k in zeros}
    what = " and ".join(f"{k} stood at {v:.3g} {units[k]} when its encoder reads zero" for k, v in zeros.items())
    return what, f"zero = {{ {', '.join(f'{k} = {v:.4g}' for k, v in zeros.items())} }}"
