"""Files that are either whole or absent."""

import os
import tempfile
from pathlib import Path

from .errors import GmsError


def write_text(path: str | Path, text: str) -> None:
    """Writes `text` to `path`: first to a temporary file beside it, then renamed.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    path = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent or ".")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
            os.chmod(name, 0o666 & ~_umask())
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
    except OSError as error:
        raise GmsError(f"{path}: cannot be written ({error.strerror})") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
