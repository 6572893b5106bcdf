"""Where compiled kernels are kept between runs, so that only the first start compiles (layer 0).

Numba notices a change of the file a kernel stands in, not of the files it calls into: after an edit or an update old
machine code could go on running beside new one. Here the folder's name holds a hash of every kernel's source.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_MARKS = (b"njit(", b"cfunc(", b"row_layout")  # what kernels are made of, and the layout compiled into them
_KEPT = 4  # folders of other versions that stay


def use_kernel_cache() -> Path:
    """Point the compiler's cache at a folder of this exact version; call it before numba is imported.

    A folder the user has chosen by ``NUMBA_CACHE_DIR`` is left alone.

    Returns:
        The folder.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    home = _cache_home() / "polish-sim"
    folder = home / f"kernels-{_fingerprint()}"
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if not folder.exists():
        _prune(home)
    return folder


def is_warm(folder: Path) -> bool:
    """Whether kernels have been compiled into a cache folder before."""
    return any(folder.rglob("loop.advance*.nbi"))


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        source = path.read_bytes()
        if any(mark in source for mark in _MARKS):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def _cache_home() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _prune(home: Path) -> None:
    others = sorted(home.glob("kernels-*"), key=lambda p: p.stat().st_mtime, reverse=True)
    for old in others[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
