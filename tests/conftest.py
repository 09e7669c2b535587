"""For all tests: signals do what they do wherever the run was started (the background of a shell ignores Ctrl-C and
Ctrl-backslash, nohup a hang-up), no test fails for being slow, and none plays through a sound card of this machine. The
files that take longest come first, so that none is left for the end while other cores have nothing to do."""

import os
import signal

import pytest
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

#: of the files that take longest; the first two compile the kernels, of an engine and of a simulation, that all others need
LONGEST = (
    "tests/test_every_command.py",
    "tests/test_simulation.py",
    "tests/test_broken_inputs.py",
    "tests/live/test_play.py",
    "tests/live/test_pipewire.py",
    "tests/author/browser/test_hear.py",
    "tests/author/test_files.py",
    "tests/author/browser/test_fit.py",
    "tests/test_compiling.py",
    "tests/author/browser/test_controls.py",
    "tests/author/browser/test_instrument.py",
    "tests/author/browser/test_page.py",
    "tests/author/browser/test_firefox.py",
    "tests/author/test_views_served.py",
    "tests/live/test_jack.py",
    "tests/live/test_portaudio.py",
    "tests/author/test_end.py",
    "tests/live/test_play_keys.py",
    "tests/live/test_midiports.py",
    "tests/live/test_recorder.py",
    "tests/author/test_sound.py",
    "tests/live/test_drone.py",
    "tests/test_hard_cases.py",
    "tests/exact/test_bar.py",
    "tests/engine/test_threads.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.nodeid.partition("::")[0], len(LONGEST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than cores: many a test waits for time to pass."""
    return (os.cpu_count() or 1) + 1
