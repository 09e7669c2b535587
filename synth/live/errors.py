"""What live playing refuses: one line that names the thing, says what is wrong and what to do."""


class DeviceError(ValueError):
    """An audio device that cannot be found or opened."""


class MidiPortError(ValueError):
    """A MIDI port that cannot be found or opened."""
