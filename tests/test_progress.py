"""Progress: drawn only for someone who watches, and the share of a part as one of the whole."""

import io

import pytest

from gms_mujoco.progress import Bar, part


def test_progress_draws_only_for_someone_who_watches() -> None:
    for force in (False, True):
        stream = io.StringIO()
        with Bar(stream, force) as bar:
            for k in range(101):
                bar(k / 100, "fitting")
        assert ("100 %" in stream.getvalue() and stream.getvalue().endswith("\x1b[K")) == force


def test_a_part_reports_its_share_of_the_whole_under_its_name() -> None:
    told: list[tuple[float, str]] = []
    inner = part(part(lambda done, message: told.append((done, message)), 0.2, 0.6), 0.5, 1.0, "baseline")
    for done in (0.0, 0.5, 1.0):
        inner(done, "refining")
    assert [done for done, _ in told] == pytest.approx([0.4, 0.5, 0.6])
    assert {message for _, message in told} == {"baseline: refining"}
