"""A terminal as a source of keys, under a shell that stops it, puts it into the background and takes it back."""

from __future__ import annotations

import os
import queue
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from synth.live.terminal import Terminal
from tests.patience import patience_s, until

pty = pytest.importorskip("pty")
termios = pytest.importorskip("termios")

ROOT = Path(__file__).resolve().parents[2]

#: what a shell with job control does to a terminal and a job, and no more: it leaves the terminal's modes alone
SHELL = """
import os, signal, sys
tty = int(sys.argv[2])
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
job = os.fork()
if not job:
    os.setpgid(0, 0)
    if sys.argv[3] == "front":
        os.tcsetpgrp(tty, os.getpgrp())
    signal.signal(signal.SIGTTOU, signal.SIG_DFL)
    os.dup2(tty, 0)
    os.execv(sys.executable, [sys.executable, "-c", sys.argv[1]])
for command in sys.stdin:
    command = command.strip()
    if command == "wait":
        _, status = os.waitpid(job, os.WUNTRACED)
        os.tcsetpgrp(tty, os.getpgrp())
        if os.WIFSTOPPED(status):
            print("stopped", os.WSTOPSIG(status), flush=True)
        else:
            print("ended", os.waitstatus_to_exitcode(status), flush=True)
    elif command == "front":
        os.tcsetpgrp(tty, job)
    else:
        os.killpg(job, int(command))
"""
WITH_TERMINAL = """
import time
from synth.live.terminal import Terminal
with Terminal() as terminal:
    print("ready", flush=True)
    while True:
        for key in terminal.keys():
            print("key", key, flush=True)
        time.sleep(0.005)
"""
WITH_KEYBOARD = """
import time
from synth.live.keyboard import Keyboard
with Keyboard(lambda *_: True, lambda: None, lambda key: print("key", key, flush=True)):
    print("ready", flush=True)
    while True:
        time.sleep(0.005)
"""
both = pytest.mark.parametrize("program", [WITH_TERMINAL, WITH_KEYBOARD], ids=["Terminal", "Keyboard"])


