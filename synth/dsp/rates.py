"""Sample rates that can be: of the output, and of the strings, which is a whole multiple of it."""

from __future__ import annotations

#: lowest output rate, at which 20 kHz passes the decimator, and highest: no converter runs faster [Hz]
MINIMUM_RATE_HZ, MAXIMUM_RATE_HZ = 44100.0, 768_000.0
#: largest multiple
MAXIMUM_FACTOR = 64
#: highest rate of strings [Hz]
MAXIMUM_INTERNAL_HZ = MAXIMUM_FACTOR * MAXIMUM_RATE_HZ
