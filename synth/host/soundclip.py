"""A sound that was rendered: an array with its rate and its report, which is saved, heard, drawn and shown in notebooks.

The same samples as `synth render` writes; `save` writes them by the same writer, so that the file is the command's.
"""

from __future__ import annotations

import io
import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from synth.files import notebook_html
from synth.host import audiofile
from synth.research.citations import bibtex
from synth.units import gain_to_db

if TYPE_CHECKING:
    import xarray

    from synth.host.render import RenderReport

SIDES = ("left", "right")
#: of sound that a notebook holds: seconds and bytes
EMBEDDED_S = 60.0
EMBEDDED_BYTES = 4_000_000
#: highest rate that browsers play [Hz]
MOST_PLAYED_HZ = 192_000
_COPY_FRAMES = 65536


@dataclass(frozen=True, eq=False, repr=False)
class Sound(NDArrayOperatorsMixin):
    """A rendered sound, made by `render`: an array with its rate and its report.

    Wherever NumPy wants an array it is its samples: `np.abs(sound).max()`, `sound[:44100, 0]`, `0.5 * sound`, `len(sound)`.
    What comes out of that are arrays.

    Attributes
    ----------
    samples : (frames, 2) array of float64
        Left and right, full scale ±1.
    rate_hz : int
        Frames a second [Hz].
    stems : dict
        Part → (frames, 2) before the limiter; empty unless asked for.
    report : RenderReport
        What `synth render --json` says: peak, notes, strings, channels, warnings, times.

    Examples
    --------
    >>> import synth
    >>> sound = synth.render([(48, 90, 0.2)], "tanpura", quality="draft", tail=0.3)
    >>> sound.shape, sound.dtype, sound.part(0.0, 0.1).duration_s
    ((22050, 2), dtype('float64'), 0.1)
    >>> sound.save("sa.flac")
    """

    samples: np.ndarray
    rate_hz: int
    stems: Mapping[str, np.ndarray] = field(repr=False)
    report: RenderReport = field(repr=False)

    # --- an array -----------------------------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, ...]:
        """(frames, channels)."""
        return self.samples.shape

    @property
    def ndim(self) -> int:
        """2."""
        return self.samples.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the samples, float64."""
        return self.samples.dtype

    @property
    def duration_s(self) -> float:
        """How long it is [s]."""
        return len(self.samples) / self.rate_hz

    @property
    def peak_dbfs(self) -> float:
        """Level of the largest sample [dB], −inf of silence."""
        return gain_to_db(float(np.abs(self.samples).max(initial=0.0)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        kind = np.dtype(self.samples.dtype if dtype is None else dtype)
        if kind != self.samples.dtype:
            if copy is False:
                raise ValueError(f"samples are {self.samples.dtype}, and {kind} needs a copy; leave copy=False out")
            return self.samples.astype(kind)
        return self.samples.copy() if copy else self.samples

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        if any(isinstance(each, Sound) for each in more.get("out", ())):
            return NotImplemented  # a sound does not change
        return getattr(ufunc, method)(*(each.samples if isinstance(each, Sound) else each for each in inputs), **more)

    def __len__(self) -> int:
        return len(self.samples)

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter(self.samples)

    def __getitem__(self, place: Any) -> Any:
        return self.samples[place]

    def __bool__(self) -> bool:
        """Whether it has any frames: of a sound of several, arrays would not say."""
        return len(self.samples) > 0

    def __repr__(self) -> str:
        return f"<Sound: {self.duration_s:.2f} s at {self.rate_hz} Hz, {self._level()}, {self._notes()}>"

    def _level(self) -> str:
        peak = self.peak_dbfs
        return "silent" if math.isinf(peak) else f"peak {peak:.1f} dBFS"

    def _notes(self) -> str:
        return f"{self.report.notes} note{'' if self.report.notes == 1 else 's'}"

    def citation(self) -> str:
        """BibTeX of the program, at its present version, and of the papers whose methods its strings used."""
        return bibtex(self.report.scheme, self.report.sources)

    # --- parts of it --------------------------------------------------------------------------------------------------

    def part(self, start_s: float = 0.0, end_s: float | None = None) -> Sound:
        """What sounds from `start_s` to `end_s` (None: its end), stems too; the report stays that of the whole. Raises
        ValueError where there is nothing between them."""
        end = self.duration_s if end_s is None else min(float(end_s), self.duration_s)
        if not 0.0 <= start_s < end:
            raise ValueError(
                f"a part must begin at 0 s or later and before its end ({end:g} s), got {start_s!r} to {end_s!r}"
            )
        frames = slice(round(start_s * self.rate_hz), round(end * self.rate_hz))
        stems = {name: samples[frames] for name, samples in self.stems.items()}
        return replace(self, samples=self.samples[frames], stems=stems)

    def stem(self, name: str) -> Sound:
        """One part alone, by its name in `stems`. Raises KeyError, which says what there is."""
        if name not in self.stems:
            raise KeyError(f"no stem {name!r}; there are {', '.join(self.stems) or 'none: render with stems=True'}")
        return replace(self, samples=self.stems[name], stems={})

    # --- out of the program -------------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str], *, bit_depth: str = "24", container: str | None = None) -> None:
        """Writes it as WAV or FLAC by the name's ending: the file that `synth render -o` would write, whole or not at all.

        bit_depth   "16" (dithered), "24" or "float"
        container   "wav", "flac" or "raw", whatever the name's ending
        Warns (UserWarning) of samples above full scale, which are clipped. Raises ValueError for what no such file holds,
        OSError that names the file.
        """
        name = os.fspath(path)
        kind = audiofile.container_of(name, container)
        with audiofile.AudioWriter(
            name, self.rate_hz, channels=self.samples.shape[1], container=kind, bit_depth=bit_depth,
            most_frames=len(self.samples), seed=self.report.seed,
        ) as writer:  # fmt: skip
            for start in range(0, len(self.samples), _COPY_FRAMES):
                writer.write(self.samples[start : start + _COPY_FRAMES])
        if writer.clipped:
            samples = f"{writer.clipped} sample{'' if writer.clipped == 1 else 's'}"
            warnings.warn(
                f"{name}: {samples} exceeded full scale and clipped; lower gain_db, keep the limiter or use "
                'bit_depth="float"',
                stacklevel=2,
            )

    def play(self, device: str | int | None = None, *, wait: bool = True) -> None:
        """Plays it through this machine's sound card; Ctrl-C stops it.

        device   number or part of a name (`synth devices` lists them); None: the default
        wait     False: comes back at once; another `play` ends the first
        Raises ImportError without the package's extra `live`, OSError where there is no sound card that takes it.
        """
        notebook_html.need("sounddevice", "play")
        try:
            import sounddevice
        except OSError as error:  # the library itself
            raise OSError(f"play needs PortAudio ({error}); install libportaudio2, or save the sound") from None
        try:
            sounddevice.play(self.samples.astype(np.float32), self.rate_hz, device=device)
            if wait:
                try:
                    sounddevice.wait()
                except BaseException:
                    sounddevice.stop()
                    raise
        except (sounddevice.PortAudioError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise OSError(
                f"cannot play at {self.rate_hz} Hz: {reason}; `synth devices` lists outputs, save() writes a file"
            ) from None

    def to_xarray(self) -> xarray.DataArray:
        """A DataArray (time, channel) of the samples, which it shares; seconds and sides as coordinates, rate and report
        (JSON) as attributes. Raises ImportError without xarray."""
        notebook_html.need("xarray", "to_xarray")
        import xarray

        frames, channels = self.samples.shape
        time = xarray.Variable("time", np.arange(frames) / self.rate_hz, {"units": "s"})
        return xarray.DataArray(
            self.samples,
            dims=("time", "channel"),
            coords={"time": time, "channel": list(SIDES[:channels])},
            name="sound",
            attrs={
                "long_name": "sound", "units": "full scale", "rate_hz": self.rate_hz,
                "report": json.dumps(self.report.as_dict(), allow_nan=False),
            },
        )  # fmt: skip

    # --- to be looked at ----------------------------------------------------------------------------------------------

    def plot(self, *, highest_hz: float = 10_000.0, range_db: float = 70.0, axes: Any = None) -> Any:
        """Draws the waveform above a spectrogram and returns the two matplotlib Axes.

        highest_hz   of the spectrogram;  range_db   how far below its loudest bin colours go
        axes         two Axes to draw into; None: a new figure
        Raises ImportError without matplotlib.
        """
        from synth.host.sound_pictures import draw, two_axes

        found = two_axes() if axes is None else axes
        draw(self.samples, self.rate_hz, found, highest_hz, range_db)
        return found

    def _repr_html_(self) -> str:
        rows = [
            ("duration", f"{self.duration_s:.2f} s at {self.rate_hz} Hz"),
            ("level", self._level()),
            ("notes", f"{self.report.notes}, at most {self.report.strings} strings at once"),
        ]
        speed = self.report.realtime_factor
        if speed is not None:
            rows.append(
                (
                    "rendered",
                    f"in {self.report.render_s:.2f} s, {speed:.1f} × real time, after {self.report.prepare_s:.1f} s",
                )
            )
        rows += [("warning", text) for text in self.report.warnings]
        pieces = [notebook_html.table(rows)]
        if len(self.samples):
            if notebook_html.there_is("matplotlib"):
                from synth.host.sound_pictures import small_png

                what = "waveform and spectrogram"
                pieces.append(notebook_html.picture(small_png(self.samples, self.rate_hz), what))
            else:
                pieces.append(notebook_html.paragraph("A picture needs matplotlib: pip install 'jawari[notebook]'"))
            pieces += self._player()
        return "".join(pieces)

    def _player(self) -> list[str]:
        """The sound in the page, as FLAC of 16 bits, and what is to be said of it."""
        if self.rate_hz > MOST_PLAYED_HZ:
            return [notebook_html.paragraph(f"Browsers play up to {MOST_PLAYED_HZ} Hz; save() writes it as it is.")]
        frames, data = self._embedded()
        said = []
        if frames < len(self.samples):
            said.append(f"The first {frames / self.rate_hz:.0f} of {self.duration_s:.0f} s; save() writes all of it.")
        if self.peak_dbfs > 0.0:
            said.append(f"The player clips what is above full scale (peak {self.peak_dbfs:.1f} dBFS).")
        player = f'<audio controls preload="none" src="{notebook_html.data_uri("audio/flac", data)}"></audio>'
        return [player, *map(notebook_html.paragraph, said)]

    def _embedded(self) -> tuple[int, bytes]:
        """(frames, FLAC of them): no more than EMBEDDED_S and EMBEDDED_BYTES."""
        import soundfile

        frames = min(len(self.samples), round(EMBEDDED_S * self.rate_hz))
        while True:
            out = io.BytesIO()
            whole = audiofile.Quantizer("16", self.report.seed)(self.samples[:frames])
            soundfile.write(out, whole, self.rate_hz, format="FLAC", subtype="PCM_16")
            data = out.getvalue()
            if len(data) <= EMBEDDED_BYTES or frames < self.rate_hz // 10:
                return frames, data
            frames = int(frames * 0.95 * EMBEDDED_BYTES / len(data))
