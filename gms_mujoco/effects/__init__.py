"""The catalogue: one file per effect, file name = effect name.

A `.cc` file is an effect evaluated by the native library; its class is made here from what the file declares.
A `.py` file defines a subclass of Effect. Nothing has to be registered.
"""

from __future__ import annotations

import importlib
import pkgutil

from .. import native
from ..effect import Effect
from ..errors import ModelError, listing


def _catalogue() -> dict[str, type[Effect]]:
    found: dict[str, type[Effect]] = {}
    classes = {m.name: importlib.import_module(f"{__name__}.{m.name}") for m in pkgutil.iter_modules(__path__)}
    for name, module in classes.items():
        found[name] = next(
            c for c in vars(module).values()
            if isinstance(c, type) and issubclass(c, Effect) and c.__dict__.get("name") == name
        )
    for d in native.DECLARATIONS:
        found[d.name] = type(
            d.class_name,
            (Effect,),
            {
                "__doc__": d.doc,
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
    return dict(sorted(found.items()))


CATALOGUE = _catalogue()
globals().update({c.__name__: c for c in CATALOGUE.values()})


def __getattr__(name: str) -> type[Effect]:
    raise AttributeError(f"no effect {name}; the effects are {listing(c.__name__ for c in CATALOGUE.values())}")


def find(name: str) -> type[Effect]:
    """The class of the effect called `name`; raises ModelError naming those that exist."""
    if name not in CATALOGUE:
        raise ModelError(f"no effect is called {name!r}; the effects are {listing(CATALOGUE)}")
    return CATALOGUE[name]
