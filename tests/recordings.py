"""What stands in a rerun recording."""

from collections import defaultdict
from pathlib import Path
from typing import Any

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
