"""The catalogue: one file per effect, file name = effect name.

A `.cc` file is an effect evaluated by the native library; its class is made here from what the file declares.
A `.py` file defines a subclass of Effect. Nothing has to be registered.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
from types import ModuleType

from .. import native
from ..effect import KINDS, Effect
from ..errors import ModelError, listing
from ..parameter import Parameter


def catalogue() -> dict[str, type[Effect]]:
    """The effects of this folder by name; raises ModelError naming a file that holds none or hides another."""
    found: dict[str, type[Effect]] = {}
    for m in pkgutil.iter_modules(__path__):
        if m.name in native.BY_NAME:
            raise ModelError(f"effects/{m.name}.py: an effect of that name stands in effects/{m.name}.cc; rename it")
        found[m.name] = of_module(importlib.import_module(f"{__name__}.{m.name}"), f"effects/{m.name}.py", m.name)
    for d in native.DECLARATIONS:
        found[d.name] = type(
            d.class_name,
            (Effect,),
            {
                "__module__": __name__,
                "name": d.name,
                "kind": d.kind,
                "doc": d.doc,
                "signature": d.signature,
                "experiment": d.experiment,
                "parameters": d.parameters,
                "is_native": True,
                "modulates": d.modulates,
                "separable": d.separable,
            },
        )
    classes: dict[str, str] = {}
    for name, kind in found.items():
        if (other := classes.setdefault(kind.__name__, name)) != name:
            raise ModelError(f"effects {other} and {name} have classes of one name, {kind.__name__}; rename one")
        kind.__doc__ = described(kind)
    return dict(sorted(found.items()))


def of_module(module: ModuleType, file: str, name: str) -> type[Effect]:
    """The effect that a .py file declares; raises ModelError naming the file where that is none, or not all of one."""
    there = [c for c in vars(module).values() if isinstance(c, type) and issubclass(c, Effect) and "name" in vars(c)]
    kind = next((c for c in there if c.name == name), None)
    if kind is None:
        found = listing(str(c.name) for c in there)
        raise ModelError(f"{file}: a subclass of Effect with name = {name!r}, that of the file, is expected; the names "
                         f"in it are {found}")
    for key in ("kind", "doc", "signature", "experiment", "parameters"):
        if not hasattr(kind, key):
            raise ModelError(f"{file}: {kind.__name__} does not declare its {key}")
    if kind.kind not in KINDS:
        raise ModelError(f"{file}: the kind of an effect is one of {listing(KINDS)}; {kind.kind!r} given")
    names = [p.name for p in kind.parameters]
    for p in kind.parameters:
        if names.count(p.name) > 1 or hasattr(Effect, p.name) or p.name in Effect.__annotations__:
            raise ModelError(f"{file}: {p.name!r} is no name of a parameter, for something else is called so already")
        if not p.lower < p.upper:
            raise ModelError(f"{file}: {p.name} must have lower below upper; {p.span} given")
        if not (math.isnan(p.default) or p.lower <= p.default <= p.upper):
            raise ModelError(f"{file}: the default of {p.name} must lie in {p.span}; {p.default:g} given")
    return kind


def described(kind: type[Effect]) -> str:
    """What `help` says of an effect: equation, source and parameters."""
    return "\n".join([kind.doc, "", "Args:", *(f"    {p.name}: {_told(p)}" for p in kind.parameters)])


def _told(p: Parameter) -> str:
    unset = "to be given or fitted" if math.isnan(p.default) else f"default {p.default:g}"
    several, default = ", one per element" * p.per_element, "equal shares" if p.share else unset
    return f"{p.doc} [{p.unit}]{several}; {default}; in {p.span}"


CATALOGUE = catalogue()
globals().update({c.__name__: c for c in CATALOGUE.values()})


def __getattr__(name: str) -> type[Effect]:
    raise AttributeError(f"no effect {name}; the effects are {listing(c.__name__ for c in CATALOGUE.values())}")


def find(name: str) -> type[Effect]:
    """The class of the effect called `name`; raises ModelError naming those that exist."""
    if name not in CATALOGUE:
        raise ModelError(f"no effect is called {name!r}; the effects are {listing(CATALOGUE)}")
    return CATALOGUE[name]
