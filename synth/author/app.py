"""The interface of the server: JSON over HTTP, one WebSocket for each page."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from synth.author.beside import compute_beside
from synth.author.connection import Connection, Stage
from synth.author.contact_fitting import FittedContact, fit_string_contact
from synth.author.document import Conflict, Document
from synth.author.documents import Documents
from synth.author.errors import one_line
from synth.author.fitting import FittedString, StringChanged, fit_string
from synth.author.jobs import Job, Jobs, Progress
from synth.author.measured import measured_mobility
from synth.author.phrases import phrase
from synth.author.samples import Samples
from synth.author.speaker import why_not
from synth.author.viewing import VIEWS, Gone, Viewer
from synth.author.voice import phrase_preset, phrase_wav, prepared_engine, warm_up
from synth.fit import missing, missing_for_contact
from synth.instrument.planfile import PROMISED, MeasuredPlan
from synth.instrument.preset import MOST_BYTES, Preset, PresetError, load_preset
from synth.jit import compiling

PAGE = Path(__file__).parent / "page"
#: how often what was edited is autosaved, files are compared with the disk, and a compilation is told of [s]
AUTOSAVE_S, LOOK_S, TELL_S = 0.5, 1.0, 0.5
MOST_BODY = 2 * MOST_BYTES
#: why a WebSocket of a page is closed whose document belongs to an earlier run
NO_DOCUMENT = 4404
#: largest recording that is fitted [bytes]
MOST_RECORDING = 100 << 20
#: largest table of mobilities that is shown [bytes]
MOST_TABLE = 16 << 20


class Refused(Exception):
    """A request that is answered with an error of this status."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


Handler = Callable[[Request], Awaitable[Response]]


def answering(handler: Handler) -> Handler:
    """The handler with everything that input can cause turned into a JSON answer of one line."""

    async def handle(request: Request) -> Response:
        try:
            return await handler(request)
        except Refused as refused:
            return problem(refused.status, str(refused))
        except Conflict as conflict:
            return problem(409, str(conflict), reason=conflict.reason)
        except PresetError as error:
            errors = [{"path": path, "message": message} for path, message in error.problems]
            return problem(422, _line(ValueError(str(error).splitlines()[0])), errors=errors)
        except FileNotFoundError as error:
            return problem(404, _line(error))
        except (ValueError, OSError) as error:
            return problem(400, _line(error))

    return handle


def problem(status: int, message: str, **more: Any) -> Response:
    # ASCII: what is refused may be what cannot be encoded
    return Response(json.dumps({"error": message, **more}), status, media_type="application/json")


def _line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return one_line(error)


async def body_of(request: Request, most: int) -> bytes:
    """The body. Raises Refused where it is longer than `most` bytes."""
    data = bytearray()
    async for piece in request.stream():
        data += piece
        if len(data) > most:
            raise Refused(413, f"the request is larger than {most >> 20} MB")
    return bytes(data)


class Fields:
    """The JSON object of a request, its values checked as they are taken out."""

    def __init__(self, values: dict[str, Any]) -> None:
        self._values = values

    @classmethod
    async def of(cls, request: Request) -> Fields:
        body = await body_of(request, MOST_BODY)
        try:
            values = json.loads(body) if body else {}
        except (ValueError, RecursionError):
            raise Refused(400, "the request's body must be JSON") from None
        if not isinstance(values, dict):
            raise Refused(400, "the request's body must be a JSON object")
        return cls(values)

    def get(self, name: str, kind: type | tuple[type, ...], default: Any = ...) -> Any:
        """The value of a field that must be of a kind; without a default it must be there."""
        value = self._values.get(name)
        if value is None and default is not ...:
            return default
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise Refused(400, f"{name}: must be a {_KINDS[kind]}, got {json.dumps(value)[:80]}")
        return value


def _number(query: Mapping[str, str], name: str, low: float, high: float, *, kind: type = int) -> Any:
    """A number of the query. Raises Refused."""
    try:
        value = kind(query[name])
    except KeyError:
        raise Refused(400, f"{name}: missing") from None
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        what = "a whole number" if kind is int else "a number"
        raise Refused(400, f"{name}: must be {what} from {low:g} to {high:g}, got {query[name][:40]!r}")
    return value


_KINDS: dict[Any, str] = {
    str: "text",
    bool: "truth value",
    int: "whole number",
    (int, float): "number",
    list: "list",
}


