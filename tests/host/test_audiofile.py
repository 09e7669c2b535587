"""Audio files: exact samples, the right names at the right time, nothing left behind."""

import io
import os
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from synth.host import audiofile
from synth.host.audiofile import AudioWriter, Quantizer, Spool, container_of
from tests.patience import patience_s

RATE_HZ = 48000
ROOT = Path(__file__).resolve().parents[2]


def noise(frames: int = 1000, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.9, 0.9, (frames, 2))


@pytest.mark.parametrize(("container", "subtype"), [("wav", "PCM_24"), ("flac", "PCM_24")])
def test_24_bits_round_to_the_nearest_step(tmp_path, container: str, subtype: str) -> None:
    path, sound = tmp_path / f"x.{container}", noise()
    with AudioWriter(path, RATE_HZ, container=container) as writer:
        writer.write(sound[:300])
        writer.write(sound[300:])
    info = soundfile.info(path)
    assert (info.samplerate, info.channels, info.frames, info.subtype) == (RATE_HZ, 2, 1000, subtype)
    whole = soundfile.read(path, dtype="int32")[0] >> 8
    np.testing.assert_array_equal(whole, np.rint(sound * 2**23).astype(int))
    assert os.listdir(tmp_path) == [path.name]


def test_float_files_hold_the_samples(tmp_path) -> None:
    sound = 3.0 * noise()
    with AudioWriter(tmp_path / "x.wav", RATE_HZ, bit_depth="float") as writer:
        writer.write(sound)
    np.testing.assert_array_equal(soundfile.read(tmp_path / "x.wav", dtype="float32")[0], sound.astype(np.float32))
    assert writer.clipped == 0


def _every_format(folder: Path) -> dict[str, bytes]:
    """Files of one sound in every format that is written, by name."""
    folder.mkdir()
    sound = noise()
    for container in audiofile.CONTAINERS:
        for bits in audiofile.BIT_DEPTHS:
            for growing in (False, True):
                for most_frames in (1000, 2**31):  # a WAV file, and one that may outgrow it
                    if (container, bits) == ("flac", "float"):
                        continue
                    path = folder / f"{bits}-{growing}-{most_frames}.{container}"
                    with AudioWriter(
                        path, RATE_HZ, container=container, bit_depth=bits, growing=growing, most_frames=most_frames
                    ) as writer:
                        writer.write(sound)
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    return found | {"in memory": audiofile.float_wav(sound, RATE_HZ)}


def test_equal_sounds_are_equal_files_whenever_they_are_written(tmp_path) -> None:
    """In every format: libsndfile would write the second of the day into files of floats."""
    first, begun = _every_format(tmp_path / "first"), int(time.time())
    while int(time.time()) <= begun + 1:
        time.sleep(0.1)
    later = _every_format(tmp_path / "later")
    assert len(first) == 33 and {data[:4] for data in first.values()} >= {b"RIFF", b"RF64", b"fLaC"}
    assert [name for name in first if first[name] != later[name]] == []


def test_a_float_file_in_memory_holds_the_samples() -> None:
    sound = 3.0 * noise()
    got, rate_hz = soundfile.read(io.BytesIO(audiofile.float_wav(sound, RATE_HZ)), dtype="float32")
    assert rate_hz == RATE_HZ
    np.testing.assert_array_equal(got, sound.astype(np.float32))


def test_full_scale_clips_and_is_counted_and_never_wraps() -> None:
    for bits, step in (("16", 1), ("24", 256)):
        quantize = Quantizer(bits)
        got = quantize(np.array([[1.5, -1.5], [1.0, -1.0], [0.5, 0.0]])).astype(np.int64)
        largest = 2 ** (int(bits) - 1)
        assert got[0].tolist() == [(largest - 1) * step, -largest * step]
        assert quantize.clipped >= 2


def test_dither_is_triangular_and_makes_the_error_independent_of_the_sound() -> None:
    # A quarter of a step would vanish without dither; with TPDF the mean is kept and the total error has
    # variance 1/12 (rounding) + 2/12 (dither) = 1/4 LSB², at every level.
    frames = 200_000
    for level in (0.0, 0.25, 0.5):
        got = Quantizer("16", seed=3)(np.full((frames, 2), level / 2**15)).astype(float)
        # Standard errors over 2·frames samples: of the mean 0.5/√n, of the variance below 1/√n.
        n = 2 * frames
        assert abs(got.mean() - level) < 5 * 0.5 / np.sqrt(n)
        assert abs(((got - level) ** 2).mean() - 0.25) < 5 / np.sqrt(n)


