"""A file is whole or absent, and what stood there before is not lost to a failure."""

import os
from pathlib import Path

import pytest

from gms_mujoco import files
from gms_mujoco.errors import GmsError


def test_text_and_bytes_arrive_with_ordinary_rights(tmp_path: Path) -> None:
    files.write_text(tmp_path / "a.toml", "µ = 1\n")
    files.write_bytes(tmp_path / "b.bin", b"\0\1")
    (tmp_path / "plain").touch()
    assert (tmp_path / "a.toml").read_text(encoding="utf-8") == "µ = 1\n"
    assert (tmp_path / "b.bin").read_bytes() == b"\0\1"
    assert (tmp_path / "a.toml").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_failure_half_way_keeps_the_old_file_and_leaves_no_other(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text("old")
    with pytest.raises(RuntimeError), files.whole(tmp_path / "model.toml") as temporary:
        temporary.write_text("half of the ne")
        raise RuntimeError
    assert os.listdir(tmp_path) == ["model.toml"] and (tmp_path / "model.toml").read_text() == "old"


def test_missing_folder_is_named(tmp_path: Path) -> None:
    for write in (lambda p: files.write_text(p, ""), files.expect_writable):
        with pytest.raises(GmsError, match="nowhere"):
            write(tmp_path / "nowhere" / "model.toml")


def test_a_folder_is_no_file_to_write(tmp_path: Path) -> None:
    with pytest.raises(GmsError, match="is a folder"):
        files.expect_writable(tmp_path)
    with pytest.raises(GmsError):
        files.write_text(tmp_path, "")
    assert os.listdir(tmp_path.parent).count(tmp_path.name) == 1


def test_a_file_is_no_folder_to_make(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    with pytest.raises(GmsError, match="taken"):
        files.make_folder(tmp_path / "taken")
    assert files.make_folder(tmp_path / "a" / "b").is_dir()


def test_what_is_no_regular_file_is_left_alone_and_links_are_followed(tmp_path: Path) -> None:
    """A device that was renamed away would be gone for everybody."""
    os.mkfifo(tmp_path / "pipe")
    for check in (files.expect_writable, lambda path: files.write_text(path, "text")):
        with pytest.raises(GmsError, match="pipe: is no regular file; expected the name of a file to write"):
            check(tmp_path / "pipe")
    (tmp_path / "behind.toml").write_text("old")
    (tmp_path / "link.toml").symlink_to("behind.toml")
    files.write_text(tmp_path / "link.toml", "new")
    assert (tmp_path / "link.toml").is_symlink() and (tmp_path / "behind.toml").read_text() == "new"
    with pytest.raises(GmsError, match="cannot be written"):
        files.expect_writable(tmp_path / ("a" * 300))


def test_a_link_to_a_pipe_is_no_file(tmp_path: Path) -> None:
    """/dev/stdout of a pipeline leads to a path that does not exist."""
    read, write = os.pipe()
    try:
        (tmp_path / "stdout").symlink_to(f"/proc/self/fd/{write}")
        with pytest.raises(GmsError, match="stdout: is no regular file"):
            files.expect_writable(tmp_path / "stdout")
    finally:
        os.close(read), os.close(write)


def test_a_file_that_is_read_or_written_already_is_not_written(tmp_path: Path) -> None:
    """By whatever name: through links, another folder, or before it is there."""
    a, b, hard, soft = (tmp_path / name for name in ("a", "b", "hard", "soft"))
    a.write_text("input")
    hard.hardlink_to(a)
    soft.symlink_to(a)
    (tmp_path / "in").mkdir()
    for other in (a, hard, soft, tmp_path / "in" / ".." / "a"):
        with pytest.raises(GmsError, match=f"{other}: is read here, and would be lost"):
            files.expect_apart([other], [b, str(a)])
    for other in (b, tmp_path / "in" / ".." / "b"):
        with pytest.raises(GmsError, match=f"{other}: is given for two files to write"):
            files.expect_apart([b, other], [a])
    b.write_text("an earlier output")
    files.expect_apart([b, tmp_path / "c"], [a, tmp_path / "none"])


def test_a_folder_that_cannot_be_made_is_told_before_and_one_that_can_is_not_made(tmp_path: Path) -> None:
    assert files.expect_folder(tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "b"):
        with pytest.raises(GmsError, match="file is no folder"):
            files.expect_folder(path)
