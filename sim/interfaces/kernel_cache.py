"""Where numba keeps the machine code of our loops; decided, and mended, when `sim.interfaces` is first imported.

In `__pycache__` beside each file, as numba does by itself. Where the checkout cannot be written: in the user's cache,
and where there is none in a temporary folder of the user's own. NUMBA_CACHE_DIR, if set, is left as it is; processes
that are started from here inherit it.
"""

import os
import pickle
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

HOME = Path(__file__).resolve().parents[2]
ROOMS_WITH_LOOPS = ("models", "sim", "controllers", "perception", "calib")
VARIABLE = "NUMBA_CACHE_DIR"
_ROOM = 64 << 20  # [bytes] that must be free; all loops take 10 MB


def prepare() -> None:
    """Choose a folder that can be written, if the checkout cannot, and take cut files away. Never raises OSError."""
    if not os.environ.get(VARIABLE) and not all(_writable(folder) for folder in folders()):
        place = _place()
        if place is not None:
            os.environ[VARIABLE] = str(place)
            if "numba" in sys.modules:  # it has read the environment already
                sys.modules["numba"].config.CACHE_DIR = str(place)
    for folder in folders():
        mend(folder)


def folders() -> list[Path]:
    """Folders that hold our loops' machine code, or will."""
    given = os.environ.get(VARIABLE)
    if given:  # numba puts the name of a source's folder before a hash of its path
        return [path for name in {folder.name for folder in _sources()} for path in Path(given).glob(f"{name}_*")]
    return [folder / "__pycache__" for folder in _sources()]


def _sources() -> list[Path]:
    """Folders of the rooms that have loops, and the folders in them."""
    rooms = [HOME / room for room in ROOMS_WITH_LOOPS]
    return [*rooms, *(file.parent for room in rooms for file in sorted(room.glob("*/__init__.py")))]


def is_kept(module: str) -> bool:
    """Whether there is machine code of a file `module`.py."""
    return any(any(folder.glob(f"{module}.*.nbi")) for folder in folders())


def mend(folder: Path) -> None:
    """Take index and code files away that were cut (by a power cut, a full disk, a broken copy): numba would raise."""
    cut = [file for file in folder.glob("*.nb[ic]") if not _whole(file)]
    for file in cut:
        try:
            file.unlink(missing_ok=True)
        except OSError:
            return  # not ours to mend; numba will say what is wrong
    if cut:
        print(f"{folder}: {len(cut)} cut files of compiled code taken away, made anew when needed", file=sys.stderr)


def _place() -> Path | None:
    """The user's cache, else a temporary folder; None: nothing can be written anywhere, and numba will say so."""
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uuv-arm" / "kernels"
        cache.mkdir(parents=True, exist_ok=True)
        if _writable(cache):
            return cache
    except (OSError, RuntimeError):  # no home, or none that can be written
        pass
    try:
        place = Path(tempfile.gettempdir()) / f"uuv-arm-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        place.mkdir(mode=0o700, exist_ok=True)
        about = place.lstat()
        if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o077):
            place = Path(tempfile.mkdtemp(prefix="uuv-arm-kernels-"))  # code of another's making is not run
    except OSError:
        return None
    print(f"compiled code is kept in {place}: neither {HOME} nor a home can be written", file=sys.stderr)
    return place


def _writable(folder: Path) -> bool:
    """Whether there is right and room to write to `folder`, or to make it."""
    there = folder if folder.exists() else folder.parent
    try:
        return os.access(there, os.W_OK | os.X_OK) and shutil.disk_usage(there).free > _ROOM
    except OSError:  # neither is there, or a file system that does not tell
        return False


class _Inert:
    """Stands for every object of a pickle that is looked through and not used."""

    def __new__(cls, *_: Any, **__: Any) -> "_Inert":
        return object.__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def __setstate__(self, _: Any) -> None: ...

    def __setitem__(self, *_: Any) -> None: ...

    def append(self, _: Any) -> None: ...

    def extend(self, _: Any) -> None: ...


class _Look(pickle.Unpickler):
    """Reads a pickle to its end, and runs nothing of it."""

    def find_class(self, _module: str, _name: str) -> type[_Inert]:
        return _Inert


def _whole(file: Path) -> bool:
    """Whether `file` is pickles from end to end, as numba writes them: version and index, or code."""
    try:
        with file.open("rb") as stream:
            end = os.fstat(stream.fileno()).st_size
            for _ in range(2 if file.suffix == ".nbi" else 1):
                _Look(stream).load()
            return stream.tell() == end
    except FileNotFoundError:  # another process took it away
        return True
    except OSError:
        return True  # cannot be read: numba says why
    except Exception:  # whatever an unpickler finds in rubbish
        return False
