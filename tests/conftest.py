"""For all tests: signals do what they do wherever the run was started (the background of a shell ignores Ctrl-C and
Ctrl-backslash, nohup a hang-up), no test fails for being slow, and none plays through a sound card of this machine."""

import os
import signal
from pathlib import Path

from hypothesis import settings

# no devices of ALSA, nor PulseAudio's by way of it
os.environ["ALSA_CONFIG_PATH"] = str(Path(__file__).parent / "live" / "no-sound-card.conf")

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
for _name in ("SIGQUIT", "SIGHUP", "SIGTERM"):
    if hasattr(signal, _name) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), signal.SIG_DFL)