@given(st.lists(st.integers(1, 50), max_size=10), st.sampled_from(("16", "24", "float")))
def test_blocks_do_not_show(cuts: list[int], bits: str) -> None:
    sound = noise(200)
    at = np.clip(np.cumsum(cuts), 0, 200) if cuts else []
    quantize = Quantizer(bits, seed=7)
    pieces = [quantize(piece) for piece in np.split(sound, at)]
    np.testing.assert_array_equal(np.concatenate(pieces), Quantizer(bits, seed=7)(sound))


def test_the_seed_decides_the_dither() -> None:
    sound = noise()
    assert (Quantizer("16", 1)(sound) == Quantizer("16", 1)(sound)).all()
    assert (Quantizer("16", 1)(sound) != Quantizer("16", 2)(sound)).any()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("container", ["wav", "flac", "raw"])
def test_an_interrupted_file_leaves_nothing_and_spares_the_old_one(tmp_path, error, container: str) -> None:
    path = tmp_path / "x.wav"
    path.write_bytes(b"old")
    with pytest.raises(error):
        with AudioWriter(path, RATE_HZ, container=container) as writer:
            writer.write(noise())
            raise error
    assert os.listdir(tmp_path) == ["x.wav"]
    assert path.read_bytes() == b"old"


def test_the_name_appears_only_when_the_file_is_whole(tmp_path) -> None:
    with AudioWriter(tmp_path / "x.wav", RATE_HZ) as writer:
        writer.write(noise())
        assert not (tmp_path / "x.wav").exists()
    assert (tmp_path / "x.wav").exists()
    # Readable by whom new files are readable, unlike ordinary temporary files.
    umask = os.umask(0)
    os.umask(umask)
    assert (tmp_path / "x.wav").stat().st_mode & 0o777 == 0o666 & ~umask


