"""What can go wrong, said in one line: what was given, what was expected, which names exist."""

from collections.abc import Iterable, Sequence
from numbers import Real
from typing import Any, TypeGuard


class GmsError(Exception):
    """Base of every error that a user can cause; the command line prints it and exits with code 2."""


class DataError(GmsError):
    """A measurement cannot be used: missing column, NaN, time running backwards, wrong unit, empty file."""


class ModelError(GmsError):
    """A plant or effect cannot be built: unknown effect or joint, a value out of bounds."""


class EngineError(GmsError):
    """The installed MuJoCo cannot be used with this build."""


def is_number(value: Any, kind: type = Real) -> TypeGuard[Any]:
    """Whether something is a number, or a whole one (`Integral`); True and False are none."""
    return isinstance(value, kind) and not isinstance(value, bool)


def listing(names: Iterable[str]) -> str:
    """Names for the end of a message: "a, b, c", or "none"."""
    return ", ".join(sorted(names)) or "none"


def several(names: Sequence[str]) -> str:
    """Names in a sentence on all of them; of many the first two, and how many more."""
    return ", ".join(names) if len(names) < 4 else f"{names[0]}, {names[1]} and {len(names) - 2} more"
