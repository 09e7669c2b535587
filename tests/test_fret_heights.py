"""Measured heights of frets, read from a file."""

from pathlib import Path

import pytest

from synth.instrument.fret_heights import FretHeightsError, read_fret_heights


@pytest.mark.parametrize(
    "text",
    [
        "fret,height_mm\n1,1.016\n2,1.27\n3,1.016\n",
        "# neck of June\n\nfret,height_thou\n1,40\n3,40\n2,50\n",
        "fret;height_mm\n1;1,016\n2;1,27\n3;1.016\n",
        "\ufefffret,height_um,who\n1,1016,a\n2,1270,a\n# worn\n3,1016,b\n",
        '"Height_mm","Fret"\r\n"1.016","1"\r\n"1.27","2"\r\n"1.016","3"\r\n',
    ],
)
def test_tables_in_every_form(tmp_path: Path, text: str) -> None:
    path = tmp_path / "frets.csv"
    path.write_text(text, encoding="utf-8", newline="")
    assert read_fret_heights(path) == pytest.approx((1.016, 1.27, 1.016), abs=1e-12)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", r"frets\.csv: is empty; begin with the line fret,height_mm"),
        (b"fret,height_mm\n", "has no fret; give a line for each"),
        (
            b"fret,hight_mm\n1,1\n",
            r"line 1: must name a column fret and one of .*got fret, hight_mm \(perhaps height_mm\?\); name",
        ),
        (b"fret,height_mm,height_um\n1,1,1\n", "line 1: must name a column fret and one of"),
        (b"fret,height_mm\n1,1\n1,1.1\n", r"line 3: has fret 1 again; leave one of its lines out"),
        (b"fret,height_mm\n1,1\n3,1\n", r"fret 2 is missing, of 1 to 3; give a line for every fret"),
        (b"fret,height_mm\n1.5,1\n", r"line 2: fret must be a whole number from 1 to 36, got '1\.5'"),
        (b"fret,height_mm\n1,high\n", r"line 2: height_mm must be a number, got 'high'; measure this fret"),
        (b"fret,height_mm\n1,40\n", r"line 2: height_mm must lie between 0\.1 and 5, got 40; check its unit"),
        (b"fret,height_thou\n1,nan\n", r"line 2: height_thou must lie between 3\.937 and 196\.9, got nan"),
        (b"fret,height_mm\n1,1,016\n", r"line 2: must have 2 columns.*got 3; separate columns by semicolons"),
        (b"fret,height_mm\n1,\xff\n", "not a text file in UTF-8"),
        (b"#" * (1 << 20) + b"\n", "larger than 1 MB, the limit for a table of fret heights"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(tmp_path: Path, data: bytes, told: str) -> None:
    path = tmp_path / "frets.csv"
    path.write_bytes(data)
    with pytest.raises(FretHeightsError, match=told):
        read_fret_heights(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_fret_heights(tmp_path / "none.csv")
