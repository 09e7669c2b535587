"""Makes the demo songs beside this script: drone.mid (tanpura) and bassline.mid (fretted bass).

    python presets/demos/make_demos.py [DIRECTORY]

The songs are this project's own; change them here and run the script again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mido

TICKS_PER_BEAT = 480
# General MIDI programs, counted from 0.
SITAR = 104
FINGERED_BASS = 33


def _song(
    name: str, tempo_bpm: float, program: int, notes: list[tuple[float, float, int, int]], beats: float
) -> mido.MidiFile:
    """A format-1 file: `notes` are (beat, length in beats, MIDI note, velocity), the song is `beats` long."""
    song = mido.MidiFile(type=1, ticks_per_beat=TICKS_PER_BEAT)
    conductor = mido.MidiTrack()
    conductor.append(mido.MetaMessage("set_tempo", tempo=mido.bpm2tempo(tempo_bpm)))
    conductor.append(mido.MetaMessage("time_signature", numerator=4, denominator=4))
    conductor.append(mido.MetaMessage("end_of_track", time=round(beats * TICKS_PER_BEAT)))
    track = mido.MidiTrack()
    track.append(mido.MetaMessage("track_name", name=name))
    timed = [(0, 0, mido.Message("program_change", program=program))]
    for beat, length, note, velocity in notes:
        start, end = round(beat * TICKS_PER_BEAT), round((beat + length) * TICKS_PER_BEAT)
        timed.append((start, 2, mido.Message("note_on", note=note, velocity=velocity)))
        timed.append((end, 1, mido.Message("note_off", note=note, velocity=64)))
    timed.sort(key=lambda item: item[:2])
    now = 0
    for tick, _, message in timed:
        track.append(message.copy(time=tick - now))
        now = tick
    track.append(mido.MetaMessage("end_of_track", time=round(beats * TICKS_PER_BEAT) - now))
    song.tracks += [conductor, track]
    return song


def drone() -> mido.MidiFile:
    """Pa–Sa–Sa–Sa on a tanpura in C, six rounds of five beats in 30 s; every string rings until it is
    plucked again.
    """
    pa, sa, low_sa = 43, 48, 36
    cycle = [(0.0, pa, 76), (1.25, sa, 80), (2.0, sa, 72), (2.75, low_sa, 84)]
    # A hand is not a machine: the rounds differ a little, the same way every time.
    lean = [0, 4, -5, 2, -3, 6]
    notes = [
        (5.0 * turn + beat, 5.0 if note != sa else 0.75 if beat < 2.0 else 4.25, note, velocity + lean[turn])
        for turn in range(6)
        for beat, note, velocity in cycle
    ]
    beats = 30.0
    notes = [(beat, min(length, beats - beat), note, velocity) for beat, length, note, velocity in notes]
    return _song("Drone", 60.0, SITAR, notes, beats)


def bassline() -> mido.MidiFile:
    """Eight bars in E minor at 100 beats a minute (19.2 s): thumb on the low strings, slapped and popped
    accents, ghosts.
    """
    thumb, slap, pop, ghost = 92, 120, 127, 34
    bars = []
    for root in (28, 28, 33, 28, 31, 33, 28, 28):  # E E A E G A E E
        bars.append(
            [
                (0.0, 0.45, root, slap),
                (0.75, 0.2, root, ghost),
                (1.0, 0.3, root + 12, pop),
                (1.5, 0.4, root, thumb),
                (2.0, 0.45, root + 7, thumb),
                (2.5, 0.2, root + 10, thumb - 8),
                (2.75, 0.2, root + 10, ghost),
                (3.0, 0.3, root + 12, pop - 5),
                (3.5, 0.4, root + 10, slap - 10),
            ]
        )
    # The last bar comes to rest on a long low E.
    bars[-1] = [(0.0, 0.45, 28, slap), (1.0, 0.3, 40, pop), (1.5, 0.4, 38, thumb), (2.0, 2.0, 28, slap)]
    notes = [
        (4.0 * number + beat, length, note, velocity)
        for number, bar in enumerate(bars)
        for beat, length, note, velocity in bar
    ]
    return _song("Bass line", 100.0, FINGERED_BASS, notes, 32.0)


def main(directory: Path) -> None:
    """Writes both songs to `directory`."""
    drone().save(directory / "drone.mid")
    bassline().save(directory / "bassline.mid")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
