"""Bundles of macOS: a folder whose Contents say what it is, with an ad-hoc signature over all of it (`macsign`).

A bank lies in Resources: bytes behind the end of a library would break its signature.
"""

from __future__ import annotations

import plistlib

import synth
from synth.plugin import macsign
from synth.plugin.description import Description

#: the file of a bank, in Resources or, where there is no bundle, beside the library
BANK = "bank.jawari"
#: where a library lies in a bundle, which is called as the bundle is
CODE = "Contents/MacOS/{}"
#: the oldest system that libraries are made for
_OLDEST = "11.0"
_PACKAGE, _NOBODY = "BNDL", "????"
_INFO, _KIND, _RESOURCE = "Contents/Info.plist", "Contents/PkgInfo", f"Contents/Resources/{BANK}"
_SEAL = "Contents/_CodeSignature/CodeResources"
#: what a bundle may hold, {} for any name
HOLDS = (_INFO, _KIND, CODE, _RESOURCE, _SEAL)


def identifier(description: Description) -> str:
    """By which the system knows a plugin."""
    return f"org.jawari.{description.id}"


def files(name: str, code: bytes, bank: bytes, description: Description) -> dict[str, bytes]:
    """The files of a bundle of this name, without ending. code: the library. Raises macsign.Unsignable."""
    info = plistlib.dumps(
        {
            "CFBundleDevelopmentRegion": "en",
            "CFBundleExecutable": name,
            "CFBundleIdentifier": identifier(description),
            "CFBundleInfoDictionaryVersion": "6.0",
            "CFBundleName": description.name,
            "CFBundlePackageType": _PACKAGE,
            "CFBundleShortVersionString": synth.__version__,
            "CFBundleSignature": _NOBODY,
            "CFBundleSupportedPlatforms": ["MacOSX"],
            "CFBundleVersion": synth.__version__,
            "LSMinimumSystemVersion": _OLDEST,
            "NSHighResolutionCapable": True,
        }
    )
    sealed = macsign.resources({_RESOURCE.removeprefix("Contents/"): bank})
    return {
        CODE.format(name): macsign.sign(code, identifier(description), info, sealed),
        _INFO: info,
        _KIND: f"{_PACKAGE}{_NOBODY}".encode("ascii"),
        _RESOURCE: bank,
        _SEAL: sealed,
    }


def alone(code: bytes, description: Description) -> bytes:
    """A library without a bundle, signed."""
    return macsign.sign(code, identifier(description))
