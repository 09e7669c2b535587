"""What the program says of itself."""

from __future__ import annotations

from importlib import metadata


def version() -> str:
    """The installed version."""
    try:
        return metadata.version("jawari")
    except metadata.PackageNotFoundError:
        return "(not installed)"
