"""The authoring tool: a page on this machine's loopback that shows, sounds and writes presets.

guard       who is let in
workspace   the folder of presets, and which names lie in it
toml_edit   changes of a TOML text that leave comments where they are
document    one preset being worked on: edits, undo, save, what is recovered
documents   the documents that are open
sound       the player behind a connection
phrases     what is played to hear a preset
samples     a few seconds of each that comes with the program
jobs        long computations with progress
app         the HTTP and WebSocket interface
serve       the server
"""
