"""Optional packages, and the extra of `uuv-arm` that installs each."""

import contextlib
import sys
from collections.abc import Iterator
from importlib.util import find_spec

from uuv.sim.interfaces.errors import MissingLibraryError

LOG = "log"  # the extra for logs and reports
BRIDGE = "bridge"  # the extra for files and interfaces of other programs
EXTRAS = {  # module: extra, as in pyproject.toml
    "embreex": "perception",
    "trimesh": "perception",
    "charset_normalizer": "perception",
    "collada": "vehicles",
    "xacro": "vehicles",
    "matplotlib": LOG,
    "PIL": LOG,
    "plotly": LOG,
    "pyarrow": LOG,
    "rerun": LOG,
    "dm_control": "rl",
    "dm_env": "rl",
    "gymnasium": "rl",
    "mcap": BRIDGE,
    "rosbags": BRIDGE,
    "pymavlink": BRIDGE,
    "ray": "cluster",
    "pandas": "pandas",
    "open3d": "open3d",
}
# newest major version of MuJoCo that dm_control's physics supports; see the extra "rl" in
# pyproject.toml
DM_CONTROL_RUNS = 3
_OLDER = ("rl", "open3d")  # extras without packages for Python 3.13


def missing(error: ImportError) -> MissingLibraryError | None:
    """Message if `error` is caused by a missing optional package; None if it is not."""
    module = (error.name or "").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or module not in EXTRAS:
        return None
    return MissingLibraryError(f"this needs the package {module}: {to_install(EXTRAS[module])}")


def without_dm_control(error: Exception) -> MissingLibraryError:
    """Message for a dm_control that cannot be imported."""
    from importlib.metadata import version

    return MissingLibraryError(
        f"this needs dm_control, for MuJoCo {DM_CONTROL_RUNS} (here {version('mujoco')}): "
        f"{to_install('rl')} ({type(error).__name__}: {error})"
    )


def check_dm_control_physics() -> None:
    """Refuse a MuJoCo on which dm_control's physics does not run. Other parts of dm_control may run
    on it.

    Raises:
        MissingLibraryError: MuJoCo is newer than `DM_CONTROL_RUNS`.
    """
    from importlib.metadata import version

    installed = version("mujoco")
    if int(installed.partition(".")[0]) > DM_CONTROL_RUNS:
        raise MissingLibraryError(
            f"this needs dm_control's physics, which runs on MuJoCo {DM_CONTROL_RUNS} (here "
            f"{installed}): {to_install('rl')}"
        )


def to_install(extra: str) -> str:
    """Command that installs an extra, or the Python version that the extra needs if this Python is
    too new.
    """
    if extra in _OLDER and sys.version_info >= (3, 13):
        return f"the extra {extra} needs Python 3.11 or 3.12"
    return f"pip install 'uuv-arm[{extra}]'"


def absent(extra: str) -> tuple[str, ...]:
    """Modules of an extra that are not installed."""
    return tuple(
        module for module, of in EXTRAS.items() if of == extra and find_spec(module) is None
    )


@contextlib.contextmanager
def wanted() -> Iterator[None]:
    """Context manager for imports: the error for a missing optional package names the extra that
    installs it.

    Raises:
        MissingLibraryError: An optional package is missing.
    """
    try:
        yield
    except ImportError as error:
        if (absence := missing(error)) is not None:
            raise absence from error
        raise
