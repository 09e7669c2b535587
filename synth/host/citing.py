"""BibTeX of the program and of what a result, a sound or an instrument used."""

from __future__ import annotations

from synth.host.preset_sources import sources_of_presets
from synth.host.soundclip import Sound
from synth.instrument.preset import Preset
from synth.research.citations import bibtex
from synth.research.coupled.coupled_result import CoupledResult
from synth.research.result import Result


def cite(what: Result | CoupledResult | Sound | Preset | None = None) -> str:
    """BibTeX of the program and of the papers whose methods were used.

    Parameters
    ----------
    what : Result, CoupledResult, Sound or Preset, optional
        What is cited. None: the program and the paper that it begins with. Of a result or a sound: what its `citation()`
        gives, the scheme named in the program's title. Of a preset: what its strings use with the scheme exact-hold.

    Returns
    -------
    str
        Entries one after the other: the program at its present version, then articles. Beside the first paper these are the
        sources of a compliant scheme, of strings on a shared body, and of fingers off which the string slides in a while.
        Methods of the program's own have no article.

    Raises
    ------
    TypeError
        For what is of another kind.

    References
    ----------
    Issanchou, Acary, Pérignon, Touzé, Le Carrou, JASA 143(5), 2018: the paper that the program begins with.

    Examples
    --------
    >>> import synth
    >>> print(synth.cite())
    @software{jawari,
      author  = {{the jawari authors}},
      title   = {jawari: strings that collide},
      ...
    >>> "Coupled piano strings" in synth.cite(synth.load_preset("steel-guitar"))
    True
    """
    if what is None:
        return bibtex(None)
    if isinstance(what, Result | CoupledResult | Sound):
        return what.citation()
    if isinstance(what, Preset):
        return bibtex(None, sources_of_presets("exact-hold", [what]))
    raise TypeError(f"cite takes a Result, CoupledResult, Sound, Preset or None, got {type(what).__name__} {what!r:.60}")
