"""Strings by their makers' names: gauge and unit weight.

The unit weights are those of D'Addario's brochure "A Complete Technical Reference for Fretted Instrument String Tensions"
(chart 13934), compared with programs that quote it: PL, NW and XLB with three or more of them, PB with one. Newer tables of
the maker's differ by a few per cent for some of the wound strings.

PL    plain steel
NW    XL nickel-plated steel, round wound, for guitars
PB    phosphor bronze, round wound, for steel-string guitars
XLB   XL nickel-plated steel, round wound, for basses of long scale; P at the end: plain

A name has the gauge in thousandths of an inch, PL0085 in ten-thousandths.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from synth.spelling import perhaps

#: metres of an inch, kilograms of a pound
INCH_M, POUND_KG = 0.0254, 0.45359237

#: gauge → unit weight [10⁻⁸ lb/in]
_PLAIN = {
    "007": 1085, "008": 1418, "0085": 1601, "009": 1794, "0095": 1999, "010": 2215, "0105": 2442, "011": 2680,
    "0115": 2930, "012": 3190, "013": 3744, "0135": 4037, "014": 4342, "015": 4984, "016": 5671, "017": 6402,
    "018": 7177, "019": 7997, "020": 8861, "022": 10722, "024": 12760, "026": 14975,
}  # fmt: skip
_NICKEL = {
    "017": 5524, "018": 6215, "019": 6947, "020": 7495, "021": 8293, "022": 9184, "024": 10857, "026": 12671,
    "028": 14666, "030": 17236, "032": 19347, "034": 21590, "036": 23964, "038": 26471, "039": 27932, "042": 32279,
    "044": 35182, "046": 38216, "048": 41382, "049": 43014, "052": 48109, "054": 53838, "056": 57598, "059": 64191,
    "060": 66542, "062": 70697, "064": 74984, "066": 79889, "068": 84614, "070": 89304, "072": 94124, "074": 98869,
    "080": 115011,
}  # fmt: skip
_BRONZE = {
    "020": 8106, "021": 8944, "022": 9876, "023": 10801, "024": 11682, "025": 12686, "026": 13640, "027": 14834,
    "029": 17381, "030": 18660, "032": 21018, "034": 23887, "035": 25365, "036": 26824, "039": 31124, "042": 36722,
    "045": 41751, "047": 45289, "049": 49151, "052": 55223, "053": 56962, "056": 63477, "059": 70535, "060": 73039,
    "062": 77682, "064": 82780, "066": 87718, "070": 96833,
}  # fmt: skip
_BASS = {
    "018P": 7265, "020P": 9093, "028W": 15433, "032": 19000, "035": 22362, "040": 29322, "042": 32252, "045": 37240,
    "050": 46463, "052": 51322, "055": 54816, "060": 66540, "065": 79569, "070": 93218, "075": 104973, "080": 116023,
    "085": 133702, "090": 150277, "095": 169349, "100": 179687, "105": 198395, "110": 227440, "120": 250280,
    "125": 274810, "130": 301941, "135": 315944, "145": 363204,
}  # fmt: skip


@dataclass(frozen=True)
class Wire:
    """A string as it is sold. gauge_in: its diameter [inch]; unit_weight_lb_in: its mass [lb/in]; wound, or plain."""

    name: str
    gauge_in: float
    unit_weight_lb_in: float
    wound: bool

    @property
    def diameter_m(self) -> float:
        return self.gauge_in * INCH_M

    @property
    def linear_density_kg_m(self) -> float:
        return self.unit_weight_lb_in * POUND_KG / INCH_M


def _wire(series: str, gauge: str, weight: int) -> Wire:
    digits = gauge.rstrip("PW")
    return Wire(
        series + gauge,
        float(f"0.{digits}"),
        1e-8 * weight,
        series != "PL" and not gauge.endswith("P"),
    )


_SERIES = {"PL": _PLAIN, "NW": _NICKEL, "PB": _BRONZE, "XLB": _BASS}
WIRES: dict[str, Wire] = {
    series + gauge: _wire(series, gauge, weight) for series, table in _SERIES.items() for gauge, weight in table.items()
}


def _near(name: str) -> str:
    """A name that may be meant: of the same series the nearest gauge, else one that is written alike."""
    found = re.fullmatch(r"([A-Z]+)(\d+)[PW]?", name.upper())
    if found is None or found[1] not in _SERIES:
        return perhaps(name, WIRES)
    gauge = float(f"0.{found[2]}")
    nearest = min((WIRES[found[1] + each] for each in _SERIES[found[1]]), key=lambda each: abs(each.gauge_in - gauge))
    return f" (perhaps {nearest.name}?)"


def wire(name: str) -> Wire:
    """The string of a name, in capital letters or not. Raises ValueError for one that is not in the table."""
    found = WIRES.get(name.upper())
    if found is None:
        raise ValueError(
            f"string {name!r} is not in the table{_near(name)}; it has plain steel PL007 to PL026, nickel NW017 to NW080, "
            "bronze PB020 to PB070 and bass XLB018P to XLB145: for another one give its mass and diameter in [[string]]"
        )
    return found
