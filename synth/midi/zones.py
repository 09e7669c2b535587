"""Which channels an MPE zone holds: plain Python that the core compiles as it stands, and hosts use as it is.

MIDI Polyphonic Expression (M1-100-UM): the lower zone has its master on channel 1 and its members from 2 upwards, the upper
one on 16 and from 15 downwards. Channels are counted from 0 here.
"""

from __future__ import annotations

#: zones
LOWER, UPPER = range(2)
CHANNELS = 16
MOST_MEMBERS = CHANNELS - 1
#: registered parameter number of the MPE configuration message, its value the number of members
CONFIGURATION = 6


def manager_of(zone: int) -> int:
    """The master channel of a zone."""
    return 0 if zone == LOWER else CHANNELS - 1


def yielded(members: int, other: int) -> int:
    """How many members a zone of `other` keeps when the other zone gets `members`."""
    return max(0, min(other, CHANNELS - 2 - members))


def master_of(channel: int, lower: int, upper: int) -> int:
    """The master of a channel's zone, where the zones have so many members; itself outside of zones."""
    if 0 < channel <= lower:
        return 0
    if CHANNELS - 1 - upper <= channel < CHANNELS - 1:
        return CHANNELS - 1
    return channel
