"""CLAP's structures, numbers and events for ctypes, by its specification, beside those of the plugin's own header."""

from __future__ import annotations

import ctypes as c
from typing import Any

NOTE_ON, NOTE_OFF, NOTE_CHOKE, NOTE_END, NOTE_EXPRESSION, PARAM_VALUE = range(6)
TRANSPORT, MIDI, MIDI_SYSEX = 9, 10, 11
HAS_TEMPO, HAS_BEATS, IS_PLAYING = 1 << 0, 1 << 1, 1 << 4
BEAT = 1 << 31
TUNING, BRIGHTNESS, PRESSURE = 2, 5, 6
ERROR, CONTINUE, CONTINUE_IF_NOT_QUIET, TAIL, SLEEP = range(5)
STEPPED, READONLY, BYPASS, AUTOMATABLE, ENUM = 1 << 0, 1 << 3, 1 << 4, 1 << 5, 1 << 16
RESCAN_VALUES, RESCAN_TEXT = 1, 2
INVALID_ID = 0xFFFFFFFF
EXTENSIONS = (
    "clap.audio-ports",
    "clap.note-ports",
    "clap.params",
    "clap.state",
    "clap.latency",
    "clap.tail",
    "clap.render",
    "clap.voice-info",
    "clap.thread-pool",
    "clap.remote-controls/2",
)

Pointer = c.c_void_p


def struct(name: str, *fields: tuple[str, Any]) -> Any:
    return type(name, (c.Structure,), {"_fields_": list(fields)})


def functions(name: str, **kinds: Any) -> Any:
    return struct(name, *kinds.items())


