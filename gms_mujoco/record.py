"""Record: one run of one axis, measured or simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from .errors import DataError, listing
from .formats import stamps

Array = NDArray[np.float64]

USES = ("fit", "select", "validate")

# The signals of a hinge joint and their units; a slide joint reads m for rad and N for N m.
UNITS: Mapping[str, str] = {
    "time": "s",
    "torque": "N m",
    "position": "rad",
    "velocity": "rad/s",
    "load": "N m",
    "temperature": "degC",
    "reference": "rad",
    "rigid_torque": "N m",
    "inertia_change": "kg m^2",
    "transmitted_torque": "N m",
}
REQUIRED = ("torque", "position")
LOAD_ACTS = (1, -1)  # a load that acts on the axis too: in its direction, or against it


def _seconds(time: ArrayLike) -> Array:
    """(n,) time stamps as seconds: numbers as they are, dates and spans since the first."""
    given = np.asarray(time)
    if given.dtype.kind not in "mM":
        return np.asarray(given, float)
    seconds = stamps.from_numpy(given)
    return seconds - seconds[:1]


@dataclass(frozen=True)
class Record:
    """Equally spaced samples of one run; a frozen value.

    Attributes:
        name: where it comes from, for messages and plots.
        time: (n,) [s], equally spaced; dates and spans of NumPy count from the first.
        signals: (n,) each, by the names in `UNITS`. `torque` is what the drive was told (or measured) to apply
            from each sample to the next; `position` is read at the sample; `reference` is where a closed loop was told
            to be, which the indirect estimate of a frequency response needs. Of a joint of a robot, `rigid_torque` is
            what the rigid bodies take beyond inertia times acceleration, `inertia_change` what the inertia about
            the joint is in that pose less the axis's, and `transmitted_torque` the load of its gear where no `load` was
            recorded (see robot.py).
        use: "fit" (identifies parameters), "select" (chooses between models) or "validate" (scored after every choice).
        resolution: position of one encoder count [rad or m], None where unknown.
        sensed: whether `torque` was read at the samples, as `position` is: a column `current` whose rows come by
            another clock than that of the drive.
        others: (n,) measured position of each other joint of the robot, by name [rad or m].
        kind: of the joint, "hinge" or "slide"; None where nobody has said it.

    Raises:
        DataError: a signal is missing, has another length, is not finite, or time does not run forward evenly.
    """

    name: str
    time: Array
    signals: Mapping[str, Array]
    use: str = "fit"
    resolution: float | None = None
    sensed: bool = False
    others: Mapping[str, Array] = field(default_factory=dict, repr=False)
    kind: str | None = None

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "time", _seconds(self.time))
            object.__setattr__(self, "signals", {k: np.asarray(v, float) for k, v in self.signals.items()})
        except (TypeError, ValueError) as error:
            raise DataError(f"{self.name}: the signals must be numbers ({error})") from None
        if self.use not in USES:
            raise DataError(f"{self.name}: use must be one of {listing(USES)}; {self.use!r} given")
        for key in REQUIRED:
            if key not in self.signals:
                raise DataError(f"{self.name}: no {key!r} signal; it has {listing(self.signals)}")
        for key, value in {"time": self.time, **self.signals}.items():
            if key not in UNITS:
                raise DataError(f"{self.name}: unknown signal {key!r}; the signals are {listing(UNITS)}")
            if np.shape(value) != np.shape(self.time) or np.ndim(value) != 1:
                raise DataError(f"{self.name}: {key} has shape {np.shape(value)}, time has {np.shape(self.time)}")
            bad = np.flatnonzero(~np.isfinite(value))
            if len(bad):
                raise DataError(f"{self.name}: {key} is not a finite number at sample {bad[0]} ({len(bad)} such)")
        if len(self.time) < 16:
            raise DataError(f"{self.name}: {len(self.time)} samples; at least 16 are needed")
        step = np.diff(self.time)
        back = np.flatnonzero(step <= 0)
        if len(back):
            raise DataError(
                f"{self.name}: time does not run forward at sample {back[0] + 1} "
                f"({self.time[back[0]]:g} s, then {self.time[back[0] + 1]:g} s)"
            )
        if np.ptp(step) > 0.02 * self.sample_time:
            worst = int(np.argmax(np.abs(step - self.sample_time)))
            raise DataError(
                f"{self.name}: samples must be equally spaced; the step is {self.sample_time:g} s on average "
                f"but {step[worst]:g} s at sample {worst + 1}"
            )

    @property
    def sample_time(self) -> float:
        """Time from one sample to the next [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def torque(self) -> Array:
        """(n,) torque applied from each sample to the next [N m]."""
        return self.signals["torque"]

    @property
    def position(self) -> Array:
        """(n,) position read at each sample [rad]."""
        return self.signals["position"]

    def get(self, signal: str) -> Array | None:
        """(n,) signal by name, None where it was not recorded; for a load then what the gear transmits by the model."""
        found = self.signals.get(signal)
        return self.signals.get("transmitted_torque") if found is None and signal == "load" else found

    def of_kind(self, kind: str) -> Self:
        """Itself; raises DataError where it is known to be of the other kind of joint."""
        if self.kind not in (None, kind):
            raise DataError(f"{self.name}: a record of a {self.kind} joint, where a {kind} joint is asked for")
        return self

    def with_signals(self, signals: Mapping[str, Array]) -> Self:
        """The record with other signals (n,), or more of them, by name."""
        return replace(self, signals={**self.signals, **signals})

    def with_acting_load(self, sign: int) -> Self:
        """The same record, of an axis on which the load acts as a torque, in its direction (1) or against it (-1)."""
        if "load" not in self.signals:
            return self
        rigid = self.signals.get("rigid_torque", 0.0) - sign * self.signals["load"]
        return self.with_signals({"rigid_torque": rigid})

    def held(self, parts: int) -> Array:
        """(parts * n,) torque held over each of so many parts of a sample [N m].

        A commanded one stays for the whole sample; one that was read goes smoothly from reading to reading.
        """
        if not self.sensed:
            return np.repeat(self.torque, parts)
        middle = (np.arange(parts * len(self)) + 0.5) / parts
        samples = np.arange(len(self))
        return np.asarray(scipy.interpolate.CubicSpline(samples, self.torque)(np.minimum(middle, samples[-1])))

    def __len__(self) -> int:
        return len(self.time)

    def slice(self, start: int, stop: int, **changes: object) -> Self:
        """Samples `start` to `stop` as a record of their own."""
        signals, others = ({k: v[start:stop] for k, v in part.items()} for part in (self.signals, self.others))
        return replace(self, time=self.time[start:stop], signals=signals, others=others, **changes)  # type: ignore[arg-type]


def told_uses(uses: Sequence[str], given: str) -> str:
    """The sentence on what the records of a set are for, and who decided it."""
    counts = [f"{n} to {use}" for use in USES if (n := sum(u == use for u in uses))]
    return f"records: {', '.join(counts)} ({given})"
