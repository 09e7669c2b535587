"""The command line from outside: help, errors, exit codes; nothing is written where something was wrong."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth import cli
from synth.cli import common, presets, render
from synth.signals import hearing_signals
from tests.forkserver import prepared
from tests.host.midibytes import header, off, on, track
from tests.patience import COMPILING_QUIET_S, compiling_s, patience_s, until

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
DRONE = str(ROOT / "presets" / "demos" / "drone.mid")


def command_line(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "synth", *arguments]


def synth(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """`synth` in a process of its own, which has its imports behind it."""
    running = prepared().start(list(arguments), cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    return running.done(compiling_s())


def anew(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The same in a new interpreter."""
    return subprocess.run(
        command_line(*arguments),
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=compiling_s(),
    )


def test_help_loads_nothing_heavy() -> None:
    program = (
        "import sys\nfrom synth.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code\n"
        "heavy = {'numba', 'numpy', 'scipy', 'soundfile', 'pydantic', 'mido'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    for arguments in (["--help"], ["render", "--help"], ["--version"]):
        command = [sys.executable, "-c", program, *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=patience_s())
        assert done.returncode == 0, done.stderr
        assert done.stdout


@pytest.mark.parametrize("command", [[], ["render"], ["presets"], ["plan"], ["simulate"]])
def test_every_command_has_help(capsys, command: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main([*command, "--help"])
    assert end.value.code == 0
    assert "usage: synth" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        (b"", "the file is empty"),
        (b"This is no music at all.", "not a MIDI file"),
        (Path(DRONE).read_bytes()[:150], "cut off"),
    ],
)
def test_files_that_are_no_songs(tmp_path, content: bytes | None, problem: str) -> None:
    if content is not None:
        (tmp_path / "song.mid").write_bytes(content)
    before = os.listdir(tmp_path)
    done = synth("render", "song.mid", "-o", "out.wav", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("synth: error: song.mid: ")
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1
    assert os.listdir(tmp_path) == before


WRONG = [
    (["sing"], "invalid choice"),
    (["render"], "IN.mid"),
    (["render", DRONE, "-p", "tampura"], "'tampura' is not one of "),
    (["render", DRONE, "-p", "tampura"], "(perhaps tanpura?)"),
    (["render", DRONE, "--map", "1=Fretted-Bas"], "(perhaps fretted-bass?)"),
    (["render", DRONE, "--fallback", "jawari-hrp"], "(perhaps jawari-harp?)"),
    (["render", DRONE, "-p", "tanpura", "--set", "pluk.position=0.3"], "no such key (perhaps pluck?)"),
    (["render", DRONE, "--transpose", "up"], "--transpose 'up' is not SEMITONES or CHANNEL=SEMITONES"),
    (["render", DRONE, "--transpose", "-97"], "-96 to 96 semitones, got -97"),
    (["render", DRONE, "--transpose=17=1"], "must be 1 to 16, got 17"),
    (["render", DRONE, "-o", "x.wav", "--volume", "3"], "unrecognized arguments: --volume"),
    (["render", DRONE, "-o", "x.wav", "-r", "22050"], "44100, 48000, 88200, 96000 Hz, got '22050'"),
    (["render", DRONE, "-o", "x.wav", "--block", "0"], "from 1 to 4096, got '0'"),
    (["render", DRONE, "-o", "x.wav", "--block", "64.5"], "whole number"),
    (["render", DRONE, "-o", "x.wav", "--threads", "0"], "from 1 to 256 (or auto), got '0'"),
    (["render", DRONE, "-o", "x.wav", "--threads", "many"], "whole number"),
    (["render", DRONE, "-o", "x.wav", "--threads", "1.5"], "whole number"),
    (["render", DRONE, "-o", "x.wav", "--quality", "good"], "invalid choice: 'good'"),
    (["render", DRONE, "-o", "x.wav", "--scheme", "euler"], "unknown contact scheme 'euler'; use one of exact-hold"),
    (["render", DRONE, "-o", "x.wav", "--restitution", "0.5"], "belongs to the Moreau–Jean schemes"),
    (["render", DRONE, "-o", "x.wav", "--restitution", "1.5"], "from 0 to 1, got '1.5'"),
    (["render", DRONE, "-o", "x.wav", "--internal-rate", "100000"], "multiple of --rate"),
    (["render", DRONE, "-o", "x.wav", "--gain", "nan"], "got 'nan'"),
    (["render", DRONE, "-o", "x.wav", "--gain", "loud"], "got 'loud'"),
    (["render", DRONE, "-o", "x.wav", "--normalize", "3"], "got '3'"),
    (["render", DRONE, "-o", "x.wav", "--tail", "-1"], "from 0 to 3600 s (or auto), got '-1'"),
    (["render", DRONE, "-o", "x.wav", "--tail=-1"], "got '-1'"),
    (["render", DRONE, "-o", "x.wav", "--tail", "inf"], "got 'inf'"),
    (["render", DRONE, "-o", "x.wav", "--start", "20", "--end", "10"], "later than --start"),
    (["render", DRONE, "-o", "x.wav", "--start", "99"], "within the song"),
    (["render", DRONE, "-o", "x.wav", "--polyphony", "0"], "got '0'"),
    (["render", DRONE, "-o", "x.wav", "--seed", "-1"], "from 0 to 2147483647, got '-1'"),
    (["render", DRONE, "-o", "x.wav", "--bit-depth", "12"], "invalid choice: '12'"),
    (["render", DRONE, "-o", "x.wav", "--map", "17=tanpura"], "must be 1 to 16, got 17"),
    (["render", DRONE, "-o", "x.wav", "--set", "loud"], "KEY=VALUE"),
    (["render", DRONE, "-o", "x.mp3"], "does not say the format"),
    (["render", DRONE, "-o", "x.flac", "--bit-depth", "float"], "FLAC holds integers"),
    (["render", DRONE, "-o", "-", "--format", "flac"], "cannot be written to a stream"),
    (["render", DRONE, "-o", "nowhere/x.wav"], "there is no directory nowhere"),
    (["render", DRONE, "-o", "."], "does not say the format"),
    (["render", DRONE, "-o", "x.wav", "--stems", "nowhere/stems"], "parent directory is missing"),
    (["render", DRONE, "-o", "x.wav", "--tuning", "none.scl"], "none.scl: no such file"),
    (["simulate", "case.toml"], "-o/--output"),
]


@pytest.mark.parametrize(
    ("arguments", "problem"), WRONG, ids=lambda value: " ".join(value[2:])[:40] if type(value) is list else ""
)
def test_wrong_usage_is_one_line_and_exit_2(tmp_path, monkeypatch, capsys, arguments: list[str], problem: str) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = cli.main(arguments)
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr()
    assert code == 2
    assert said.out == ""
    assert said.err.startswith("synth: error: ")
    assert problem in said.err
    assert said.err.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_normalize_takes_a_level_or_none() -> None:
    joined = render.joined_normalize
    assert joined(["--normalize", "a.mid"]) == ["--normalize=-1", "a.mid"]
    assert joined(["a.mid", "--normalize"]) == ["a.mid", "--normalize=-1"]
    assert joined(["--normalize", "-3", "a.mid"]) == ["--normalize=-3", "a.mid"]
    assert joined(["--normalize=-3", "a.mid"]) == ["--normalize=-3", "a.mid"]
    assert joined(["--", "--normalize"]) == ["--", "--normalize"]


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt, 130), (BrokenPipeError, 1), (ValueError("bad"), 2)])
def test_how_a_command_ends(monkeypatch, capfd, error, code: int) -> None:
    def fail(_: object) -> int:
        raise error

    monkeypatch.setattr(presets, "_list_presets", fail)
    keep = os.dup(1)
    try:
        assert cli.main(["presets"]) == code
    finally:
        os.dup2(keep, 1)
        os.close(keep)
    assert "Traceback" not in capfd.readouterr().err


