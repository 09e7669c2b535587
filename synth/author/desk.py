"""The documents that are open: the same for every tab that names them, watched on disk and autosaved."""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from synth.author.document import Conflict, Document, preset_name
from synth.author.workspace import AUTOSAVE, SUFFIX, Workspace, read_text, write_text
from synth.preset import PresetError

LOG = logging.getLogger(__name__)
#: before the names of autosave files of documents without a file: those that come with the program, and imported ones
EMBEDDED, UNSAVED = "embedded-", "unsaved-"
#: most documents that are open at once
MOST = 200


class Desk:
    """Documents of a workspace. Listeners get (document, kind): kind is "state", or "disk" after a change by others."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.documents: dict[str, Document] = {}
        self.opened: Document | None = None
        self._listeners: list[Callable[[Document, str], None]] = []

    def listen(self, listener: Callable[[Document, str], None]) -> None:
        self._listeners.append(listener)

    def tell(self, document: Document, kind: str = "state") -> None:
        for listener in self._listeners:
            listener(document, kind)

    def __getitem__(self, key: str) -> Document:
        """Raises KeyError."""
        return self.documents[key]

    def presets(self) -> list[dict[str, Any]]:
        """What can be opened: name, title, embedded, file, and unsaved (left by an earlier session that ended before it was
        saved)."""
        from synth.preset import preset_folder

        rows = []
        for path in sorted(preset_folder().glob(f"*{SUFFIX}")):
            rows.append({"name": path.stem, "title": _title(path), "embedded": True, "file": None, "unsaved": False})
        for path in self.workspace.files():
            rows.append({"name": path.stem, "title": _title(path), "embedded": False, "file": path.name, "unsaved": False})
        open_now = {document.autosave for document in self.documents.values()}
        for path in self._left():
            if path not in open_now:
                name = path.name.removeprefix(f".{UNSAVED}").removesuffix(SUFFIX + AUTOSAVE)
                rows.append({"name": name, "title": _title(path), "embedded": False, "file": None, "unsaved": True})
        return rows

    def _left(self) -> list[Path]:
        return sorted(self.workspace.folder.glob(f".{UNSAVED}*{SUFFIX}{AUTOSAVE}"))

    def open(self, preset: str) -> Document:
        """The document of a preset that comes with the program (name), of a file of the folder (name.toml), or of what an
        earlier session left unsaved (name). Raises ValueError, OSError."""
        embedded = None if preset.endswith(SUFFIX) else self.workspace.embedded(preset)
        if embedded is not None:
            for document in self.documents.values():
                if document.embedded and document.name == preset:
                    return document
            made = Document(preset, read_text(embedded), self.workspace.autosave(EMBEDDED + preset), embedded=True)
            return self._add(made)
        left = self.workspace.autosave(UNSAVED + preset)
        if not preset.endswith(SUFFIX) and left in self._left():
            for document in self.documents.values():
                if document.autosave == left:
                    return document
            made = Document(preset, read_text(left), left)
            made.notices = ["recovered: an earlier session ended before this was saved", *made.notices]
            return self._add(made, look=False)
        file = self.workspace.file(preset)
        for document in self.documents.values():
            if document.file == file:
                return document
        if not file.is_file():
            raise FileNotFoundError(
                f"{preset}: there is no such preset, neither in {self.workspace.folder} nor in the program"
            )
        return self._add(Document(file.stem, read_text(file), self.workspace.autosave(file.stem), file=file))

    def bring_in(self, filename: str, text: str) -> Document:
        """A document of a text from elsewhere, which has no file yet. Raises PresetError."""
        stem = preset_name(Path(filename.replace("\\", "/")).name.removesuffix(SUFFIX))
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
            raise ValueError(f"{MOST} documents are open already; start the program anew")
        if look:
            document.find_autosaved()
        self.documents[document.id] = document
        return document

    def save_as(self, document: Document, name: str, overwrite: bool) -> None:
        """Raises Conflict, ValueError, OSError."""
        file = self._target(name, overwrite, document)
        other = next((each for each in self.documents.values() if each.file == file and each is not document), None)
        if other is not None:
            if other.dirty:
                raise Conflict("open", f"{file.name} is open with changes that are not saved: save or revert them first")
            del self.documents[other.id]
        document.save_as(file, self.workspace.autosave(file.stem))

    def duplicate(self, document: Document, name: str) -> Document:
        """A copy under another name, as a file and a document of its own. Raises Conflict, ValueError, OSError."""
        from synth.author import changes

        file = self._target(name, False, document)
        text, _ = changes.apply(document.text, [("name", preset_name(file.stem))], document.name)
        write_text(file, text)
        return self.open(file.name)

    def _target(self, name: str, overwrite: bool, document: Document) -> Path:
        file = self.workspace.file(name)
        if file.exists() and file != document.file and not overwrite:
            raise Conflict("exists", f"{file.name} is there already: choose another name, or overwrite it")
        if file.exists() and file == document.file and not overwrite:
            raise Conflict("exists", f"{file.name} is this preset's own file: save it, or choose another name")
        return file

    def look_at_disk(self) -> None:
        """Tell the listeners of files that others have changed. Called about every second."""
        for document in list(self.documents.values()):
            if document.look_at_disk():
                self.tell(document, "disk")

    def autosave(self) -> None:
        """Write what has been edited since the last call; in any thread."""
        for document in list(self.documents.values()):
            if document.autosave_due:
                try:
                    document.write_autosave()
                except OSError as error:
                    document.autosave_due = True
                    LOG.warning("%s: cannot be autosaved: %s", document.autosave, error.strerror or error)


def _title(path: Path) -> str:
    try:
        data = tomllib.loads(read_text(path))
    except (OSError, ValueError, RecursionError, PresetError):
        return f"{path.stem} (cannot be read)"
    title = data.get("title")
    return title if isinstance(title, str) and title else path.stem
