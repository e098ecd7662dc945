"""Realistic joint friction for MuJoCo: simulate it, identify it, and find the effect that is missing.

    import gms_mujoco as gms

    runs = gms.load("measurements/")
    plant = gms.fit(gms.baseline(runs.inertia, runs.kind), runs.fit).plant
    print(gms.compare(plant, runs.validate))
    print(gms.diagnose(runs))

Importing the package registers its friction plug-in with MuJoCo.
"""

from importlib import import_module
from typing import Any

from . import effects
from . import registration as _registration  # noqa: F401  makes the environments known to Gymnasium
from .bench import measure
from .compare import Comparison, compare
from .dahl_resonance import DahlReading, identify_dahl
from .dataset import Dataset, load
from .diagnose import diagnose
from .diagnosis.findings import Diagnosis
from .effect import Effect
from .elements import choose_elements
from .engine import attach, friction, install_callback, remove_callback
from .errors import DataError, EngineError, GmsError, ModelError
from .excitation import Excitation
from .files import MODELS
from .fit import baseline, fit
from .fit_result import FitResult
from .frf import FRF, estimate_frf
from .hensen import LuGreReading, identify_lugre
from .parameter import Parameter
from .plant import Plant
from .record import Record
from .sampling import sample
from .servo_run import ServoRun
from .simulate import simulate
from .sweep import stepped_sine
from .version import __version__

__all__ = [
    "FRF",
    "MODELS",
    "Comparison",
    "DahlReading",
    "DataError",
    "Dataset",
    "Diagnosis",
    "Effect",
    "EngineError",
    "Excitation",
    "FitResult",
    "GmsError",
    "LuGreReading",
    "ModelError",
    "Parameter",
    "Plant",
    "Record",
    "ServoRun",
    "__version__",
    "attach",
    "baseline",
    "choose_elements",
    "compare",
    "diagnose",
    "effects",
    "estimate_frf",
    "fit",
    "friction",
    "identify_dahl",
    "identify_lugre",
    "install_callback",
    "load",
    "measure",
    "remove_callback",
    "sample",
    "simulate",
    "stepped_sine",
]


def __getattr__(name: str) -> Any:
    if name in ("control", "env", "mjx", "sb3", "view", "warp"):  # what they load takes seconds, or is an extra
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
