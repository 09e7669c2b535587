"""One preset being worked on: its text, edits with undo, the file it belongs to, what a crash left of it.

The text is the truth: a TOML file with its comments, of today's format, and always one that can be played: an edit that
would make it anything else changes nothing. After every edit it also stands in an autosave file, until it is saved.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import threading
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomlkit

from synth.author import changes
from synth.author.views.place import playable
from synth.author.workspace import read_text, write_text
from synth.preset import FORMAT, Preset, PresetError, format_of, migrate

STEPS = 500


class Conflict(Exception):
    """What cannot be done as things stand; `reason` is a word for programs: exists, changed-on-disk, no-file, open."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Step:
    text: str
    label: str
    merge: str | None = None


def fingerprint(text: str) -> str:
    """What tells texts apart."""
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def current(text: str, origin: str) -> tuple[str, list[str]]:
    """A preset's text in today's format, and what that changed, in words. Raises PresetError."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise PresetError(f"{origin}: not valid TOML: {error}") from None
    version = format_of(data, origin)
    if version == FORMAT:
        return text, []
    document = tomlkit.parse(text)
    words = migrate(document, origin)
    return tomlkit.dumps(document), [
        f"read as format {version} and brought to format {FORMAT}, which is what saving writes: {'; '.join(words)}"
    ]


def paths_written(data: Any, prefix: str = "") -> list[str]:
    """Paths of the values that stand in a file's data; lists of numbers and numbers at notes are one value."""
    found = []
    for key, value in data.items() if isinstance(data, Mapping) else enumerate(data):
        path = f"{prefix}{key}"
        tables = isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value)
        table = isinstance(value, Mapping) and (not prefix or any(isinstance(each, Mapping) for each in value.values()))
        found += paths_written(value, f"{path}.") if tables or table or isinstance(data, list) else [path]
    return found


