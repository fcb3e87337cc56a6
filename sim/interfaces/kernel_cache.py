"""Location and repair of numba's on-disk kernel cache, set up when `sim.interfaces` is first imported.

By default `__pycache__` beside each file, as numba does. If the checkout is read-only: the user's cache folder, else a
private temporary folder. If NUMBA_CACHE_DIR is set, it is left unchanged. Child processes inherit the choice.
"""

import os
import pickle
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

HOME = Path(__file__).resolve().parents[2]
ROOMS_WITH_LOOPS = ("models", "sim", "controllers", "perception", "calib")  # packages that have kernels
VARIABLE = "NUMBA_CACHE_DIR"
_ROOM = 64 << 20  # [bytes] that must be free on disk; all kernels take 10 MB


def prepare() -> None:
    """Choose a writable cache folder and remove truncated cache files; never raises OSError."""
    if not os.environ.get(VARIABLE) and not all(_writable(folder) for folder in folders()):
        place = _place()
        if place is not None:
            os.environ[VARIABLE] = str(place)
            if "numba" in sys.modules:  # numba has read the environment already
                sys.modules["numba"].config.CACHE_DIR = str(place)
    for folder in folders():
        mend(folder)


def folders() -> list[Path]:
    """Folders that hold the kernels' machine code, or will."""
    given = os.environ.get(VARIABLE)
    if given:  # numba names each subfolder by the source's folder and a hash of its path
        return [path for name in {folder.name for folder in _sources()} for path in Path(given).glob(f"{name}_*")]
    return [folder / "__pycache__" for folder in _sources()]


def _sources() -> list[Path]:
    """Folders of the packages that have kernels, and their subpackages."""
    wiring = [path for path in (HOME / "scenarios", HOME / "scripts" / "scenarios") if path.is_dir()]  # wheel, checkout
    rooms = [*(HOME / room for room in ROOMS_WITH_LOOPS), *wiring]
    return [*rooms, *(file.parent for room in rooms for file in sorted(room.glob("*/__init__.py")))]


def is_kept(kernel: Any) -> bool:
    """Return True if machine code of a kernel `keyed_by_imports` is cached, made from the present sources."""
    function = kernel.py_func
    name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}-*.nbi"
    return any(any(folder.glob(name)) for folder in folders())


def mend(folder: Path) -> None:
    """Remove truncated index and code files (power cut, full disk, broken copy); numba would raise on them."""
    cut = [file for file in folder.glob("*.nb[ic]") if not _whole(file)]
    for file in cut:
        try:
            file.unlink(missing_ok=True)
        except OSError:
            return  # no right to repair it; numba reports the error
    if cut:
        print(f"{folder}: {len(cut)} cut files of compiled code taken away, made anew when needed", file=sys.stderr)


def _place() -> Path | None:
    """The user's cache folder, else a temporary one; None if nothing can be written, which numba reports."""
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uuv-arm" / "kernels"
        cache.mkdir(parents=True, exist_ok=True)
        if _writable(cache):
            return cache
    except (OSError, RuntimeError):  # no home, or a read-only one
        pass
    try:
        place = Path(tempfile.gettempdir()) / f"uuv-arm-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        place.mkdir(mode=0o700, exist_ok=True)
        about = place.lstat()
        if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o077):
            place = Path(tempfile.mkdtemp(prefix="uuv-arm-kernels-"))  # never run code that another user wrote
    except OSError:
        return None
    print(f"compiled code is kept in {place}: neither {HOME} nor a home can be written", file=sys.stderr)
    return place


def _writable(folder: Path) -> bool:
    """Return True if `folder` can be written or created, and the disk has space."""
    there = folder if folder.exists() else folder.parent
    try:
        return os.access(there, os.W_OK | os.X_OK) and shutil.disk_usage(there).free > _ROOM
    except OSError:  # neither exists, or the file system gives no answer
        return False


class _Inert:
    """Stand-in for every object of a pickle that is only read through."""

    def __new__(cls, *_: Any, **__: Any) -> "_Inert":
        return object.__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def __setstate__(self, _: Any) -> None: ...

    def __setitem__(self, *_: Any) -> None: ...

    def append(self, _: Any) -> None: ...

    def extend(self, _: Any) -> None: ...


class _Look(pickle.Unpickler):
    """Unpickler that reads a pickle to its end and executes nothing of it."""

    def find_class(self, _module: str, _name: str) -> type[_Inert]:
        return _Inert


def _whole(file: Path) -> bool:
    """Return True if `file` is complete pickles, as numba writes them: version and index, or code."""
    try:
        with file.open("rb") as stream:
            end = os.fstat(stream.fileno()).st_size
            for _ in range(2 if file.suffix == ".nbi" else 1):
                _Look(stream).load()
            return stream.tell() == end
    except FileNotFoundError:  # removed by another process
        return True
    except OSError:
        return True  # unreadable: numba reports it
    except Exception:  # a damaged pickle can raise anything
        return False
