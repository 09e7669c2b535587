"""Audio out of the renderer: WAV and FLAC files that appear whole or not at all, and standard output.

A file is written beside its final name and renamed when it is complete; whatever interrupts the writing,
nothing is left behind (what a killed process leaves, the next takes away). Long files are streamed; what could outgrow a
WAV header (4 GB) is written as RF64.
"""

from __future__ import annotations

import errno
import io
import os
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any, BinaryIO, Protocol, Self

import numpy as np

from synth.files.targets import Whole, check_folder, check_target, is_special, naming, open_special, told

CONTAINERS = ("wav", "flac", "raw")
BIT_DEPTHS = ("16", "24", "float")
_BYTES_PER_SAMPLE = {"16": 2, "24": 3, "float": 4}
_SUBTYPES = {"16": "PCM_16", "24": "PCM_24", "float": "FLOAT"}
# A WAV header counts bytes in 32 bits; some room is left for the header itself.
_LARGEST_WAV_BYTES = 2**32 - 2**16
_COPY_FRAMES = 65536
#: libsndfile has a C library of its own on Windows, which knows other numbers of open files than Python
_BY_NUMBER = os.name != "nt"
_PROBE_BYTES = 65536
# Commands of libsndfile (sndfile.h), which soundfile has no names for.
_SFC_SET_UPDATE_HEADER_AUTO, _SFC_RF64_AUTO_DOWNGRADE = 0x1061, 0x1210


class AudioSink(Protocol):
    """Where blocks go: `write` takes (frames, channels) float64, full scale ±1."""

    def write(self, block: np.ndarray) -> None: ...


def container_of(path: str, asked: str | None = None) -> str:
    """'wav', 'flac' or 'raw' for an output path: as asked, else by the name's ending ('-' is WAV).

    Raises ValueError for an ending that says neither.
    """
    if asked is not None:
        if asked not in CONTAINERS:
            raise ValueError(f"format {asked!r} is not known; use one of {', '.join(CONTAINERS)}")
        return asked
    if path == "-":
        return "wav"
    ending = Path(path).suffix.lower().lstrip(".")
    if ending in ("wav", "wave"):
        return "wav"
    if ending in ("flac", "raw"):
        return ending
    if is_special(path):
        return "wav"
    raise ValueError(f"{path}: the name's ending does not say the format; end it in .wav or .flac, or give --format")


class Quantizer:
    """float64 samples → the integers (or float32) of a bit depth.

    16 bit gets triangular dither of ±1 LSB (TPDF) from a seeded generator: the same samples give the same
    file, however they are cut into blocks. `clipped` counts samples beyond full scale.
    """

    def __init__(self, bit_depth: str, seed: int = 0) -> None:
        if bit_depth not in BIT_DEPTHS:
            raise ValueError(f"bit depth {bit_depth!r} is not known; use one of {', '.join(BIT_DEPTHS)}")
        self.bit_depth = bit_depth
        self.clipped = 0
        self._random = np.random.Generator(np.random.PCG64(seed))

    def __call__(self, block: np.ndarray) -> np.ndarray:
        """(frames, channels) float64 → int16, int32 (24 bits in the upper bytes) or float32 of that shape."""
        if self.bit_depth == "float":
            return block.astype(np.float32)
        bits = int(self.bit_depth)
        largest = 2 ** (bits - 1)
        scaled = block * float(largest)
        if bits == 16:
            dither = self._random.random((*block.shape, 2))
            scaled = scaled + (dither[..., 0] - dither[..., 1])
        whole = np.rint(scaled)
        self.clipped += int(np.count_nonzero((whole > largest) | (whole < -largest)))
        whole = np.clip(whole, -largest, largest - 1)
        return whole.astype(np.int16) if bits == 16 else whole.astype(np.int32) << 8


def most_unclipped(bit_depth: str) -> float:
    """The largest peak that surely does not clip in files of a bit depth, dither included."""
    return np.inf if bit_depth == "float" else 1.0 - 2.0 ** (2 - int(bit_depth))


