"""The documents that are open: the same for every tab that names them, watched on disk and autosaved."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import tomllib
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from synth.author.document import Conflict, Document
from synth.author.workspace import AUTOSAVE, SUFFIX, Workspace, read_text, regular, stem_of
from synth.files.targets import write_text
from synth.instrument.preset import PresetError

LOG = logging.getLogger(__name__)
#: before the names of autosave files of documents without a file: those that come with the program, and imported ones
#: (with a sign that the name of no file that is written has)
EMBEDDED, UNSAVED = "embedded~", "unsaved~"
#: most documents that are open at once
MOST = 200


class Documents:
    """Documents of a workspace. Listeners get (document, kind): kind is "state", or "disk" after a change by others."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.documents: dict[str, Document] = {}
        self.opened: Document | None = None
        self._listeners: list[Callable[[Document, str], None]] = []
        #: held while documents come and go
        self._lock = threading.RLock()
        self._moved: dict[str, str] = {}

    def listen(self, listener: Callable[[Document, str], None]) -> None:
        self._listeners.append(listener)

    def tell(self, document: Document, kind: str = "state") -> None:
        for listener in self._listeners:
            listener(document, kind)

    def __getitem__(self, key: str) -> Document:
        """Raises KeyError."""
        while key in self._moved:
            key = self._moved[key]
        return self.documents[key]

    def presets(self) -> list[dict[str, Any]]:
        """What can be opened: name, title, embedded, file, unsaved (left by an earlier session that ended before it was
        saved), when (that was, ISO 8601, else null), and reason (why it cannot be opened after all, else null)."""
        from synth.instrument.preset import preset_folder

        def row(name: str, path: Path, **more: Any) -> dict[str, Any]:
            same = {"name": name, "embedded": False, "file": None, "unsaved": False, "when": None, "reason": None, **more}
            # what cannot be opened is not opened for its title either; the program's own may be installed as links
            return {"title": _title(path, follow=same["embedded"]) if same["reason"] is None else same["file"], **same}

        open_now = {document.autosave for document in list(self.documents.values())}
        rows = []
        for path in self._left():
            if path not in open_now:
                with contextlib.suppress(OSError):  # gone meanwhile
                    when = datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
                    rows.append(row(_unsaved_name(path), path, unsaved=True, when=when))
        for path in sorted(preset_folder().glob(f"*{SUFFIX}")):
            rows.append(row(path.stem, path, embedded=True))
        for path, reason in self.workspace.files():
            shown = os.fsencode(path.name).decode("utf-8", "replace")
            if reason is None:
                rows.append(row(path.stem, path, file=path.name))
            else:
                rows.append(row(shown, path, file=shown, reason=reason))
        return rows

    def _left(self) -> list[Path]:
        """Autosaved texts of documents without a file."""
        return sorted(filter(regular, self.workspace.folder.glob(f".{UNSAVED}*{SUFFIX}{AUTOSAVE}")))

    def open(self, preset: str) -> Document:
        """The document of a preset that comes with the program (name), or of a file of the folder (name.toml). Raises
        ValueError, OSError."""
        with self._lock:
            embedded = None if preset.endswith(SUFFIX) else self.workspace.embedded(preset)
            if embedded is not None:
                for document in self.documents.values():
                    if document.embedded and document.name == preset:
                        return document
                text = read_text(embedded, follow=True)
                made = Document(preset, text, self.workspace.autosave(EMBEDDED + preset), embedded=True)
                return self._add(made)
            file = self.workspace.file(preset)
            for document in self.documents.values():
                if document.file == file:
                    return document
            if not file.is_file():
                raise FileNotFoundError(f"{preset}: no such preset, neither in {self.workspace.folder} nor in the program")
            return self._add(Document(file.stem, read_text(file), self.workspace.autosave(file.stem), file=file))

    def open_unsaved(self, name: str) -> Document:
        """The document of what an earlier session left, which has no file. Raises ValueError, OSError."""
        with self._lock:
            for left in self._left():
                if _unsaved_name(left) != name:
                    continue
                for document in self.documents.values():
                    if document.autosave == left:
                        return document
                made = Document(name, read_text(left), left)
                made.notices = ["recovered: an earlier session ended before this was saved", *made.notices]
                return self._add(made, look=False)
        raise FileNotFoundError(f"{name}: nothing of this name was left unsaved in {self.workspace.folder}")

    def bring_in(self, filename: str, text: str) -> Document:
        """A document of a text from elsewhere, which has no file yet. Raises PresetError."""
        with self._lock:
            stem = stem_of(filename)
            taken = {document.autosave for document in self.documents.values()} | set(self._left())
            name, number = stem, 1
            while self.workspace.autosave(UNSAVED + name) in taken:
                number += 1
                name = f"{stem}-{number}"
            document = Document(name, text, self.workspace.autosave(UNSAVED + name))
            document.autosave_due = True
            return self._add(document, look=False)

    def _add(self, document: Document, *, look: bool = True) -> Document:
        if len(self.documents) >= MOST:
            raise ValueError(f"{MOST} documents are open already; restart the program")
        if look:
            document.find_autosaved()
        self.documents[document.id] = document
        return document

    def save_as(self, document: Document, name: str, overwrite: bool) -> Document | None:
        """Save it under another name. Gives the document that was open from that file, if there was one: its id leads to
        this one from now on. Raises Conflict, ValueError, OSError."""
        with self._lock:
            file = self._target(name, overwrite, document)
            other = next((each for each in self.documents.values() if each.file == file and each is not document), None)
            if other is not None and other.dirty:
                raise Conflict("open", f"{file.name} is open with unsaved changes: save or revert them first")
            document.save_as(file, self.workspace.autosave(file.stem))
            if other is not None:
                other.close()
                del self.documents[other.id]
                self._moved[other.id] = document.id
                if self.opened is other:
                    self.opened = document
            return other

    def duplicate(self, document: Document, name: str) -> Document:
        """A copy under another name, as a file and a document of its own. Raises Conflict, ValueError, OSError."""
        with self._lock:
            file = self._target(name, False, document)
            text, _ = document.under(file.stem)
            write_text(file, text)
            return self.open(file.name)

    def discard(self, document: Document) -> None:
        """Throw a document away that has no file. Raises Conflict."""
        with self._lock:
            if document.file is not None or document.embedded:
                raise Conflict("has-file", f"{document.name} has a saved version: revert to it")
            document.close(discard=True)
            self.documents.pop(document.id, None)
            if self.opened is document:
                self.opened = None

    def _target(self, name: str, overwrite: bool, document: Document) -> Path:
        file = self.workspace.file(name)
        if file.exists() and file != document.file and not overwrite:
            raise Conflict("exists", f"{file.name} already exists: choose another name, or overwrite it")
        if file.exists() and file == document.file and not overwrite:
            raise Conflict("exists", f"{file.name} is this preset's own file: save it, or choose another name")
        return file

    def look_at_disk(self) -> list[Document]:
        """The documents whose files others have changed since the last call; in any thread."""
        return [document for document in list(self.documents.values()) if self._carefully(document, _changed_on_disk)]

    def autosave(self) -> list[Document]:
        """Write what has been edited since the last call; the documents of which there is news about that. In any thread."""
        return [document for document in list(self.documents.values()) if self._carefully(document, _autosaved)]

    @staticmethod
    def _carefully(document: Document, work: Callable[[Document], bool]) -> bool:
        """One document's trouble is not that of the others."""
        try:
            return work(document)
        except Exception:
            LOG.exception("%s: cannot be autosaved or checked for changes", document.name)
            return False


def _changed_on_disk(document: Document) -> bool:
    return document.look_at_disk()


def _autosaved(document: Document) -> bool:
    if not document.autosave_due:
        return False
    try:
        document.write_autosave()
    except (OSError, ValueError) as error:
        why = f"{document.autosave}: {getattr(error, 'strerror', None) or error}"
        news = document.autosave_failed(why)
        if news:
            LOG.warning("cannot be autosaved: %s", why)
        return news
    return document.autosave_failed(None)


def _unsaved_name(path: Path) -> str:
    return path.name.removeprefix(f".{UNSAVED}").removesuffix(SUFFIX + AUTOSAVE)


def _title(path: Path, *, follow: bool) -> str:
    try:
        data = tomllib.loads(read_text(path, follow=follow))
    except (OSError, ValueError, RecursionError, PresetError):
        return f"{path.stem} (cannot be read)"
    title = data.get("title")
    return title if isinstance(title, str) and title else path.stem