Version = struct("Version", ("major", c.c_uint32), ("minor", c.c_uint32), ("revision", c.c_uint32))
Header = struct(
    "Header", ("size", c.c_uint32), ("time", c.c_uint32), ("space", c.c_uint16), ("type", c.c_uint16), ("flags", c.c_uint32)
)
_ADDRESS = (("note_id", c.c_int32), ("port", c.c_int16), ("channel", c.c_int16), ("key", c.c_int16))
Note = struct("Note", ("header", Header), *_ADDRESS, ("velocity", c.c_double))
Expression = struct("Expression", ("header", Header), ("expression", c.c_int32), *_ADDRESS, ("value", c.c_double))
ParamValue = struct(
    "ParamValue", ("header", Header), ("param_id", c.c_uint32), ("cookie", Pointer), *_ADDRESS, ("value", c.c_double)
)
Transport = struct(
    "Transport",
    ("header", Header),
    ("flags", c.c_uint32),
    ("song_pos_beats", c.c_int64),
    ("song_pos_seconds", c.c_int64),
    ("tempo", c.c_double),
    ("tempo_inc", c.c_double),
    *((name, c.c_int64) for name in ("loop_start_beats", "loop_end_beats", "loop_start_seconds", "loop_end_seconds")),
    ("bar_start", c.c_int64),
    ("bar_number", c.c_int32),
    ("tsig_num", c.c_uint16),
    ("tsig_denom", c.c_uint16),
)
Midi = struct("Midi", ("header", Header), ("port", c.c_uint16), ("data", c.c_uint8 * 3))
Sysex = struct("Sysex", ("header", Header), ("port", c.c_uint16), ("buffer", Pointer), ("length", c.c_uint32))
SizeFunction = c.CFUNCTYPE(c.c_uint32, Pointer)
GetFunction = c.CFUNCTYPE(Pointer, Pointer, c.c_uint32)
PushFunction = c.CFUNCTYPE(c.c_bool, Pointer, Pointer)
InputEvents = struct("InputEvents", ("ctx", Pointer), ("size", SizeFunction), ("get", GetFunction))
OutputEvents = struct("OutputEvents", ("ctx", Pointer), ("try_push", PushFunction))
AudioBuffer = struct(
    "AudioBuffer",
    ("data32", Pointer),
    ("data64", Pointer),
    ("channel_count", c.c_uint32),
    ("latency", c.c_uint32),
    ("constant_mask", c.c_uint64),
)
Process = struct(
    "Process",
    ("steady_time", c.c_int64),
    ("frames_count", c.c_uint32),
    ("transport", Pointer),
    ("audio_inputs", Pointer),
    ("audio_outputs", Pointer),
    ("audio_inputs_count", c.c_uint32),
    ("audio_outputs_count", c.c_uint32),
    ("in_events", Pointer),
    ("out_events", Pointer),
)
Nothing = c.CFUNCTYPE(None, Pointer)
Yes = c.CFUNCTYPE(c.c_bool, Pointer)
_Whole = c.CFUNCTYPE(c.c_uint32, Pointer)
Extension = c.CFUNCTYPE(Pointer, Pointer, c.c_char_p)
HostStruct = struct(
    "HostStruct",
    ("version", Version),
    ("data", Pointer),
    *((name, c.c_char_p) for name in ("name", "vendor", "url", "own_version")),
    ("get_extension", Extension),
    ("request_restart", Nothing),
    ("request_process", Nothing),
    ("request_callback", Nothing),
)
Descriptor = struct(
    "Descriptor",
    ("clap_version", Version),
    *((name, c.c_char_p) for name in ("id", "name", "vendor", "url", "manual_url", "support_url", "version", "description")),
    ("features", c.POINTER(c.c_char_p)),
)
Plugin = struct(
    "Plugin",
    ("desc", c.POINTER(Descriptor)),
    ("data", Pointer),
    ("init", Yes),
    ("destroy", Nothing),
    ("activate", c.CFUNCTYPE(c.c_bool, Pointer, c.c_double, c.c_uint32, c.c_uint32)),
    ("deactivate", Nothing),
    ("start_processing", Yes),
    ("stop_processing", Nothing),
    ("reset", Nothing),
    ("process", c.CFUNCTYPE(c.c_int32, Pointer, Pointer)),
    ("get_extension", Extension),
    ("on_main_thread", Nothing),
)
Factory = functions(
    "Factory",
    count=_Whole,
    descriptor=c.CFUNCTYPE(c.POINTER(Descriptor), Pointer, c.c_uint32),
    create=c.CFUNCTYPE(c.POINTER(Plugin), Pointer, Pointer, c.c_char_p),
)
Entry = struct(
    "Entry",
    ("version", Version),
    ("init", c.CFUNCTYPE(c.c_bool, c.c_char_p)),
    ("deinit", c.CFUNCTYPE(None)),
    ("get_factory", c.CFUNCTYPE(Pointer, c.c_char_p)),
)
AudioPortInfo = struct(
    "AudioPortInfo",
    ("id", c.c_uint32),
    ("name", c.c_char * 256),
    ("flags", c.c_uint32),
    ("channel_count", c.c_uint32),
    ("port_type", c.c_char_p),
    ("in_place_pair", c.c_uint32),
)
NotePortInfo = struct(
    "NotePortInfo", ("id", c.c_uint32), ("supported", c.c_uint32), ("preferred", c.c_uint32), ("name", c.c_char * 256)
)
ParamInfo = struct(
    "ParamInfo",
    ("id", c.c_uint32),
    ("flags", c.c_uint32),
    ("cookie", Pointer),
    ("name", c.c_char * 256),
    ("module", c.c_char * 1024),
    ("minimum", c.c_double),
    ("maximum", c.c_double),
    ("initial", c.c_double),
)
VoiceInfo = struct("VoiceInfo", ("count", c.c_uint32), ("capacity", c.c_uint32), ("flags", c.c_uint64))
RemotePage = struct(
    "RemotePage",
    ("section", c.c_char * 256),
    ("id", c.c_uint32),
    ("name", c.c_char * 256),
    ("params", c.c_uint32 * 8),
    ("for_preset", c.c_bool),
)
_PortGet = c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, c.c_bool, Pointer)
Ports = functions("Ports", count=c.CFUNCTYPE(c.c_uint32, Pointer, c.c_bool), get=_PortGet)
Params = functions(
    "Params",
    count=_Whole,
    get_info=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, Pointer),
    get_value=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, Pointer),
    value_to_text=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, c.c_double, Pointer, c.c_uint32),
    text_to_value=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, c.c_char_p, Pointer),
    flush=c.CFUNCTYPE(None, Pointer, Pointer, Pointer),
)
StreamFunction = c.CFUNCTYPE(c.c_int64, Pointer, Pointer, c.c_uint64)
Stream = functions("Stream", ctx=Pointer, move=StreamFunction)
State = functions("State", save=c.CFUNCTYPE(c.c_bool, Pointer, Pointer), load=c.CFUNCTYPE(c.c_bool, Pointer, Pointer))
OneWhole = functions("OneWhole", get=_Whole)
Render = functions("Render", realtime=Yes, set=c.CFUNCTYPE(c.c_bool, Pointer, c.c_int32))
VoiceInfos = functions("VoiceInfos", get=c.CFUNCTYPE(c.c_bool, Pointer, Pointer))
Pool = functions("Pool", exec=c.CFUNCTYPE(None, Pointer, c.c_uint32))
Pages = functions("Pages", count=_Whole, get=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32, Pointer))
KINDS = dict(
    zip(EXTENSIONS, (Ports, Ports, Params, State, OneWhole, OneWhole, Render, VoiceInfos, Pool, Pages), strict=True)
)
FlagsFunction = c.CFUNCTYPE(None, Pointer, c.c_uint32)
HostParams = functions(
    "HostParams", rescan=FlagsFunction, clear=c.CFUNCTYPE(None, Pointer, c.c_uint32, c.c_uint32), request_flush=Nothing
)
HostOne = functions("HostOne", call=Nothing)
HostPool = functions("HostPool", request_exec=c.CFUNCTYPE(c.c_bool, Pointer, c.c_uint32))
HostLog = functions("HostLog", log=c.CFUNCTYPE(None, Pointer, c.c_int32, c.c_char_p))
HostThreads = functions("HostThreads", is_main=Yes, is_audio=Yes)