class AudioWriter:
    """Writes an audio file, or standard output for the path '-'. Use it as a context manager.

    When the block ends well the file gets its name; on an exception (an interrupt too) it is removed.

    path: file name or '-'.  container: 'wav', 'flac' or 'raw' (samples without a header, little-endian).
    bit_depth: '16', '24' or 'float'.  most_frames: an upper bound of the length, if known; decides on RF64.
    seed: of the 16-bit dither.  growing: the length is not known, and what is written is to be readable at any time, also
    if the program is killed: the header is kept right, a WAV file becomes an RF64 when it outgrows 4 GB.
    beside: directory where the file lies until it is complete, on the same file system (its own, which must be there).

    Raises ValueError for a combination that does not exist, OSError where the file cannot be made; both
    before anything is rendered.
    """

    def __init__(
        self,
        path: str | Path,
        rate_hz: int,
        *,
        channels: int = 2,
        container: str = "wav",
        bit_depth: str = "24",
        most_frames: int | None = None,
        seed: int = 0,
        growing: bool = False,
        beside: Path | None = None,
    ) -> None:
        self.path = str(path)
        self.frames = 0
        self._rate_hz, self._channels = rate_hz, channels
        self._container, self._bit_depth = container_of(self.path, container), bit_depth
        self._quantize = Quantizer(bit_depth, seed)
        if container == "flac" and bit_depth == "float":
            raise ValueError("FLAC holds integers only, not float; give --bit-depth 24 or --format wav")
        if container == "flac" and self._is_stream():
            raise ValueError("FLAC cannot be written to a stream; give --format wav or a file name")
        if beside is not None:
            check_folder(Path(path), beside)
        elif not self._is_stream():
            check_target(self.path)
        most_bytes = (most_frames or 0) * channels * _BYTES_PER_SAMPLE[bit_depth]
        self._growing = growing and container == "wav"
        self._big = self._growing or (container == "wav" and most_bytes > _LARGEST_WAV_BYTES)
        self._bytes_left: float = _LARGEST_WAV_BYTES if container == "wav" and not self._big else np.inf
        self._stream: BinaryIO | None = None
        self._sound: Any = None
        self._files: list[BinaryIO] = []
        self._discarded = False
        self._whole = None if self._is_stream() else Whole(self.path, beside=beside, kept=growing)

    @property
    def clipped(self) -> int:
        """Samples beyond full scale so far."""
        return self._quantize.clipped

    def _is_stream(self) -> bool:
        return self.path == "-" or is_special(self.path)

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:
            self._discard()
            raise
        return self

    def _open(self) -> None:
        if self._whole is None:
            # A stream goes forward only, so its header cannot be mended at the end: it says "until the end".
            self._bytes_left = np.inf
            with naming(self.path):
                self._stream = standard_output() if self.path == "-" else open_special(self.path)
                if self._container == "wav":
                    _write_all(self._stream, _streaming_wav_header(self._rate_hz, self._channels, self._bit_depth))
            return
        handle = self._whole.open()
        if self._container == "raw":
            self._stream = open(os.dup(handle), "wb", buffering=0)
            return
        import soundfile

        try:
            self._sound = soundfile.SoundFile(
                self._opened(handle, "w+b"),
                "w",
                samplerate=self._rate_hz,
                channels=self._channels,
                format="FLAC" if self._container == "flac" else ("RF64" if self._big else "WAV"),
                subtype=_SUBTYPES[self._bit_depth],
            )
        except soundfile.LibsndfileError as error:
            raise self._why_not(error) from None
        if self._growing:
            for command in (_SFC_RF64_AUTO_DOWNGRADE, _SFC_SET_UPDATE_HEADER_AUTO):
                soundfile._snd.sf_command(self._sound._file, command, soundfile._ffi.NULL, 1)

    def _opened(self, handle: int, mode: str) -> Any:
        """The open file as libsndfile takes it; it closes one that it has by its number, `_close` the other."""
        if _BY_NUMBER:
            return os.dup(handle)
        file: Any = open(os.dup(handle), mode, buffering=0)
        self._files.append(file)
        return file

    def write(self, block: np.ndarray) -> None:
        """Appends (frames, channels) float64 samples. Raises OSError that names the file, ValueError where it is full."""
        samples = self._quantize(block)
        self._bytes_left -= samples.size * _BYTES_PER_SAMPLE[self._bit_depth]
        if self._bytes_left < 0:
            raise ValueError(f"{self.path}: a WAV file holds at most 4 GB; render a shorter part, or write FLAC")
        if self._sound is not None:
            import soundfile

            try:
                self._sound.write(samples)
            except soundfile.LibsndfileError as error:
                raise self._why_not(error) from None
        else:
            assert self._stream is not None, "the writer is used as a context manager"
            with naming(self.path):
                _write_all(self._stream, _little_endian(samples, self._bit_depth))
        self.frames += len(block)

    def _why_not(self, error: Exception) -> OSError:
        """libsndfile does not say why it cannot write: the system does, when it is asked to write more."""
        assert self._whole is not None
        handle = self._whole.handle
        try:
            size = os.fstat(handle).st_size
            try:
                if hasattr(os, "pwrite"):
                    os.pwrite(handle, bytes(_PROBE_BYTES), size)
                else:
                    os.lseek(handle, size, os.SEEK_SET)
                    os.write(handle, bytes(_PROBE_BYTES))
                os.fsync(handle)
            finally:
                os.ftruncate(handle, size)
        except OSError as reason:
            return told(reason, self.path)
        return OSError(f"{self.path}: cannot be written ({error})")

    def finish(self) -> None:
        """All is in the file and on the disk, though not under its name yet; whoever writes several calls this for all
        before any is left. Raises OSError that names it."""
        try:
            self._close()
            if self._whole is not None and self._whole.handle >= 0:
                self._whole.settle()
        except BaseException:
            self._discard()
            raise

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        if self._discarded:
            return
        if kind is not None:
            self._discard()
            return
        self.finish()
        if self._whole is not None:
            self._whole.commit()

    def discard(self) -> None:
        """Leaves no file: what was written is removed, and a file that has its name stays."""
        self._discard()
        self._discarded = True

    def keep(self) -> str:
        """The end of a growing file, which has its name then, also where its end could not be written: returns why not,
        empty if it could. Raises OSError where it has no name."""
        reason = ""
        try:
            self._close()
            if self._whole is not None:
                self._whole.settle()
        except OSError as error:
            reason = error.strerror or str(error)
        if self._whole is not None:
            self._whole.commit()
        return reason

    def _close(self) -> None:
        sound, self._sound = self._sound, None
        if sound is not None:
            import soundfile

            try:
                sound.close()
                if self._container == "flac":
                    self._check_end()
                elif self._bit_depth == "float":
                    assert self._whole is not None
                    with naming(self.path), open(os.dup(self._whole.handle), "r+b", buffering=0) as file:
                        _forget_time_of_day(file)
            except soundfile.LibsndfileError as error:
                raise self._why_not(error) from None
        while self._files:
            self._files.pop().close()
        stream, self._stream = self._stream, None
        if stream is not None and self.path != "-":
            with naming(self.path):
                stream.close()

    def _check_end(self) -> None:
        """The last block of a FLAC file is written when it is closed, and libsndfile does not tell whether it could be."""
        import soundfile

        assert self._whole is not None
        os.lseek(self._whole.handle, 0, os.SEEK_SET)
        with soundfile.SoundFile(self._opened(self._whole.handle, "r+b")) as sound:
            if self.frames and sound.seek(self.frames - 1) == self.frames - 1 and len(sound.read(1)) != 1:
                raise soundfile.LibsndfileError(0)

    def _discard(self) -> None:
        try:
            self._close()
        except Exception:
            # What cannot be closed cannot be kept either; the error that led here is the one to show.
            pass
        while self._files:
            self._files.pop().close()
        if self._whole is not None:
            self._whole.discard()


