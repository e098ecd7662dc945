"""The native library: the catalogue of effects written in C++, and joints built from them.

It knows no particular law. `Joint` replays a joint's effects along a given motion; the MuJoCo plug-in runs the
same code inside the engine.
"""

from .in_model import Attached, Reading, attached, reading
from .joint import INTEGRATION, Joint, Motion, Replay
from .shared_library import ANCHOR, BY_NAME, DECLARATIONS, LIBRARY_PATH, Declaration, library

__all__ = [
    "ANCHOR", "BY_NAME", "DECLARATIONS", "INTEGRATION", "LIBRARY_PATH", "Attached", "Declaration", "Joint", "Motion",
    "Reading", "Replay", "attached", "library", "reading",
]  # fmt: skip
