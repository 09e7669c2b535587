"""BibTeX of the sources of a run: this program, the paper that it begins with, and those of the methods that it used."""

from __future__ import annotations

from collections.abc import Iterable

from synth._version import DATE, __version__

_JASA = "The Journal of the Acoustical Society of America"
#: fields of the articles, by key
ARTICLES: dict[str, dict[str, str]] = {
    "issanchou2018": {
        "author": "Issanchou, Clara and Acary, Vincent and P{\\'e}rignon, Franck and Touz{\\'e}, Cyril and "
        'Le Carrou, Jean-Lo{\\"\\i}c',
        "title": "Nonsmooth contact dynamics for the numerical simulation of collisions in musical string instruments",
        "journal": _JASA,
        "volume": "143",
        "number": "5",
        "pages": "3195--3205",
        "year": "2018",
        "doi": "10.1121/1.5039740",
    },
    "issanchou2017": {
        "author": "Issanchou, Clara and Bilbao, Stefan and Le Carrou, Jean-Lo{\\\"\\i}c and Touz{\\'e}, Cyril and "
        "Doar{\\'e}, Olivier",
        "title": "A modal-based approach to the nonlinear vibration of strings against a unilateral obstacle: "
        "Simulations and experiments in the pointwise case",
        "journal": "Journal of Sound and Vibration",
        "volume": "393",
        "pages": "229--251",
        "year": "2017",
        "doi": "10.1016/j.jsv.2016.12.025",
    },
    "ducceschi2021": {
        "author": "Ducceschi, Michele and Bilbao, Stefan and Willemsen, Silvin and Serafin, Stefania",
        "title": "Linearly-implicit schemes for collisions in musical acoustics based on energy quadratisation",
        "journal": _JASA,
        "volume": "149",
        "number": "5",
        "pages": "3502--3516",
        "year": "2021",
        "doi": "10.1121/10.0005008",
    },
    "bilbao2023": {
        "author": "Bilbao, Stefan and Ducceschi, Michele and Zama, Fabiana",
        "title": "Explicit exactly energy-conserving methods for {Hamiltonian} systems",
        "journal": "Journal of Computational Physics",
        "volume": "472",
        "pages": "111697",
        "year": "2023",
        "doi": "10.1016/j.jcp.2022.111697",
    },
    "chadefaux2013": {
        "author": 'Chadefaux, Delphine and Le Carrou, Jean-Lo{\\"\\i}c and Fabre, Beno{\\^i}t',
        "title": "A model of harp plucking",
        "journal": _JASA,
        "volume": "133",
        "number": "4",
        "pages": "2444--2455",
        "year": "2013",
        "doi": "10.1121/1.4792249",
    },
    "weinreich1977": {
        "author": "Weinreich, Gabriel",
        "title": "Coupled piano strings",
        "journal": _JASA,
        "volume": "62",
        "number": "6",
        "pages": "1474--1484",
        "year": "1977",
        "doi": "10.1121/1.381677",
    },
}
#: the paper that the program begins with: its string and its contact problem
FIRST = "issanchou2018"
#: sources of the methods that are not this program's own, beside the paper that it begins with
_OF_SCHEMES = {
    "compliant": ("issanchou2017",),
    "energy-quadratisation": ("ducceschi2021", "issanchou2017"),
    "scalar-auxiliary-variable": ("bilbao2023", "issanchou2017"),
}


def sources_of(scheme: str, on_a_body: bool = False, slips: bool = False) -> list[str]:
    """Keys of ARTICLES that a scheme rests on; on_a_body: of strings that share one; slips: off the finger, in a while."""
    beside = ["weinreich1977"] * on_a_body + ["chadefaux2013"] * slips
    return [FIRST, *_OF_SCHEMES.get(scheme, ()), *beside]


def bibtex(scheme: str | None, sources: Iterable[str] = (FIRST,)) -> str:
    """BibTeX entries of the program, with the scheme in its title where there is one, and of ARTICLES by their keys."""
    year, month, _ = DATE.split("-")
    program = {
        "author": "{the jawari authors}",
        "title": "jawari: strings that collide" + (f", scheme {scheme}" if scheme else ""),
        "version": __version__,
        "year": year,
        "month": str(int(month)),
    }
    return "\n\n".join([_entry("software", "jawari", program), *(_entry("article", key, ARTICLES[key]) for key in sources)])


def _entry(kind: str, key: str, fields: dict[str, str]) -> str:
    lines = "".join(f"  {name:<8}= {{{value}}},\n" for name, value in fields.items())
    return f"@{kind}{{{key},\n{lines}}}"
