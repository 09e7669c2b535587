"""One preset being worked on: its text, edits with undo, the file it belongs to, what a crash left of it.

The text is the truth: a TOML file with its comments, of today's format, and always one that can be played: an edit that
would make it anything else changes nothing. After every edit it also stands in an autosave file, until it is saved.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import threading
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomlkit

from synth.author import changes
from synth.author.workspace import check_regular, read_text, regular
from synth.files.targets import is_special, write_text
from synth.instrument.place import first_note
from synth.instrument.planfile import MeasuredPlan, PlanError, path_of, read_beside, text_of
from synth.instrument.preset import FORMAT, Preset, PresetError, format_of, migrate, playable_notes, preset_folder
from synth.instrument.ways import switch_keys

STEPS = 500


class Conflict(Exception):
    """What cannot be done as things stand; `reason` is a word for programs: exists, changed-on-disk, no-file, open."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Version:
    """A text and the preset that it is."""

    text: str
    preset: Preset


@dataclass(frozen=True)
class Step(Version):
    """A version in the history: what led to it, and by which drag."""

    label: str = ""
    merge: str | None = None


@dataclass(frozen=True)
class History:
    """The steps up to now, and those that were undone, the last undone last. Replaced as a whole, so that a thread that
    reads it once sees what belongs together."""

    past: tuple[Step, ...]
    future: tuple[Step, ...] = ()

    @property
    def now(self) -> Step:
        return self.past[-1]


def fingerprint(text: str) -> str:
    """What tells texts apart."""
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def version_fingerprint(text: str, preset: Preset) -> str:
    """What tells versions apart: a text, and the plan measured of its preset."""
    return fingerprint(text + text_of(preset.measured))


