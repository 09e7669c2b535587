"""What a machine is known by where its figures stand: processor, clock, cores, caches; never its name or a place on it."""

from __future__ import annotations

import platform
import subprocess
from pathlib import Path
from typing import NamedTuple

from synth.native.processors import cores, model

_SYSTEM = Path("/")
_UNITS = {"K": 1, "M": 1024, "G": 1024**2}


class Machine(NamedTuple):
    """processor: its model; mhz: its clock, 0 where the system does not tell; cores: those that may be used here;
    caches: level and size [KiB] of those that hold data, of the first core, such as {"L2": 1024}."""

    processor: str
    mhz: int
    cores: int
    caches: dict[str, int]

    @property
    def same(self) -> tuple[str, int, int]:
        """What tells machines apart: model, clock to 100 MHz (it is never read twice the same), cores."""
        return self.processor, round(self.mhz / 100), self.cores

    @property
    def words(self) -> str:
        """Model and clock."""
        return f"{self.processor}, {self.mhz / 1e3:.1f} GHz" if self.mhz else self.processor

    @property
    def short(self) -> str:
        """The same without marks and general words."""
        left = {"intel", "amd", "cpu", "processor"}
        plain = self.processor.replace("(R)", "").replace("(TM)", "").partition("@")[0].split()
        name = " ".join(word for word in plain if word.lower() not in left) or self.processor
        return f"{name} {self.mhz / 1e3:.1f} GHz" if self.mhz else name


def here(system: Path = _SYSTEM) -> Machine:
    """This machine, as the system below `system` describes it."""
    name, mhz = model(system), 0.0
    for line in _read(system / "proc/cpuinfo").splitlines():
        what, _, value = (part.strip() for part in line.partition(":"))
        if what == "cpu MHz" and not mhz:
            mhz = float(value)
    base = _read(system / "sys/devices/system/cpu/cpu0/cpufreq/base_frequency")  # kHz; /proc/cpuinfo says what it is now
    if base:
        mhz = int(base) / 1e3
    if not name and platform.system() == "Darwin":
        done = subprocess.run(["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, text=True)
        name = done.stdout.strip() if done.returncode == 0 else ""
    return Machine(name or platform.processor() or platform.machine(), round(mhz), cores(), _caches(system))


def _caches(system: Path) -> dict[str, int]:
    found = {}
    for folder in sorted((system / "sys/devices/system/cpu/cpu0/cache").glob("index*")):
        size = _read(folder / "size")
        if size and _read(folder / "type") != "Instruction":
            found[f"L{_read(folder / 'level')}"] = int(size.rstrip("KMG")) * _UNITS.get(size[-1], 1)
    return found


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