@dataclass(frozen=True)
class PlanOf:
    """A plan measured of the preset of document `doc`."""

    doc: str
    plan: MeasuredPlan

    def told(self) -> dict[str, Any]:
        """How many strings there are, and quality → how many of them take less than by the law."""
        strings = self.plan.strings
        less = {quality: sum(quality in each.qualities for each in strings) for quality in PROMISED}
        return {"strings": len(strings), "less": less}


class App:
    """Routes over a documents. `settings`: rate_hz, quality."""

    def __init__(self, documents: Documents, *, rate_hz: int, quality: str) -> None:
        self.documents = documents
        self.rate_hz = rate_hz
        self.quality = quality
        self.stage = Stage()
        self.viewer = Viewer()
        self.jobs = Jobs()
        self.samples = Samples(rate_hz, quality)
        self.kernels = "loading"
        self._device: tuple[str | None, str | None] = (None, None)
        documents.listen(self.stage.tell)

    def asgi(self) -> Starlette:
        def on(path: str, handler: Handler, *methods: str) -> Route:
            return Route(path, answering(handler), methods=list(methods or ("GET",)))

        doc = "/api/docs/{doc}"
        return Starlette(
            routes=[
                Route("/", self._index),
                Mount("/page", StaticFiles(directory=PAGE)),
                on("/api/session", self._session),
                on("/api/kernels", self._kernels),
                on("/api/presets", self._presets),
                on("/api/presets/{name}/sample.wav", self._sample),
                on("/api/open", self._open, "POST"),
                on("/api/import", self._import, "POST"),
                on(doc, self._state),
                on(f"{doc}/edit", self._edit, "POST"),
                on(f"{doc}/text", self._text, "POST"),
                on(f"{doc}/undo", self._doing(Document.undo), "POST"),
                on(f"{doc}/redo", self._doing(Document.redo), "POST"),
                on(f"{doc}/revert", self._doing(Document.revert), "POST"),
                on(f"{doc}/reload", self._doing(Document.reload), "POST"),
                on(f"{doc}/randomise", self._randomise, "POST"),
                on(f"{doc}/save", self._save, "POST"),
                on(f"{doc}/save-as", self._save_as, "POST"),
                on(f"{doc}/discard", self._discard, "POST"),
                on(f"{doc}/duplicate", self._duplicate, "POST"),
                on(f"{doc}/recover", self._recover, "POST"),
                on(f"{doc}/export", self._export),
                on(f"{doc}/sound.wav", self._sound),
                *(on(f"{doc}/{view}", self._viewing(view)) for view in VIEWS),
                on(f"{doc}/reference", self._reference, "POST"),
                on(f"{doc}/apply-fit", self._apply_fit, "POST"),
                on(f"{doc}/plan", self._plan, "POST"),
                on(f"{doc}/keep-plan", self._keep_plan, "POST"),
                on(f"{doc}/buzz-map", self._buzz_map, "POST"),
                on(f"{doc}/set-up", self._set_up, "POST"),
                on("/api/fit", self._fit, "POST"),
                on("/api/mobility", self._mobility, "POST"),
                on("/api/jobs/{job}", self._job),
                on("/api/jobs/{job}", self._cancel, "DELETE"),
                WebSocketRoute("/ws/{doc}", self._connect),
            ],
            lifespan=self._lifespan,
        )

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        tasks = [
            asyncio.create_task(self._autosave()),
            asyncio.create_task(self._look_at_disk()),
            asyncio.create_task(self._tell_of_compiling()),
        ]
        threading.Thread(target=self._warm_up, args=(asyncio.get_running_loop(),), daemon=True).start()
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()

    def end(self) -> None:
        """Write what is edited, and end what is computed; from then on views and jobs are refused. May be called again."""
        try:
            self.documents.autosave()
        finally:
            self.jobs.close()
            self.viewer.close()

    async def _autosave(self) -> None:
        while True:
            await asyncio.sleep(AUTOSAVE_S)
            for document in await asyncio.to_thread(self.documents.autosave):  # a disk may take its time
                self.documents.tell(document)

    async def _look_at_disk(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            for document in await asyncio.to_thread(self.documents.look_at_disk):
                self.documents.tell(document, "disk")

    def _warm_up(self, loop: asyncio.AbstractEventLoop) -> None:
        """Load (the first time compile) the kernels before anybody waits for them; in a thread that no end waits for."""
        warm_up(self.rate_hz, self.quality)
        with contextlib.suppress(RuntimeError, OSError):  # the server has ended meanwhile
            loop.call_soon_threadsafe(self._ready)
            self.viewer.warm_up(load_preset("fretted-bass"), 33)

    def _ready(self) -> None:
        self.kernels = "ready"
        self._post_kernels()

    async def _tell_of_compiling(self) -> None:
        while self.kernels == "loading":
            await asyncio.sleep(TELL_S)
            if self.kernels == "loading" and compiling.busy():
                self._post_kernels()

    def _post_kernels(self) -> None:
        for connection in self.stage.connections:
            connection.post({"type": "kernels", **self._kernels_now()})

    def _kernels_now(self) -> dict[str, Any]:
        """Whether kernels are there, and how far those are that are compiled (null: none)."""
        now = compiling.progress() if self.kernels == "loading" else None
        return {"kernels": self.kernels, "compiling": now._asdict() if now is not None else None}

    async def _kernels(self, _: Request) -> Response:
        return JSONResponse(self._kernels_now())

    # --- the page ---

    async def _index(self, _: Request) -> Response:
        return FileResponse(PAGE / "index.html", media_type="text/html")

    async def _session(self, _: Request) -> Response:
        from synth.author.about import version

        opened = self.documents.opened
        if self.stage.uses_device:
            name, reason = self._device
        else:
            name, reason = self._device = await asyncio.to_thread(why_not, self.rate_hz)
        return JSONResponse(
            {
                "version": version(),
                "folder": str(self.documents.workspace.folder),
                "quality": self.quality,
                "rate_hz": self.rate_hz,
                **self._kernels_now(),
                "presets": await asyncio.to_thread(self.documents.presets),
                "opened": opened.id if opened is not None else None,
                "outputs": [
                    {"id": "browser", "label": "Browser", "available": True, "reason": None},
                    {
                        "id": "server",
                        "label": f"This machine: {name}" if name else "This machine",
                        "available": name is not None,
                        "reason": reason,
                    },
                ],
                "fit": {"available": missing() is None, "reason": missing()},
                "fit_contact": {"available": missing_for_contact() is None, "reason": missing_for_contact()},
            }
        )

    # --- documents ---

    def _document(self, request: Request) -> Document:
        try:
            return self.documents[request.path_params["doc"]]
        except KeyError:
            raise Refused(
                404, "there is no such document: it belongs to an earlier run of the program; open the preset again"
            ) from None

    async def _told(self, document: Document, work: Callable[..., Any], *arguments: Any, **options: Any) -> Response:
        """Change a document, beside the event loop, which sends the sound; tell every tab of it, and answer."""
        await asyncio.to_thread(work, *arguments, **options)
        return await self._changed(document)

    async def _changed(self, document: Document) -> Response:
        """Tell every tab of a document what it is now, and answer."""
        self.documents.tell(document)
        return JSONResponse(await asyncio.to_thread(document.state))

    @staticmethod
    async def _opened(work: Callable[..., Document], *arguments: Any) -> Response:
        return JSONResponse(await asyncio.to_thread(lambda: work(*arguments).state()))

    async def _open(self, request: Request) -> Response:
        fields = await Fields.of(request)
        unsaved = fields.get("unsaved", str, None)
        if unsaved is not None:
            return await self._opened(self.documents.open_unsaved, unsaved)
        return await self._opened(self.documents.open, fields.get("preset", str))

    async def _import(self, request: Request) -> Response:
        fields = await Fields.of(request)
        text = fields.get("text", str)
        if len(text) > MOST_BYTES:
            raise Refused(413, f"text: larger than {MOST_BYTES >> 20} MB, the limit for a preset")
        return await self._opened(self.documents.bring_in, fields.get("filename", str), text)

    async def _state(self, request: Request) -> Response:
        return JSONResponse(self._document(request).state())

    async def _edit(self, request: Request) -> Response:
        document = self._document(request)
        fields = await Fields.of(request)
        wanted = []
        for change in fields.get("changes", list):
            if not isinstance(change, dict) or not isinstance(change.get("path"), str) or "value" not in change:
                raise Refused(400, "changes: each must be a table of path and value")
            wanted.append((change["path"], change["value"]))
        return await self._told(document, document.edit, wanted, fields.get("merge", str, None))

    async def _text(self, request: Request) -> Response:
        document = self._document(request)
        return await self._told(document, document.set_text, (await Fields.of(request)).get("text", str))

    def _doing(self, work: Callable[[Document], None]) -> Handler:
        async def handle(request: Request) -> Response:
            document = self._document(request)
            return await self._told(document, work, document)

        return handle

    async def _randomise(self, request: Request) -> Response:
        document = self._document(request)
        fields = await Fields.of(request)
        groups = fields.get("groups", list, None)
        return await self._told(document, document.randomise, fields.get("seed", int, None), groups)

    async def _save(self, request: Request) -> Response:
        document = self._document(request)
        force = (await Fields.of(request)).get("force", bool, False)
        return await self._told(document, document.write, force=force)

    async def _save_as(self, request: Request) -> Response:
        document = self._document(request)
        fields = await Fields.of(request)
        name, overwrite = fields.get("name", str), fields.get("overwrite", bool, False)
        replaced = await asyncio.to_thread(self.documents.save_as, document, name, overwrite)
        if replaced is not None:
            self._lead(replaced, document)
        return await self._changed(document)

    def _lead(self, gone: Document, to: Document | None) -> None:
        """Tell the pages that show a document which one to show instead, if any."""
        for connection in list(self.stage.connections):
            if connection.document is gone:
                connection.post({"type": "moved", "doc": to.id if to is not None else None})

    async def _discard(self, request: Request) -> Response:
        document = self._document(request)
        await asyncio.to_thread(self.documents.discard, document)
        self._lead(document, None)
        return JSONResponse({})

    async def _duplicate(self, request: Request) -> Response:
        document = self._document(request)
        return await self._opened(self.documents.duplicate, document, (await Fields.of(request)).get("name", str))

    async def _recover(self, request: Request) -> Response:
        document = self._document(request)
        return await self._told(document, document.recover, (await Fields.of(request)).get("take", bool))

    # --- views and jobs ---

    def _viewing(self, name: str) -> Handler:
        view = VIEWS[name]

        async def handle(request: Request) -> Response:
            document = self._document(request)
            query = request.query_params
            which = query.get("which", "current")
            version = document.version(which)
            arguments = {
                parameter: _number(query, parameter, 0, 127 if parameter in ("note", "velocity") else 1e6, kind=kind)
                for parameter, kind in view.parameters.items()
                if parameter in query or parameter == "note"
            }
            if view.long:  # of a note as the session plays it
                arguments |= {"quality": self.quality, "rate_hz": self.rate_hz}
            try:
                body = await self.viewer.json(name, version.preset, version.text, arguments, request.is_disconnected)
            except Gone:
                return Response(status_code=204)
            return Response(body, media_type="application/json")

        return handle

    async def _reference(self, request: Request) -> Response:
        document = self._document(request)
        fields = await Fields.of(request)
        note, velocity = fields.get("note", int), fields.get("velocity", int)
        seconds = fields.get("seconds", (int, float), 1.0)
        preset = document.preset_of(fields.get("which", str, "current"))

        def work(progress: Progress) -> Any:
            from synth.author.views.reference import compare

            return compare(preset, note, velocity, seconds, progress, quality=self.quality, rate_hz=self.rate_hz)

        return JSONResponse({"job": self.jobs.start(f"reference of {document.id}", work).id})

    async def _fit(self, request: Request) -> Response:
        query = request.query_params
        document = self.documents.documents.get(query.get("doc", ""))
        if document is None:
            raise Refused(404, "doc: there is no such document; open it again")
        strings = len(document.preset.string)
        string = _number(query, "string", 0, strings - 1) if "string" in query else None  # None: the nearest to its note
        contact = _number(query, "contact", 0, 1) if "contact" in query else 0
        amplitude_m = (
            1e-3 * _number(query, "amplitude", 0.01, 49, kind=float) if "amplitude" in query else None
        )  # given in mm
        preset = document.preset
        data = await body_of(request, MOST_RECORDING)

        def work(progress: Progress) -> Any:
            if contact:
                return fit_string_contact(document.id, data, preset, string, amplitude_m, progress)
            return fit_string(document.id, data, preset, string, progress)

        return JSONResponse({"job": self.jobs.start(f"fit of {document.id}", work, lambda made: made.report).id})

    async def _mobility(self, request: Request) -> Response:
        name = request.query_params.get("name", "table")
        data = await body_of(request, MOST_TABLE)
        return JSONResponse(await asyncio.to_thread(measured_mobility, data, name))

    async def _apply_fit(self, request: Request) -> Response:
        document = self._document(request)
        job = self._a_job((await Fields.of(request)).get("job", str))
        if job.state != "done" or not isinstance(job.made, FittedString | FittedContact):
            raise Refused(409, "this job has no fit to apply; fit a recording first")
        if job.made.doc != document.id:
            raise Refused(409, "this was fitted to another preset; fit the recording again")
        try:
            settings = await asyncio.to_thread(job.made.settings_of, document.preset)
        except StringChanged as changed:
            raise Refused(409, str(changed)) from None
        return await self._told(document, document.edit, settings, label="fit")

    async def _plan(self, request: Request) -> Response:
        """Measure what each quality takes on the strings of a document that has a file."""
        document = self._document(request)
        await asyncio.to_thread(document.check_plan_place)
        preset = document.preset

        def work(progress: Progress) -> Any:
            from synth.fit.plan_measuring import measure_plan

            return PlanOf(document.id, measure_plan(preset, progress))

        return JSONResponse({"job": self.jobs.start(f"plan of {document.id}", work, PlanOf.told).id})

    async def _keep_plan(self, request: Request) -> Response:
        document = self._document(request)
        job = self._a_job((await Fields.of(request)).get("job", str))
        if job.state != "done" or not isinstance(job.made, PlanOf):
            raise Refused(409, "this job has no plan to keep; measure one first")
        if job.made.doc != document.id:
            raise Refused(409, "this plan was measured for another preset; measure it again")
        return await self._told(document, document.keep_plan, job.made.plan)

    async def _buzz_map(self, request: Request) -> Response:
        """Where the strings of a document buzz under a stroke."""
        document = self._document(request)
        stroke = (await Fields.of(request)).get("stroke", str)
        return await self._beside(f"buzz map of {document.id}", "mapped", document.preset, stroke)

    async def _set_up(self, request: Request) -> Response:
        """The set-up of a document that a wish asks for."""
        document = self._document(request)
        wish = (await Fields.of(request)).get("wish", str)
        return await self._beside(f"set-up of {document.id}", "proposed", document.preset, wish)

    async def _beside(self, about: str, function: str, preset: Preset, asked: str) -> Response:
        """A job of `synth.author.buzz_maps`, where what is asked can be."""

        def check() -> None:
            from synth.author import buzz_maps

            buzz_maps.CHECKS[function](preset, asked)

        await asyncio.to_thread(check)

        def work(progress: Progress) -> Any:
            return compute_beside("synth.author.buzz_maps", function, (preset, asked), progress)

        return JSONResponse({"job": self.jobs.start(about, work).id})

    def _a_job(self, key: str) -> Job:
        try:
            return self.jobs[key]
        except KeyError:
            raise Refused(404, "there is no such job") from None

    async def _job(self, request: Request) -> Response:
        return JSONResponse(self._a_job(request.path_params["job"]).as_dict())

    async def _cancel(self, request: Request) -> Response:
        job = self._a_job(request.path_params["job"])
        job.cancel()
        return JSONResponse(job.as_dict())

    # --- sound ---

    async def _connect(self, socket: WebSocket) -> None:
        try:
            document = self.documents[socket.path_params["doc"]]
        except KeyError:
            await socket.accept()  # a page is told why only of a connection that stood
            await socket.close(NO_DOCUMENT, "there is no such document")
            return
        await Connection(socket, document, self.stage, rate_hz=self.rate_hz, quality=self.quality).run()

    async def _sound(self, request: Request) -> Response:
        document = self._document(request)
        query = request.query_params
        preset = document.preset_of(query.get("which", "current"))
        wanted = phrase(
            query.get("phrase", "note"),
            preset,
            _number(query, "note", 0, 127),
            _number(query, "velocity", 1, 127),
            self.rate_hz,
        )
        seconds = float(_number(query, "seconds", 0, 60, kind=float)) if "seconds" in query else wanted.length_s

        def render() -> bytes:
            engine = prepared_engine(phrase_preset(preset, wanted), wanted.notes, self.rate_hz, self.quality)
            return phrase_wav(engine, wanted, seconds)

        return Response(await asyncio.to_thread(render), media_type="audio/wav")

    async def _presets(self, _: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self.samples.rows))

    async def _sample(self, request: Request) -> Response:
        data = await asyncio.to_thread(self.samples.wav, request.path_params["name"])
        return Response(data, media_type="audio/wav")

    async def _export(self, request: Request) -> Response:
        document = self._document(request)
        name = document.file.name if document.file is not None else f"{document.name}.toml"
        called = f'filename="{name}"' if name.isascii() and '"' not in name else f"filename*=UTF-8''{quote(name)}"
        headers = {"content-disposition": f"attachment; {called}"}
        return Response(document.text.encode(), media_type="application/toml", headers=headers)
