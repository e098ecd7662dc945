"""Stretches of time that are left out together, to be predicted from the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def folds(stretches: int, count: int) -> NDArray[np.intp]:
    """(stretches,) number of the fold of each: of every `count` that follow each other one in each, in drawn order.

    Taken in turn they would be in step with motions of many a period: a fold would hold all that was ever seen of one
    phase, and nothing would be left to predict it from.
    """
    rng = np.random.default_rng(0)
    return np.concatenate([rng.permutation(count) for _ in range(0, stretches, count)] or [np.arange(0)])[:stretches]
