"""The version of this package, as pyproject.toml declares it."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("gms-mujoco")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0.0.0"
