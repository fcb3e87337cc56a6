"""What works on this machine, and what to install for the rest: `uuv doctor`."""

import contextlib
import importlib
import io
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version

from uuv.cli.json_output import print_json
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import EXTRAS, to_install
from uuv.sim.runs.command_line import parse

OK, ABSENT = "ok", "absent"
_COLOURS = {OK: "green", ABSENT: "yellow"}
_NEEDED = ("mujoco", "numpy", "numba", "scipy", "tyro")
_USES = {  # module of an extra: what it is for
    "embreex": "ray casting for camera and sonar",
    "trimesh": "mesh files",
    "rerun": "run.rrd, uuv view",
    "matplotlib": "figures of the reports",
    "plotly": "time series of the reports",
    "pyarrow": "series as Parquet, studies",
    "PIL": "uuv picture",
    "dm_control": "uuv.environments, reinforcement learning",
    "mcap": "uuv export --mcap",
    "rosbags": "messages of ROS 2, uuv export --bag",
    "pymavlink": "logs of ArduPilot and MAVLink",
    "ray": "campaigns on a cluster",
    "open3d": "peers to compare registration with",
}
_PACKAGES = {
    "rerun": "rerun-sdk",
    "PIL": "pillow",
    "dm_control": "dm-control",
    "open3d": "open3d-cpu",
}

_RENDER = (
    "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).render()"
)


@dataclass(kw_only=True)
class DoctorOptions:
    """What works on this machine, and what to install for the rest."""

    kernels: bool = False
    """Print only the store of compiled kernels: folder, size, age, and its use by the last start.
    """
    json: bool = False
    """Print the table, or with --kernels the store, as JSON."""
    empty_kernels: bool = False
    """Remove all files of the store; the next start compiles again."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the table; exit code 1 if a package that every job needs is absent."""
    del verb
    options = parse(DoctorOptions, args)
    if options.empty_kernels:
        return _empty_kernels()
    if options.kernels:
        return _print_kernels(options.json)

    rows = list(_rows())
    sound = not any(state == ABSENT and name in _NEEDED for name, state, _ in rows)
    if options.json:
        print_json({name: {"state": state, "about": about} for name, state, about in rows})
        return 0 if sound else 1

    from rich.table import Table
    from rich.text import Text

    from uuv.sim.runs.terminal import console

    table = Table("", "", "for", title="this machine", title_justify="left")
    for name, state, about in rows:
        table.add_row(name, Text(state, style=_COLOURS[state]), about)
    console(120).print(table)
    return 0 if sound else 1


def _empty_kernels() -> int:
    from uuv.sim.interfaces.kernels import store  # brings numba

    folder = store.folder()
    if folder is None:
        raise ConfigurationError(f"--empty-kernels: there is no store: {store.content().why}")
    print(f"{store.empty()} compiled kernels removed from {folder}")
    return 0


def _print_kernels(as_json: bool) -> int:
    """Prints the store's content; exit code 1 if there is no store."""
    from uuv.sim.interfaces.kernels import store

    content, last = store.content(), store.last_start()
    if as_json:
        entries = asdict(content) | {
            "folder": None if content.folder is None else str(content.folder)
        }
        entries["last_start"] = None if last is None else asdict(last)
        print_json(entries)
    elif content.folder is None:
        print(f"no store of compiled kernels: {content.why}")
    else:
        print(f"compiled kernels in {content.folder}{f' ({content.why})' if content.why else ''}")
        print(
            f"  {content.files} files, {content.bytes / 1e6:.1f} MB of at most "
            f"{content.limit / 1e6:.0f} MB"
        )

        if content.files:
            print(f"  used between {_ago(content.oldest)} and {_ago(content.newest)}")
        if last is not None:
            print(
                f"  last start, {_ago(last.time)}: {last.loaded} loaded, {last.compiled} compiled"
            )
    return 0 if content.folder is not None else 1


def _ago(moment: float) -> str:
    """Time since `moment` [s since the epoch], in words."""
    seconds = max(time.time() - moment, 0.0)
    for length, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.0f} {unit} ago"
    return f"{seconds:.0f} s ago"


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
        release = version(_PACKAGES.get(module, module))
    except PackageNotFoundError:  # under another name
        release = ""
    return OK, f"{release} {use}".strip()


def rendering() -> tuple[str, str]:
    """State of MuJoCo's renderer, tried in child processes: a missing library may end a process."""
    for backend in dict.fromkeys((os.environ.get("MUJOCO_GL", ""), "egl", "osmesa")):
        tried = {**os.environ, "MUJOCO_GL": backend} if backend else dict(os.environ)
        try:
            ran = subprocess.run(
                [sys.executable, "-c", _RENDER],
                env=tried,
                capture_output=True,
                timeout=30,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired):
            continue

        if ran.returncode == 0:
            return OK, (
                "pictures by OpenGL "
                f"({f'MUJOCO_GL={backend}' if backend else 'the default backend'})"
            )

    return (
        ABSENT,
        "no OpenGL: pictures are drawn by ray casting; rendering is faster with libosmesa6 "
        "(MUJOCO_GL=osmesa) or libegl1 (egl)",
    )


def _numba_threads() -> int:
    import numba

    return numba.get_num_threads()


def _compiled() -> tuple[str, str]:
    from uuv.sim.interfaces.kernels import store

    content, last = store.content(), store.last_start()
    if content.folder is None:
        return ABSENT, f"each start compiles, one to two minutes: {content.why}"
    if not content.files:
        return ABSENT, "the first run compiles them, which takes one to two minutes, once"

    then = "" if last is None else f"; last start: {last.loaded} loaded, {last.compiled} compiled"
    return OK, (
        f"{content.files} in {content.folder}, {content.bytes / 1e6:.0f} MB{then} (--kernels)"
    )
