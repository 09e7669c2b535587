"""A machine without a sound card, as far as ALSA can tell: nothing of the tests is to come out of a loudspeaker."""

import os
import tempfile
from pathlib import Path

#: its only device, and PortAudio aborts where there is none at all, is one that is not there
_CONFIGURATION = "pcm.default { type hw card 99 }\nctl.default { type hw card 99 }\n"


def hide_sound_card() -> dict[str, str]:
    """What the environment of a process must have. ALSA takes no path with a space: the file lies among temporary ones."""
    file = Path(tempfile.gettempdir()) / f"jawari-no-sound-card-{os.getuid()}.conf"
    if not file.exists():
        beside = file.with_suffix(f".{os.getpid()}")
        beside.write_text(_CONFIGURATION, encoding="utf-8")
        beside.replace(file)
    return {"ALSA_CONFIG_PATH": str(file)}