def test_what_could_outgrow_wav_becomes_rf64(tmp_path) -> None:
    sound = noise()
    with AudioWriter(tmp_path / "x.wav", RATE_HZ, most_frames=2**32 // 6) as writer:
        writer.write(sound)
    assert (tmp_path / "x.wav").read_bytes()[:4] == b"RF64"
    got, _ = soundfile.read(tmp_path / "x.wav")
    np.testing.assert_allclose(got, sound, atol=2**-24)
    with AudioWriter(tmp_path / "y.wav", RATE_HZ, most_frames=2**32 // 7) as writer:
        writer.write(sound)
    assert (tmp_path / "y.wav").read_bytes()[:4] == b"RIFF"


class _Pipe(io.BytesIO):
    def seekable(self) -> bool:
        return False

    def seek(self, *_: int) -> int:
        raise OSError("a pipe cannot seek")


@pytest.mark.parametrize("bits", ["16", "24", "float"])
def test_standard_output_carries_the_same_samples_as_a_file(tmp_path, monkeypatch, bits: str) -> None:
    sound, pipe = noise(), _Pipe()
    monkeypatch.setattr(sys, "stdout", type("Stdout", (), {"buffer": pipe}))
    with AudioWriter("-", RATE_HZ, bit_depth=bits) as writer:
        writer.write(sound)
    with AudioWriter(tmp_path / "x.wav", RATE_HZ, bit_depth=bits) as writer:
        writer.write(sound)
    with AudioWriter(tmp_path / "x.raw", RATE_HZ, bit_depth=bits, container="raw") as writer:
        writer.write(sound)
    data = pipe.getvalue()
    assert data[:4] == b"RIFF" and data[36:40] == b"data"
    assert data[44:] == (tmp_path / "x.raw").read_bytes()
    # With the true lengths in its header the stream is a WAV file.
    body = len(data) - 44
    mended = data[:4] + (36 + body).to_bytes(4, "little") + data[8:40] + body.to_bytes(4, "little") + data[44:]
    got, rate_hz = soundfile.read(io.BytesIO(mended))
    assert rate_hz == RATE_HZ
    np.testing.assert_array_equal(got, soundfile.read(tmp_path / "x.wav")[0])


def test_a_device_is_written_to_and_not_replaced() -> None:
    with AudioWriter("/dev/null", RATE_HZ) as writer:
        writer.write(noise())
    assert not os.path.isfile("/dev/null")


@pytest.mark.parametrize(
    ("path", "options", "error", "problem"),
    [
        ("x.flac", {"container": "flac", "bit_depth": "float"}, ValueError, "FLAC holds integers"),
        ("-", {"container": "flac"}, ValueError, "cannot be written to a stream"),
        ("x.wav", {"bit_depth": "8"}, ValueError, "bit depth '8' is not known"),
        ("x.mp3", {"container": "mp3"}, ValueError, "format 'mp3' is not known"),
        ("nowhere/x.wav", {}, OSError, "there is no directory"),
        (".", {}, OSError, "is a directory"),
    ],
)
def test_what_cannot_be_written_is_said_before_anything_is_done(
    tmp_path, monkeypatch, path: str, options: dict, error: type[Exception], problem: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=problem):
        AudioWriter(path, RATE_HZ, **options)
    assert os.listdir(tmp_path) == []


def test_the_ending_of_the_name_says_the_format() -> None:
    assert [container_of(name) for name in ("a.WAV", "a.wave", "b.flac", "-", "c.raw")] == [
        "wav",
        "wav",
        "flac",
        "wav",
        "raw",
    ]
    assert container_of("song.out", "flac") == "flac"
    with pytest.raises(ValueError, match=r"\.mp3: the name's ending does not say the format"):
        container_of("song.mp3")


def test_a_device_takes_the_format_of_streams() -> None:
    assert [container_of("/dev/null"), container_of("/dev/null", "raw")] == ["wav", "raw"]
    with AudioWriter("/dev/null", RATE_HZ, container="raw") as writer:
        writer.write(noise())
    assert writer.frames == 1000


@pytest.mark.parametrize(("bits", "code", "width"), [("16", 1, 2), ("24", 1, 3), ("float", 3, 4)])
def test_the_header_of_a_stream_is_a_wav_files(monkeypatch, bits: str, code: int, width: int) -> None:
    pipe = _Pipe()
    monkeypatch.setattr(sys, "stdout", type("Stdout", (), {"buffer": pipe}))
    with AudioWriter("-", RATE_HZ, channels=1, bit_depth=bits):
        pass
    data = pipe.getvalue()
    assert len(data) == 44 and data[8:16] == b"WAVEfmt "
    assert data[4:8] == data[40:44] == b"\xff" * 4
    fields = struct.unpack("<IHHIIHH", data[16:36])
    assert fields == (16, code, 1, RATE_HZ, RATE_HZ * width, width, 8 * width)


def test_a_pipe_that_takes_little_at_a_time_gets_all(monkeypatch) -> None:
    class Slow(_Pipe):
        def write(self, data) -> int:
            return super().write(bytes(data[:7]))

    pipe, sound = Slow(), noise(50)
    monkeypatch.setattr(sys, "stdout", type("Stdout", (), {"buffer": pipe}))
    with AudioWriter("-", RATE_HZ, bit_depth="float", container="raw") as writer:
        writer.write(sound)
    assert pipe.getvalue() == sound.astype("<f4").tobytes()
    monkeypatch.setattr(pipe, "write", lambda data: None)  # a full pipe that does not wait
    with pytest.raises(BlockingIOError):
        with AudioWriter("-", RATE_HZ) as writer:
            writer.write(sound)


def test_full_scale_is_counted_from_the_first_sample_beyond_it() -> None:
    """24 bits, without dither: +1 is a step more than there is and does not count, what rounds to more does."""
    step = 2.0**-23
    quantize = Quantizer("24")
    got = quantize(np.array([[1.0, -1.0], [1.0 - step, 1.0 + 0.4 * step], [-1.0 - 0.4 * step, 0.25]]))
    assert quantize.clipped == 0
    assert (got >> 8).tolist() == [[2**23 - 1, -(2**23)], [2**23 - 1, 2**23 - 1], [-(2**23), 2**21]]
    quantize(np.array([[1.0 + step, 0.0], [-1.0 - step, -1.0]]))
    assert quantize.clipped == 2
    quantize(np.array([[2.0, 0.0]]))
    assert quantize.clipped == 3


def test_16_bits_are_off_by_dither_and_rounding_and_no_more() -> None:
    sound = noise(5000)
    off = Quantizer("16")(sound) - sound * 2**15
    assert 1.0 < np.abs(off).max() < 1.5 and abs(off.mean()) < 5 * 0.5 / np.sqrt(off.size)


def test_a_wav_file_is_full_at_four_gigabytes(tmp_path, monkeypatch) -> None:
    """Where the length was not known: refused before it is written, to the sample."""
    monkeypatch.setattr(audiofile, "_LARGEST_WAV_BYTES", 6 * 300)
    with AudioWriter(tmp_path / "x.wav", RATE_HZ) as writer:
        writer.write(noise(200))
        writer.write(noise(100))
    assert soundfile.info(tmp_path / "x.wav").frames == 300
    with pytest.raises(ValueError, match=r"y\.wav: a WAV file holds at most 4 GB"):
        with AudioWriter(tmp_path / "y.wav", RATE_HZ) as writer:
            writer.write(noise(301))
    assert os.listdir(tmp_path) == ["x.wav"]
    for container in ("flac", "raw"):  # hold more
        with AudioWriter(tmp_path / f"z.{container}", RATE_HZ, container=container) as writer:
            writer.write(noise(301))


@pytest.mark.parametrize("container", ["wav", "flac", "raw"])
def test_a_growing_file_can_be_read_at_any_time_and_is_kept(tmp_path, container: str) -> None:
    sound = noise(20_000)
    path = tmp_path / f"x.{container}"
    writer = AudioWriter(path, RATE_HZ, container=container, growing=True)
    with writer:
        writer.write(sound[:12_000])
        (beside,) = tmp_path.iterdir()
        if container == "wav":
            assert soundfile.info(beside).frames == 12_000
        writer.write(sound[12_000:])
        assert writer.frames == 20_000
        assert writer.keep() == ""
        assert [each.name for each in tmp_path.iterdir()] == [path.name]
    if container == "raw":
        assert path.stat().st_size == 6 * 20_000
        return
    np.testing.assert_allclose(soundfile.read(path)[0], sound, atol=2**-24)
    if container == "wav":
        assert path.read_bytes()[:4] == b"RIFF"  # not RF64, which fewer programs read


def test_several_files_are_finished_before_any_has_its_name(tmp_path) -> None:
    with AudioWriter(tmp_path / "x.wav", RATE_HZ) as writer:
        writer.write(noise())
        writer.finish()
        assert not (tmp_path / "x.wav").exists()
        assert [soundfile.info(path).frames for path in tmp_path.iterdir()] == [1000]
    assert [path.name for path in tmp_path.iterdir()] == ["x.wav"]


def test_a_spool_knows_the_loudest_of_all_it_got(tmp_path) -> None:
    with Spool(2, tmp_path) as spool:
        for level in (0.5, -3.0, 2.0):
            spool.write(np.array([[0.1, level]]))
        spool.write(np.zeros((0, 2)))
        assert spool.peak == 3.0
    with pytest.raises(OSError, match=f"temporary file in {tmp_path / 'nowhere'}"):
        Spool(2, tmp_path / "nowhere")


def test_a_spool_gives_back_what_it_got_times_a_gain(tmp_path) -> None:
    sound = noise(100_000)
    got: list[np.ndarray] = []

    class Sink:
        def write(self, block: np.ndarray) -> None:
            got.append(block.copy())

    with Spool(2, tmp_path) as spool:
        for piece in np.array_split(sound, 7):
            spool.write(piece)
        spool.copy_to(Sink(), 0.5)
    assert spool.peak == np.abs(sound).max()
    np.testing.assert_array_equal(np.concatenate(got), 0.5 * sound)
    assert os.listdir(tmp_path) == []


LIMITED = """
import resource, sys
import numpy as np
from synth.host.audiofile import AudioWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with AudioWriter(sys.argv[1], 44100, container=sys.argv[1].rpartition(".")[2]) as writer:
        writer.write(np.random.default_rng(1).uniform(-0.5, 0.5, (2000, 2)))
    print("whole")
except OSError as error:
    print(error.strerror)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of file size")
@pytest.mark.parametrize("container", ["wav", "flac", "raw"])
def test_a_file_that_lacks_one_byte_is_none(tmp_path, container: str) -> None:
    """Whichever byte cannot be written, the last too: libsndfile says nothing of a FLAC file's last block."""
    path = tmp_path / f"x.{container}"
    with AudioWriter(path, 44100, container=container) as writer:
        writer.write(np.random.default_rng(1).uniform(-0.5, 0.5, (2000, 2)))
    whole = path.read_bytes()
    for size, old in ((len(whole), b"old"), (len(whole) - 1, b"old"), (len(whole) // 2, None), (60, None)):
        path.unlink()
        if old is not None:
            path.write_bytes(old)
        command = [sys.executable, "-c", LIMITED, str(path), str(size)]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=patience_s())
        if size == len(whole):
            assert (said.stdout, path.read_bytes()) == ("whole\n", whole), said.stderr
            continue
        assert said.stdout.startswith("File too large; "), said.stderr
        assert "Traceback" not in said.stderr
        assert [(each.name, each.read_bytes()) for each in tmp_path.iterdir()] == ([(path.name, old)] if old else [])
        path.touch()


@pytest.mark.parametrize("container", ["wav", "flac", "raw"])
def test_a_file_system_that_is_full(tmp_path, container: str) -> None:
    """A real one, where one can be made."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)], capture_output=True, timeout=patience_s()
    )
    if not mounted or mounted.returncode:
        pytest.skip("a small file system can be mounted by root only; limits of file size stand for it above")
    try:
        path = disk / f"x.{container}"
        path.write_bytes(b"old")
        with pytest.raises(OSError, match="No space left on device; make room there") as raised:
            with AudioWriter(path, 44100, container=container) as writer:
                for k in range(20):
                    writer.write(noise(seed=k))
        assert raised.value.filename == str(path)
        assert [(each.name, each.read_bytes()) for each in disk.iterdir()] == [(path.name, b"old")]
        with AudioWriter(path, 44100, container=container) as writer:  # there is room again
            writer.write(noise())
    finally:
        subprocess.run(["umount", str(disk)], check=True, timeout=patience_s())
