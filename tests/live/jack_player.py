"""An instrument in a process of its own: its server is killed, or it is held itself, or it leaves without a word."""

import sys
import time

from synth.live.deck import Deck
from synth.live.errors import DeviceError
from synth.live.jackclient import open_output
from tests.engine import kit

server, how = sys.argv[1:]
deck = Deck(kit.engine(kit.FREE))
output = open_output(deck, server=server)
output.start()
while deck.frame < 4096:
    time.sleep(0.01)
print("playing", flush=True)
if how == "leave":
    sys.exit(0)
if how == "stall":
    while output.frames_skipped < 4096:
        time.sleep(0.01)
    print("skipped", flush=True)
    after = deck.frame
    while output.alive and deck.frame < after + 4096:
        time.sleep(0.01)
    output.close()
    print("goes on", flush=True)
    sys.exit(0)
while output.alive:
    time.sleep(0.01)
output.stop()
try:
    output.start()
except DeviceError as error:
    print(error, flush=True)
output.close()
output.close()
deck.close()
print("closed", flush=True)
