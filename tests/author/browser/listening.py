"""What the page plays, kept as it comes and as it goes out, against what `synth render` writes."""

import mido
import numpy as np
import soundfile

from tests.author.browser.running import floats
from tests.forkserver import prepared
from tests.patience import compiling_s

RATE_HZ = 44100

# What the page receives, and what its audio thread puts out, both from the player's own events.
LISTEN = """
window.heard = {received: [], played: []};
for (const type of ["received", "played"])
  document.getElementById("player").addEventListener(type, ({detail}) => window.heard[type].push(detail));
"""
FORGET = "window.heard = {received: [], played: []};"
FRAMES = """
const last = window.heard.played.at(-1);
const parts = window.heard.played.filter((part) => part.stream === last.stream);
return parts.reduce((frames, part) => frames + part.samples.length / 2, 0);
"""
# [first frame, base64 of the samples] of the newest stream's parts
PARTS = """
const parts = window.heard[arguments[0]];
const { stream } = window.heard.played.at(-1);
return parts.filter((part) => part.stream === stream).map(({frame, samples}) => {
  const bytes = new Uint8Array(samples.buffer, samples.byteOffset, samples.byteLength);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return [frame, btoa(text)];
});
"""


def silence(page):
    """Nothing sounds, so that nothing fades over what comes next, and nothing is remembered."""
    page.click(".player-phrases .quiet")
    page.until(lambda: "sounding" not in page.script("return document.getElementById('player').className"))
    page.result("await new Promise((done) => setTimeout(done, 200))")  # a fade takes 6 ms
    page.script(FORGET)


def heard(page, kind):
    """[(first frame, samples (frames, 2))]: the newest stream's parts."""
    return [(first, floats(text).reshape(-1, 2)) for first, text in page.script(PARTS, kind)]


def is_beginning_of(parts, want):
    """Whether parts are, bit for bit, what stands at their frames in `want`, from frame 0 on. A machine that stands still
    for seconds may leave some out, never change one."""
    assert parts[0][0] == 0
    return all(np.array_equal(samples, want[first : first + len(samples)]) for first, samples in parts)


def rendered(preset, note, velocity, folder, held_s=2.0):
    """What `synth render` writes for the note from frame 0 on, (frames, 2)."""
    song = mido.MidiFile(ticks_per_beat=1000)
    track = song.add_track()
    track.append(mido.MetaMessage("set_tempo", tempo=1_000_000))
    track.append(mido.Message("note_on", note=note, velocity=velocity))
    track.append(mido.Message("note_off", note=note, velocity=64, time=round(1000 * held_s)))
    song.save(folder / "note.mid")
    command = ["render", "note.mid", "-p", str(preset), "-o", "note.wav", "--quiet"]
    command += ["--bit-depth", "float", "--no-limiter", "--quality", "standard", "-r", str(RATE_HZ), "--tail", "12"]
    assert prepared().start(command, folder).done(compiling_s()).returncode == 0
    samples, rate = soundfile.read(folder / "note.wav", dtype="float32", always_2d=True)
    assert rate == RATE_HZ
    return samples
