"""Files that are either whole or absent, and those that come with the package."""

import json
import math
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import GmsError

_HERE = Path(__file__).resolve().parent
# Of the wheel, or of the tree; MJCF models and plants.
MODELS = next((p for p in (_HERE / "models", _HERE.parent / "models") if p.is_dir()), _HERE / "models")


def write_text(path: str | Path, text: str) -> None:
    """Writes `text` to `path` in UTF-8; see `whole`."""
    write_bytes(path, text.encode())


def write_bytes(path: str | Path, data: bytes) -> None:
    """Writes `data` to `path`; see `whole`."""
    with whole(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A temporary file beside `path` that takes its name when the block ends well and is deleted when it does not.

    Raises:
        GmsError: the folder does not exist or cannot be written, or the path is that of a device or the like.
    """
    path = _followed(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        try:
            yield Path(name)
            os.chmod(name, 0o666 & ~_umask())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise GmsError(f"{path}: cannot be written ({error.strerror or error})") from None


def expect_writable(path: str | Path) -> Path:
    """The path of a file to be written later; raises GmsError now, before any long work, where it cannot be."""
    path = _followed(path)
    if path.is_dir():
        raise GmsError(f"{path}: is a folder; expected the name of a file to write")
    if not path.parent.is_dir():
        raise GmsError(f"{path}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise GmsError(f"{path}: the folder {path.parent} cannot be written")
    return path


def expect_apart(outputs: Iterable[Path], inputs: Iterable[str | Path]) -> None:
    """Raises GmsError where a file to be written later is one that is read, or one that is written already."""
    read, written = list(map(Path, inputs)), list[Path]()
    for path in outputs:
        if any(_is_same(path, other) for other in read):
            raise GmsError(f"{path}: is read here, and would be lost; expected the name of another file to write")
        if any(_is_same(path, other) for other in written):
            raise GmsError(f"{path}: is given for two files to write; expected a name for each")
        written.append(path)


def _is_same(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file, there or not."""
    try:
        return one.samefile(other)
    except OSError:
        return one.resolve() == other.resolve()


def _followed(path: str | Path) -> Path:
    """The path of a file to be written, behind symbolic links; GmsError where it is neither a file nor free."""
    path = Path(path)
    try:
        # Before the link of a pipe, /dev/stdout say, which leads to no path.
        other = path.exists() and not path.is_file() and not path.is_dir()
        path = path.resolve() if path.is_symlink() and not other else path
    except OSError as error:  # a name that is too long, links that go round
        raise GmsError(f"{path}: cannot be written ({error.strerror or error})") from None
    if other:
        raise GmsError(f"{path}: is no regular file; expected the name of a file to write")
    return path


def expect_folder(path: str | Path) -> Path:
    """The path of a folder to be made later; raises GmsError now, before any long work, where it cannot be."""
    path = Path(path)
    try:
        there = next(p for p in (path, *path.absolute().parents) if p.exists())
    except OSError as error:
        raise GmsError(f"{path}: the folder cannot be made ({error.strerror or error})") from None
    if not there.is_dir() or not os.access(there, os.W_OK):
        why = "cannot be written" if there.is_dir() else "is no folder"
        raise GmsError(f"{path}: the folder cannot be made ({there} {why})")
    return path


def make_folder(path: str | Path) -> Path:
    """The folder `path`, made where it does not exist; raises GmsError where it cannot be made."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GmsError(f"{path}: the folder cannot be made ({error.strerror or error})") from None
    return Path(path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def as_json(value: Any) -> str:
    """Strict JSON text: numbers that are not finite become null."""
    return json.dumps(_finite(value), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "tolist"):  # numpy
        return _finite(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
