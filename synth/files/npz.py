"""Arrays out of .npz files that others have made, or that are broken."""

from __future__ import annotations

import os
import warnings

import numpy as np


def read_npz(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Every array of an .npz by its name. Raises OSError, and ValueError that names the file and says why it is none."""
    with open(path, "rb") as file:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # what NumPy only warns of in a header is no file of ours either
                data = np.load(file, allow_pickle=False)
                if isinstance(data, np.lib.npyio.NpzFile):
                    return {name: data[name] for name in data.files}
        except OSError:
            raise
        except MemoryError:
            raise ValueError(f"{path} cannot be read as .npz: its header asks for more memory than there is") from None
        except Exception as error:  # a flipped byte may be met by zipfile, zlib, struct, tokenize or ast
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(f"{path} cannot be read as .npz: {reason}") from None
    raise ValueError(f"{path} holds one array without a name; write it with numpy.savez")
