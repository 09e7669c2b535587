"""The settings of an engine, whatever it plays: each with its kind, range, unit and words in one place.

    settings = EngineSettings(quality="fine", gain_db=-6.0)
    engine = Engine([load_preset("tanpura")], settings=settings)

A render job and a live session are such settings with more (`host.render.RenderSettings`, `live.session.SessionSettings`);
the command line makes its options from them. What an engine is told of its parts (their channels, tuning, notes, bindings)
is no setting. Plain, so that the command line need load no kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypedDict

from synth.dsp.rates import MAXIMUM_INTERNAL_HZ
from synth.engine.numbers import a_count, a_number
from synth.instrument.qualities import FLOAT32, PRECISIONS, QUALITIES
from synth.solver.contact_laws import check_scheme
from synth.solver.schemes import LAWS

#: largest seed of what varies from stroke to stroke
MOST_SEED = (1 << 31) - 1
#: most threads that can be asked for
MOST_THREADS = 1 << 16
#: most strings that can be asked for
MOST_STRINGS = 1 << 20


@dataclass(frozen=True)
class Setting:
    """A setting: what it may be, and what it does.

    words     of `--help`, in a line
    check     (name, value) → the value as it is used. Raises TypeError or ValueError that names it
    absent    what None stands for; "": None is no value
    choices   names that it may be
    typed     lowest and highest value that a command takes, both whole where it must be; unit of both
    """

    words: str
    check: Callable[[str, Any], Any]
    absent: str = ""
    choices: tuple[str, ...] = ()
    typed: tuple[float, float] | None = None
    unit: str = ""

    def checked(self, name: str, value: Any) -> Any:
        """The value as it is used. Raises TypeError or ValueError that names it."""
        return None if value is None and self.absent else self.check(name, value)


def _setting(default: Any, words: str, check: Callable[[str, Any], Any], absent: str = "", **more: Any) -> Any:
    return field(default=default, metadata={"setting": Setting(words, check, absent, **more)})


def _number(default: float | None, words: str, low: float, high: float, unit: str = "", **more: Any) -> Any:
    """A setting that is a number from low to high."""
    return _setting(default, words, lambda name, value: a_number(name, value, low, high, unit), unit=unit, **more)


def _count(default: int | None, words: str, least: int, most: int, **more: Any) -> Any:
    """A setting that is a whole number from least to most."""
    return _setting(default, words, lambda name, value: a_count(name, value, least, most), **more)


def _choice(default: str | None, words: str, choices: tuple[str, ...], absent: str = "") -> Any:
    """A setting that is one of some names."""

    def check(name: str, value: Any) -> Any:
        if not (isinstance(value, str) and value in choices):
            none = f", or None for {absent}" if absent else ""
            raise ValueError(f"{name} must be one of {', '.join(choices)}{none}, got {value!r}")
        return value

    return _setting(default, words, check, absent, choices=choices)


def _switch(default: bool | None, words: str, absent: str = "") -> Any:
    """A setting that is True or False."""

    def check(name: str, value: Any) -> bool:
        try:
            known = value in (True, False)
        except ValueError:  # an array
            known = False
        if not known:
            raise TypeError(f"{name} must be True or False, got {value!r}")
        return bool(value)

    return _setting(default, words, check, absent)


def _check_scheme(name: str, value: Any) -> str:
    return check_scheme(value if isinstance(value, str) else repr(value), LAWS)


def _check_threads(name: str, value: Any) -> int | str:
    if isinstance(value, str) and value == "auto":
        return value
    try:
        return a_count(name, value, 1, MOST_THREADS)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a whole number from 1 on or 'auto', got {value!r}") from None


@dataclass(frozen=True, kw_only=True)
class EngineSettings:
    """How an engine computes, how loud it is and how it begins.

    Parameters
    ----------
    quality : str
        What is promised of the strings' rates and modes (`instrument.plan`): "draft", "standard", "fine" or "reference".
    scheme : str
        Contact law (`solver.schemes.LAWS`, or registered).
    restitution : float
        0 … 1, of the Moreau–Jean laws.
    internal_rate_hz : float, optional
        Rate of the strings, a multiple of the output rate; None: as planned for the quality [Hz].
    precision : str, optional
        "float64", or "float32" where strings can have their modes so (not over boards, and on a shared body only while they
        touch nothing); None: as planned (`plan.planned_precision`).
    economy : bool, optional
        Free flight at the output rate, and modes that nobody hears at rest; None: at draft and standard.
    limiter : bool
        Whether the mix stays below full scale.
    gain_db : float
        −200 … 200, of all parts [dB].
    polyphony : int, optional
        Most strings that sound at a time; None: the sum of the presets'.
    threads : int or str
        How many compute, the caller of `process` included; "auto": one per processor. No effect on the sound.
    mpe : bool
        Begin with an MPE zone of 15 members, as if the MPE configuration message had come on channel 1.
    seed : int
        0 … 2³¹ − 1, of what varies from stroke to stroke (`[hand]` of a preset): the same seed, the same performance.

    Raises
    ------
    TypeError, ValueError
        For a value that cannot be; the message names setting, condition and value.

    Examples
    --------
    >>> import synth
    >>> settings = synth.EngineSettings(quality="draft", gain_db=-6.0)
    >>> settings.economises, synth.Engine(["tanpura"], settings=settings).settings.gain_db
    (True, -6.0)
    """

    quality: str = _choice("standard", "accuracy; see `synth plan`", QUALITIES)
    scheme: str = _setting("exact-hold", f"contact law: {', '.join(LAWS)}, or an installed one", _check_scheme)
    restitution: float = _number(0.0, "restitution of the Moreau–Jean schemes, 0 (default) to 1", 0.0, 1.0, typed=(0.0, 1.0))
    internal_rate_hz: float | None = _number(
        None,
        "rate of the string model, a multiple of --rate (default: chosen by --quality)",
        0.0,
        MAXIMUM_INTERNAL_HZ,
        " Hz",
        absent="the planned one",
        typed=(44100, int(MAXIMUM_INTERNAL_HZ)),
    )
    precision: str | None = _choice(
        None,
        "precision of the strings' modes (default: float32 at draft and standard, otherwise float64)",
        PRECISIONS,
        "the planned one",
    )
    economy: bool | None = _switch(
        None, "spare what nobody hears (default: at draft and standard)", "True at draft and standard"
    )
    limiter: bool = _switch(True, "keep peaks below full scale")
    gain_db: float = _number(0.0, "gain in dB", -200.0, 200.0, " dB", typed=(-96.0, 96.0))
    polyphony: int | None = _count(
        None,
        "maximum number of strings sounding at once",
        1,
        MOST_STRINGS,
        absent="the sum of the presets'",
        typed=(1, 1024),
    )
    threads: int | str = _setting(
        1, "number of threads, or auto (default): one per processor (no effect on the sound)", _check_threads, typed=(1, 256)
    )
    mpe: bool = _switch(False, "start with an MPE zone: every note has its own channel")
    seed: int = _count(
        0,
        "seed of the variation of strokes and of the dither: the same seed gives the same sound (default 0)",
        0,
        MOST_SEED,
        typed=(0, MOST_SEED),
    )

    def __post_init__(self) -> None:
        for name, each in SETTINGS.items():
            object.__setattr__(self, name, each.checked(name, getattr(self, name)))
        if self.precision == FLOAT32 and self.scheme != "exact-hold":
            raise ValueError(f"precision float32 needs scheme exact-hold, got {self.scheme}; leave out one of the two")

    def of_engine(self, **changes: Any) -> EngineSettings:
        """These settings alone, with changes: of a job or a session, what its engine is made with."""
        return EngineSettings(**{name: getattr(self, name) for name in SETTINGS} | changes)

    @property
    def economises(self) -> bool:
        """Whether strings are spared what nobody hears."""
        return self.quality in ("draft", "standard") if self.economy is None else self.economy


#: by the names of the fields
SETTINGS: dict[str, Setting] = {each.name: each.metadata["setting"] for each in fields(EngineSettings)}
#: values that they have unless told otherwise
DEFAULTS: dict[str, Any] = {each.name: each.default for each in fields(EngineSettings)}


class EngineOptions(TypedDict, total=False):
    """The fields of EngineSettings as arguments by name, for type checkers."""

    quality: str
    scheme: str
    restitution: float
    internal_rate_hz: float | None
    precision: str | None
    economy: bool | None
    limiter: bool
    gain_db: float
    polyphony: int | None
    threads: int | str
    mpe: bool
    seed: int
