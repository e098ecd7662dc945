"""Recent: what was worked out lately is not worked out again, and few results are kept."""

from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.recent import kept


@given(st.lists(st.integers(0, 9), min_size=1, max_size=60))
def test_results_are_those_of_their_keys_and_few(keys: list[int]) -> None:
    known: dict[int, str] = {}
    made: list[int] = []
    for key in keys:
        anew = [] if key in known else [key]
        count = len(made)
        assert kept(known, key, lambda key=key: made.append(key) or str(key)) == str(key)  # type: ignore[misc]
        assert made[count:] == anew
        assert len(known) <= 5
    assert kept(known, keys[-1], lambda: "anew") == str(keys[-1])  # not worked out again
