"""The speed benchmark behind `tools/bench`: what a step, a note, a block and a start cost on this machine.

`test_*.py` are measured by pytest-benchmark, each round beside what it is compared with; `report` and `plots` make
tables and pictures of its JSON. `tools/test` runs none of it.
"""

import sys
from pathlib import Path

import synth  # noqa: F401  (says where compiled kernels are kept, before numba is loaded)

REPOSITORY = Path(__file__).resolve().parents[2]
TOOLS = REPOSITORY / "tools"
if str(TOOLS) not in sys.path:  # where pytest is started by itself
    sys.path.append(str(TOOLS))