# ---- events -------------------------------------------------------------------------------------------------------


def _header(kind: int, size: int, time: int) -> Any:
    return Header(size, time, 0, kind, 0)


def note_on(time: int, key: int, velocity: float, channel: int = 0, note_id: int = -1, port: int = 0) -> Any:
    return Note(_header(NOTE_ON, c.sizeof(Note), time), note_id, port, channel, key, velocity)


def note_off(time: int, key: int, channel: int = 0, note_id: int = -1, velocity: float = 0.0, port: int = 0) -> Any:
    return Note(_header(NOTE_OFF, c.sizeof(Note), time), note_id, port, channel, key, velocity)


def choke(time: int, key: int = -1, channel: int = -1, note_id: int = -1, port: int = -1) -> Any:
    return Note(_header(NOTE_CHOKE, c.sizeof(Note), time), note_id, port, channel, key, 0.0)


def expression(time: int, what: int, value: float, key: int, channel: int = 0, note_id: int = -1, port: int = 0) -> Any:
    header = _header(NOTE_EXPRESSION, c.sizeof(Expression), time)
    return Expression(header, what, note_id, port, channel, key, value)


def param(time: int, identity: int, value: float) -> Any:
    return ParamValue(_header(PARAM_VALUE, c.sizeof(ParamValue), time), identity, None, -1, -1, -1, -1, value)


def midi(time: int, *data: int) -> Any:
    return Midi(_header(MIDI, c.sizeof(Midi), time), 0, (c.c_uint8 * 3)(*data))


def sysex(time: int, data: bytes) -> Any:
    buffer = c.create_string_buffer(data, len(data))
    event = Sysex(_header(MIDI_SYSEX, c.sizeof(Sysex), time), 0, c.addressof(buffer), len(data))
    event.kept = buffer
    return event


def transport(time: int, playing: bool, beat: float | None, tempo: float | None) -> Any:
    """Where the host is; None: it does not say."""
    flags = (HAS_TEMPO if tempo is not None else 0) | (HAS_BEATS if beat is not None else 0) | (IS_PLAYING if playing else 0)
    header = _header(TRANSPORT, c.sizeof(Transport), time)
    return Transport(header, flags, round((beat or 0.0) * BEAT), 0, tempo or 0.0)
