"""What can go wrong, said in one line: what was given, what was expected, which names exist."""

from collections.abc import Iterable


class GmsError(Exception):
    """Base of every error that a user can cause; the command line prints it and exits with code 2."""


class DataError(GmsError):
    """A measurement cannot be used: missing column, NaN, time running backwards, wrong unit, empty file."""


class ModelError(GmsError):
    """A plant or effect cannot be built: unknown effect or joint, a value out of bounds."""


class EngineError(GmsError):
    """The installed MuJoCo cannot be used with this build."""


def listing(names: Iterable[str]) -> str:
    """Names for the end of a message: "a, b, c", or "none"."""
    return ", ".join(sorted(names)) or "none"