def _forget_time_of_day(file: BinaryIO) -> None:
    """Sets the time in the PEAK chunk of a WAV or RF64 file to 0: libsndfile writes the second of the day there, into files
    of floats, and equal sounds are equal files."""
    at = 12  # behind the file's own name, length and kind
    while True:
        file.seek(at)
        head = file.read(8)
        if len(head) < 8 or head[:4] == b"data":
            return
        if head[:4] == b"PEAK":
            file.seek(at + 12)  # behind the chunk's name, length and version
            file.write(bytes(4))
            return
        at += 8 + (int.from_bytes(head[4:], "little") + 1) // 2 * 2


def float_wav(samples: np.ndarray, rate_hz: int) -> bytes:
    """A WAV file of (frames, channels) samples as 32-bit floats, in memory."""
    import soundfile

    buffer = io.BytesIO()
    with soundfile.SoundFile(buffer, "w", rate_hz, samples.shape[1], "FLOAT", format="WAV") as sound:
        sound.write(samples.astype(np.float32))
    _forget_time_of_day(buffer)
    return buffer.getvalue()


def standard_output() -> Any:
    """Standard output for bytes, unbuffered: nothing is left to be written when the program ends."""
    stream = sys.stdout.buffer
    stream.flush()
    return getattr(stream, "raw", stream)


