"""Portable kernels: one result of every operation. Whole takes on different processors are compared in test_systems."""

from __future__ import annotations

import ctypes
import math
import random
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import mpmath
import pytest

from synth.plugin.one_rounding import FUNCTIONS, with_one_rounding
from synth.plugin.wasm_memory import with_words

SOURCE = Path(__file__).resolve().parents[2] / "synth" / "plugin" / "c" / "portable_math.c"
#: units in the last place, as portable_math.c says
ULPS = 2.0


@pytest.fixture(scope="module")
def functions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Callable[..., float]]:
    """Those of c/portable_math.c, by name."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("a C compiler (cc) is missing")
    built = tmp_path_factory.mktemp("math") / "portable.so"
    seen = "-DHIDDEN="  # what is hidden in the library is to be called here
    text = SOURCE.read_text(encoding="utf-8")
    own = built.with_suffix(".c")
    own.write_text(re.sub(r"^#define HIDDEN .*$", "", text, flags=re.MULTILINE), encoding="utf-8")
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-shared", "-fPIC", f"-I{SOURCE.parent}", seen]
    command = [compiler, *flags, str(own), "-o", str(built)]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(built))
    found = {}
    for name, count in FUNCTIONS.items():
        function = getattr(library, f"jawari_{name}")
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * count
        found[name] = function
    return found


def _signed(draw: random.Random, low: float, high: float) -> float:
    return draw.choice((-1, 1)) * 10.0 ** draw.uniform(low, high)


_TRUE: dict[str, tuple[Callable, Callable[[random.Random], tuple[float, ...]]]] = {
    "exp": (mpmath.exp, lambda r: (r.choice((r.uniform(-745, 709), r.uniform(-1, 1), _signed(r, -20, 0))),)),
    "exp2": (lambda x: mpmath.mpf(2) ** x, lambda r: (r.choice((r.uniform(-1074, 1023), r.uniform(-2, 2))),)),
    "expm1": (mpmath.expm1, lambda r: (r.choice((r.uniform(-30, 700), r.uniform(-1, 1), _signed(r, -20, 0))),)),
    "log2": (
        lambda x: mpmath.log(x, 2),
        lambda r: (r.choice((10.0 ** r.uniform(-320, 308), r.uniform(0.5, 2.0), 1 + _signed(r, -16, -1))),),
    ),
    "sin": (mpmath.sin, lambda r: (r.choice((_signed(r, -20, 11.9), r.randrange(1, 10**6) * math.pi / 2)),)),
    "cos": (mpmath.cos, lambda r: (r.choice((_signed(r, -20, 11.9), r.randrange(1, 10**6) * math.pi / 2)),)),
    "pow": (
        lambda x, y: x**y,
        lambda r: r.choice(
            (
                (10.0, r.uniform(-5, 5)),
                (2.0, r.uniform(-1000, 1000)),
                (10.0 ** r.uniform(-30, 30), r.uniform(-9, 9)),
                (r.uniform(0.9, 1.1), r.uniform(-5000, 5000)),
            )
        ),
    ),
}


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_are_as_near_as_they_say(functions, name):
    true, draw = _TRUE[name]
    numbers = random.Random(7)
    with mpmath.workprec(300):
        for _ in range(4000):
            given = draw(numbers)
            value, wanted = functions[name](*given), true(*map(mpmath.mpf, given))
            assert abs(mpmath.mpf(value) - wanted) <= ULPS * math.ulp(float(wanted)), given


def test_functions_at_the_ends_are_those_of_c(functions):
    """C99, annex F; but for sin and cos of angles that have no bits left, which are no numbers."""
    infinite, none = math.inf, math.nan
    for name, given, wanted in (
        ("exp", -infinite, 0.0),
        ("exp", 710.0, infinite),
        ("exp2", 1024.0, infinite),
        ("exp2", -1074.0, 5e-324),
        ("exp2", -1076.0, 0.0),
        ("expm1", -infinite, -1.0),
        ("expm1", infinite, infinite),
        ("expm1", 1e-320, 1e-320),
        ("log2", 0.0, -infinite),
        ("log2", infinite, infinite),
        ("log2", -1.0, none),
        ("log2", 5e-324, -1074.0),
        ("sin", infinite, none),
        ("cos", 0.0, 1.0),
        ("cos", none, none),
    ):
        value = functions[name](given)
        assert value == wanted or (value != value and wanted != wanted), (name, given, value)
    assert math.copysign(1.0, functions["sin"](-0.0)) == -1.0
    for x in (0.0, -0.0, 1.0, -1.0, 2.0, -2.0, infinite, -infinite, none):
        for y in (0.0, 1.0, -1.0, 2.0, 3.0, -3.0, infinite, -infinite, none, 1e300):
            try:
                wanted = math.pow(x, y)
            except (ValueError, OverflowError):  # Python refuses what C answers: a pole, or beyond the largest
                wanted = math.copysign(infinite, x) if y in (-1.0, -3.0) else infinite
            value = functions["pow"](x, y)
            assert (value == wanted and math.copysign(1.0, value) == math.copysign(1.0, wanted)) or (
                value != value and wanted != wanted
            ), (x, y, value)


LOOSE = """
define <2 x double> @f(<2 x double> %x, <2 x double> %y, double %z) {
  %1 = tail call <2 x double> @llvm.fma.v2f64(<2 x double> %x, <2 x double> <double 1.0, double 2.0>, <2 x double> %y)
  %"a b" = fmul reassoc nsz contract <2 x double> %1, %y
  %c = call reassoc double @llvm.exp.f64(double %z), !tbaa !4
  %d = call double @llvm.fma.f64(double %z, double %c, double 1.0)
  %e = call <2 x double> @llvm.cos.v2f64(<2 x double> %"a b")
  %g = insertelement <2 x double> %e, double %d, i32 0
  ret <2 x double> %g
}
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>) #1
declare double @llvm.fma.f64(double, double, double)
declare double @llvm.exp.f64(double)
declare <2 x double> @llvm.cos.v2f64(<2 x double>)
attributes #1 = { nounwind }
!4 = !{}
"""


def test_nothing_is_left_to_a_compilers_taste():
    import llvmlite.binding as llvm

    text = with_one_rounding(LOOSE.replace(", !tbaa !4", ""))
    assert not re.search(r"\b(?:fast|reassoc|contract|nsz)\b|llvm\.(?:fma|cos|exp)", text)
    assert text.count("fmul <2 x double>") == 2 and text.count("fadd double") == 1
    assert len(re.findall(r"call double @jawari_cos\(", text)) == 2
    llvm.parse_assembly(text).verify()


def test_relaxed_kernels_leave_products_of_vectors_with_an_addition_to_the_processor():
    import llvmlite.binding as llvm

    text = with_one_rounding(LOOSE.replace(", !tbaa !4", ""), relaxed=True)
    assert text.count("call <2 x double> @llvm.fmuladd.v2f64(") == 1 and "llvm.fma." not in text
    assert text.count("fadd double") == 1
    llvm.parse_assembly(text).verify()


def test_an_operation_of_the_systems_is_refused():
    with pytest.raises(ValueError, match=r"llvm\.log10\.f64, which has no portable replacement"):
        with_one_rounding("%x = call double @llvm.log10.f64(double %y)\n")


def test_records_of_addresses_take_eight_bytes_each():
    record = "{ ptr, ptr, i64, i64, ptr, [2 x i64], [2 x i64] }"
    text = with_words(
        f"  %a = alloca {record}, align 8\n"
        f"  %b = getelementptr inbounds {record}, ptr %a, i32 0, i32 6\n"
        f"  %c = load {record}, ptr %a, align 8\n"
    )
    assert "%a = alloca [9 x i64]" in text and "getelementptr inbounds i8, ptr %a, i32 56" in text
    assert text.count("load ptr") == 3 and text.count("load [2 x i64]") == 2
    with pytest.raises(ValueError, match="a record of addresses in memory"):
        with_words("  %a = alloca { ptr, i32 }, align 8\n")
