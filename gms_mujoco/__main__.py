"""`python -m gms_mujoco` is `gms-mujoco`."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
