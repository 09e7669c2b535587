"""Kernels that compute the same bits on every processor, from those for the plainest x86-64.

Basic operations of IEEE 754 (+ − × ÷ √) have one result. What parts processors and compilers is the rest, and of that
nothing stays:

what                                          instead
permission to reorder or to contract          none
a multiplication with an addition as one      two operations, of which each rounds
exp, sin, … of a system's own                 those of c/portable_math.c
subnormal numbers counted as zero             kept, whatever the host has set (see `retarget`)

The number of lanes, and with it the order of sums, is that of `retarget.FROM_LANES` everywhere.
"""

from __future__ import annotations

import re

#: functions of c/portable_math.c, and how many numbers each takes
FUNCTIONS = {"exp": 1, "exp2": 1, "expm1": 1, "log2": 1, "pow": 2, "sin": 1, "cos": 1}

_FLAGS = "fast|reassoc|nnan|ninf|nsz|arcp|contract|afn"
_LOOSE = re.compile(
    rf"\b(fadd|fsub|fmul|fdiv|frem|fneg|fcmp|fptrunc|fpext|sitofp|uitofp|select|phi|call)((?: (?:{_FLAGS}))+) "
)
_FUSED = re.compile(
    r"^  (%\S+) = (?:tail |musttail |notail )?call (<\d+ x (?:double|float)>|double|float) "
    r"@llvm\.(?:fma|fmuladd)\.\w+\(\2 (.*), \2 (.*), \2 (.*?)\)(?: #\d+)?(?:, !.*)?$",
    re.MULTILINE,
)
_FUSED_VECTOR = re.compile(r"@llvm\.(?:fma|fmuladd)\.(v\d+f\d+)\(")
#: what such an operation is called meanwhile
_RELAXED_NAME = "jawari_relaxed"
_RELAXED = rf"@{_RELAXED_NAME}.\1("
_VECTOR = re.compile(r"@llvm\.(\w+)\.v(\d+)f64\(")


def with_one_rounding(text: str, relaxed: bool = False) -> str:
    """A module's text in which every operation has one result; relaxed: but for products of vectors with an addition, which
    a processor may do as one.

    Raises ValueError for an operation that is not known here.
    """
    text = _LOOSE.sub(r"\1 ", text)
    if relaxed:
        text = _FUSED_VECTOR.sub(_RELAXED, text)
    text = _FUSED.sub(_apart, text)
    text = re.sub(rf"^declare [^\n]*@(?:llvm\.fma|llvm\.fmuladd|{_RELAXED_NAME})\.[^\n]*$", "", text, flags=re.MULTILINE)
    for kind in sorted(set(re.findall(rf"@{_RELAXED_NAME}\.(v\d+f\d+)\(", text))):
        vector = f"<{kind[1 : kind.index('f')]} x {'double' if kind.endswith('64') else 'float'}>"
        text = text.replace(f"@{_RELAXED_NAME}.{kind}(", f"@llvm.fmuladd.{kind}(")
        text += f"\ndeclare {vector} @llvm.fmuladd.{kind}({vector}, {vector}, {vector})\n"
    text = text.replace("@sqrt(", "@llvm.sqrt.f64(")
    text = _declared_once(text, "llvm.sqrt.f64", "declare double @llvm.sqrt.f64(double)")
    for name, width in sorted({(found[1], int(found[2])) for found in _VECTOR.finditer(text)}):
        if name in FUNCTIONS:
            text = _lane_by_lane(text, name, width)
    for name, count in FUNCTIONS.items():
        before = text
        text = text.replace(f"@llvm.{name}.f64(", f"@jawari_{name}(").replace(f"@{name}(", f"@jawari_{name}(")
        if text != before:
            taken = ", ".join(["double"] * count)
            text = _declared_once(text, f"jawari_{name}", f"declare double @jawari_{name}({taken})")
    fused = "fma" if relaxed else "fma|fmuladd"
    systems = r"^declare (?:double|float) @(?!llvm\.|jawari_)[^(]*"
    if left := re.search(
        rf"@llvm\.(?:{fused}|exp|exp2|exp10|log|log2|log10|pow|powi|sin|cos|tan)\.\w+|{systems}", text, re.M
    ):
        raise ValueError(f"the kernels use {left[0]}, which has no portable replacement; see {__name__}")
    return text


def _apart(found: re.Match[str]) -> str:
    """A product and a sum in the place of one operation."""
    result, kind, x, y, z = found.groups()
    product = f'%"{result[1:].strip(chr(34))}.product"'
    return f"  {product} = fmul {kind} {x}, {y}\n  {result} = fadd {kind} {product}, {z}"


def _declared_once(text: str, name: str, declaration: str) -> str:
    """A module's text that declares a function exactly once."""
    text = re.sub(rf"^declare [^\n]*@{re.escape(name)}\([^\n]*$", "", text, flags=re.MULTILINE)
    return f"{text}\n{declaration}\n"


def _lane_by_lane(text: str, name: str, width: int) -> str:
    """A module's text with a function of vectors written as calls of the function of numbers."""
    intrinsic, own, kind = f"llvm.{name}.v{width}f64", f"jawari.{name}.v{width}f64", f"<{width} x double>"
    count = FUNCTIONS[name]
    text = re.sub(rf"^declare [^\n]*@{re.escape(intrinsic)}\([^\n]*$", "", text, flags=re.MULTILINE)
    text = text.replace(f"@{intrinsic}(", f"@{own}(")
    lines, before = [], "undef"
    for lane in range(width):
        given = []
        for k in range(count):
            lines.append(f"  %a{k}.{lane} = extractelement {kind} %a{k}, i32 {lane}")
            given.append(f"double %a{k}.{lane}")
        lines.append(f"  %r.{lane} = call double @llvm.{name}.f64({', '.join(given)})")
        lines.append(f"  %v.{lane} = insertelement {kind} {before}, double %r.{lane}, i32 {lane}")
        before = f"%v.{lane}"
    taken = ", ".join(f"{kind} %a{k}" for k in range(count))
    body = "\n".join(lines)
    return f"{text}\ndefine internal {kind} @{own}({taken}) {{\n{body}\n  ret {kind} {before}\n}}\n"
