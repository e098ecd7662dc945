"""What stands in a rerun recording."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

Rows = dict[str, dict[str, Any]]


def last_values(file: Path) -> Rows:
    """Of each entity the last value of each component, and the number of rows."""
    found: Rows = defaultdict(dict)
    for chunk in RrdReader(file).stream().collect().stream():
        batch = chunk.to_record_batch()
        known = found[chunk.entity_path]
        known["rows"] = max(known.get("rows", 0), chunk.num_rows)
        for name in batch.schema.names:
            if ":" in name or name in ("x", "y"):
                known[name.split(":")[-1]] = batch.column(name).to_pylist()
    return found


def series(file: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(n,) times [s] and (n, ...) values of each entity that changes."""
    found: dict[str, list[tuple[float, object]]] = {}
    for chunk in RrdReader(file).stream().collect().stream():
        batch = chunk.to_record_batch()
        if "time" not in batch.schema.names:
            continue
        seconds = batch.column("time").cast("int64").to_numpy(zero_copy_only=False) * 1e-9
        for name in batch.schema.names:
            if name.split(":")[-1] in ("scalars", "translation", "state"):
                rows = batch.column(name).to_pylist()
                pairs = ((t, v[0]) for t, v in zip(seconds, rows, strict=True) if v)
                found.setdefault(chunk.entity_path, []).extend(pairs)
    ordered = {k: sorted(v, key=lambda p: p[0]) for k, v in found.items()}
    return {k: (np.array([t for t, _ in v]), np.array([x for _, x in v])) for k, v in ordered.items()}
