"""`synth completion`: what real shells make of the scripts."""

import os
import pty
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from synth import cli
from synth.cli import completion
from tests.patience import patience_s

#: what stands on the line, and what is offered behind it (all of it, or with … in the end some of it)
LINES = [
    ("synth re", ["render"]),
    ("synth compl", ["completion"]),
    ("synth completion ", ["bash", "fish", "zsh"]),
    ("synth render a.mid --quality f", ["fine"]),
    ("synth render a.mid -p tanpura-f", ["tanpura-female"]),
    ("synth presets --family ve", ["veena"]),
    ("synth presets --tag slap", ["slap"]),
    ("synth drone --first komal-N", ["komal-Ni"]),
    ("synth render a.mid --fallback jawari", ["jawari-harp"]),
    ("synth render a.", ["a.mid"]),
    ("synth presets show veena", ["veena", "veena-soft"]),
    ("synth author my", ["my.toml"]),
    ("synth simulate hard/two", ["hard/two-close"]),
    ("synth simulate my", ["my.toml"]),
    ("synth sweep tanpura-j", ["tanpura-jiva"]),
    ("synth sweep my", ["my.toml"]),
    ("synth export tanpura jawari", ["jawari-harp"]),
    ("synth export tanpura --target win", ["windows-x86-64"]),
]


@pytest.fixture(scope="module")
def scripts(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("completion")
    for shell in completion.SHELLS:
        (folder / f"synth.{shell}").write_text(completion.script(cli.command_parser(), shell), encoding="utf-8")
    for name in ("a.mid", "a.txt", "my.toml", "my.mid"):
        (folder / name).touch()
    return folder


def run(command: list[str], text: str, folder: Path) -> str:
    done = subprocess.run([*command, text], cwd=folder, capture_output=True, text=True, timeout=patience_s())
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return done.stdout


needs_fish = pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
needs_zsh = pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")


@needs_bash
def test_bash(scripts: Path) -> None:
    program = 'source synth.bash; name=$(complete -p synth | sed "s/.*-F \\([^ ]*\\).*/\\1/")\n'
    for line, _ in LINES:
        words = " ".join(f"'{word}'" for word in line.split(" "))
        program += f"COMP_WORDS=({words}); COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 )); COMPREPLY=()\n"
        program += 'COMP_LINE="${COMP_WORDS[*]}"; COMP_POINT=${#COMP_LINE}; '
        program += '"$name" synth "${COMP_WORDS[COMP_CWORD]}"; echo "${COMPREPLY[@]}"\n'
    said = run(["bash", "--norc", "-c"], program, scripts).splitlines()
    assert [sorted(each.split()) for each in said] == [offered for _, offered in LINES]


@needs_fish
def test_fish(scripts: Path, tmp_path: Path) -> None:
    program = "source synth.fish\n" + "".join(f"complete -C '{line}'; echo =\n" for line, _ in LINES)
    done = subprocess.run(
        ["fish", "--no-config", "-c", program],
        cwd=scripts,
        env={**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=patience_s(),
    )
    assert done.returncode == 0, done.stderr
    said = done.stdout.split("=\n")[:-1]
    assert [sorted(row.split("\t")[0] for row in each.splitlines()) for each in said] == [offered for _, offered in LINES]


@needs_zsh
def test_zsh(scripts: Path, tmp_path: Path) -> None:
    """Its completion works on a terminal only: where there is one thing to be had, a tab writes it."""
    rc = 'PS1=; autoload -Uz compinit; compinit -u -D; eval "$(cat synth.zsh)"; stty cols 300; print READY\n'
    (tmp_path / ".zshrc").write_text(rc, encoding="utf-8")
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(scripts)
        os.environ.update(TERM="dumb", HOME=str(tmp_path), ZDOTDIR=str(tmp_path))
        os.execvp("zsh", ["zsh", "-d", "-i"])
    try:
        shown = ""
        end = time.monotonic() + patience_s()

        def until(wanted: str) -> None:
            nonlocal shown
            while wanted not in shown:
                assert time.monotonic() < end, (wanted, shown)
                if select.select([terminal], [], [], 1.0)[0]:
                    shown += os.read(terminal, 4096).decode("utf-8", "replace")
            shown = ""

        until("READY")
        for line, offered in LINES:
            if len(offered) == 1 and "export" not in line:  # the script has only the first of several presets
                os.write(terminal, b"\x15: begin\r")
                os.write(terminal, line.encode() + b"\t")
                until(f"{line.rpartition(' ')[0]} {offered[0]} ")
        os.write(terminal, b"\x15exit\r")
    finally:
        os.close(terminal)
        os.waitpid(child, 0)


def test_the_command_prints_the_script_and_knows_its_shells(capsys) -> None:
    assert cli.main(["completion", "bash"]) == 0
    said = capsys.readouterr()
    assert "_shtab_synth" in said.out and "_synth_presets" in said.out and said.err == ""
    with pytest.raises(SystemExit) as end:
        cli.main(["completion", "csh"])
    assert end.value.code == 2


def test_every_file_option_is_completed() -> None:
    """A value with a name of a kind that nobody has thought of is one that completes to nothing."""
    parser = cli.command_parser()
    completion.script(parser, "bash")
    open_ended = {
        f"{action.option_strings or action.dest}"
        for action in completion._actions(parser)
        if isinstance(action.metavar, str)
        and any(word in action.metavar for word in (".", "FILE", "DIR", "PATH", "PRESET"))
        and not hasattr(action, "complete")
    }
    assert open_ended == {"['--map']", "['--set']"}
