"""Tries broken inputs one after the other; says on its standard output which it is at and what came of it, in JSON."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
import traceback
import warnings

from break_inputs.trial import Broke, attempt, broken, source, whole

#: longest that one may take, of this process's own time [s]
MOST_S = 10.0


def work(kind: str, first: int, beyond: int, seed: int) -> None:
    """Inputs `first` to `beyond` − 1 of a kind."""
    warnings.simplefilter("error")
    out = os.fdopen(os.dup(1), "w", buffering=1)
    warmed: set[int] = set()
    for number in range(first, beyond):
        origin = source(kind, number, seed)
        if origin not in warmed:
            warmed.add(origin)
            _warm(kind, whole(kind)[origin])
            print(json.dumps({"warmed": origin}), file=out)
        data = broken(kind, number, seed)
        print(json.dumps({"at": number}), file=out)
        signal.setitimer(signal.ITIMER_PROF, 2 * MOST_S)  # ends the process, whatever it is doing
        began = time.process_time()
        try:
            came = attempt(kind, data)
        except Broke as error:
            came = f"broke: {error}"
        except BaseException:
            came = "broke: " + traceback.format_exc()
        took = time.process_time() - began
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        if took > MOST_S:
            came = f"broke: took {took:.1f} s of processor time; {came}"
        print(json.dumps({"of": number, "came": came, "took": took}), file=out)


def _warm(kind: str, data: bytes) -> None:
    """Compile or load what a whole input needs, outside of any count."""
    with contextlib.suppress(Broke):
        attempt(kind, data)


if __name__ == "__main__":
    work(sys.argv[1], *map(int, sys.argv[2:5]))
