"""`sweep`: a study from its tables to its finished table; reading what a folder has."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.study.addressing import Addresses, check_rows
from synth.study.conducting import Counts, address
from synth.study.design import Design, spread
from synth.study.foreseen import row_faults
from synth.study.plotcheck import plot_faults
from synth.study.remote import Remote, remote
from synth.study.studyfile import Study, StudyError, read_study

if TYPE_CHECKING:
    import pandas

#: rows that are looked at before any is computed
CHECKED = 200
#: study.json is written anew so often, at most [s]
_SAID_S = 2.0


@dataclass(frozen=True)
class OpenedStudy:
    """A study that has been read: its tables, its rows, its addresses, and what it is called in messages."""

    study: Study
    design: Design
    addresses: Addresses
    origin: str

    def addressed(self, settings: dict[str, Any]) -> tuple[str, str | None]:
        """(address of a row, its reference's or None)."""
        return address(self.addresses, self.design, settings)


def open_study(study: str | os.PathLike[str] | Mapping[str, Any] | Study, checked: int = CHECKED) -> OpenedStudy:
    """Reads a study and looks at `checked` of its rows. Raises StudyError, with a line for every fault, or OSError."""
    found, folder, origin = read_study(study)
    design = Design(found)
    addresses = Addresses(found, folder)
    check_rows(addresses, design, origin, spread(len(design), checked))
    if faults := plot_faults(found, design):
        raise StudyError("\n".join(f"{origin}: {fault}" for fault in faults))
    return OpenedStudy(found, design, addresses, origin)


def foreseen(opened: OpenedStudy, checked: int = CHECKED) -> list[str]:
    """What will fail of `checked` rows and their references, a line each, as far as it is known before they are computed."""
    return row_faults(opened.addresses, opened.design, spread(len(opened.design), checked))


def sweep(
    study: str | os.PathLike[str] | Mapping[str, Any] | Study,
    folder: str | os.PathLike[str],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    security: Any = None,
    insecure: bool = False,
    retry_failed: bool = False,
    prune: bool = False,
    told: Callable[[Counts], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> pandas.DataFrame:
    """Computes all rows of a study that its folder does not have yet, and returns its table.

    Parameters
    ----------
    study : str, path, dict or Study
        A file (docs/sweep.md has its tables), one of the program by name, these tables as a dict, or a `Study`.
    folder : str or path
        Where it is kept; made where there is none. Stopped, killed, or changed: the same call goes on.
    workers : int, optional
        Processes of this machine, one thread each (default: one for each processor); 0: none, a loop in this process.
    scheduler : str, optional
        Address of a Dask scheduler whose workers take the place of these.
    security : distributed.Security, optional
        Dask's for it, with certificates; left out: that of Dask's configuration.
    insecure : bool
        Take a scheduler whose traffic is not encrypted and that is on another machine.
    retry_failed : bool
        Rows that failed are computed again.
    prune : bool
        Rows that the study no longer asks for, and those of another version of the program, leave the folder.
    told : callable, optional
        Called often with how far it is (`Counts`).
    say : callable, optional
        Called with a line, where something is to be known.

    Returns
    -------
    pandas.DataFrame
        A row for each that the study asks for, in its order: parameters, measures, `failure` where a row failed,
        `reference`, `key`; and what differs from run to run, such as `cpu_s` (`times.parquet`).

    Raises
    ------
    StudyError
        For a study that cannot be run (a ValueError).
    ValueError
        Where a worker has another program, and for workers that are no number from 0 to 4096.
    OSError
        For a folder that cannot be written.

    Notes
    -----
    A script that calls it with workers needs `if __name__ == "__main__":`, as the processes import it.

    Examples
    --------
    >>> import synth
    >>> study = {
    ...     "base": {"case": "tanpura", "set": {"duration_s": 0.01, "quality": "draft"}},
    ...     "grid": {"initial.displacement_m": [0.5e-3, 1e-3]},
    ...     "measures": ["peak"],
    ... }
    >>> table = synth.sweep(study, "small.sweep", workers=0)
    >>> len(table), bool(table["peak"][0] < table["peak"][1])
    (2, True)
    """
    from synth.native.processors import cores

    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or not 0 <= workers <= 4096):
        raise ValueError(f"workers must be a whole number from 0 to 4096, got {workers!r}")
    opened = open_study(study)
    there = None if scheduler is None else remote(scheduler, security, insecure)
    conduct(opened, Path(folder), cores() if workers is None else workers, there, retry_failed, prune, told, say)
    return read_table(folder)


def conduct(
    opened: OpenedStudy, folder: Path, workers: int, scheduler: Remote | None, retry_failed: bool = False,
    prune: bool = False,
    told: Callable[[Counts], None] | None = None, say: Callable[[str], None] | None = None,
) -> Counts:  # fmt: skip
    """Runs a study in its folder and writes its table. See `sweep`."""
    from synth.study import clusters, compacting
    from synth.study.conducting import Conductor
    from synth.study.keeping import AddressSet, Folder

    say, told = say or (lambda text: None), told or (lambda counts: None)
    with Folder(folder) as kept:
        done, failed, codes = kept.known(retry_failed)
        other = sum(rows for code, rows in codes.items() if code != opened.addresses.code)
        if other and not prune:
            say(f"{other} rows in {folder} come from another version of the program or its libraries; they are kept, and "
                "their rows are computed again with this version (--prune removes them)")  # fmt: skip
        counts = Counts(len(opened.design))
        last = 0.0

        def heard(now: Counts, state: str = "running") -> None:
            nonlocal last, counts
            counts = now
            told(now)
            if time.monotonic() - last > _SAID_S or state != "running":
                last = time.monotonic()
                kept.say(_said(opened, now, state))

        heard(counts)
        crew = None
        try:
            missing = _missing(opened, done)
            if missing:
                crew = clusters.crew_of(opened.addresses.head, min(workers, missing), scheduler)
                conductor = Conductor(opened.design, opened.addresses, kept, crew, done, failed, heard)
                counts = conductor.counts
                conductor.run()
                kept.flush()
                counts = conductor.counts
            else:
                counts.kept = counts.total
                counts.failed = _failed(opened, failed) if len(failed) else 0
            done, failed = AddressSet(), AddressSet()
            if prune:
                gone = compacting.prune(kept, opened.design, opened.addressed)
                say(
                    f"removed from {folder}: {gone} row{'' if gone == 1 else 's'} that the study does not ask for"
                ) if gone else None
            if compacting.finish(kept, opened.design, opened.addressed) is None and counts.total:
                raise OSError(f"{folder}: rows are missing, though all were computed; start again")
            heard(counts, "finished")
        except BaseException:
            heard(counts, "stopped")
            raise
        finally:
            if crew is not None:
                crew.close()
    return counts


def _missing(opened: OpenedStudy, done: Any) -> int:
    """Rows that are not there, counted up to as many as there could be workers."""
    missing = 0
    for settings in opened.design:
        missing += opened.addressed(settings)[0] not in done
        if missing >= 4096:
            break
    return missing


def _failed(opened: OpenedStudy, failed: Any) -> int:
    return sum(opened.addressed(settings)[0] in failed for settings in opened.design)


def _said(opened: OpenedStudy, counts: Counts, state: str) -> dict[str, Any]:
    return {
        "name": opened.study.name, "code": opened.addresses.code, "state": state, "rows": counts.total, "done": counts.done,
        "computed": counts.computed, "failed": counts.failed, "workers": counts.workers, "process": os.getpid(),
        "seconds": round(time.monotonic() - counts.began, 1), "at": time.strftime("%F %T"),
        "parameters": opened.study.parameters,
        "measures": [each["as"] for each in opened.study.measured()],
    }  # fmt: skip


def read_table(folder: str | os.PathLike[str], times: bool = True) -> pandas.DataFrame:
    """Reads the finished table of a study's folder.

    Parameters
    ----------
    folder : str or path
        Of a study that `sweep` or `synth sweep` finished.
    times : bool
        Whether what differs from run to run (`times.parquet`) stands beside it.

    Returns
    -------
    pandas.DataFrame
        A row for each that the study asks for, in its order.

    Raises
    ------
    OSError
        Where there is none yet: `read_rows` reads what has arrived.

    Examples
    --------
    >>> import synth
    >>> study = {"base": {"case": "tanpura", "set": {"duration_s": 0.01, "quality": "draft"}}, "measures": ["steps"]}
    >>> _ = synth.sweep(study, "one.sweep", workers=0)
    >>> synth.read_table("one.sweep")["steps"].tolist()
    [882]
    """
    import pandas
    import pyarrow.parquet as pq

    path = Path(folder)
    if not (path / "table.parquet").is_file():
        raise FileNotFoundError(f"{path}: has no table.parquet yet; `synth sweep --status` says how far it is")
    table = pq.read_table(path / "table.parquet").to_pandas()
    if times and (path / "times.parquet").is_file():
        spent = pq.read_table(path / "times.parquet").to_pandas()
        if not spent["key"].equals(table["key"]):  # killed between the two
            spent = spent.drop_duplicates("key").set_index("key").reindex(table["key"]).reset_index()
        spent = spent.drop(columns="key")
        table = pandas.concat([table, spent[[name for name in spent if name not in table]]], axis=1)
    return table


def read_rows(folder: str | os.PathLike[str]) -> Iterator[dict[str, Any]]:
    """Reads every row that a folder has in its parts, as it came, also while a study runs.

    Parameters
    ----------
    folder : str or path
        Of a study.

    Returns
    -------
    iterator of dict
        Parameters, values and `time.…` of each, nested values as Python's.

    Raises
    ------
    OSError
        For a folder that cannot be read.

    Examples
    --------
    >>> import synth
    >>> study = {"base": {"case": "tanpura", "set": {"duration_s": 0.01, "quality": "draft"}}, "measures": ["steps"]}
    >>> _ = synth.sweep(study, "rows.sweep", workers=0)
    >>> [row["steps"] for row in synth.read_rows("rows.sweep")]
    [882]
    """
    from synth.study import columns
    from synth.study.keeping import Folder

    for part in Folder(Path(folder)).tables():
        yield from columns.rows_of(part)


def read_results(folder: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Rows of the finished table in order, nested values as Python's, times beside them. Raises OSError."""
    import pyarrow.parquet as pq

    from synth.study import columns

    path = Path(folder)
    rows = columns.rows_of(pq.read_table(path / "table.parquet"))
    spent = columns.rows_of(pq.read_table(path / "times.parquet"))
    times = {each["key"]: each for each in spent}
    return [times.get(row["key"], {}) | row for row in rows]


def read_arrays(folder: str | os.PathLike[str], key: str) -> dict[str, Any]:
    """Reads the NumPy arrays that a study kept of one row.

    Parameters
    ----------
    folder : str or path
        Of a study whose `arrays` name fields of a `Result`, or of a function that returned arrays.
    key : str
        The row's address, its `key` in the table.

    Returns
    -------
    dict
        Name → array.

    Raises
    ------
    OSError
        Where there are none.

    Examples
    --------
    >>> import synth
    >>> study = {
    ...     "base": {"case": "tanpura", "set": {"duration_s": 0.01, "quality": "draft"}},
    ...     "measures": ["steps"],
    ...     "arrays": ["u"],
    ... }
    >>> table = synth.sweep(study, "arrays.sweep", workers=0)
    >>> synth.read_arrays("arrays.sweep", table["key"][0])["u"].shape
    (442, 1)
    """
    import zarr

    path = Path(folder) / "arrays.zarr" / key
    if not path.is_dir():
        raise FileNotFoundError(f"{folder}: has no arrays of row {key}")
    group = zarr.open_group(path, mode="r")
    return {str(name): array[:] for name, array in group.arrays()}


__all__ = [
    "OpenedStudy",
    "StudyError",
    "conduct",
    "foreseen",
    "open_study",
    "read_arrays",
    "read_results",
    "read_rows",
    "read_table",
    "sweep",
]
