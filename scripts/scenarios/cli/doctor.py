"""What works on this machine, and what to install for the rest: `uuv doctor`."""

import contextlib
import importlib
import io
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.interfaces.extras import EXTRAS, to_install

OK, ABSENT = "[green]ok[/green]", "[yellow]absent[/yellow]"
_NEEDED = ("mujoco", "numpy", "numba", "scipy", "tyro")
_USES = {  # module of an extra: what it is for
    "embreex": "ray casting for camera and sonar",
    "trimesh": "mesh files",
    "rerun": "run.rrd, uuv view",
    "matplotlib": "figures of the reports",
    "plotly": "time series of the reports",
    "pyarrow": "series as Parquet, studies",
    "PIL": "uuv picture",
    "dm_control": "sim.environment, reinforcement learning",
    "ray": "campaigns on a cluster",
    "open3d": "peers to compare registration with",
}
_PACKAGES = {"rerun": "rerun-sdk", "PIL": "pillow", "dm_control": "dm-control", "open3d": "open3d-cpu"}

_RENDER = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).render()"


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the table; 1 if something that every job needs is absent."""
    del verb
    if args:
        print("usage: uuv doctor\n\nWhat works on this machine, and what to install for the rest.")
        return 0 if args[0] in ("-h", "--help") else 2
    table = Table("", "", "for", title="this machine", title_justify="left")
    sound = True
    for name, state, said in _rows():
        table.add_row(name, state, escape(said))
        sound &= not (state == ABSENT and name in _NEEDED)
    Console(width=None if Console().is_terminal else 120).print(table)
    return 0 if sound else 1


def _rows() -> Iterator[tuple[str, str, str]]:
    yield "Python", OK, f"{platform.python_version()}, {sys.executable}"
    yield "cores", OK, f"{os.cpu_count()}; numba uses {_numba_threads()}"
    for name in _NEEDED:
        yield name, *_package(name, "", "pip install uuv-arm")
    for module, use in _USES.items():
        yield module, *_package(module, use, to_install(EXTRAS[module]))
    yield "rendering", *rendering()
    yield "compiled loops", *_compiled()


def _package(module: str, use: str, remedy: str) -> tuple[str, str]:
    """State of a package that may be missing, or lack a system library."""
    try:
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            importlib.import_module(module)
    except ModuleNotFoundError as error:
        return ABSENT, f"{use}; {remedy if error.name == module else error}"
    except (ImportError, OSError) as error:
        return ABSENT, f"{use}; a system library is missing: {str(error).splitlines()[0]}"
    try:
        found = version(_PACKAGES.get(module, module))
    except PackageNotFoundError:  # under another name
        found = ""
    return OK, f"{found} {use}".strip()


def rendering() -> tuple[str, str]:
    """State of MuJoCo's renderer, tried in processes of their own: a missing library may end one."""
    for backend in dict.fromkeys((os.environ.get("MUJOCO_GL", ""), "egl", "osmesa")):
        tried = {**os.environ, "MUJOCO_GL": backend} if backend else dict(os.environ)
        try:
            ran = subprocess.run(
                [sys.executable, "-c", _RENDER], env=tried, capture_output=True, timeout=30, check=False
            )
        except (OSError, subprocess.TimeoutExpired):
            continue
        if ran.returncode == 0:
            return OK, f"pictures by OpenGL ({f'MUJOCO_GL={backend}' if backend else 'the default backend'})"
    return (
        ABSENT,
        "OpenGL: pictures are drawn by ray casting; faster with libosmesa6 (MUJOCO_GL=osmesa) or libegl1 (egl)",
    )


def _numba_threads() -> int:
    import numba

    return numba.get_num_threads()


def _compiled() -> tuple[str, str]:
    from scenarios.ticks.compiled_ticks import run_ticks
    from sim.interfaces.kernel_cache import is_kept

    if not is_kept(run_ticks):
        return ABSENT, "the first run compiles them, which takes one to two minutes, once"
    return OK, "in numba's cache: a run starts at once"
