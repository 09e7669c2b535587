"""What can be wrong with the devices of a live session."""

from __future__ import annotations


class DeviceError(ValueError):
    """An audio device or server that cannot be used as asked."""