def current(text: str, origin: str) -> tuple[str, list[str]]:
    """A preset's text in today's format, and what that changed, in words. Raises PresetError."""
    changes.check_text(text, origin)
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
        f"read as format {version} and converted to format {FORMAT}, in which it will be saved: {'; '.join(words)}"
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
    """See the module's docstring. Its methods may be called in any thread; one at a time changes it.

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
        #: why the autosave could not be written
        self.autosave_problem: str | None = None
        #: held by whatever changes the document or its files
        self._lock = threading.RLock()
        self._closed = False
        self._looked_at: tuple[int, ...] | None = None
        self._offers: list[Path] = []
        origin = str(file) if file is not None else name
        now, self.notices = current(text, origin)
        #: what was measured of its strings, beside the file that it was read from
        self._measured = self._plan_beside(preset_folder() / f"{name}.toml" if embedded and file is None else file)
        preset = changes.checked(now, origin).with_measured(self._measured)
        self._on_disk = text
        self._saved = Version(now, preset)
        self._history = History((Step(now, preset),))

    def _plan_beside(self, file: Path | None) -> MeasuredPlan:
        """The plan beside a preset's file; of one that cannot be read a notice is given."""
        try:
            return MeasuredPlan() if file is None else read_beside(file)
        except (PlanError, OSError) as error:
            self.notices = [*self.notices, str(error)]
            return MeasuredPlan()

    @property
    def text(self) -> str:
        return self._history.now.text

    @property
    def preset(self) -> Preset:
        return self._history.now.preset

    @property
    def dirty(self) -> bool:
        return self.text != self._saved.text or (self.file is None and not self.embedded)

    def state(self) -> dict[str, Any]:
        """What the page is told."""
        revision, history, saved = self.revision, self._history, self._saved
        text, preset, file = history.now.text, history.now.preset, self.file
        return {
            "doc": self.id,
            "name": self.name,
            "title": preset.title or preset.name,
            "file": file.name if file is not None else None,
            "embedded": self.embedded,
            "revision": revision,
            "dirty": text != saved.text or (file is None and not self.embedded),
            "text": text,
            "data": preset.model_dump(mode="json"),
            "saved": saved.preset.model_dump(mode="json"),
            "set": paths_written(tomllib.loads(text)),
            "can_undo": len(history.past) > 1,
            "can_redo": bool(history.future),
            "undo_label": history.now.label or None,
            "redo_label": history.future[-1].label if history.future else None,
            "recovered": self._offer(),
            "disk": self.disk,
            "autosave_problem": self.autosave_problem,
            "notices": self.notices,
            "notes": playable_notes(preset),
            "first_note": first_note(preset),
            "saved_notes": playable_notes(saved.preset),
            "switches": _switches(preset),
            "saved_switches": _switches(saved.preset),
            "kind": preset.obstacle.kind,
        }

    def version(self, which: str = "current") -> Version:
        """Text and preset as they are ("current") or as they were saved ("saved"). Raises ValueError."""
        if which not in ("current", "saved"):
            raise ValueError(f"which: must be current or saved, got {which!r}")
        return self._history.now if which == "current" else self._saved

    def preset_of(self, which: str) -> Preset:
        """The preset of `version`."""
        return self.version(which).preset

    # --- edits ---

    def edit(self, wanted: Sequence[tuple[str, Any]], merge: str | None = None, label: str | None = None) -> None:
        """Change values by path (None: back to the default). Edits with the same `merge` are one step of undo. Raises
        PresetError, and then nothing has changed."""
        changes.check_size(wanted, self.name)
        with self._lock:
            text, preset = changes.apply(self.text, wanted, self.name)
            self._take(text, preset, label or ", ".join(dict.fromkeys(path for path, _ in wanted)), merge)

    def set_text(self, text: str, label: str = "text") -> None:
        """Replace the whole text, which may be of an older format. Raises PresetError."""
        with self._lock:
            now, notices = current(text, self.name)
            self._take(now, changes.checked(now, self.name), label)
            self.notices = self.notices + [notice for notice in notices if notice not in self.notices]

    def randomise(self, seed: int | None, groups: Sequence[str] | None) -> None:
        """Raises PresetError, ValueError."""
        with self._lock:
            text, preset = changes.randomised(self.text, self.name, seed, groups)
            self._take(text, preset, "randomise")

    def _take(self, text: str, preset: Preset, label: str, merge: str | None = None) -> None:
        past = self._history.past
        if text == past[-1].text:
            return
        if merge is not None and past[-1].merge == merge:
            past = past[:-1]
        self._changed(History((*past, Step(text, preset.with_measured(self._measured), label, merge))[-STEPS - 1 :]))

    def _changed(self, history: History) -> None:
        self._history = history
        self.revision += 1
        self.autosave_due = True

    def undo(self) -> None:
        with self._lock:
            past, future = self._history.past, self._history.future
            if len(past) > 1:
                self._changed(_merging_ended(History(past[:-1], (*future, past[-1]))))

    def redo(self) -> None:
        with self._lock:
            past, future = self._history.past, self._history.future
            if future:
                self._changed(_merging_ended(History((*past, future[-1]), future[:-1])))

    def revert(self) -> None:
        """Back to what is saved; can be undone."""
        with self._lock:
            self._take(self._saved.text, self._saved.preset, "revert")

    # --- files ---

    def write(self, *, force: bool = False) -> None:
        """Save to `file`. Raises Conflict, where it was changed by others and not `force`, and OSError."""
        with self._lock:
            if self.file is None:
                raise Conflict("no-file", f"{self.name} has no file yet: save it under a name")
            self.look_at_disk()
            if self.disk is not None and not force:
                how = "was changed" if self.disk == "changed" else "was deleted or moved"
                raise Conflict(
                    "changed-on-disk", f"{self.file.name} {how} on disk since it was read: reload it, or save by force"
                )
            check_regular(self.file)
            write_text(self.file, self.text)
            self._is_saved()

    def _is_saved(self) -> None:
        now = self._history.now
        self._on_disk, self._saved = now.text, now
        self.disk = None
        self.embedded = False
        self.notices = []
        self.revision += 1
        self.autosave_due, self.autosave_problem = False, None
        self._drop_autosave()
        self._history = _merging_ended(self._history)

    def under(self, stem: str) -> tuple[str, Preset]:
        """Its text and preset under the name of another file, and with a title of that name where the title is the one that
        the preset keeps which it was made from. Raises PresetError."""
        wanted = [("name", preset_name(stem))]
        kept = self._saved.preset.title
        if (self.embedded or self.file is not None) and stem != self.name and kept and self.preset.title == kept:
            wanted.append(("title", title_of(stem)))
        return changes.apply(self.text, wanted, self.name)

    def save_as(self, file: Path, autosave: Path) -> None:
        """Save to another file, under its name, and go on there. A plan goes along that lies beside the file left: it was
        asked for. What an earlier session left of the new file is offered from then on. Raises PresetError, OSError."""
        with self._lock:
            text, preset = self.under(file.stem)
            check_regular(file)
            along = self.file is not None and bool(self._measured.strings)
            if along:
                check_regular(path_of(file))
                write_text(path_of(file), text_of(self._measured))
            write_text(file, text)
            if text != self.text:
                self._take(text, preset, "name")
            if not along:
                self._go_by(self._plan_beside(file))
            if autosave != self.autosave:
                self._drop_autosave()
                self.file, self.autosave, self.name = file, autosave, file.stem
                self.find_autosaved()
            self._is_saved()

    def look_at_disk(self) -> bool:
        """Compare the file with what was read or written last; whether `disk` has changed."""
        with self._lock:
            if self.file is None:
                return False
            before = self.disk
            try:
                found = self.file.lstat()
                now = (found.st_ino, found.st_size, found.st_mtime_ns, hash(self._on_disk))
                if now == self._looked_at:
                    return False
                self._looked_at = now
                self.disk = None if read_text(self.file) == self._on_disk else "changed"
            except FileNotFoundError:
                self.disk, self._looked_at = "gone", None
            except (OSError, ValueError):
                self.disk = "changed"
            return self.disk != before

    def reload(self) -> None:
        """Take what is on disk; what was there before can be had back by undo. Raises Conflict, OSError, PresetError."""
        with self._lock:
            if self.file is None:
                raise Conflict("no-file", f"{self.name} has no file to read again")
            text = read_text(self.file)
            now, notices = current(text, self.name)
            preset = changes.checked(now, self.name)
            self.notices = notices
            self._take(now, preset, "reload")
            self._go_by(self._plan_beside(self.file))
            self._on_disk, self._saved = text, Version(now, preset.with_measured(self._measured))
            self.disk = None
            self.revision += 1
            self.autosave_due, self.autosave_problem = False, None
            self._drop_autosave()

    def check_plan_place(self) -> None:
        """Raises Conflict or OSError where no plan can lie beside the preset's file, as it has none."""
        if self.file is None:
            raise Conflict("no-file", f"{self.name} has no file yet to keep a plan beside: save it under a name")
        check_regular(path_of(self.file))

    def keep_plan(self, plan: MeasuredPlan) -> None:
        """Write what was measured of its strings beside the file, and go by it. Raises Conflict, OSError."""
        with self._lock:
            self.check_plan_place()
            assert self.file is not None
            write_text(path_of(self.file), text_of(plan))
            self._go_by(plan)
            self.revision += 1

    def _go_by(self, plan: MeasuredPlan) -> None:
        """Have every version planned by it."""
        self._measured = plan
        past, future = (
            tuple(replace(step, preset=step.preset.with_measured(plan)) for step in steps)
            for steps in (self._history.past, self._history.future)
        )
        self._history = History(past, future)
        self._saved = replace(self._saved, preset=self._saved.preset.with_measured(plan))

    def close(self, *, discard: bool = False) -> None:
        """Write nothing from now on; `discard`: and throw the autosaved text away."""
        with self._lock:
            self._closed = True
            if discard:
                self._drop_autosave()

    def _drop_autosave(self) -> None:
        """Take the autosaved text away, which is of no use any more: one that stays undoes nothing of what was done."""
        with contextlib.suppress(OSError):
            self.autosave.unlink(missing_ok=True)

    # --- after a crash ---

    def write_autosave(self) -> None:
        """Bring the autosave file up to date; in any thread. Raises OSError."""
        with self._lock:
            self.autosave_due = False
            if self._closed:
                return
            if self.dirty:
                if not self.autosave.is_symlink() or is_special(self.autosave):
                    check_regular(self.autosave)  # a link to a file is replaced
                write_text(self.autosave, self.text, mode=0o600)  # the preset may be one that nobody else reads
            else:
                self.autosave.unlink(missing_ok=True)

    def autosave_failed(self, why: str | None) -> bool:
        """Keep in mind why the autosave could not be written (None: it could); whether that is news."""
        with self._lock:
            self.autosave_due = self.autosave_due or why is not None
            news = why != self.autosave_problem
            self.autosave_problem = why
            self.revision += news
            return news

    def find_autosaved(self) -> None:
        """Look for what an earlier session left. It is put aside, so that nothing overwrites it before it is answered."""
        with self._lock:
            if regular(self.autosave):
                number = 1
                while os.path.lexists(aside := self._aside(number)):
                    number += 1
                os.replace(self.autosave, aside)
            found = self.autosave.parent.glob(f"{_escaped(self.autosave.name)}.[0-9]*")
            self._offers = sorted(filter(regular, found), key=lambda path: path.stat().st_mtime_ns)
            for path in list(self._offers):
                try:
                    same = read_text(path) in ("", self.text, self._on_disk)
                except (OSError, ValueError):
                    self._offers.remove(path)
                    continue
                if same:  # nothing that is not in the file already, or nothing yet
                    self._offers.remove(path)
                    path.unlink()

    def _aside(self, number: int) -> Path:
        return self.autosave.with_name(f"{self.autosave.name}.{number}")

    def _offer(self) -> dict[str, str] | None:
        for path in reversed(self._offers):
            try:
                when = datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
                return {"when": when, "text": read_text(path)}
            except (OSError, ValueError):
                with self._lock, contextlib.suppress(ValueError):
                    self._offers = [each for each in self._offers if each != path]
        return None

    def recover(self, take: bool) -> None:
        """Take what an earlier session left as an edit, or throw it away. Raises Conflict, OSError, PresetError: then it is
        still there."""
        with self._lock:
            if self._offer() is None:
                raise Conflict("nothing", f"there are no unsaved changes to recover of {self.name}")
            path = self._offers[-1]
            if take:
                self.set_text(read_text(path), "recover")
                self.write_autosave()
            self._offers = self._offers[:-1]
            path.unlink(missing_ok=True)
            self.revision += 1


def _merging_ended(history: History) -> History:
    """The next edit is a step of its own."""
    return replace(history, past=(*history.past[:-1], replace(history.now, merge=None)))


def _escaped(name: str) -> str:
    """A file name as a pattern that fits it only."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def preset_name(stem: str) -> str:
    """A preset's name from its file's: lower-case letters, digits and hyphens; letters lose their accents."""
    bare = "".join(letter for letter in unicodedata.normalize("NFKD", stem.lower()) if not unicodedata.combining(letter))
    name = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in bare).strip("-")
    return name[:64] or "preset"


def title_of(stem: str) -> str:
    """A preset's title from its file's name: words, the first with a capital."""
    words = " ".join(re.split(r"[\s_-]+", unicodedata.normalize("NFC", stem))).strip()
    return words[:1].upper() + words[1:]


def _switches(preset: Preset) -> list[dict[str, Any]]:
    """Keys that switch articulations, and what they switch to."""
    return [{"key": key, "name": name} for key, name in switch_keys(preset).items()]
