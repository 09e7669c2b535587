"""Kernels as objects for any target, from the intermediate code that Numba has made on x86-64.

Numba compiles for the machine that it runs on. But what it makes is LLVM's intermediate code, and of that little is x86's
own: numbers and addresses lie in memory alike, and a multiplication with an addition is one instruction on AArch64 too.
What is x86's own (the control register, waiting, an atomic operation) is written anew here; and where the system is not
Linux, its functions are those of the C part (c/system.h) that do the same.

level           made from                computes
x86-64-v3, -v4  the same                 on every system the same but for the system's exp, sin, …
aarch64         x86-64, two lanes        what the others do but for rounding (1e-13 of full scale)
portable        x86-64, two lanes        the same bits everywhere (`one_rounding`)
relaxed         x86-64, two lanes        of wasm32 alone: products of vectors with an addition may round once
"""

from __future__ import annotations

import re

from synth.plugin.one_rounding import with_one_rounding
from synth.plugin.platforms import Target
from synth.plugin.wasm_memory import with_words

#: the level of x86-64 and the lanes from which other processors' kernels are made: what all have
FROM_LEVEL, FROM_LANES = "x86-64", 2
#: what LLVM is told of a processor: name, instructions
_PROCESSORS = {
    "x86-64": ("x86-64", ""),
    "arm64": ("generic", ""),
    "wasm32": ("generic", "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals"),
}
#: how the levels that a processor has begin, but for "portable"
_LEVELS = {"x86-64": ("x86-64",), "arm64": ("aarch64",), "wasm32": ("relaxed",)}
#: functions of a system that kernels call, and the C part has as jawari_system_NAME
_SYSTEM = ("nanosleep", "clock_gettime", "sched_yield", "read", "write")

_SUBTRACT = """
define internal i8 @jawari.sub.cc.i64(ptr %place, i64 %less, i32 %condition) {
  %before = atomicrmw sub ptr %place, i64 %less seq_cst
  %zero = icmp eq i64 %before, %less
  %answer = zext i1 %zero to i8
  ret i8 %answer
}
"""
#: what stands in the place of x86's: MXCSR's flush-to-zero (bit 15, with 6) is FPCR's bit 24
_ARM64 = {
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
    "llvm.x86.atomic.sub.cc.i64": _SUBTRACT,
}
#: WebAssembly keeps subnormal numbers, and its engine has one thread
_WASM32 = {
    "llvm.x86.sse2.pause": "define internal void @jawari.pause() {\n  ret void\n}\n",
    "llvm.x86.sse.stmxcsr": "define internal void @jawari.stmxcsr(ptr %place) {\n  store i32 0, ptr %place\n  ret void\n}\n",
    "llvm.x86.sse.ldmxcsr": "define internal void @jawari.ldmxcsr(ptr %place) {\n  ret void\n}\n",
    "llvm.x86.atomic.sub.cc.i64": _SUBTRACT,
}
_INSTEAD: dict[str, dict[str, str]] = {"x86-64": {}, "arm64": _ARM64, "wasm32": _WASM32}


def object_of(text: str, level: str, target: Target) -> bytes:
    """The object for a target's linker of a module's text, which `emit.intermediate` has made for a level.

    Raises ValueError for a level that the target's processor does not have, and for something of x86's own that is not known
    here.
    """
    import llvmlite.binding as llvm

    if not level.startswith(("portable", *_LEVELS[target.processor])):
        raise ValueError(f"{target.name} has no level {level}; use {', '.join(target.levels)} or portable")
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    if level in ("portable", "aarch64", "relaxed"):
        text = _for_processor(text, target.processor, level == "portable")
    if level in ("portable", "relaxed"):
        text = with_one_rounding(text, relaxed=level == "relaxed")
    if target.processor == "wasm32":
        text = with_words(text)
    if target.system != "linux":
        for name in _SYSTEM:
            text = re.sub(rf"@{name}\b", f"@jawari_system_{name}", text)
    processor, instructions = _PROCESSORS[target.processor]
    if level.startswith("x86-64"):
        processor = level
    if level == "relaxed":
        instructions += ",+relaxed-simd"
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=processor,
        features=instructions,
        opt=3,
        reloc="static" if target.processor == "wasm32" else "pic",
        codemodel="default",
    )
    text = re.sub(r"^target datalayout = .*$", f'target datalayout = "{machine.target_data}"', text, flags=re.MULTILINE)
    text = re.sub(r"^target triple = .*$", f'target triple = "{target.triple}"', text, flags=re.MULTILINE)
    module = llvm.parse_assembly(text)
    module.verify()
    # kernels are optimised: what nobody calls is left out, and that is all
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    return bytes(machine.emit_object(module))


def _for_processor(text: str, processor: str, portable: bool) -> str:
    """A module's text without what is x86's own, where the processor is another; where it is x86 and the kernels are
    portable, flush-to-zero is seen and set the other way round: kernels that switch it on switch it off, and leave it
    as it was."""
    if other := re.search(r"@llvm\.x86\.atomic\.sub\.cc\.i64\([^)]*i32 (?!4\))(\d+)\)", text):
        raise ValueError(f"the kernels test condition {other[1]} after a subtraction, but only 4, equal, is supported here")
    instead = dict(_INSTEAD[processor])
    if portable and processor != "wasm32":
        instead |= _inverted(instead)
    for name in instead:
        own = f"jawari.{name.split('.', 3)[-1]}"
        text = re.sub(rf"^declare [^\n]*@{re.escape(name)}\([^\n]*$", "", text, flags=re.MULTILINE)
        text = text.replace(f"@{name}(", f"@{own}(")
    text += "".join(instead.values())
    if processor != "x86-64" and (left := re.search(r"@(llvm\.x86\.[\w.]+)", text)):
        raise ValueError(f"the kernels use {left[1]}, which has no replacement for {processor}; see {__name__}")
    return text


def _inverted(instead: dict[str, str]) -> dict[str, str]:
    """The two functions of the control register with flush-to-zero inverted: of those that a processor has instead, or of
    x86's own."""
    own = """
declare void @llvm.x86.sse.stmxcsr(ptr)
declare void @llvm.x86.sse.ldmxcsr(ptr)
define internal void @jawari.real.stmxcsr(ptr %place) {
  call void @llvm.x86.sse.stmxcsr(ptr %place)
  ret void
}
define internal void @jawari.real.ldmxcsr(ptr %place) {
  call void @llvm.x86.sse.ldmxcsr(ptr %place)
  ret void
}
"""
    if "llvm.x86.sse.stmxcsr" in instead:
        own = "".join(instead[f"llvm.x86.sse.{name}"] for name in ("stmxcsr", "ldmxcsr"))
        own = own.replace("@jawari.stmxcsr(", "@jawari.real.stmxcsr(").replace("@jawari.ldmxcsr(", "@jawari.real.ldmxcsr(")
    read = """
define internal void @jawari.stmxcsr(ptr %place) {
  call void @jawari.real.stmxcsr(ptr %place)
  %as = load i32, ptr %place
  %inverted = xor i32 %as, 32832
  store i32 %inverted, ptr %place
  ret void
}
"""
    write = """
define internal void @jawari.ldmxcsr(ptr %place) {
  %as = load i32, ptr %place
  %inverted = xor i32 %as, 32832
  %own = alloca i32
  store i32 %inverted, ptr %own
  call void @jawari.real.ldmxcsr(ptr %own)
  ret void
}
"""
    return {"llvm.x86.sse.stmxcsr": own + read, "llvm.x86.sse.ldmxcsr": write}