class Document:
    """See the module's docstring.

    text       as it was read; of any format this program knows
    file       where it is saved; None: nowhere yet
    embedded   whether it comes with the program
    autosave   file of the autosaved text
    Raises PresetError.
    """

    def __init__(self, name: str, text: str, autosave: Path, *, file: Path | None = None, embedded: bool = False) -> None:
        self.id = secrets.token_hex(4)
        self.name = name
        self.file = file
        self.embedded = embedded
        self.autosave = autosave
        self.revision = 0
        self.disk: str | None = None
        self.autosave_due = False
        #: held while files are written: autosaving has a thread of its own
        self._writing = threading.Lock()
        self._looked_at: tuple[int, ...] | None = None
        self._offers: list[Path] = []
        self.notices: list[str] = []
        self._begin(text)

    def _begin(self, text: str) -> None:
        """Take a text as what is saved."""
        now, self.notices = current(text, self.name)
        self.preset = changes.checked(now, self.name)
        self.on_disk = text
        self.saved_text, self.saved_preset = now, self.preset
        self._past = [Step(now, "")]
        self._future: list[Step] = []

    @property
    def text(self) -> str:
        return self._past[-1].text

    @property
    def dirty(self) -> bool:
        return self.text != self.saved_text or (self.file is None and not self.embedded)

    def state(self) -> dict[str, Any]:
        """What the page is told."""
        preset = self.preset
        return {
            "doc": self.id,
            "name": self.name,
            "title": preset.title or preset.name,
            "file": self.file.name if self.file is not None else None,
            "embedded": self.embedded,
            "revision": self.revision,
            "dirty": self.dirty,
            "text": self.text,
            "data": preset.model_dump(mode="json"),
            "saved": self.saved_preset.model_dump(mode="json"),
            "set": paths_written(tomllib.loads(self.text)),
            "can_undo": len(self._past) > 1,
            "can_redo": bool(self._future),
            "undo_label": self._past[-1].label or None,
            "redo_label": self._future[-1].label if self._future else None,
            "recovered": self._offer(),
            "disk": self.disk,
            "notices": self.notices,
            "notes": playable(preset),
            "saved_notes": playable(self.saved_preset),
            "kind": preset.obstacle.kind,
        }

    def preset_of(self, which: str) -> Preset:
        """The preset as it is ("current") or as it was saved ("saved"). Raises ValueError."""
        if which not in ("current", "saved"):
            raise ValueError(f"which: must be current or saved, got {which!r}")
        return self.preset if which == "current" else self.saved_preset

    def text_of(self, which: str) -> str:
        """The text of `preset_of`."""
        return self.text if which == "current" else self.saved_text

    # --- edits ---

    def edit(self, wanted: Sequence[tuple[str, Any]], merge: str | None = None, label: str | None = None) -> None:
        """Change values by path (None: back to the default). Edits with the same `merge` are one step of undo. Raises
        PresetError, and then nothing has changed."""
        text, preset = changes.apply(self.text, wanted, self.name)
        self._take(text, preset, label or ", ".join(dict.fromkeys(path for path, _ in wanted)), merge)

    def set_text(self, text: str, label: str = "text") -> None:
        """Replace the whole text, which may be of an older format. Raises PresetError."""
        now, notices = current(text, self.name)
        self._take(now, changes.checked(now, self.name), label)
        self.notices = self.notices + [notice for notice in notices if notice not in self.notices]

    def randomise(self, seed: int | None, groups: Sequence[str] | None) -> None:
        """Raises PresetError, ValueError."""
        text, preset = changes.randomised(self.text, self.name, seed, groups)
        self._take(text, preset, "randomise")

    def _take(self, text: str, preset: Preset, label: str, merge: str | None = None) -> None:
        if text == self.text:
            return
        if merge is not None and self._past[-1].merge == merge:
            self._past.pop()
        self._past.append(Step(text, label, merge))
        del self._past[: -STEPS - 1]
        self._future.clear()
        self._changed(preset)

    def _changed(self, preset: Preset | None = None) -> None:
        self.preset = preset if preset is not None else changes.checked(self.text, self.name)
        self.revision += 1
        self.autosave_due = True

    def undo(self) -> None:
        if len(self._past) > 1:
            self._future.append(self._past.pop())
            self._end_merging()
            self._changed()

    def redo(self) -> None:
        if self._future:
            self._past.append(self._future.pop())
            self._end_merging()
            self._changed()

    def _end_merging(self) -> None:
        last = self._past[-1]
        self._past[-1] = Step(last.text, last.label)

    def revert(self) -> None:
        """Back to what is saved; can be undone."""
        self._take(self.saved_text, self.saved_preset, "revert")

    # --- files ---

    def write(self, *, force: bool = False) -> None:
        """Save to `file`. Raises Conflict, where it was changed by others and not `force`, and OSError."""
        if self.file is None:
            raise Conflict("no-file", f"{self.name} has no file of its own yet: save it under a name")
        self.look_at_disk()
        if self.disk is not None and not force:
            how = "was changed" if self.disk == "changed" else "was deleted or moved"
            raise Conflict(
                "changed-on-disk", f"{self.file.name} {how} on disk since it was read: reload it, or save by force"
            )
        with self._writing:
            write_text(self.file, self.text)
            self._saved()

    def _saved(self) -> None:
        self.on_disk = self.saved_text = self.text
        self.saved_preset = self.preset
        self.disk = None
        self.embedded = False
        self.notices = []
        self.revision += 1
        self.autosave_due = False
        self.autosave.unlink(missing_ok=True)
        self._end_merging()

    def save_as(self, file: Path, autosave: Path) -> None:
        """Save to another file, under its name, and go on there. Raises PresetError, OSError."""
        text, preset = changes.apply(self.text, [("name", preset_name(file.stem))], self.name)
        with self._writing:
            write_text(file, text)
            if text != self.text:
                self._take(text, preset, "name")
            self.autosave.unlink(missing_ok=True)
            self.file, self.autosave, self.name = file, autosave, file.stem
            self._saved()

    def look_at_disk(self) -> bool:
        """Compare the file with what was read or written last; whether `disk` has changed."""
        if self.file is None:
            return False
        before = self.disk
        try:
            found = self.file.stat()
            now = (found.st_ino, found.st_size, found.st_mtime_ns, hash(self.on_disk))
            if now == self._looked_at:
                return False
            self._looked_at = now
            self.disk = None if read_text(self.file) == self.on_disk else "changed"
        except FileNotFoundError:
            self.disk, self._looked_at = "gone", None
        except (OSError, ValueError):
            self.disk = "changed"
        return self.disk != before

    def reload(self) -> None:
        """Take what is on disk; what was there before can be had back by undo. Raises Conflict, OSError, PresetError."""
        if self.file is None:
            raise Conflict("no-file", f"{self.name} has no file of its own that could be read again")
        text = read_text(self.file)
        now, notices = current(text, self.name)
        preset = changes.checked(now, self.name)
        self._take(now, preset, "reload")
        self.on_disk, self.saved_text, self.saved_preset = text, now, preset
        self.disk, self.notices = None, notices
        self.revision += 1
        self.autosave_due = False
        with self._writing:
            self.autosave.unlink(missing_ok=True)

    # --- after a crash ---

    def write_autosave(self) -> None:
        """Bring the autosave file up to date; in any thread. Raises OSError."""
        with self._writing:
            self.autosave_due = False
            if self.dirty:
                write_text(self.autosave, self.text)
            else:
                self.autosave.unlink(missing_ok=True)

    def find_autosaved(self) -> None:
        """Look for what an earlier session left. It is put aside, so that nothing overwrites it before it is answered."""
        if self.autosave.is_file():
            number = 1
            while (aside := self._aside(number)).exists():
                number += 1
            os.replace(self.autosave, aside)
        found = list(self.autosave.parent.glob(f"{_escaped(self.autosave.name)}.[0-9]*"))
        self._offers = sorted(found, key=lambda path: path.stat().st_mtime_ns)
        for path in list(self._offers):
            try:
                same = read_text(path) in (self.text, self.on_disk)
            except (OSError, ValueError):
                self._offers.remove(path)
                continue
            if same:  # nothing that is not in the file already
                self._offers.remove(path)
                path.unlink()

    def _aside(self, number: int) -> Path:
        return self.autosave.with_name(f"{self.autosave.name}.{number}")

    def _offer(self) -> dict[str, str] | None:
        while self._offers:
            path = self._offers[-1]
            try:
                when = datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
                return {"when": when, "text": read_text(path)}
            except (OSError, ValueError):
                self._offers.pop()
        return None

    def recover(self, take: bool) -> None:
        """Take what an earlier session left as an edit, or throw it away. Raises Conflict, OSError, PresetError: then it is
        still there."""
        if self._offer() is None:
            raise Conflict("nothing", f"there is nothing to recover of {self.name}")
        path = self._offers[-1]
        if take:
            self.set_text(read_text(path), "recover")
            self.write_autosave()
        self._offers.pop()
        path.unlink(missing_ok=True)
        self.revision += 1


def _escaped(name: str) -> str:
    """A file name as a pattern that fits it only."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def preset_name(stem: str) -> str:
    """A preset's name from its file's: lower-case letters, digits and hyphens."""
    name = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in stem.lower()).strip("-")
    return name[:64] or "preset"
