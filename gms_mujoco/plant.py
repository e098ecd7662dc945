"""Plant: one axis, inertia plus effects. `plant + effect` is a new plant."""

from __future__ import annotations

import itertools
import json
import math
import os
import tomllib
import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date, time
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import effects, native
from .effect import Effect, passed
from .errors import ModelError, is_number, listing
from .files import MODELS, write_text
from .parameter import WAVES, Parameter

if TYPE_CHECKING:
    import mujoco

JOINT_KINDS = ("hinge", "slide")
_MOST_DIGITS = 7  # of a value that is told
_ROUNDED = 1e-4  # of an entry of a covariance, by the digits of files


@dataclass(frozen=True)
class Plant:
    """An axis as a frozen value.

    Attributes:
        inertia: [kg m^2] for a hinge, [kg] for a slide; None until a fit has identified it.
        effects: each physical cause once, in the order in which they were added.
        kind: "hinge" (rad, N m) or "slide" (m, N).
        inertia_known: given, not identified: a fit leaves it as it is.
        uncertainty: 95 % interval of each identified parameter by its name "effect.parameter" (or
            "effect.parameter[i]", "inertia").
        provenance: from which data and with which version the parameters come.
        covariance: rows of the covariance of a fit by name, a symmetric matrix in the order of the names; of
            logarithms where a parameter has no natural zero, see `Coordinates`. It says how parameters go together.
    """

    inertia: float | None
    effects: tuple[Effect, ...] = ()
    kind: str = "hinge"
    inertia_known: bool = True
    uncertainty: Mapping[str, tuple[float, float]] = field(default_factory=dict, compare=False, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    covariance: Mapping[str, tuple[float, ...]] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.kind not in JOINT_KINDS:
            raise ModelError(f"joint kind must be one of {listing(JOINT_KINDS)}; {self.kind!r} given")
        if self.inertia is not None:
            if not is_number(self.inertia):
                raise ModelError(f"inertia must be a number [kg m^2]; {self.inertia!r} given")
            if not (_is_finite(self.inertia) and self.inertia > 0):
                raise ModelError(f"inertia must be a positive number [kg m^2]; {self.inertia!r} given")
            object.__setattr__(self, "inertia", float(self.inertia))
        if not isinstance(self.inertia_known, bool):
            raise ModelError(f"inertia_known must be true or false; {self.inertia_known!r} given")
        for e in self.effects:
            if getattr(e, "kind", "") == "friction" and not e.is_native:  # one without a kind may act by its hooks
                raise ModelError(f"{e.name} is friction in Python, which nothing would evaluate: a law of friction is "
                                 "native code, one .cc file; CONTRIBUTING.md says how")
        names = [e.name for e in self.effects]
        for name in names:
            if names.count(name) > 1:
                raise ModelError(f"the plant has {name} already; change it with plant.replace({name}(...))")

    @classmethod
    def axis(cls, inertia: float | None = None, kind: str = "hinge") -> Plant:
        """A bare axis. Without `inertia` a fit identifies it."""
        return cls(inertia, (), kind, inertia is not None)

    def __add__(self, effect: Effect) -> Plant:
        if isinstance(effect, type) and issubclass(effect, Effect):
            raise ModelError(f"{effect.__name__} is a kind of effect; add one of it, as in {effect.__name__}()")
        if not isinstance(effect, Effect):
            return NotImplemented
        return replace(self, effects=(*self.effects, effect))

    def __contains__(self, name: str) -> bool:
        return any(e.name == name for e in self.effects)

    def __getitem__(self, name: str) -> Effect:
        for e in self.effects:
            if e.name == name:
                return e
        raise ModelError(f"the plant has no {name!r}; its effects are {listing(e.name for e in self.effects)}")

    def replace(self, effect: Effect) -> Plant:
        """The same plant with the effect of that name exchanged."""
        _ = self[effect.name]
        return replace(self, effects=tuple(effect if e.name == effect.name else e for e in self.effects))

    def without(self, name: str) -> Plant:
        """The same plant with one effect taken away."""
        _ = self[name]
        return replace(self, effects=tuple(e for e in self.effects if e.name != name))

    def part(self, name: str) -> Plant:
        """The effect of that name with those that act on it, which modulate friction or change the reading.

        Torques of effects add: what a change of the effect does to the torque that is needed can be seen on this part
        alone. Itself for an effect that acts on others. Of a name that is not there, what acts on every effect.
        """
        if name in self and (self[name].modulates or self[name].kind == "sensor"):
            return self
        kept = tuple(e for e in self.effects if e.name == name or e.modulates or e.kind == "sensor")
        return replace(self, effects=kept)

    @property
    def friction(self) -> Plant:
        """The same axis with nothing but its friction."""
        return replace(self, effects=tuple(e for e in self.effects if e.kind == "friction"))

    @property
    def driven_inertia(self) -> float:
        """Inertia that moves with the joint [kg m^2]: the axis's less what its effects put behind a coupling."""
        assert self.inertia is not None
        return self.inertia - sum(e.hidden_inertia for e in self.effects)

    def light_loads(self) -> Plant:
        """Itself; raises ModelError where what its effects put behind a coupling is no part of a known inertia."""
        if self.inertia is not None and self.driven_inertia <= 0:
            loads = listing(e.name for e in self.effects if e.hidden_inertia)
            raise ModelError(f"{loads} must have less inertia than the axis, {self.inertia:g}, of which it is a part")
        return self

    @property
    def drive(self) -> tuple[Effect, ...]:
        """The effects that stand between the torque commanded and the torque delivered."""
        return tuple(e for e in self.effects if type(e).deliver is not Effect.deliver)

    def delivered(self, command: NDArray[np.float64], sample_time: float, parts: int) -> NDArray[np.float64]:
        """Torque that the drive delivers for a command that is held from sample to sample.

        Drive effects shape the torque inside a sample, so they are followed on a finer grid.

        Args:
            command: (n,) torque command [N m].
            sample_time: [s].
            parts: of a sample, over each of which the torque is held.

        Returns:
            (parts * n,) mean torque over each part [N m].
        """
        torque: NDArray[np.float64] = np.repeat(np.asarray(command, np.float64), parts)
        if self.drive:
            time = np.asarray(sample_time / parts * np.arange(len(torque)), float)
            for effect in self.drive:
                torque = passed(effect, "deliver", time, torque)
        return torque

    def numbers(self) -> dict[str, tuple[float, str]]:
        """Every value with its unit, by its name: "inertia", "effect.parameter" or, of several, with "[i]"."""
        out = {} if self.inertia is None else {"inertia": (float(self.inertia), self.mass_unit)}
        for e in self.effects:
            for p in e.parameters:
                values = np.atleast_1d(np.asarray(e.values[p.name], float))
                labels = [f"[{i}]" for i in range(len(values))] if len(values) > 1 else [""]
                for label, value in zip(labels, values, strict=True):
                    out[f"{e.name}.{p.name}{label}"] = (float(value), self._unit(p))
        return out

    @property
    def mass_unit(self) -> str:
        """Of its inertia."""
        return "kg m^2" if self.kind == "hinge" else "kg"

    def _unit(self, p: Parameter) -> str:
        """The unit of a parameter of an effect; a phase is an angle on a slide joint too."""
        return p.unit if self.kind == "hinge" or p.name == "phase" else slide_unit(p.unit)

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Name, value, 95 % interval and unit of every parameter, as text."""
        return [
            (name, f"{value:.{max(5, n)}g}", _interval_text(value, interval, max(4, n)), unit)
            for name, (value, unit) in self.numbers().items()
            for interval in [self.uncertainty.get(name)]
            for n in [_telling_digits(value, interval)]
        ]

    def __str__(self) -> str:
        return "\n".join(f"  {name:36} {value:>12}  {ci95:28} {unit}" for name, value, ci95, unit in self.rows())

    def table(self, effect: str) -> dict[str, dict[str, object]]:
        """The parameters of one effect, as `diagnosis.json` shows them; no interval where none was identified."""
        return {
            name: {"value": value, "unit": unit, "ci95": list(ci) if (ci := self.uncertainty.get(name)) else None}
            for name, (value, unit) in self.numbers().items()
            if name.startswith(f"{effect}.")
        }

    @property
    def unset(self) -> tuple[str, ...]:
        """Names of the parameters that have no value yet."""
        inertia = ("inertia",) if self.inertia is None else ()
        return inertia + tuple(f"{e.name}.{p}" for e in self.effects for p in e.unset)

    def complete(self) -> Plant:
        """Itself; raises ModelError naming the parameters that have no value yet."""
        if self.unset:
            raise ModelError(f"these parameters have no value yet: {listing(self.unset)}; give them, or fit first")
        return self

    def expect_names(self, names: Collection[str]) -> Plant:
        """Itself; raises ModelError where it has no parameter of one of the names, "effect.parameter" or "inertia"."""
        known = ["inertia", *(f"{e.name}.{p.name}" for e in self.effects for p in e.parameters)]
        for name in [names] if isinstance(names, str) else names:
            if name not in known:
                raise ModelError(f"the plant has no parameter {name!r}; its parameters are {listing(known)}")
        if isinstance(names, str):
            raise ModelError(f"names are given as a list, as in [{names!r}]; {names!r} given")
        return self

    def torque_driven(self) -> Plant:
        """Itself; raises ModelError where it closes a position loop of its own, so that no torque is asked of it."""
        for e in self.effects:
            if e.kind == "controller":
                raise ModelError(f"a plant with {e.name} takes a goal, not a torque: it is for runs of a servo, whose "
                                 'dataset.toml has controller = "position"')
        return self

    def joint(self) -> native.Joint:
        """The native effects of this plant, ready to be replayed."""
        return self._joint

    @cached_property
    def _joint(self) -> native.Joint:
        return native.Joint([(e.name, e.elements, e.packed) for e in self.effects if e.is_native])

    def number_in_joint(self, name: str) -> int:
        """Where a native effect of this plant stands among those of its `joint`."""
        return [e.name for e in self.effects if e.is_native].index(name)

    @cached_property
    def memory_places(self) -> dict[str, slice]:
        """Where the state of each native effect before the first sample stands among the unknowns of the joint."""
        sizes = [native.Joint([(e.name, e.elements, e.packed)]).n_memory for e in self.effects if e.is_native]
        ends = itertools.accumulate(sizes, initial=0)
        names = [e.name for e in self.effects if e.is_native]
        return {n: slice(a, b) for n, (a, b) in zip(names, itertools.pairwise(ends), strict=True)}

    def carried(self, near: Plant, memory: NDArray[np.float64] | None) -> NDArray[np.float64]:
        """(n_memory,) state before a record of its effects, each as it stood in a plant near to it.

        Args:
            near: the other plant. What it lacks, or has with another number of states, has never moved.
            memory: (n_memory,) state of its effects; None: none has moved.
        """
        known = {} if memory is None else {name: memory[place] for name, place in near.memory_places.items()}
        out = np.zeros(self.joint().n_memory)
        for name, place in self.memory_places.items():
            stood = known.get(name, np.empty(0))
            if len(stood) == place.stop - place.start:
                out[place] = stood
        return out

    @classmethod
    def from_mjcf(cls, model: mujoco.MjSpec | str | os.PathLike[str], joint: str) -> Plant:
        """The friction that a joint of a MuJoCo model has; see `gms_mujoco.mjcf.plant_of_joint`."""
        from .mjcf import plant_of_joint

        return plant_of_joint(model, joint)

    @classmethod
    def from_bam(cls, path: str | os.PathLike[str]) -> Plant:
        """A parameter file of Rhoban's BAM; see `gms_mujoco.bam.read_plant`."""
        from .bam import read_plant

        return read_plant(path)

    def attach(
        self, model: mujoco.MjSpec | str | os.PathLike[str], joint: str | Iterable[str], **options: Any
    ) -> mujoco.MjSpec:
        """Puts the effects of this plant on joints of a MuJoCo model: `gms_mujoco.attach`, which takes the options."""
        from .engine import attach

        return attach(model, {name: self for name in ([joint] if isinstance(joint, str) else joint)}, **options)

    def save(self, path: str | Path) -> None:
        """Writes `model.toml`; warns of an effect that is not in the catalogue, by which it cannot be read back."""
        write_text(path, self.to_toml())
        for e in self.effects:
            if type(e) is not effects.CATALOGUE.get(e.name):
                warnings.warn(f"{path} cannot be read back: {e.name} is not in the catalogue, the folder "
                              "gms_mujoco/effects; keep the class and add it to the plant again", stacklevel=2)

    def to_toml(self) -> str:
        """The text of `model.toml`, with the unit and meaning of each number as comments."""
        lines = ["[axis]"]
        if self.kind != "hinge":
            lines.append(f'kind = "{self.kind}"')
        if self.inertia is not None:
            found = "" if self.inertia_known else ", identified"
            lines.append(f"inertia = {self.inertia!r}  # {self.mass_unit}{found}")
        if not self.inertia_known:
            lines.append("inertia_known = false")
        for e in self.effects:
            lines += ["", f"[effects.{e.name}]"]
            for p in e.parameters:
                value = e.values[p.name]
                text = f"[{', '.join(map(repr, value))}]" if isinstance(value, tuple) else repr(value)
                lines.append(f"{p.name} = {text}  # {self._unit(p)}, {p.doc}")
        numbers = self.numbers()  # an effect that was taken away or exchanged has left what was known of it behind
        intervals = {k: ends for k, ends in self.uncertainty.items() if k in numbers}
        if intervals:
            lines += ["", "[uncertainty]  # 95 % intervals"]
            lines += [f'"{k}" = [{float(lo)!r}, {float(hi)!r}]' for k, (lo, hi) in intervals.items()]
        known = [k in numbers for k in self.covariance]
        if any(known):
            lines += ["", "[covariance]  # of logarithms where values are positive, of log-ratios of shares"]
            rows = {k: itertools.compress(row, known) for k, row in self.covariance.items() if k in numbers}
            lines += [f'"{k}" = [{", ".join(f"{x:.12g}" for x in row)}]' for k, row in rows.items()]
        if self.provenance:
            lines += ["", "[provenance]"]
            lines += [f"{_toml_key(k)} = {_toml_value(v)}" for k, v in self.provenance.items()]
        return "\n".join(lines) + "\n"

    @classmethod
    def load(cls, path: str | Path) -> Plant:
        """Reads `model.toml`.

        Args:
            path: of the file, or the name of a plant that comes with the package, such as "arm_joint".

        Raises:
            ModelError: the file is missing, is not TOML, names what does not exist, or has a value that cannot be.
        """
        if not isinstance(path, str | os.PathLike):
            raise ModelError(f"the path of a model.toml, or the name of a plant of the package, is expected; {path!r} "
                             "given")
        preset = MODELS / f"{path}.toml"
        path = preset if preset.is_file() else Path(path)
        if path.is_dir():
            set_ = "a measurement set" if (path / "dataset.toml").is_file() else "a folder"
            raise ModelError(f"{path}: is {set_}; expected a plant, a model.toml or the name of one of the package")
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        except FileNotFoundError:
            presets = listing(p.stem for p in MODELS.glob("*.toml"))
            raise ModelError(f"{path}: no such file; plants that come with the package are {presets}") from None
        except (OSError, ValueError, RecursionError) as error:
            raise ModelError(f"{path}: not a readable TOML file ({error})") from None
        try:
            return cls.from_table(table)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Plant:
        """A plant from the contents of `model.toml`; raises ModelError where they are none, see `load`."""
        _only(table, ("axis", "effects", "uncertainty", "covariance", "provenance"), "table")
        axis = _table(table, "axis")
        _only(axis, ("inertia", "kind", "inertia_known"), "key in [axis]")
        inertia = axis.get("inertia")
        if inertia is not None and not is_number(inertia):
            raise ModelError(f"axis.inertia must be a number [kg m^2]; {inertia!r} given")
        known = axis.get("inertia_known", inertia is not None)
        if known is True and inertia is None:
            raise ModelError("axis.inertia_known is true, but axis.inertia [kg m^2] is not given")
        built = []
        for name, values in _table(table, "effects").items():
            if not isinstance(values, Mapping):
                raise ModelError(f"effects.{name} must be a table of parameters; {values!r} given")
            kind = effects.find(name)
            names = [p.name for p in kind.parameters]
            for key in values:
                if key not in names:
                    raise ModelError(f"{name} has no parameter {key!r}; its parameters are {listing(names)}")
            built.append(kind(**values))
        uncertainty, covariance = _table(table, "uncertainty"), _table(table, "covariance")
        plant = cls(
            inertia,
            tuple(built),
            axis.get("kind", "hinge"),
            known,
            {k: _interval(k, v) for k, v in uncertainty.items()},
            _provenance(_table(table, "provenance")),
            _covariance(covariance),
        )
        numbers = plant.numbers()
        for key, told in (("uncertainty", uncertainty), ("covariance", covariance)):
            for name in told:
                if name not in numbers:
                    raise ModelError(f"{key} of {name!r}, which the plant does not have; it has {listing(numbers)}")
        return plant


def _telling_digits(value: float, interval: tuple[float, float] | None) -> int:
    """Significant digits of a value by which its interval is told from a point; 0 without an interval."""
    width = interval[1] - interval[0] if interval else 0.0
    if not 0 < width < math.inf or value == 0:
        return 0
    return min(math.floor(math.log10(abs(value))) - math.floor(math.log10(width)) + 2, _MOST_DIGITS)


def _interval_text(value: float, interval: tuple[float, float] | None, digits: int) -> str:
    if interval is None:
        return ""
    low, high = interval
    if high == math.inf and 0 < value < 1e3 * low:
        return f"at least {low:.{digits}g}"
    if not high - low < 1e3 * abs(value) and (value != 0 or not math.isfinite(high - low)):
        return "undetermined"
    return f"[{low:.{digits}g}, {high:.{digits}g}]"


def plant_of(plant: Plant | str | os.PathLike[str]) -> Plant:
    """A plant as it is, from a `model.toml`, or the one of models/ with that name ("servo_axis")."""
    if not isinstance(plant, Plant | str | os.PathLike):
        raise ModelError(f"a Plant, the path of a model.toml or a name out of models/ is expected; {plant!r} given")
    return plant if isinstance(plant, Plant) else Plant.load(os.fspath(plant))


def slide_unit(unit: str) -> str:
    """The unit that a slide joint reads for a hinge joint's."""
    unit = unit.replace("(N m)", "N").replace("N m", "N").replace("rad", "m")
    return unit.replace("kg m^2", "kg").replace(WAVES, "rad/m")


def _only(table: Mapping[str, Any], names: tuple[str, ...], what: str) -> None:
    for key in table:
        if key not in names:
            raise ModelError(f"unknown {what}: {key!r}; expected {listing(names)}")


def _table(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, Mapping):
        raise ModelError(f"{key} must be a table; {value!r} given")
    return value


def _interval(key: str, value: Any) -> tuple[float, float]:
    """An interval; the value need not lie in it, for percentiles of a bootstrap may lie beside an estimate."""
    is_pair = isinstance(value, list | tuple) and len(value) == 2
    if is_pair and all(_is_finite(x) or x in (-math.inf, math.inf) for x in value) and value[0] <= value[1]:
        return float(value[0]), float(value[1])
    raise ModelError(f"uncertainty.{key} must be an interval [low, high]; {value!r} given")


def _covariance(table: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    n = len(table)
    for row in table.values():
        if not (isinstance(row, list | tuple) and len(row) == n and all(map(_is_finite, row))):
            raise ModelError(f"covariance must have {n} finite numbers in each of its {n} rows; {row!r} given")
    rows = {k: tuple(map(float, row)) for k, row in table.items()}
    matrix = np.array(list(rows.values()), float).reshape(n, n)
    if not np.allclose(matrix, matrix.T, rtol=_ROUNDED) or (np.diag(matrix) < 0).any():
        raise ModelError("covariance must be a symmetric matrix, with no number on its diagonal below 0")
    sigma = np.sqrt(np.diag(matrix))
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = matrix / scale / scale[:, None]
    if n and np.linalg.eigvalsh((correlation + correlation.T) / 2)[0] < -n * _ROUNDED:
        raise ModelError("covariance must be positive semidefinite; these numbers are no covariance of anything")
    return rows


def _is_finite(value: Any) -> bool:
    """Whether something is a finite number that a float can hold, as not every whole number is."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:
        return False


def _provenance(table: Mapping[str, Any]) -> dict[str, Any]:
    """Anything; but by these keys records are looked at as those of the fit were."""
    for key, fits, expected in (
        ("bandwidth", lambda v: _is_finite(v) and v > 0, "a positive number [Hz]"),
        ("clock_skew", _is_finite, "a number [s]"),
        ("time_steps", lambda v: isinstance(v, list | tuple) and len(v) == 3 and all(x in (-1, 0, 1) for x in v),
         "three numbers out of -1, 0, 1"),
        ("rests_unasked", lambda v: isinstance(v, bool), "true or false"),
    ):  # fmt: skip
        if key in table and not fits(table[key]):
            raise ModelError(f"provenance.{key} must be {expected}; {table[key]!r} given")
    return dict(table)


def _toml_key(key: str) -> str:
    return key if key.isidentifier() and key.isascii() else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, np.ndarray | np.generic):
        return _toml_value(value.tolist())
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_toml_key(str(k))} = {_toml_value(v)}' for k, v in value.items())}}}"
    if isinstance(value, date | time):  # a datetime is a date
        return value.isoformat()
    # The escapes of JSON are those of TOML, which wants one more.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