def _write_all(stream: Any, data: bytes) -> None:
    """A pipe may take less than it is given."""
    left = memoryview(data)
    while left:
        written = stream.write(left)
        if written is None:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        left = left[written:]


class Metered:
    """A sink that knows the peak of all it has passed on."""

    def __init__(self, sink: AudioSink) -> None:
        self.peak = 0.0
        self._sink = sink

    def write(self, block: np.ndarray) -> None:
        if block.size:
            self.peak = max(self.peak, float(np.abs(block).max()))
        self._sink.write(block)


class Spool:
    """Keeps a rendering in a nameless temporary file (float64), for what needs two passes. A context
    manager.
    """

    def __init__(self, channels: int = 2, directory: str | Path | None = None) -> None:
        self.peak = 0.0
        self._channels = channels
        self._where = f"temporary file in {tempfile.gettempdir() if directory is None else directory}"
        with naming(self._where):
            self._file = tempfile.TemporaryFile(dir=directory, buffering=0)

    def write(self, block: np.ndarray) -> None:
        """Appends (frames, channels) float64 samples."""
        if block.size:
            self.peak = max(self.peak, float(np.abs(block).max()))
        with naming(self._where):
            _write_all(self._file, np.ascontiguousarray(block, dtype=np.float64).tobytes())

    def copy_to(self, sink: AudioSink, gain: float) -> None:
        """Writes everything kept, times `gain`, to `sink`."""
        self._file.seek(0)
        while data := self._file.read(8 * self._channels * _COPY_FRAMES):
            sink.write(np.frombuffer(data).reshape(-1, self._channels) * gain)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def _little_endian(samples: np.ndarray, bit_depth: str) -> bytes:
    if bit_depth == "16":
        return samples.astype("<i2").tobytes()
    if bit_depth == "float":
        return samples.astype("<f4").tobytes()
    quads = np.ascontiguousarray(samples.astype("<i4")).view(np.uint8).reshape(-1, 4)
    return quads[:, 1:].tobytes()


def _streaming_wav_header(rate_hz: int, channels: int, bit_depth: str) -> bytes:
    """44 bytes of WAV header with unknown lengths (all ones), as sox and ffmpeg write to pipes."""
    width = _BYTES_PER_SAMPLE[bit_depth]
    code = 3 if bit_depth == "float" else 1
    form = struct.pack("<HHIIHH", code, channels, rate_hz, rate_hz * channels * width, channels * width, 8 * width)
    unknown = struct.pack("<I", 0xFFFFFFFF)
    return b"RIFF" + unknown + b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + unknown
