"""The test on data not seen: its size where nothing is to be found, and its power where an effect acts now and then."""

import numpy as np
import pytest

from gms_mujoco.identification.held_out import BLOCK, HeldOut, correlated, p_value, scatter
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.record import Record

RATE, SECONDS, RECORDS = 500, 3, 4
RNG = np.random.default_rng(0)


def _observation() -> Observation:
    t = np.arange(RATE * SECONDS) / RATE
    return Observation(Record("run", t, {"torque": np.sin(t), "position": np.sin(3 * t)}, "fit"), 50.0)


SEEN = [_observation()] * RECORDS
ROWS = len(SEEN[0].index)


def rough(rows: int, lag: int) -> np.ndarray:
    """(rows,) noise that is correlated over some rows."""
    return np.convolve(RNG.standard_normal(rows + lag - 1), np.ones(lag) / np.sqrt(lag), "valid")


def noise(lag: int) -> np.ndarray:
    """Noise of all records, in each as loud as it likes."""
    return np.concatenate([np.exp(RNG.standard_normal()) * rough(ROWS, lag) for _ in SEEN])


def acting(where: str) -> np.ndarray:
    """What an effect does: everywhere, in one record, or in a few moments of one."""
    shape, moments = rough(ROWS * RECORDS, 2), np.zeros(ROWS * RECORDS)
    if where == "everywhere":
        moments[:] = 1
    elif where == "one record":
        moments[:ROWS] = 1
    else:
        for start in (0.1, 0.5, 0.8):
            moments[int(start * ROWS) : int((start + 0.1) * ROWS)] = 1
    return shape * moments


def rarely() -> np.ndarray:
    """Moments at which anything is asked of a record: a third of it, and half of those in which an effect acts."""
    out = np.zeros((RECORDS, ROWS), bool)
    out[:, ROWS * 2 // 3 :] = True
    for start in (0.1, 0.5):
        out[0, int(start * ROWS) : int((start + 0.05) * ROWS)] = True
    return out.ravel()


def p(before: np.ndarray, after: np.ndarray) -> float:
    return p_value(HeldOut(before, SEEN), HeldOut(after, SEEN))


@pytest.mark.parametrize("where", ["everywhere", "one record", "moments"])
@pytest.mark.parametrize("lag", [1, 10, 60])
def test_what_does_nothing_passes_no_more_often_than_stated(where: str, lag: int) -> None:
    """What a fit to other blocks makes of chance, in the place of an effect that is not there."""
    found = []
    for _ in range(300):
        error = noise(lag)
        found.append(p(error, error - 0.3 * RNG.standard_normal() * acting(where)))
    assert np.mean(np.array(found) < 0.01) < 0.025 and np.mean(np.array(found) < 0.1) < 0.13


@pytest.mark.parametrize("where", ["everywhere", "one record", "moments"])
def test_what_acts_is_seen_where_it_acts(where: str) -> None:
    for _ in range(20):
        error, effect = 0.3 * rough(ROWS * RECORDS, 2), acting(where)
        assert p(error + effect, error + 0.1 * effect) < 1e-4


def test_the_same_where_little_is_asked() -> None:
    """Most stretches hold nothing then that would say how loud they are; a refit moves all of the others a little."""
    asked, found = rarely(), []
    for _ in range(300):
        error = noise(2)
        found.append(p(error * asked, (error - 0.3 * RNG.standard_normal() * acting("moments")) * asked))
    assert np.mean(np.array(found) < 0.01) < 0.025
    seen = []
    for _ in range(40):
        error, effect = 0.3 * rough(ROWS * RECORDS, 2), acting("moments") + 0.01 * acting("everywhere")
        seen.append(p((error + effect) * asked, (error + 0.1 * effect) * asked))
    assert np.median(seen) < 1e-7


def test_what_makes_everything_worse_has_no_small_p_value() -> None:
    error = noise(2)
    assert p(error, 1.2 * error) > 0.9 and p(error, error) == 1.0


def test_stretches_in_which_nothing_moves_do_not_count() -> None:
    error, effect = 0.3 * rough(ROWS * RECORDS, 2), acting("everywhere")
    silent = np.zeros(ROWS)
    with_rest = [np.append(x, silent) for x in (error + effect, error)]
    got = p_value(*(HeldOut(x, [*SEEN, SEEN[0]]) for x in with_rest))
    assert got == pytest.approx(p(error + effect, error), rel=1e-6)


def test_squares_add_up() -> None:
    held = HeldOut(noise(2), SEEN)
    assert held.squares.sum() == pytest.approx(held.total) == pytest.approx(sum(held.by_record))


def test_the_length_of_a_correlation_is_found() -> None:
    assert correlated(rough(20000, 1)) == 1
    assert 30 <= correlated(rough(20000, 40)) <= 40


def spread(before: np.ndarray, after: np.ndarray, floor: np.ndarray) -> float:
    return scatter(HeldOut(before, SEEN), HeldOut(after, SEEN), floor)


def test_what_is_real_scatters_no_more_than_the_noise_says() -> None:
    for where in ("everywhere", "one record", "moments"):
        effect = acting(where)
        for loud in (0.1, 1.0, 3.0):
            error, floor = loud * rough(ROWS * RECORDS, 2), loud * rough(ROWS * RECORDS, 2)
            assert spread(error + effect, error, floor) < 0.3 * max(loud, 0.3)


def test_what_is_left_where_an_effect_hardly_acts_does_not_scatter_it() -> None:
    """A refit without it moves all else by a little, along with whatever is not explained there."""
    effect, floor = acting("one record"), 0.01 * rough(ROWS * RECORDS, 2)
    elsewhere = effect == 0
    error = np.where(elsewhere, rough(ROWS * RECORDS, 2), floor)
    slight = 0.01 * elsewhere * error
    assert elsewhere.any()
    assert spread(error + effect + slight, error, floor) < 0.1


def test_what_stands_for_something_else_scatters_by_its_own_size() -> None:
    """Twice as strong in some blocks as in others: a mean strength fits, and the noise does not say why."""
    effect, floor = acting("everywhere"), 0.01 * rough(ROWS * RECORDS, 2)
    n = SEEN[0].rows_per_block(BLOCK)
    of_block = np.tile(np.minimum(np.arange(ROWS) // n, ROWS // n - 1) % 2, RECORDS)
    for uneven in (0.2, 0.8):
        true = effect * (1 + uneven * (2 * of_block - 1))
        assert spread(true, true - effect, floor) == pytest.approx(uneven, rel=0.1)
    assert spread(floor, floor, floor) == 0.0
