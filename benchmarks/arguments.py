"""The command line of a benchmark: its numbers in order, each with a default, and `--help` from its docstring."""

import argparse
from typing import Any


def arguments(doc: str | None, **defaults: Any) -> dict[str, Any]:
    """What was given on the command line by name, each of the type of its default."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        shown = f"default: {default}" if default else "may be left out"
        parser.add_argument(name, nargs="?", type=type(default), default=default, help=shown)
    return vars(parser.parse_args())
