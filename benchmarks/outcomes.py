"""What a diagnosis found beside what was hidden: a line for each case, and the tables over many."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from bench_axes import Axis

from gms_mujoco.diagnosis.findings import Diagnosis

# The same torque by another name, on motion like this: an answer that counts as right.
SAME = {"current_loop_lag": {"delay"}, "delay": {"current_loop_lag"}}
HEAD = (
    f"{'kind':8} {'hidden':38} strength  seed {'friction':12} {'verdict':16} before  after  floor    s  found"
)


@dataclass(frozen=True)
class Case:
    """What to hide: effects of the catalogue ("single", "pairs"), none ("healthy"), or one that it does not have
    ("invented")."""

    kind: str
    hidden: tuple[str, ...]
    strength: float
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What was found.

    Attributes:
        alike: what each of those found was said to be confusable with.
        errors: on the validate records: before, after, noise floor.
        seconds: of processor time.
        inertia: found over true; nan where it was given.
        values: parameters of what was found.
        same: what else counts as right.
    """

    case: Case
    friction: str
    found: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]
    verdict: str
    errors: tuple[float, float, float]
    seconds: float
    inertia: float
    values: str
    remainder: str
    same: dict[str, set[str]]

    @classmethod
    def of(
        cls, case: Case, axis: Axis, d: Diagnosis, seconds: float, same: dict[str, set[str]] = SAME
    ) -> Outcome:
        steps = d.steps[1:]
        before, after = (float(s.validate_error or 0) for s in (d.steps[0], d.steps[-1]))
        values = (f"{k} {v['value']:.3g}" for s in steps for k, v in d.plant.table(str(s.effect)).items())
        return cls(
            case, axis.friction, tuple(str(s.effect) for s in steps), tuple(s.confusable_with for s in steps),
            d.verdict, (before, after, d.noise_floor), seconds,
            float("nan") if axis.given else float(d.plant.inertia or 0) / axis.inertia, "; ".join(values), d.remainder,
            same,
        )  # fmt: skip

    @property
    def hidden(self) -> tuple[str, ...]:
        """What should be named: of an invented effect nothing."""
        return self.case.hidden if self.case.kind in ("single", "pairs") else ()

    @property
    def first(self) -> str:
        return self.found[0] if self.found else "nothing"

    @property
    def right(self) -> bool:
        """The first one named is hidden, or does the same."""
        if not self.hidden:
            return not self.found
        return any(self.first in {w} | self.same.get(w, set()) for w in self.hidden)

    @property
    def exact(self) -> bool:
        """Named, or said to be confusable with what was named."""
        return bool(self.found) and any(w in (self.first, *self.alike[0]) for w in self.hidden)

    @property
    def whole(self) -> bool:
        """Everything that is hidden was found, and nothing else."""
        found = set(self.found)
        return len(found) == len(self.hidden) and all(found & ({w} | self.same.get(w, set())) for w in self.hidden)

    def __str__(self) -> str:
        c = self.case
        found = [f + (f" (or {', '.join(a)})" if a else "") for f, a in zip(self.found, self.alike, strict=True)]
        before, after, floor = (100 * e for e in self.errors)
        return (
            f"{c.kind:8} {' + '.join(c.hidden) or 'none':38} {c.strength:8.0%} {c.seed:5} {self.friction:12} "
            f"{self.verdict:16} {before:6.2f} {after:6.2f} {floor:6.2f} {self.seconds:4.0f}  "
            f"{'' if self.whole else '! '}{', '.join(found) or 'nothing'}  {self.values}"
            f"{f'  [{self.remainder}]' if self.remainder else ''}"
        )


def tables(done: Sequence[Outcome]) -> str:
    """How often what was hidden was named first, whole and nothing else; errors, bias and time."""
    out: list[str] = []

    def share(title: str, kind: str, good: Callable[[Outcome], bool]) -> None:
        chosen = [good(o) for o in done if o.case.kind == kind]
        if chosen:
            out.append(f"{title:56} {sum(chosen):4} of {len(chosen):4}  {np.mean(chosen):5.0%}")

    singles = [o for o in done if o.case.kind == "single"]
    strengths = sorted({o.case.strength for o in singles})
    if singles:
        out.append(f"{'hidden, named first':40}" + "".join(f"{s:>9.0%}" for s in strengths) + "   what was named first")
        for name in dict.fromkeys(o.case.hidden[0] for o in singles):
            own = [o for o in singles if o.case.hidden[0] == name]
            row = [[o.right for o in own if o.case.strength == s] for s in strengths]
            cells = "".join(f"{f'{sum(r)}/{len(r)}':>9}" for r in row)
            named = ", ".join(f"{k} {n}" for k, n in Counter(o.first for o in own).most_common())
            out.append(f"{name:40}{cells}   {named}")
        row = [[o.right for o in singles if o.case.strength == s] for s in strengths]
        out += [f"{'all':40}" + "".join(f"{np.mean(r):>9.0%}" for r in row), ""]
    share("named itself first, or said to be confusable", "single", lambda o: o.exact)
    share("named first and nothing false after it", "single", lambda o: o.whole)
    share("false alarms on healthy axes", "healthy", lambda o: bool(o.found))
    share("healthy axes called adequate", "healthy", lambda o: o.verdict == "adequate")
    share("abstention: nothing named for an invented effect", "invented", lambda o: not o.found)
    share("pairs fully found", "pairs", lambda o: o.whole)
    errors = np.array([o.errors for o in singles if o.right])
    if len(errors):
        before, after, floor = errors.T
        out.append(
            f"validate error over noise floor, median (90 %): before {np.median(before / floor):.2f}, after "
            f"{np.median(after / floor):.2f} ({np.quantile(after / floor, 0.9):.2f}); at most 1.2 in "
            f"{np.mean(after <= 1.2 * floor):.0%}"
        )
    bias = np.array([o.inertia for o in done if np.isfinite(o.inertia) and o.right and o.case.kind != "invented"])
    if len(bias):
        off = np.abs(bias - 1)
        out.append(f"identified inertia off by: median {np.median(off):.2%}, 90 % within {np.quantile(off, 0.9):.2%}")
    if done:
        took = np.array([o.seconds for o in done])
        out.append(f"processor time per case: median {np.median(took):.1f} s, longest {took.max():.1f} s")
    return "\n".join(out)
