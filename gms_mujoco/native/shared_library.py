"""The shared library as it is loaded: its functions, and the catalogue of effects that it holds."""

from __future__ import annotations

import ctypes
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from ..parameter import Parameter

Array = NDArray[np.float64]

_SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
LIBRARY_PATH = Path(__file__).parent / f"libgms_mujoco{_SUFFIX}"
_MAX_PARAMETERS = 12


class _Parameter(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
        ("fallback", ctypes.c_double),
        ("lower", ctypes.c_double),
        ("upper", ctypes.c_double),
        ("per_element", ctypes.c_bool),
        ("free", ctypes.c_bool),
        ("doc", ctypes.c_char_p),
        ("share", ctypes.c_bool),
        ("at_least", ctypes.c_char_p),
    )


class _Effect(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("class_name", ctypes.c_char_p),
        ("kind", ctypes.c_char_p),
        ("doc", ctypes.c_char_p),
        ("signature", ctypes.c_char_p),
        ("experiment", ctypes.c_char_p),
        ("parameters", _Parameter * _MAX_PARAMETERS),
        ("n_state", ctypes.c_void_p),
        ("n_memory", ctypes.c_void_p),
        ("recall", ctypes.c_void_p),
        ("modulate", ctypes.c_void_p),
        ("torque", ctypes.c_void_p),
        ("elements", ctypes.c_void_p),
        ("turns_round", ctypes.c_bool),
        ("torques", ctypes.c_void_p),
        ("alternatives", ctypes.c_void_p),
    )


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(LIBRARY_PATH))
    except OSError as error:
        raise EngineError(
            f"the native library {LIBRARY_PATH.name} cannot be loaded ({error}); reinstall with 'pip install .'"
        ) from None
    pointer, integer, real = ctypes.c_void_p, ctypes.c_int, ctypes.c_double
    for name, result, arguments in (
        ("gms_n_effects", integer, ()),
        ("gms_effect", ctypes.POINTER(_Effect), (integer,)),
        ("gms_joint_new", pointer, ()),
        ("gms_joint_delete", None, (pointer,)),
        ("gms_joint_add", integer, (pointer, integer, integer, pointer)),
        ("gms_joint_n_state", integer, (pointer,)),
        ("gms_joint_n_memory", integer, (pointer,)),
        ("gms_joint_replay", None, (pointer, integer) + (pointer,) * 9),
        ("gms_joint_elements", None, (pointer, integer, integer) + (pointer,) * 7),
        (
            "gms_joints_changes",
            None,
            (pointer,) + (integer,) * 4 + (pointer,) * 8 + (integer, pointer, integer, integer, integer, pointer),
        ),
        ("gms_joint_cycle", integer, (pointer, integer, integer, integer, integer) + (pointer,) * 4),
        ("gms_joint_mean", integer, (pointer, integer) + (pointer,) * 6 + (real, pointer, pointer, integer)),
        (
            "gms_joint_simulate",
            integer,
            (pointer, integer, integer, integer, real, real, real) + (pointer,) * 6 + (real, real) + (pointer,) * 4,
        ),
        (
            "gms_servo_simulate",
            integer,
            (pointer, integer, real, real, real, real, pointer, real, integer) + (pointer,) * 5,
        ),
        ("gms_series_mean", None, (integer, pointer, integer, pointer, pointer)),
        ("gms_series_band", None, (integer, pointer, integer, integer, integer, pointer, pointer)),
        ("gms_engine_symbols", ctypes.POINTER(ctypes.c_char_p), (pointer,)),
        ("gms_engine_init", integer, (pointer, ctypes.c_char_p, integer)),
        ("gms_engine_read", ctypes.c_char_p, (pointer, pointer, integer, integer) + (pointer,) * 4),
        ("gms_engine_strip", integer, (pointer,)),
        ("gms_engine_effect", pointer, (pointer, pointer, integer, integer) + (pointer,) * 4),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


library = _load()


@dataclass(frozen=True)
class Declaration:
    """What an effect's source file says of itself."""

    index: int
    name: str
    class_name: str
    kind: str
    doc: str
    signature: str
    experiment: str
    parameters: tuple[Parameter, ...]
    modulates: bool
    has_torque: bool
    has_state: bool
    separable: bool  # its elements do not know of each other


def _declaration(index: int) -> Declaration:
    e = library.gms_effect(index).contents
    parameters = tuple(
        Parameter(
            p.name.decode(), p.unit.decode(), p.fallback, p.lower, p.upper, p.free, p.per_element, p.share,
            (p.at_least or b"").decode(), p.doc.decode()
        )
        for p in e.parameters
        if p.name
    )
    texts = {k: getattr(e, k).decode() for k in ("name", "class_name", "kind", "doc", "signature", "experiment")}
    return Declaration(
        index, **texts, parameters=parameters,
        modulates=bool(e.modulate), has_torque=bool(e.torque), has_state=bool(e.n_state), separable=bool(e.elements),
    )  # fmt: skip


DECLARATIONS = tuple(_declaration(i) for i in range(library.gms_n_effects()))
BY_NAME = {d.name: d for d in DECLARATIONS}
ANCHOR = 2  # numbers of a joint's state before those of its effects


def address(array: Array | None) -> Any:
    return None if array is None else array.ctypes.data
