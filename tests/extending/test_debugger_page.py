"""docs/extending/debugger.md does what it says: a debugger stops in a kernel and shows the numbers of the page."""

import re

import numpy as np

from tests.extending.pages import FOLDER, type_commands, write_files


def arrays(text: str) -> np.ndarray:
    return np.array(
        [[float(x) for x in re.findall(r"[-\d.]+", found)] for found in re.findall(r"array\(\[(.*?)\]\)", text, re.DOTALL)]
    )


def test_the_page_runs(tmp_path):
    write_files("debugger", tmp_path)
    (printed,) = type_commands("debugger", tmp_path)
    expected = arrays((FOLDER / "debugger.md").read_text(encoding="utf-8"))
    assert expected.shape == (2, 8)
    assert np.allclose(arrays(printed), expected, rtol=1e-6)
