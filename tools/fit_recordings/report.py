"""What tools/fit-recordings says."""

from __future__ import annotations

from typing import Any

import numpy as np

#: what predicts, in the order of the table
WAYS = ("preset", "fit", "nearest recording", "another take")


def show(rows: list[dict[str, Any]]) -> None:
    """Every note, and a summary of each split."""
    for split in dict.fromkeys(row["split"] for row in rows):
        mine = [row for row in rows if row["split"] == split]
        print(f"\n{split}: rms of the spectrum's difference, and of every window's of every band [dB]")
        for row in mine:
            if "refused" in row:
                print(f"  {row['note']:4} refused: {row['refused']}")
                continue
            for one in row["predicted"]:
                said = "; ".join(
                    f"{way} {one[way]['spectrum_db']:.2f} {one[way]['windows_db']:.2f}" for way in WAYS if way in one
                )
                print(f"  {row['note']:4} {one['dynamic']:2} take {one['take']}: {said}")
            values = ", ".join(f"{name} {value:.3g}" for name, value in row["values"].items())
            print(f"       fitted on {' '.join(row['fitted'])}: {values}")
            preset, fit = row["loss"]["preset"], row["loss"]["fit"]
            print(f"       loss {preset:.3f} by the preset, {fit:.3f} fitted; {row['cpu_s']:.0f} s")
        summary(split, [row for row in mine if "refused" not in row])


def summary(split: str, rows: list[dict[str, Any]]) -> None:
    """Medians over recordings, and how many of them the fit predicts better than the preset."""
    said = [one for row in rows for one in row["predicted"]]
    if not said:
        return
    seconds = np.median([row["cpu_s"] for row in rows])
    print(f"  {split}, {len(said)} recordings of {len(rows)} notes, {seconds:.0f} s a fit (median):")
    for measure in ("spectrum_db", "windows_db"):
        parts = []
        for way in WAYS:
            some = [one[way][measure] for one in said if way in one]
            if some:
                parts.append(f"{way} {np.median(some):.2f} (of {len(some)})")
        gained = np.array([one["preset"][measure] - one["fit"][measure] for one in said])
        print(f"    {measure}, medians: {', '.join(parts)}")
        print(
            f"      fit better than preset by {np.median(gained):+.2f} (median), {gained.mean():+.2f} (mean), "
            f"{gained.min():+.2f} … {gained.max():+.2f} dB; better in {int((gained > 0).sum())} of {gained.size}"
        )