class Shell:
    """A job at a terminal of its own; `master` is its user's end."""

    def __init__(self, program: str, *, front: bool = True) -> None:
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        self._process = subprocess.Popen(
            [sys.executable, "-c", SHELL, program, str(self.slave), "front" if front else "back"],
            cwd=ROOT,
            env={**os.environ, "TERM": "xterm-256color"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            pass_fds=[self.slave],
            preexec_fn=self._own_the_terminal,
        )
        self._told: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _own_the_terminal(self) -> None:
        import fcntl

        os.setsid()
        fcntl.ioctl(self.slave, termios.TIOCSCTTY, 0)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._told.put(line.strip())

    def tell(self, *commands: object) -> None:
        assert self._process.stdin is not None
        for command in commands:
            self._process.stdin.write(f"{command}\n")
            self._process.stdin.flush()

    def told(self) -> str:
        """The next line from the shell or its job."""
        return self._told.get(timeout=patience_s())

    def shown(self) -> bytes:
        """What the terminal was sent next."""
        assert select.select([self.master], [], [], patience_s())[0], "nothing was shown"
        return os.read(self.master, 100)

    def foreground(self) -> None:
        """What `fg` does to a stopped job."""
        self.tell("front", int(signal.SIGCONT))

    @property
    def as_before(self) -> bool:
        return termios.tcgetattr(self.slave) == self.before

    @property
    def gives_keys(self) -> bool:
        return not termios.tcgetattr(self.slave)[3] & (termios.ECHO | termios.ICANON)

    def close(self) -> None:
        self.tell(int(signal.SIGKILL))
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait(patience_s())
        self._reader.join(patience_s())
        self._process.stdout.close()
        for end in (self.master, self.slave):
            os.close(end)


@pytest.fixture
def shells() -> Iterator[list[Shell]]:
    opened: list[Shell] = []
    yield opened
    for shell in opened:
        shell.close()


@both
def test_a_job_that_is_stopped_and_goes_on(program: str, shells: list[Shell]) -> None:
    shell = Shell(program)
    shells.append(shell)
    assert shell.told() == "ready" and shell.gives_keys
    for _ in range(2):
        shell.tell("wait")
        os.write(shell.master, b"\x1a")
        assert shell.told() == f"stopped {int(signal.SIGTSTP)}"
        assert shell.as_before
        shell.foreground()
        until(lambda: shell.gives_keys)
        os.write(shell.master, b"7")
        assert shell.told() == "key 7"
    shell.tell("wait")
    os.write(shell.master, b"\x03")
    assert shell.told() == f"ended {-signal.SIGINT}" and shell.as_before


@both
def test_a_job_that_cannot_know_that_it_is_stopped(program: str, shells: list[Shell]) -> None:
    shell = Shell(program)
    shells.append(shell)
    assert shell.told() == "ready"
    shell.tell(int(signal.SIGSTOP), "wait")
    assert shell.told() == f"stopped {int(signal.SIGSTOP)}"
    termios.tcsetattr(shell.slave, termios.TCSANOW, shell.before)  # as the shell does for its prompt
    shell.foreground()
    until(lambda: shell.gives_keys)
    os.write(shell.master, b"7")
    assert shell.told() == "key 7"


@both
def test_a_job_in_the_background_leaves_the_terminal_alone(program: str, shells: list[Shell]) -> None:
    shell = Shell(program)
    shells.append(shell)
    assert shell.told() == "ready"
    shell.tell(int(signal.SIGSTOP), "wait")
    assert shell.told() == f"stopped {int(signal.SIGSTOP)}"
    termios.tcsetattr(shell.slave, termios.TCSANOW, shell.before)
    shell.tell(int(signal.SIGCONT))
    os.write(shell.master, b"7\n")  # for the shell
    # It is ended by its own kind of end, which closes the terminal; were it stopped meanwhile, the shell would say so.
    shell.tell(int(signal.SIGINT), "wait")
    assert shell.told() == f"ended {-signal.SIGINT}" and shell.as_before
    os.set_blocking(shell.slave, False)
    assert os.read(shell.slave, 10) == b"7\n"


def test_a_job_from_the_background_takes_the_terminal_when_it_comes_to_the_front(shells: list[Shell]) -> None:
    shell = Shell(WITH_TERMINAL, front=False)
    shells.append(shell)
    assert shell.told() == "ready" and shell.as_before
    shell.tell("front")  # without a signal, as `fg` does to a job that runs
    until(lambda: shell.gives_keys)
    os.write(shell.master, b"\x1b[A")
    assert shell.told() == "key up"


@both
@pytest.mark.parametrize("number", [signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM])
def test_what_ends_a_job_gives_the_terminal_back(program: str, number: int, shells: list[Shell]) -> None:
    shell = Shell(program)
    shells.append(shell)
    assert shell.told() == "ready" and shell.gives_keys
    shell.tell("wait")
    if number == signal.SIGQUIT:
        os.write(shell.master, b"\x1c")
    else:
        os.killpg(os.tcgetpgrp(shell.master), number)
    assert shell.told() == f"ended {-number}" and shell.as_before


def test_ctrl_z_and_key_up(shells: list[Shell]) -> None:
    """A terminal that tells of keys going up leaves Ctrl-Z to the program, and must not tell the shell of them."""
    shell = Shell(WITH_KEYBOARD)
    shells.append(shell)
    assert shell.told() == "ready" and shell.shown() == b"\x1b[>11u"
    shell.tell("wait")
    os.write(shell.master, b"\x1b[122;5u")
    assert shell.told() == f"stopped {int(signal.SIGTSTP)}"
    assert shell.shown() == b"\x1b[<u" and shell.as_before
    shell.foreground()
    assert shell.shown() == b"\x1b[>11u"
    shell.tell("wait")
    os.write(shell.master, b"\x1b[92;5u")
    assert shell.told() == f"ended {-signal.SIGQUIT}" and shell.as_before


def test_keys_by_name_and_the_terminal_as_it_was() -> None:
    master, slave = pty.openpty()
    try:
        before = termios.tcgetattr(slave)
        with Terminal(slave) as terminal:
            assert terminal.is_one and terminal.keys() == []
            os.write(master, "fé\x1b[D\x1b[1;5C\x1bOB \x1b[15~?".encode())
            assert terminal.keys() == ["f", "é", "left", "right", "down", " ", "?"]
        assert termios.tcgetattr(slave) == before and not terminal.is_one and terminal.keys() == []
    finally:
        os.close(master)
        os.close(slave)


def test_a_terminal_that_goes_away_gives_no_keys_any_more() -> None:
    master, slave = pty.openpty()
    try:
        with Terminal(slave) as terminal:
            os.close(master)
            assert terminal.keys() == [] and not terminal.is_one
            assert terminal.read(0.0) is None
    finally:
        os.close(slave)


def test_a_terminal_that_has_been_closed_under_it() -> None:
    master, slave = pty.openpty()
    with Terminal(slave) as terminal:
        os.close(slave)
        assert terminal.keys() == [] and not terminal.is_one
    os.close(master)


def test_what_is_no_terminal_gives_no_keys() -> None:
    read, write = os.pipe()
    try:
        os.write(write, b"q")
        for file in (read, -1):
            with Terminal(file) as terminal:
                assert not terminal.is_one and terminal.keys() == []
    finally:
        os.close(read)
        os.close(write)
