"""Names of what a plan promises (`plan`), and of the numbers that modes are computed in; plain, so that the command line can
offer them at once."""

from __future__ import annotations

QUALITIES = ("draft", "standard", "fine", "reference")
#: elements of a string's modes
FLOAT64, FLOAT32 = PRECISIONS = ("float64", "float32")
