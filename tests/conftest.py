"""For all tests: signals do what they do wherever the run was started (the background of a shell ignores Ctrl-C and
Ctrl-backslash, nohup a hang-up), no test fails for being slow, and none plays through a sound card of this machine."""

import os
import signal

from hypothesis import settings

from tests.nocard import hide_sound_card

os.environ.update(hide_sound_card())

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
for _name in ("SIGQUIT", "SIGHUP", "SIGTERM"):
    if hasattr(signal, _name) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), signal.SIG_DFL)