#: a command that a signal ends while an object is half built, whose destructor then fails
_HALF_BUILT = """
import signal, sys
from synth import cli
from synth.cli import presets

number = int(sys.argv.pop())

class Half:
    def __init__(self):
        signal.raise_signal(number)
        self.pointer = 1

    def __del__(self):
        print(self.pointer)

presets._list_presets = lambda _: Half()
sys.exit(cli.main())
"""


@pytest.mark.parametrize(("how", "code", "says"), [(signal.SIGINT, 130, "synth: interrupted\n"), (signal.SIGTERM, 143, "")])
def test_objects_half_built_at_a_signal_are_not_reported(how: signal.Signals, code: int, says: str) -> None:
    ended = subprocess.run([sys.executable, "-c", _HALF_BUILT, "presets", str(int(how))], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", says)


def test_termination_ends_with_143_and_restores_the_handler(monkeypatch) -> None:
    def stop(_: object) -> int:
        signal.raise_signal(signal.SIGTERM)
        return 0

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(presets, "_list_presets", stop)
    assert cli.main(["presets"]) == 143
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.fixture(scope="module")
def rendered(tmp_path_factory) -> Path:
    """A directory with song.mid and its rendering song.wav by the real engine."""
    directory = tmp_path_factory.mktemp("rendered")
    events = [
        (0, b"\xc0\x21"),
        (0, on(40, 100)),
        (240, on(36, channel=9)),
        (240, off(40)),
        (0, on(12, 90)),
        (10, off(12)),
    ]
    (directory / "song.mid").write_bytes(header() + track(*events))
    done = anew("render", "song.mid", "-o", "song.wav", "--tail", "0.25", "--no-fold", "--json", cwd=directory)
    assert done.returncode == 0, done.stderr
    (directory / "report.json").write_text(done.stdout)
    return directory


def test_a_render_by_the_real_engine(rendered) -> None:
    report = json.loads((rendered / "report.json").read_text())
    sound, rate_hz = soundfile.read(rendered / "song.wav")
    assert rate_hz == 44100
    assert len(sound) == round((490 / 960 + 0.25) * 44100)
    assert report["parts"] == ["ch01-fretted-bass"]
    assert report["left_out"] == {"10": 1}
    assert [(each["note"], each["count"]) for each in report["unplayed"]] == [("C0", 1)]
    assert report["strings"] == 1
    # The report's peak is the file's, to half a step of 24 bits.
    assert 10 ** (report["peak_dbfs"] / 20) == pytest.approx(np.abs(sound).max(), abs=2**-23)
    assert 0.01 < np.abs(sound).max() < 1.0


def test_block_size_and_threads_do_not_show_in_the_file(rendered, tmp_path) -> None:
    song = str(rendered / "song.mid")
    done = synth(
        "render",
        song,
        "-o",
        "other.wav",
        "--tail",
        "0.25",
        "--no-fold",
        "--block",
        "37",
        "--threads",
        "3",
        "--quiet",
        cwd=tmp_path,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "other.wav").read_bytes() == (rendered / "song.wav").read_bytes()


def test_a_part_of_the_song_is_a_slice_of_the_whole(rendered, tmp_path) -> None:
    song = str(rendered / "song.mid")
    done = synth("render", song, "-o", "part.wav", "--start", "0.1", "--end", "0.3", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    whole, _ = soundfile.read(rendered / "song.wav")
    np.testing.assert_array_equal(soundfile.read(tmp_path / "part.wav")[0], whole[4410:13230])


def test_standard_output_carries_the_samples_and_nothing_else(rendered, tmp_path) -> None:
    song = str(rendered / "song.mid")
    arguments = command_line(
        "render", song, "-o", "-", "--format", "raw", "--tail", "0.25", "--no-fold", "--bit-depth", "24"
    )
    done = subprocess.run(arguments, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, timeout=compiling_s())
    assert done.returncode == 0
    whole, _ = soundfile.read(rendered / "song.wav", dtype="int32")
    steps = np.frombuffer(done.stdout, np.uint8).reshape(-1, 3)
    padded = np.concatenate((np.zeros((len(steps), 1), np.uint8), steps), axis=1)
    np.testing.assert_array_equal(padded.view("<i4").reshape(-1, 2), whole)
    assert b"standard output: " in done.stderr


def test_a_reader_that_goes_away_is_no_traceback(rendered) -> None:
    arguments = command_line("render", str(rendered / "song.mid"), "-o", "-", "--tail", "60")
    running = subprocess.Popen(arguments, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert running.stdout is not None and running.stderr is not None
    running.stdout.read(44)
    running.stdout.close()
    told = running.stderr.read()
    running.stderr.close()
    assert running.wait(timeout=compiling_s()) == 1
    assert b"Traceback" not in told


@pytest.mark.parametrize(("how", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_render_leaves_nothing(tmp_path, how: signal.Signals, code: int) -> None:
    # A day of music: it is certainly still going on when the signal comes.
    (tmp_path / "long.mid").write_bytes(header(division=1) + track((0, on(40)), (170_000, off(40))))
    arguments = ["render", "long.mid", "-p", "fretted-bass", "-o", "long.wav", "--stems", "stems"]
    running = prepared().start(arguments, tmp_path, stderr=subprocess.PIPE)
    until(lambda: running.poll() is not None or list(tmp_path.glob(".long.wav.*")), quiet_s=COMPILING_QUIET_S)
    assert running.poll() is None
    running.send_signal(how)
    told = running.communicate(timeout=patience_s())[1]
    assert running.returncode == code
    assert "Traceback" not in told
    assert os.listdir(tmp_path) == ["long.mid"]


def test_presets_are_listed_shown_and_checked(capsys, tmp_path) -> None:
    assert cli.main(["presets"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert {"tanpura", "fretted-bass", "jawari-harp"} <= set(listed)
    assert cli.main(["presets", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == listed
    assert next(row for row in rows if row["name"] == "fretted-bass")["range"] == ["E1", "D#4"]
    for name in listed[::6]:  # tests/test_presets.py compiles them all
        assert cli.main(["presets", "show", name]) == 0
        text = capsys.readouterr().out
        (tmp_path / "mine.toml").write_text(text)
        assert cli.main(["presets", "check", str(tmp_path / "mine.toml")]) == 0
        assert f"{name} is in order" in capsys.readouterr().out


@pytest.mark.parametrize(
    "options", [["list", "--tag", "Buzz", "--family", "HARP"], ["--tag", "buzz", "--tag", "harp", "list"]]
)
def test_presets_are_found_by_tag_and_family(capsys, options: list[str]) -> None:
    assert cli.main(["presets", *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "harp" and lines[1].startswith("  jawari-harp ") and "E1–C7" in lines[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tag", "buz"], ["no preset has the tag 'buz' (perhaps buzz?); there are ", "tanpura"]),
        (["list", "--family", "gitar"], ["no preset has the family 'gitar' (perhaps guitar?); there are bass, "]),
        (["list", "--family", "bass", "--tag", "drone"], ["no preset has family bass and tag drone together"]),
    ],
)
def test_tags_and_families_that_there_are_not(capsys, options: list[str], words: list[str]) -> None:
    assert cli.main(["presets", *options]) == 2
    told = capsys.readouterr()
    assert told.out == "" and all(word in told.err for word in words)


def test_a_wrong_preset_is_told_with_all_its_faults(capsys, tmp_path) -> None:
    (tmp_path / "wrong.toml").write_text('format = 2\nname = "Wrong Name"\nvolume = 11\n')
    assert cli.main(["presets", "check", str(tmp_path / "wrong.toml")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 3
    assert all(line.startswith("synth: error: ") for line in lines)
    assert any("volume" in line for line in lines) and any(": name" in line for line in lines)


def test_a_preset_that_is_not_there(tmp_path, capsys) -> None:
    assert cli.main(["render", DRONE, "-p", "sarod", "-o", str(tmp_path / "x.wav"), "--stems", str(tmp_path / "s")]) == 2
    assert "preset 'sarod'" in capsys.readouterr().err
    assert os.listdir(tmp_path) == []


def test_signals_are_heard_while_a_kernel_runs() -> None:
    """The work is out of every signal's reach, as compiled code is."""
    over, ran = threading.Event(), []
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        hearing_signals(lambda: ran.append(threading.current_thread()) or over.wait(30.0))
    over.set()
    assert ran != [threading.main_thread()]
    assert hearing_signals(lambda: 3) == 3
    with pytest.raises(ValueError, match="no"):
        hearing_signals(lambda: int("no"))


def test_a_simulation_that_leaves_the_numbers_says_so(capsys, tmp_path, monkeypatch) -> None:
    """Still JSON, no word from NumPy, a warning."""
    from synth.research import methods

    solved = methods.run

    def blown_up(scene):
        outcome = solved(scene)
        outcome.u[-1] = np.inf
        return outcome

    run = ["simulate", "tanpura", "--json", "--rate", "44100", "--modes", "5", "--duration", "0.001"]
    assert cli.main([*run, "-o", str(tmp_path / "sound.npz")]) == 0
    capsys.readouterr()  # where kernels were compiled, it was said
    monkeypatch.setattr(methods, "run", blown_up)
    assert cli.main([*run, "-o", str(tmp_path / "out.npz")]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out, parse_constant=pytest.fail)
    assert summary["finite"] is False and summary["largest_displacement_m"] is None
    assert err == "synth: the results are not finite; check the units of the case, or raise the internal rate\n"


def test_a_plan_in_words_and_as_json(capsys) -> None:
    assert cli.main(["plan", "tanpura", "C3", "--quality", "draft"]) == 0
    assert "draft" in capsys.readouterr().out
    assert cli.main(["plan", "tanpura", "48", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)
    assert cli.main(["plan", "tanpura", "H9"]) == 2
    assert capsys.readouterr().err.startswith("synth: error: ")


def test_a_plan_says_what_it_costs_here_where_it_is_asked_for(capsys) -> None:
    assert cli.main(["plan", "jawari-harp", "C4", "--quality", "draft", "--json"]) == 0
    assert "cost" not in json.loads(capsys.readouterr().out)
    assert cli.main(["plan", "jawari-harp", "C4", "--quality", "draft", "--measure", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    cost = plan["cost"]
    assert cost["real_time_factor"] > 0.0 and 0.0 < cost["median_block"] <= cost["worst_block"]
    assert cost["real_time_factor"] * cost["worst_block"] >= 0.99 and cost["strings"] == 12
    assert f"{cost['real_time_factor']:.3g} × real time" in plan["text"]


def test_without_a_name_the_sound_lies_here_and_over_nothing_else(tmp_path, monkeypatch, capsys) -> None:
    (tmp_path / "songs").mkdir()
    (tmp_path / "songs" / "two notes.mid").write_bytes(header() + track((0, on(36, channel=9)), (48, off(36, channel=9))))
    monkeypatch.chdir(tmp_path)
    song = os.path.join("songs", "two notes.mid")
    assert cli.main(["render", song, "--tail", "0"]) == 0
    assert capsys.readouterr().out.startswith("two notes.wav: 0.")
    before = (tmp_path / "two notes.wav").read_bytes()
    assert soundfile.info(tmp_path / "two notes.wav").format == "WAV"
    assert cli.main(["render", song, "--tail", "0"]) == 2
    assert "two notes.wav already exists; -o two notes.wav overwrites it" in capsys.readouterr().err
    assert (tmp_path / "two notes.wav").read_bytes() == before
    assert cli.main(["render", song, "--tail", "0", "--format", "flac"]) == 0
    assert cli.main(["render", song, "--tail", "0", "-o", "two notes.wav"]) == 0
    assert sorted(os.listdir(tmp_path)) == ["songs", "two notes.flac", "two notes.wav"]
    assert os.listdir(tmp_path / "songs") == ["two notes.mid"]


def test_a_speed_is_said_when_it_has_been_measured(monkeypatch, capsys) -> None:
    now = [100.0]
    monkeypatch.setattr(common.time, "monotonic", lambda: now[0])

    def shown(step_s: float, call, *values: float) -> str:
        now[0] += step_s
        call(*values)
        return capsys.readouterr().err.strip()

    line = common.ProgressLine(True)
    assert shown(0.2, line.preparing, 3, 69) == "preparing: 3 of 69 strings"
    assert shown(0.01, line.preparing, 4, 69) == ""
    # the first block took no time that could be measured; what was done until then counts for no speed
    assert shown(0.2, line.show, 1.0, 60.0) == "2 %  1.0 of at most 60.0 s"
    assert shown(0.3, line.show, 2.0, 60.0) == "3 %  2.0 of at most 60.0 s"
    assert shown(0.7, line.show, 5.0, 60.0) == "8 %  5.0 of at most 60.0 s  4.0× real time"
    assert shown(1.0, common.ProgressLine(False).show, 5.0, 60.0) == ""
    assert shown(0.2, line.fitting, 0.42) == "42 %" and line.fitting(0.43)
    with pytest.raises(ValueError), line:
        raise ValueError  # a refusal stands on a line of its own
    assert capsys.readouterr().err.split("\r")[-2:] == [" " * len("   42 %"), ""]
