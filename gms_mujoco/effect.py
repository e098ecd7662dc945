"""The Effect contract: one physical cause, the same object for simulator, identifier and diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from .errors import ModelError, is_number, listing
from .parameter import KELVIN, Parameter

if TYPE_CHECKING:
    import mujoco

Value = float | tuple[float, ...]

KINDS = ("friction", "drive", "mechanics", "sensor", "controller")
LOADED = "load_dependent_friction"  # which follows the signal `load`


class Effect:
    """A frozen value: a kind of effect with its parameters.

    A subclass lives in `gms_mujoco/effects/NAME.*` and declares the class attributes below. Parameters that
    are not given take their default; one whose default is NaN stays unset until a fit has identified it.

    Args:
        elements: number of elements (Maxwell elements, harmonics ...) where parameters are per element and
            none of them is given.
        **values: parameters by name, a number or, per element, a sequence.

    Raises:
        ModelError: unknown parameter, wrong number of values, what is no number, or a value out of bounds.
    """

    name: ClassVar[str]
    kind: ClassVar[str]  # one of KINDS
    doc: ClassVar[str]  # equation and source
    signature: ClassVar[str]  # what a person sees on a plot when the model lacks the effect
    experiment: ClassVar[str]  # what to measure to bring it out
    parameters: ClassVar[tuple[Parameter, ...]]
    is_native: ClassVar[bool] = False  # evaluated by the native library
    modulates: ClassVar[bool] = False  # scales the level of the joint's friction laws
    separable: ClassVar[bool] = False  # its elements do not know of each other, and the native library tells them apart

    elements: int
    values: Mapping[str, Value]

    def __init__(self, elements: int | None = None, **values: Any) -> None:
        table = {p.name: p for p in self.parameters}
        for key in values:
            if key not in table:
                raise ModelError(f"{self.name} has no parameter {key!r}; its parameters are {listing(table)}")
        given = {k: _numbers(self.name, table[k], v) for k, v in values.items()}
        sizes = {k: np.size(np.asarray(v)) for k, v in given.items() if table[k].per_element}
        if len(set(sizes.values())) > 1:
            counts = ", ".join(f"{k} has {n}" for k, n in sizes.items())
            raise ModelError(f"{self.name}: parameters per element must have equally many values; {counts}")
        if elements is not None and not any(p.per_element for p in self.parameters):
            raise ModelError(f"{self.name}: parameters are given by name, out of {listing(table)}; {elements!r} given "
                             "without one, which is the number of elements, and it has none")
        if elements is not None and (isinstance(elements, bool) or not isinstance(elements, int | np.integer)):
            raise ModelError(f"{self.name}: elements is a whole number; {elements!r} given")
        n = next(iter(sizes.values()), 1 if elements is None else elements)
        if elements is not None and n != elements:
            raise ModelError(f"{self.name}: elements is {elements} but {next(iter(sizes))} has {n} values")
        if n < 1:
            raise ModelError(f"{self.name}: at least one element is needed, {n} given")
        self.elements = n
        self.values = {p.name: _checked(self.name, p, given.get(p.name), n) for p in self.parameters}

        for p in self.parameters:
            if p.at_least and np.any(np.asarray(self.values[p.name]) < np.asarray(self.values[p.at_least])):
                raise ModelError(
                    f"{self.name}.{p.name} must be at least {p.at_least}; "
                    f"{self.values[p.name]} and {self.values[p.at_least]} given"
                )

    def __getattr__(self, name: str) -> Value:
        values = self.__dict__.get("values", {})
        if name in values:
            return values[name]
        raise AttributeError(f"{type(self).__name__} has no attribute or parameter {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        if "values" in self.__dict__:
            raise AttributeError(f"{type(self).__name__} is frozen; use replace({name}=...)")
        super().__setattr__(name, value)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.values == other.values

    def __hash__(self) -> int:
        return hash((self.name, *self.values.values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v}' for k, v in self.values.items())})"

    def replace(self, **values: Any) -> Self:
        """The same effect with some parameters changed."""
        return type(self)(**{**self.values, **values})

    @property
    def unset(self) -> tuple[str, ...]:
        """Names of the parameters that have no value yet."""
        return tuple(k for k, v in self.values.items() if np.isnan(v).any())

    @property
    def thermometer(self) -> str:
        """Name of the parameter by which it follows a measured temperature; empty where it does not."""
        return next((p.name for p in self.parameters if p.unit == KELVIN and np.any(self.values[p.name])), "")

    @property
    def packed(self) -> NDArray[np.float64]:
        """All parameters in the order of the table, as the native library takes them."""
        return np.concatenate([np.atleast_1d(np.asarray(v, float)) for v in self.values.values()])

    def index(self, parameter: str) -> slice:
        """Where the values of a parameter stand in `packed`."""
        at = 0
        for p in self.parameters:
            size = self.elements if p.per_element else 1
            if p.name == parameter:
                return slice(at, at + size)
            at += size
        raise ModelError(f"{self.name} has no parameter {parameter!r}")

    @property
    def hidden_inertia(self) -> float:
        """Part of the axis's inertia that does not move with the joint [kg m^2]: the parameter in that unit."""
        return float(sum(np.sum(self.values[p.name]) for p in self.parameters if p.unit == "kg m^2"))

    def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torque that reaches the joint for a commanded one (drive effects).

        Args:
            time: (n,) start of each sample [s], equally spaced.
            command: (n,) torque commanded from each sample to the next [N m].

        Returns:
            (n,) mean torque delivered over each sample [N m].
        """
        return command

    def read(self, time: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Position as the encoder reads it (sensor effects).

        Args:
            time: (n,) of each sample [s], equally spaced.
            position: (n,) where the joint is [rad].

        Returns:
            (n,) reading, before noise and quantisation [rad].
        """
        return position

    def correct(self, time: NDArray[np.float64], reading: NDArray[np.float64]) -> NDArray[np.float64]:
        """Position of the joint from what the encoder read: the inverse of `read` (sensor effects).

        Args:
            time: (n,) of each sample [s], equally spaced.
            reading: (n,) [rad].

        Returns:
            (n,) where the joint was [rad].
        """
        return reading

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Changes a MuJoCo model so that the effect acts on `joint`.

        For effects that MuJoCo has an element for; the plug-in does the native ones.

        Args:
            spec: the model, changed in place.
            joint: name of a hinge or slide joint that exists.
        """

    @classmethod
    def found(cls, spec: mujoco.MjSpec, joint: str) -> Self | None:
        """What `edit` would have had to be called on to leave `joint` as it is; None where nothing of it is there.

        Args:
            spec: a model, left as it is.
            joint: name of a hinge or slide joint that exists.
        """
        return None


def passed(effect: Effect, way: str, time: NDArray[np.float64], samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """What an effect makes of samples.

    Args:
        effect: whose.
        way: "deliver", "read" or "correct".
        time, samples: (n,) as for that method.

    Raises:
        ModelError: it does not give (n,) numbers back.
    """
    found = getattr(effect, way)(time, samples)
    if np.shape(found) != np.shape(samples) or not _is_numeric(found):
        given = f"shape {np.shape(found)}" if _is_numeric(found) else repr(found)
        expected = f"must give a number for each of the {len(samples)} samples"
        raise ModelError(f"{effect.name}: {way} {expected}; {given} given")
    return np.asarray(found, float)


def actuators_of(spec: mujoco.MjSpec, joint: str) -> list[Any]:
    """The actuators that act on a joint, and on no tendon, site or body that is called as it is."""
    import mujoco

    on_joints = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return [a for a in spec.actuators if a.target == joint and a.trntype in on_joints]


def _numbers(effect: str, p: Parameter, value: Any) -> float | NDArray[np.float64] | None:
    """A value that is given as a number, or several as an array; ModelError where it is neither."""
    if value is None or isinstance(value, float):
        return value
    try:
        if _is_numeric(value):
            return np.asarray(value, float)
    except (ValueError, OverflowError):  # lists of different lengths, a whole number beyond any float
        pass
    expected = "a list of numbers" if p.per_element else "a number"
    raise ModelError(f"{effect}.{p.name} must be {expected} [{p.unit}]; {value!r} given")


def _is_numeric(value: Any) -> bool:
    """Whether something is a number, or an array or a list of numbers; NumPy takes text and True for numbers too."""
    if isinstance(value, list | tuple):
        return all(isinstance(x, float) or _is_numeric(x) for x in value)
    return is_number(value) or np.asarray(value).dtype.kind in "iuf"


def _checked(effect: str, p: Parameter, value: float | NDArray[np.float64] | None, n: int) -> Value:
    if value is None:
        value = np.full(n, 1.0 / n if p.share else p.default) if p.per_element else p.default
    # Most are one number, of which NumPy's checks are dear.
    if isinstance(value, float) and not p.per_element and math.isfinite(value) and p.lower <= value <= p.upper:
        return float(value)
    array = np.asarray(value, float)
    if array.ndim > 1 or (array.ndim == 1 and not p.per_element):
        raise ModelError(f"{effect}.{p.name} must be one number [{p.unit}]; {array.tolist()!r} given")
    bad = (array < p.lower) | (array > p.upper) | np.isinf(array)
    if bad.any():
        wrong = float(np.atleast_1d(array)[np.atleast_1d(bad)][0])
        raise ModelError(f"{effect}.{p.name} must lie in {p.span} {p.unit}; {wrong:g} given")
    if p.share and abs(array.sum() - 1) > 1e-6:
        raise ModelError(f"{effect}.{p.name} must sum to 1; the {n} values given sum to {array.sum():.6g}")
    return tuple(float(x) for x in np.atleast_1d(array)) if p.per_element else float(array)
