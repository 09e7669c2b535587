"""The engine without Python: its kernels behind a small C library, banks of presets for it, and plugins made of both.

platforms            systems and processors
emit, retarget       kernels → one object for the linker, for a level of processors and a target
one_rounding, wasm_memory  what retarget changes for portable kernels, and for addresses of 32 bits
c_sources, links     which C sources a target takes, how they are compiled and linked
library, shelf       objects and the C sources (c/) → libjawari.so; the one that is at hand, or is built
addresses, bankfile  the memory of prepared engines → the bytes of a bank
predicted, packed_models, packed_bank   a bank without what follows from the rest of it: as web pages load it
description, turtle  what a plugin says of itself; the same as LV2 wants it
droning              the drone that a plugin plays by itself, as a table of a bank
setup, recipe        what a player may turn of what is compiled in; what a bank of another setup is made of
rebuild              makes it, started by a plugin; python_record: where plugins find Python
bundle, exporting    CLAP, VST3 and LV2 as hosts look for them; what `synth export` does
webfolder, wclap, wasmbank  pages that play an instrument; a CLAP as WebAssembly, and the bank in its memory
macbundle, macsign   bundles of macOS, and the ad-hoc code signatures that seal them

In c/: jawari.h is the library's interface; core*, bank* and midi are behind it; plugin* is what the formats have in common;
clap*, vst3* and lv2* are the formats, each with its interface in *_api.h.
"""
