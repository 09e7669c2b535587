"""Kernels for AArch64, from those for the plainest x86-64.

Numba compiles for the machine that it runs on. But what it makes is LLVM's intermediate code, and of that little is x86's
own: vectors are of two doubles on both, numbers and addresses lie in memory alike, and a multiplication with an addition is
one instruction there too. What is x86's own (the control register, waiting, an atomic operation) is written anew here.

The kernels come from the optimiser as it works for x86-64: they compute what the others do but for rounding (1e-13 of full
scale), not what a Numba on AArch64 would, bit for bit.
"""

from __future__ import annotations

import re
from typing import Any

TRIPLE = "aarch64-unknown-linux-gnu"
#: the level of x86-64 and the lanes from which AArch64's are made: what both have
FROM_LEVEL, FROM_LANES = "x86-64", 2

#: what stands in the place of x86's: MXCSR's flush-to-zero (bit 15, with 6) is FPCR's bit 24
_INSTEAD = {
    "llvm.x86.sse2.pause": """
define internal void @jawari.pause() {
  call void @llvm.aarch64.hint(i32 1)
  ret void
}
declare void @llvm.aarch64.hint(i32)
""",
    "llvm.x86.sse.stmxcsr": """
define internal void @jawari.stmxcsr(ptr %place) {
  %control = call i64 @llvm.aarch64.get.fpcr()
  %flush = and i64 %control, 16777216
  %set = icmp ne i64 %flush, 0
  %as = select i1 %set, i32 32832, i32 0
  store i32 %as, ptr %place
  ret void
}
""",
    "llvm.x86.sse.ldmxcsr": """
define internal void @jawari.ldmxcsr(ptr %place) {
  %as = load i32, ptr %place
  %flush = and i32 %as, 32768
  %set = icmp ne i32 %flush, 0
  %control = call i64 @llvm.aarch64.get.fpcr()
  %without = and i64 %control, -16777217
  %with = or i64 %control, 16777216
  %new = select i1 %set, i64 %with, i64 %without
  call void @llvm.aarch64.set.fpcr(i64 %new)
  ret void
}
declare i64 @llvm.aarch64.get.fpcr()
declare void @llvm.aarch64.set.fpcr(i64)
""",
    "llvm.x86.atomic.sub.cc.i64": """
define internal i8 @jawari.sub.cc.i64(ptr %place, i64 %less, i32 %condition) {
  %before = atomicrmw sub ptr %place, i64 %less seq_cst
  %zero = icmp eq i64 %before, %less
  %answer = zext i1 %zero to i8
  ret i8 %answer
}
""",
}


def retargeted(text: str) -> tuple[Any, Any]:
    """(module, machine that writes objects of it) for AArch64, of a module's text for FROM_LEVEL.

    Raises ValueError for something of x86's own that is not known here.
    """
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(cpu="generic", features="", opt=3, reloc="pic", codemodel="default")
    text = re.sub(r"^target datalayout = .*$", f'target datalayout = "{machine.target_data}"', text, flags=re.MULTILINE)
    text = re.sub(r"^target triple = .*$", f'target triple = "{TRIPLE}"', text, flags=re.MULTILINE)
    text = re.sub(r"^declare [^\n]*@llvm\.x86\.[^\n]*$", "", text, flags=re.MULTILINE)
    if other := re.search(r"@llvm\.x86\.atomic\.sub\.cc\.i64\([^)]*i32 (?!4\))(\d+)\)", text):
        raise ValueError(f"the kernels test condition {other[1]} after a subtraction, but only 4, equal, is supported here")
    for name, instead in _INSTEAD.items():
        text = text.replace(f"@{name}(", f"@jawari.{name.split('.', 3)[-1]}(") + instead
    if left := re.search(r"@(llvm\.x86\.[\w.]+)", text):
        raise ValueError(f"the kernels use {left[1]}, which has no replacement for AArch64; see {__name__}")
    module = llvm.parse_assembly(text)
    module.verify()
    return module, machine
