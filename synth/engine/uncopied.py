"""Objects that only their own process can use: they hold addresses, threads or devices."""

from __future__ import annotations

from typing import NoReturn


class Uncopied:
    """Refuses `copy.copy`, `copy.deepcopy` and `pickle` with a TypeError; `REMEDY` says what to do instead."""

    REMEDY = "make another one"

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(
            f"{type(self).__name__} cannot be copied or pickled: it holds addresses, threads or a device of this "
            f"process; {self.REMEDY}"
        )
