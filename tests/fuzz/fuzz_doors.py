"""Every door for files, options and Python arguments, and what is thrown at it;
`test_fuzz_doors.py` runs it.

    ./uvw run tests/fuzz/fuzz_doors.py --inputs 200                     # of each door, fixed seeds
    ./uvw run tests/fuzz/fuzz_doors.py --inputs 200 --seed 77 --door urdf

An input is right if what comes out is whole and finite, or one of our errors in one line of at most
300 characters. Any other exception, a warning of numpy's, a number that is none, or more than
LONGEST seconds is a finding. One input is repeated by its door, seed and number.
"""

import argparse
import contextlib
import dataclasses
import importlib
import io
import re
import signal
import tempfile
import time
import tomllib
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import mujoco
import numpy as np

from uuv import models, scenario_file
from uuv.calib import Arm, MapFit
from uuv.calib import identify as calibrate
from uuv.calib.arm_files import read_arm
from uuv.calib.touch_files import read_touches
from uuv.campaigns.campaign import read_campaign
from uuv.cli import main as verbs
from uuv.cli.completion import options_class, options_in
from uuv.controllers.mkps import Chain, IkOptions, Tracker, solve, solve_many
from uuv.experiment.declaration import experiments_in
from uuv.jobs import BY_NAME, clean_barrel
from uuv.jobs.command_line import options_class as options_of_job
from uuv.jobs.command_line import typed
from uuv.models.arms import published_arms
from uuv.models.files import sidecar
from uuv.models.files.parts_file import read_parts
from uuv.models.objects import deformed, targets
from uuv.models.objects.target_model import ModelPath, Symmetry, TargetModel
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.own_vehicle import vehicle_spec
from uuv.perception import identify
from uuv.perception.clouds.cloud_files import load_cloud
from uuv.perception.clouds.point_files import read_targets
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.seabed.terrain_path import plan_seabed_work
from uuv.perception.toolpath.path_shapes import circle, laid_on, line, raster
from uuv.perturbations.pad import Pad
from uuv.perturbations.vehicle import Water
from uuv.sim.interfaces.errors import LONGEST as LONGEST_MESSAGE
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.runs import command_line as startup
from uuv.sim.sensors import arm_camera
from uuv.sim.water.current import Current

ROOT = Path(__file__).resolve().parents[2]

_WARMED: set[str] = set()
LONGEST = 10.0  # [s] for one input
Rng = np.random.Generator


class RefusedError(UuvError):
    """A script's options were refused, in the line that the user sees."""


class Door(NamedTuple):
    """One way in. `throw(rng, folder)` makes an input from `rng` and gives it to the door; what
    comes out is returned, to be looked through for numbers that are none.
    """

    name: str
    throw: Callable[[Rng, Path], Any]
    share: float = 1.0  # of the inputs that a quick door gets
    # a first call, to compile what the door leads to, off the clock
    warm: Callable[[], Any] | None = None


class FindingError(AssertionError):
    """An input that was not met as it should be."""


class Overdue(BaseException):
    """An input took too long; no Exception, so that no `except Exception` on the way swallows
    it.
    """


# What comes out


def whole(value: Any, depth: int = 0) -> None:
    """Raise FindingError where `value` holds a number that is none; None, words and infinite limits
    pass.
    """
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and np.isnan(value).any():
            raise FindingError(f"an array {value.shape} with NaN")
    elif isinstance(value, float):
        if value != value:
            raise FindingError("NaN")
    elif depth < 4 and isinstance(value, list | tuple):
        for element in value:
            whole(element, depth + 1)
    elif depth < 4 and isinstance(value, Mapping):
        for element in value.values():
            whole(element, depth + 1)
    elif depth < 4 and dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            whole(getattr(value, field.name), depth + 1)


@contextlib.contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raise Overdue in what takes longer, where the system has timers."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise Overdue(f"took more than {seconds:g} s")

    if not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def attempt(door: Door, seed: int, number: int) -> str:
    """Throw input `number` of `seed` at `door`: "passed", or what our error says.

    Raises FindingError otherwise.
    """
    if door.warm is not None and door.name not in _WARMED:
        _WARMED.add(door.name)
        with contextlib.suppress(UuvError):
            door.warm()
    rng = np.random.default_rng([seed, zlib.crc32(door.name.encode()), number])
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", category=ResourceWarning)
        try:
            with at_most(LONGEST), contextlib.redirect_stdout(io.StringIO()):
                whole(door.throw(rng, Path(folder)))
        except UuvError as error:
            message = str(error)
            if not message or len(message) > LONGEST_MESSAGE or not message.isprintable():
                raise FindingError(
                    f"{len(message)} characters, or not one line: {message!r}"
                ) from error
            return message
        except Overdue as overdue:
            raise FindingError(str(overdue)) from overdue
        except FindingError:
            raise
        except (Exception, SystemExit) as error:
            raise FindingError(f"{type(error).__name__}: {error}") from error
    return "passed"


# What is thrown: numbers and things

NUMBERS: list[Any] = [
    float("nan"),
    float("inf"),
    -float("inf"),
    -1.0,
    0.0,
    -0.0,
    1e-300,
    -1e-12,
    1e18,
    1e300,
    -1e308,
    10**400,
    -(10**400),
    10**5000,
    2**63,
    2**64,
    2.5,
    True,
    "1",
    "nan",
    np.float32(1e38),
    np.int8(-1),
    np.uint64(2**64 - 1),
]


class Hostile:
    """An object that raises whatever is asked of it."""

    def __array__(self, *_args: Any, **_how: Any) -> Any:
        raise RuntimeError("no array")

    def __repr__(self) -> str:
        raise RuntimeError("no words")


def things() -> list[Any]:
    return [
        None,
        "much",
        "",
        "x" * 1000,
        "Müller\n日本\0",
        b"bytes",
        [],
        [[]],
        {},
        set(),
        [1, "a"],
        [[1, 2], [3]],
        object(),
        1j,
        [1j],
        Hostile(),
        lambda: 1,
        int,
        np.zeros((0, 3)),
        np.zeros((3, 0)),
        np.zeros((2, 2, 2, 2)),
        np.array(None),
        np.zeros(3, dtype="datetime64[s]"),
        np.array(["a", "b"]),
        np.zeros(3, dtype=complex),
        np.array([object()] * 3),
        np.zeros((4, 4), dtype=bool),
        (x for x in (1, 2)),
        range(3),
        Path("nowhere"),
        {"a": float("nan")},
        slice(1),
        np.full((3, 3), np.nan),
        np.ma.masked_all((3,)),
        7,
        7.0,
        -3,
        *NUMBERS,
    ]


def one_of(rng: Rng, choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


def wrong(rng: Rng, value: Any) -> Any:
    """`value` with something done to it, or something else in its place."""
    kind = int(rng.integers(9))
    if kind < 3 or value is None or not isinstance(value, int | float | list | tuple | np.ndarray):
        return one_of(rng, things())
    try:
        array = np.array(value, dtype=object if kind == 3 else np.float64)
    except (TypeError, ValueError):
        return one_of(rng, things())
    if array.dtype == object and array.size:
        array.flat[int(rng.integers(array.size))] = one_of(rng, NUMBERS)
    elif kind == 4:
        array = (
            array * 10.0 ** rng.integers(-300, 300)
            if np.abs(array).max(initial=0.0) < 1e8
            else -array
        )
    elif kind == 5:
        array = np.asfortranarray(array[..., None] if rng.random() < 0.3 else array)
        array.setflags(write=False)
    elif kind == 6:
        array = array.astype(one_of(rng, [">f8", "f4", "i4", "f2", "O", "U8", "c16", "?", "i1"]))
    elif kind == 7:
        array = np.ones(
            [(), (1,), (3,), (4,), (6,), (3, 3), (4, 4), (6, 4), (1, 1, 1)][int(rng.integers(9))]
        )
    elif kind == 8:
        array = np.repeat(array, int(rng.integers(0, 4)), axis=0) if array.ndim else -array
    return array.tolist() if rng.random() < 0.3 or array.ndim == 0 else array


def spoilt(rng: Rng, given: dict[str, Any], least: int = 1) -> dict[str, Any]:
    """`given` with at least so many of its values made `wrong`."""
    chosen = rng.permutation(list(given))[: max(least, int(rng.integers(1, 3)))]
    return {
        name: wrong(rng, argument) if name in chosen else argument
        for name, argument in given.items()
    }


# What is thrown: files

WORDS: list[bytes] = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-1",
    b"0",
    b"1e308",
    b"1e-320",
    b"9" * 400,
    b"",
    b"x",
    b"1,5",
    b"0x1f",
    b"1_0",
    b"true",
    b"null",
    b"[",
    b"]",
    b"{",
    b"}",
    b"<",
    b">",
    b"&",
    b"\0",
    b"\xff\xfe",
    b"\xe9",
    "ä→\u2028".encode(),
    b"\n",
    b"\r",
    b"\t",
    b"  ",
    b"#",
    b"%",
    b"&lol;",
    b"-",
    b".",
    b"1e",
    b"--",
    b"!!python/object:os.system",
    b"*a",
    b"&a",
    b"." * 300,
    b"[" * 3000,
    b"<a>" * 300,
    b"../" * 200,
    b"2.",
    b".nan",
    b"1 2 3 4 5 6 7 8 9",
]


def mutated(rng: Rng, raw: bytes) -> bytes:
    """A valid file `raw` with one to four things done to it."""
    # one value in place of another: what follows the grammar gets past the parser
    gentle = rng.random() < 0.6
    for _ in range(1 if gentle else int(rng.integers(1, 5))):
        at, end = sorted(int(k) for k in rng.integers(0, len(raw) + 1, 2))
        end = min(end, at + int(10 ** rng.uniform(0.0, 3.0)))
        kind = int(rng.integers(6 if gentle else 0, 9))
        if kind == 0:
            raw = raw[:at]
        elif kind == 1:
            raw = raw[:at] + raw[end:]
        elif kind == 2:
            raw = raw[:at] + raw[at:end] * int(rng.integers(2, 4)) + raw[end:]
        elif kind == 3:
            raw = raw[:at] + one_of(rng, WORDS) + raw[at:]
        elif kind == 4:
            raw = (
                raw[:at]
                + rng.integers(0, 256, min(8, len(raw) - at), dtype=np.uint8).tobytes()
                + raw[at + 8 :]
            )
        elif kind == 5:
            lines = raw.split(b"\n")
            i, j = (int(k) for k in rng.integers(0, len(lines), 2))
            lines[i], lines[j] = lines[j], lines[i]
            raw = b"\n".join(lines)
        else:  # mostly a number in place of a number, a word in place of a word
            matches = list(
                re.finditer(rb"-?\d+\.?\d*(e-?\d+)?" if kind < 8 else rb"[A-Za-z_]{2,}", raw)
            )
            if matches:
                spot = one_of(rng, matches)
                other = (
                    one_of(rng, [word.group() for word in matches])
                    if rng.random() < 0.3
                    else one_of(rng, WORDS[:17])
                )
                raw = (
                    raw[: spot.start()]
                    + (other if gentle else one_of(rng, WORDS))
                    + raw[spot.end() :]
                )
    return raw


def thrown(rng: Rng, folder: Path, valid: Mapping[str, bytes]) -> Path:
    """One of the `valid` files, mutated, in `folder`; rarely a name that there is not, or a
    folder.
    """
    name = one_of(rng, sorted(valid))
    file = folder / name
    odd = rng.random()
    if odd < 0.02:
        return folder / ("n" * 300 + Path(name).suffix)
    if odd < 0.04:
        file.mkdir()
        return file
    file.write_bytes(mutated(rng, valid[name]) if odd < 0.95 else valid[one_of(rng, sorted(valid))])
    return file


_VEHICLE = """
<mujoco><option timestep="0.002"/><worldbody><body name="hull"><freejoint/>
<geom type="box" size=".5 .3 .2" mass="60"/><site name="camera" pos=".5 0 0" quat=".5 -.5 .5 -.5"/>
<site name="t1" pos="-.5 .2 0"/><site name="t2" pos="-.5 -.2 0"/>
<body name="arm_base" pos=".4 0 -.2"><geom size=".05" mass="1"/>
<body name="a" pos="0 0 -.1"><joint name="j1" axis="0 0 1" range="-2 2" limited="true"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".04" mass="3"/>
<body name="b" pos=".3 0 0"><joint name="j2" axis="0 1 0" range="-2 2" limited="true"/>
<geom name="pad" type="sphere" size=".04" mass="1"/>
  <site name="tip" pos=".1 0 0" quat=".7071 0 .7071 0"/>
</body></body></body></body></worldbody>
<actuator><motor name="j1" joint="j1" ctrlrange="-50 50" ctrllimited="true"/>
<motor name="j2" joint="j2" ctrlrange="-50 50" ctrllimited="true"/>
<motor name="thruster_t1" site="t1" gear="1 0 0 0 0 0"/>
</actuator><keyframe><key name="home" qpos="0 0 0 1 0 0 0 .1 .2"/></keyframe></mujoco>
"""
_URDF = b"""<?xml version="1.0" encoding="utf-8"?>
<robot name="r"><link name="base"/><link name="l1"/><link name="l2"/><link name="tip"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/>
  <origin xyz="0 0 0.3" rpy="0 0 0.1"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="l1"/><child link="l2"/>
  <origin xyz="0.2 0 0" rpy="1.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.5" effort="1" velocity="1"/></joint>
<joint name="j3" type="continuous"><parent link="l2"/><child link="tip"/><origin xyz="0 0 0.2"/>
<axis xyz="1 0 0"/></joint></robot>"""
_DH = b"theta,d,a,alpha\n0,0.3,0,1.5708\n0,0,0.4,0\n0.1,0,0.3,0\n0,0.2,0,-1.5708\n"
_YAML = b"""units: {angle: rad, length: m}
base: base
joint_names: [one, two, three]
joint_types: rrp
X_base_0: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]]
X_n_flange: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
tcp: [0, 0, 0.1]
limits: [[-1, 2], [null, null], [0, 0.5]]
dh:
- {theta: 0, d: 0.3, a: 0, alpha: 1.5708}
- {theta: 0, d: 0, a: 0.4, alpha: 0}
- {theta: 0.1, d: 0, a: 0.3, alpha: 0}
"""
_UR = b"""kinematics:
  shoulder: {x: 0, y: 0, z: 0.18, roll: 0, pitch: 0, yaw: 0.1}
  upper_arm: {x: 0, y: 0, z: 0, roll: 1.57, pitch: 0, yaw: 0}
  forearm: {x: -0.6, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}
  hash: calib_1
"""
_PARTS = b"""hull: hull
tip: {body: b, pos: [0.1, 0, 0], z: [1, 0, 0]}
camera: camera
joints: {j1: 10, j2: null}
thrusters:
- {name: port, pos: [-0.2, 0.1, 0], direction: [1, 0, 0], kind: t200}
- {actuator: thruster_t1, kind: {forward: 30, reverse: 22.5, dead_band: 5e-2, time_constant: 0.15}}
- &last
  site: t2
  direction: [0, 1, 0]
  kind: {of_table: {command: [-1, 0, 1], thrust: [-4, 0, 5]}}
- {<<: *last, name: other}
trim: 0.05
"""
_WATER = b"""water_density: 1010.5
bodies:
  hull: &hull
    volume: 0.06
    center_of_buoyancy: [0.01, 0, 0.1]
    added_mass: [15.1, 20, 25, 0.4, 0.8, 0.9]
    quadratic_damping: [30, 60, 80, 1, 2, 3.3]
    strips: [{start: [0, 0, 0], end: [0.3, 0, 0], normal: 3.1, stations: 5}]
    forms: [{munk_factor: {factor: [0, 0.5, 1]}}, {wing: {area: 0.1, span: 0.3, drag_0: 0.1}}]
  a: {cylinder: {radius: 3e-2, start: [0, 0, 0], end: [0.3, 0.1, 0]}, volume: 0.001}
thrusters:
  thruster_t1: {of_polynomial: {ahead: [20], astern: [10, 5], slew_rate: .inf}}
"""
_CAMPAIGN = b"""base = "clean-barrel"
quick = true
cases = 3
design = "sobol"
kept = 0.5
[set]
"belief.water_error" = 0.1
[distributions]
"site.current" = { direction = [0.1, 0.4] }
"perturbations.Pad.stiffness" = { log_uniform = [1e4, 1e6] }
[metrics]
names = ["contact.force_error_rms_n"]
[bounds]
"contact.lost_s" = 0.0
[limits]
time_s = 30.0
"""
_SCENARIO = scenario_file.to_toml(
    replace(clean_barrel(quick=True), perturbations=(Pad(stiffness=1e5), Water(spread=0.2)))
)
_OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
_PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
    b"z\nelement face 4\n"
    b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    b"3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
)
_OFF = b"OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
_FACET = b"facet normal 0 0 1\nouter loop\nvertex %s\nvertex %s\nvertex %s\nendloop\nendfacet\n"
_STL = (
    b"solid a\n"
    + _FACET % (b"0 0 0", b"0 1 0", b"1 0 0")
    + _FACET % (b"0 0 0", b"1 0 0", b"0 0 1")
    + b"endsolid a\n"
)
_BINARY_STL = (
    bytes(80)
    + (1).to_bytes(4, "little")
    + np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], dtype="<f4").tobytes()
    + b"\0\0"
)


def _cloud_files() -> dict[str, bytes]:
    points = np.random.default_rng(0).normal([0.0, 0.0, 2.0], 0.3, (40, 3)).astype("<f4")
    rows = "\n".join(" ".join(f"{x:.4f}" for x in row) for row in points).encode()
    ply = (
        "ply\nformat {} 1.0\nelement vertex 40\nproperty float x\nproperty float y\nproperty "
        "float z\nend_header\n"
    )
    pcd = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH "
        "40\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA {}\n"
    )
    return {
        "a.txt": rows,
        "a.csv": rows.replace(b" ", b","),
        "a.xyz": rows.replace(b" ", b"; "),
        "a.ply": ply.format("ascii").encode() + rows + b"\n",
        "b.ply": ply.format("binary_little_endian").encode() + points.tobytes(),
        "a.pcd": pcd.format("ascii").encode() + rows + b"\n",
        "b.pcd": pcd.format("binary").encode() + points.tobytes(),
    }


def _touch_files() -> dict[str, bytes]:
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (12, 3))
    rows = [",".join(f"{x:.5f}" for x in row) for row in q]
    return {
        "a.csv": "\n".join(rows).encode(),
        "b.csv": "\n".join(["j1,j2,j3", *rows]).encode(),
        "c.csv": "\n".join(
            [
                "point;j1[deg];j2[deg];j3[deg]",
                *(f"p{k % 2};" + r.replace(",", ";") for k, r in enumerate(rows)),
            ]
        ).encode(),
        "d.tsv": "\n\n".join(
            "\n".join(rows[k : k + 4]).replace(",", "\t") for k in (0, 4, 8)
        ).encode(),
    }


VALID: dict[str, dict[str, bytes]] = {
    "parts": {"a.yaml": _PARTS},
    "water": {"a.yaml": _WATER},
    "campaign": {"a.toml": _CAMPAIGN},
    "scenario": {"a.toml": _SCENARIO.encode()},
    "arm camera": {"a.toml": arm_camera.TABLE.read_bytes()},
    "vehicle": {"a.xml": _VEHICLE.encode(), "b.mjcf": _VEHICLE.encode()},
    "mesh": {"a.obj": _OBJ, "a.ply": _PLY, "a.off": _OFF, "a.stl": _STL, "b.stl": _BINARY_STL},
    "cloud": _cloud_files(),
    "urdf": {
        "a.urdf": _URDF,
        "b.xml": _URDF,
        "c.urdf": _URDF.replace(b"utf-8", b"latin-1").replace(b'"r"', b'"\xe9"'),
    },
    "arm": {
        "a.csv": _DH,
        "b.txt": _DH.replace(b",", b" "),
        "a.yaml": _YAML,
        "b.yml": _UR,
        "a.xml": _VEHICLE.encode(),
    },
    "touches": _touch_files(),
    "targets": {"a.txt": b"# B\n0 0 0\n0.5, 0, 0.1\n1;0;0\nz 0 0 1\n", "b.csv": b"0 0 0\n"},
}


def give(door: str, file: Path, rng: Rng | None = None) -> Any:
    """What comes out of a `door` for files (a key of VALID) that is given `file`."""
    if door == "vehicle":
        model = vehicle_spec(str(file)).compile()
        out = [
            model.qpos0,
            model.body_mass,
            model.body_inertia,
            model.geom_size,
            model.body_pos,
            model.site_pos,
        ]
        return [*map(np.array, out), Vehicle.of(model)]
    if door == "parts":
        parts = read_parts(file)
        return [
            parts,
            [(thruster.axis, thruster.place, thruster.thruster) for thruster in parts.thrusters],
        ]
    if door == "water":
        spec = mujoco.MjSpec.from_string(_VEHICLE)
        sidecar.attach_tree(spec, sidecar.read_sidecar(file), "file")
        return [np.array(element.userdata) for element in (*spec.bodies, *spec.actuators)]
    if door == "campaign":
        return [run.values for run in read_campaign(file).runs(2)]
    if door == "scenario":
        return scenario_file.read_scenario(file)
    if door == "arm camera":
        return arm_camera.ErrorModel.read(file)
    if door == "mesh":
        return targets.of(str(file), None if rng is None or rng.random() < 0.7 else 1e-3)
    if door == "cloud":
        return load_cloud(file, None if rng is None or rng.random() < 0.7 else 1e-3)
    if door == "urdf":
        if rng is not None and rng.random() < 0.5:
            chain = Chain.from_urdf(file, "base", "l2")
            return [chain.forward(np.full(chain.n, 0.1)), chain]
        return _arm_of(read_arm(file))
    if door == "arm":
        return _arm_of(read_arm(file))
    if door == "touches":
        return read_touches(file, joint_types="rrr", limits=np.tile([-2.0, 2.0], (3, 1)))
    return read_targets(file)


def _arm_of(source: Any) -> Any:
    q = np.full((1, source.arm.n), 0.1)
    return [source.arm.limits, source.tcp, source.arm.flange(q), source.arm.dh, *source.arm.axes()]


def _file_door(name: str) -> Door:
    def throw(rng: Rng, folder: Path) -> Any:
        file = thrown(rng, folder, VALID[name])
        return give(name, folder if name == "touches" and rng.random() < 0.2 else file, rng)

    def warm() -> None:
        file, raw = next(iter(VALID[name].items()))
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / file).write_bytes(raw)
            give(name, Path(folder) / file)

    return Door(f"file: {name}", throw, warm=warm)


# Python arguments

_DH_ROWS = [[0.0, 0.3, 0.0, 1.57], [0.0, 0.0, 0.4, 0.0], [0.1, 0.0, 0.3, 0.2]]
_CHAIN = Chain.from_arm(published_arms.load("puma560"))
_TARGET = _CHAIN.forward([0.1, 0.2, -0.3, 0.4, 0.5, 0.6])
_BALL = targets.named("rock")
_GRID = np.stack(
    np.meshgrid(np.linspace(-0.5, 0.5, 12), np.linspace(-0.5, 0.5, 12)), axis=-1
).reshape(-1, 2)
_GROUND = np.column_stack([_GRID, 0.01 * np.sin(9.0 * _GRID[:, 0]) - 1.0])
_WALL = np.column_stack([_GRID, 1.5 + 0.1 * _GRID[:, 0]])
_PUMA = models.load("uuv_puma").compile()
_PUMA_TOUCHES = [np.random.default_rng(k).uniform(-1.0, 1.0, (6, 3)) for k in range(2)]


def _vary(
    function: Callable[..., Any], given: Callable[[], dict[str, Any]]
) -> Callable[[Rng, Path], Any]:
    def throw(rng: Rng, _folder: Path) -> Any:
        return function(**spoilt(rng, given()))

    return throw


_OPTIONS = [option.name for option in dataclasses.fields(IkOptions) if option.init]


def _with_options(how: dict[str, Any]) -> dict[str, Any]:
    rest = {name: setting for name, setting in how.items() if name not in _OPTIONS}
    return rest | {"options": IkOptions(**{name: how[name] for name in how if name in _OPTIONS})}


def _solve(X_base_tip: Any, q0: Any, **how: Any) -> Any:
    return tuple(solve(_CHAIN, X_base_tip, q0, **_with_options(how)))


def _solve_many(**how: Any) -> Any:
    batch = solve_many(_CHAIN, **_with_options(how))
    return [batch.q, batch.position_error, batch.orientation_error]


def _track(q0: Any, X_base_tip: Any, **how: Any) -> Any:
    tracker = Tracker(_CHAIN, **how)
    return tracker.step(tracker.init(q0), X_base_tip)


def _scan(cloud: Any, sensor: Any) -> Any:
    model = SensorModel(focal=sensor)
    return [model, np.nan_to_num(Scan.from_cloud(cloud).points)]


def _identify(**how: Any) -> Any:
    identification = identify(_WALL, **how)
    return [identification.X_sensor_target, identification.accepted]


def _calibrate(**how: Any) -> Any:
    fit = MapFit(
        **{name: how.pop(name) for name in ("noise", "robust", "max_iterations") if name in how}
    )
    outcome = calibrate(**how, method=fit)
    return [outcome.arm.dh, outcome.tcp, outcome.cost, outcome.noise, outcome.points, outcome.sigma]


def _plan(**how: Any) -> Any:
    plan = plan_seabed_work(**how)
    return [plan.terrain.vertices, plan.targets.A, None if plan.path is None else plan.path.p]


def _shapes(what: str, **how: Any) -> Any:
    return {"line": line, "circle": circle, "raster": raster}[what](**how)


def _python_doors() -> Iterator[Door]:
    def door(
        name: str, function: Callable[..., Any], given: dict[str, Any], share: float = 1.0
    ) -> Door:
        return Door(
            f"python: {name}",
            _vary(function, lambda: dict(given)),
            share,
            lambda: function(**given),
        )

    yield door(
        "Chain.from_dh",
        Chain.from_dh,
        {"dh": _DH_ROWS, "joint_types": "rrp", "limits": [[-1.0, 2.0]] * 3, "tool": np.eye(4)},
    )
    yield door(
        "Chain.from_vectors",
        Chain.from_vectors,
        {
            "M": np.ones((3, 3)),
            "e": np.eye(3),
            "p": [1, 0, 2],
            "L": [[-1.0] * 3, [1.0] * 3],
            "tool": np.eye(4),
        },
    )
    yield door(
        "Chain.from_mjcf",
        lambda **how: Chain.from_mjcf(_PUMA, **how),
        {"base_body": "arm_base", "tip_site": "tip", "exclude": ["pad"]},
    )
    yield door(
        "Chain.from_urdf",
        Chain.from_urdf,
        {"urdf": _URDF.decode(), "base_link": "base", "tip_link": "l2"},
    )
    yield door("Chain.forward", _CHAIN.forward, {"q": np.zeros(6)})
    yield door(
        "solve",
        _solve,
        {
            "X_base_tip": _TARGET,
            "q0": np.zeros(6),
            "position_tolerance": 1e-4,
            "orientation_tolerance": 1e-3,
            "method": "hybrid",
            "branch": "free",
            "max_iterations": 300,
            "max_restarts": 3,
            "precision": "double",
            "stage_tolerances": None,
            "stage_axes": "joint",
        },
    )
    yield door(
        "solve_many",
        _solve_many,
        {
            "X_base_tip": np.array([_TARGET] * 3),
            "q0": np.zeros(6),
            "max_iterations": 300,
            "max_restarts": 3,
            "threads": 1,
            "method": "hybrid",
        },
    )
    yield door(
        "Tracker",
        _track,
        {
            "q0": np.zeros(6),
            "X_base_tip": _TARGET,
            "period": 0.01,
            "speed_limits": 1.0,
            "passing": "auto",
            "near": 0.1,
            "position_tolerance": 1e-6,
            "orientation_tolerance": 1e-5,
            "method": "hybrid",
        },
    )
    yield door(
        "calib.Arm.from_dh", Arm.from_dh, {"dh": _DH_ROWS, "joint_types": "rrp", "beta": [0.0] * 3}
    )
    yield door(
        "calib.Arm.from_axes",
        Arm.from_axes,
        {"axes": np.eye(3), "points": np.eye(3), "X_base_flange0": np.eye(4), "joint_types": "rrr"},
    )
    yield door(
        "calib.identify",
        _calibrate,
        {
            "series": _PUMA_TOUCHES,
            "nominal": _DH_ROWS,
            "free": ["theta", "tcp"],
            "prior": {"theta": 0.01},
            "noise": 1e-3,
            "distances": [(0, 1, 0.5)],
            "tcp": [0.0, 0.0, 0.1],
            "loads": None,
            "robust": True,
            "max_iterations": 20,
        },
        0.5,
    )
    yield door(
        "TargetModel",
        TargetModel,
        {
            "name": "a",
            "vertices": np.vstack([np.zeros(3), np.eye(3)]),
            "triangles": [[0, 2, 1], [0, 1, 3]],
            "symmetry": Symmetry(),
            "paths": {},
        },
    )
    yield door("Symmetry", Symmetry, {"axis": [0.0, 0.0, 1.0], "rotations": np.eye(3)[None]})
    yield door(
        "ModelPath",
        ModelPath,
        {
            "p": np.arange(12.0).reshape(4, 3),
            "a": [[0.0, 0.0, 1.0]] * 4,
            "b": [[1.0, 0.0, 0.0]] * 4,
        },
    )
    yield door(
        "TargetModel.from_file",
        TargetModel.from_file,
        {"file": __file__, "name": "a", "symmetry": None, "paths": None, "scale": 1.0},
        0.5,
    )
    yield door("targets.of", targets.of, {"name_or_file": "barrel", "scale": None})
    yield door("targets.named", lambda **how: targets.named("rock", **how), {"seed": 1}, 0.5)
    yield door(
        "deformed.fouled",
        lambda **how: deformed.fouled(_BALL, np.random.default_rng(0), **how).target.vertices,
        {"patches": 1, "height": (0.01, 0.02), "near": _BALL.vertices[:1]},
        0.3,
    )
    yield door("load_cloud", load_cloud, {"file": __file__, "scale": 1.0})
    yield door("Scan.from_cloud", _scan, {"cloud": _WALL, "sensor": 554.0})
    yield door(
        "perception.identify",
        _identify,
        {
            "target": _BALL,
            "approach": [0.0, 0.0, 1.5],
            "orientation": np.eye(3),
            "sensor": None,
            "approach_error": 0.3,
            "seed": 0,
            "method": "paper",
        },
        0.2,
    )
    yield door(
        "plan_seabed_work",
        _plan,
        {
            "cloud": _GROUND,
            "B": [[-0.2, 0.0, 0.0], [0.2, 0.1, 0.0]],
            "z": [0.0, 0.0, 1.0],
            "width": 0.1,
            "patch": 0.15,
            "limits": None,
        },
        0.5,
    )
    yield door("path_shapes.line", line, {"start": np.zeros(3), "end": np.ones(3)})
    yield door(
        "path_shapes.raster",
        raster,
        {"center": np.zeros(3), "along": [0.2, 0.0, 0.0], "across": [0.0, 0.2, 0.0], "pitch": 0.05},
    )
    yield door(
        "path_shapes.laid_on",
        lambda **how: laid_on(_BALL, **how),
        {
            "curve": line([-0.05, 0.0, 1.0], [0.05, 0.0, 1.0]),
            "direction": [0.0, 0.0, -1.0],
            "before": 0.5,
        },
        0.3,
    )
    yield door(
        "Thruster",
        thrusters.Thruster,
        {
            "forward": 100.0,
            "reverse": 80.0,
            "dead_band": 0.05,
            "time_constant": 0.1,
            "slew_rate": 5.0,
            "handedness": -1,
        },
    )
    yield door(
        "Current",
        Current,
        {
            "mean_W": [0.1, 0.0, 0.0],
            "gust": 0.03,
            "timestep": 0.002,
            "rng": np.random.default_rng(0),
        },
    )
    yield door("vehicle_spec", vehicle_spec, {"vehicle": "uuv_puma"}, 0.5)
    yield door("uuv.models.load", models.load, {"name": "uuv_puma"}, 0.5)
    yield door("arms.load", published_arms.load, {"name": "panda"})
    yield door("Arm.joint_frames", published_arms.load("panda").joint_frames, {"q": np.zeros(7)})


# Options


def _options_stage(name: str, options: Any, args: list[str]) -> Any:
    """The scenario that a job makes of its options; nothing of another command, which is not
    cheap.
    """
    if name not in BY_NAME:
        return None
    job = BY_NAME[name]
    words = typed(args)
    scenario = job(**{word: getattr(options, word) for word in job.options() if word in words})
    again = scenario_file.from_dict(tomllib.loads(scenario_file.to_toml(scenario)))
    if again != scenario:
        raise FindingError(f"{name}: its scenario's file reads as another one: {again}")
    return scenario.site.pose(np.random.default_rng(0))


VERBS = (
    "calibrate",
    "plan-seabed",
    "identify object",
    "identify friction",
    "identify water",
    "campaign",
    "benchmark",
)
SCRIPTS = (
    "experiments.contact.step_response",
    "experiments.kinematics.ik",
    "experiments.seabed.seabed",
    "experiments.contact.tip_force",
)
VALUES = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1",
    "2.5",
    "1e308",
    "-1e-9",
    "1e400",
    "9" * 400,
    "9" * 5000,
    "",
    " ",
    "x",
    "x" * 400,
    "ä→",
    "\ud800",
    "None",
    "True",
    "[]",
    "a.txt",
    "/",
    "../..",
    "/dev/null",
    "rock",
    "barrel",
    "uuv_puma",
    "3",
    "0.3",
    "--seed",
    "-",
    "mod:Class",
    "os:nothing",
    "json.decoder:JSONDecoder",
    "nowhere.stl",
    "60",
    "n" * 300 + ".xml",
)


def _options_of(name: str) -> type[Any]:
    """Class of the options of a job, a verb or a script."""
    if name in BY_NAME:
        return options_of_job(BY_NAME[name])
    if name in VERBS:
        return options_class(verbs.VERBS[name])
    module = importlib.import_module(name)
    declared = experiments_in(module)
    return declared[0].options if declared else module.Options


def _options_door(name: str) -> Door:
    def throw(rng: Rng, folder: Path) -> Any:
        kind = _options_of(name)
        flags = [word for word in options_in(kind) if word != "--help"]
        args: list[str] = ["--out", str(folder)] if "--out" in flags else []
        if name == "plan-seabed":
            args += ["--cloud", str(folder / "none.txt"), "--targets", str(folder / "none.txt")]
        for _ in range(int(rng.integers(1, 3))):
            args.append(one_of(rng, flags))
            args += [one_of(rng, VALUES) for _ in range(int(rng.choice([1, 1, 1, 1, 0, 2, 3])))]
        output = io.StringIO()
        try:
            with contextlib.redirect_stderr(output):
                options = startup.parse(kind, args)
        except SystemExit as stop:
            text = output.getvalue()
            if (
                stop.code != startup.BAD_INPUT
                or text.count("\n") != 1
                or len(text) > LONGEST_MESSAGE + 10
            ):
                raise FindingError(f"options {args}: code {stop.code}, {text!r}") from stop
            raise RefusedError(text.strip()) from None
        return _options_stage(name, options, args)

    return Door(f"options: {name}", throw, 0.25, lambda: _options_of(name))


DOORS: tuple[Door, ...] = (
    *(_file_door(name) for name in VALID),
    *_python_doors(),
    *(_options_door(name) for name in (*BY_NAME, *VERBS, *SCRIPTS)),
)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--inputs", type=int, default=100, help="of each door; slow ones get a share"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--door", default="", help="part of a door's name")
    options = parser.parse_args()
    findings, total = 0, 0
    for door in DOORS:
        if options.door not in door.name:
            continue
        began = time.perf_counter()
        became = Counter()
        seen_keys = set()
        for number in range(
            options.first, options.first + max(1, round(door.share * options.inputs))
        ):
            try:
                outcome = attempt(door, options.seed, number)
                became["passed" if outcome == "passed" else "refused"] += 1
            except FindingError as finding:
                became["found"] += 1
                key = re.sub(r"\d+", "", str(finding))[:60]
                if key not in seen_keys:
                    seen_keys.add(key)
                    print(
                        f"  {door.name} --seed {options.seed} --first {number}: {finding}"[:400]
                        .encode("ascii", "backslashreplace")
                        .decode()
                    )
        findings = findings + became["found"]
        total = total + sum(became.values())
        counts = " ".join(f"{became[word]:5} {word}" for word in ("passed", "refused", "found"))
        print(f"{door.name:34} {counts} {time.perf_counter() - began:6.1f} s", flush=True)
    print(f"{total} inputs, {findings} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    mujoco.set_mju_user_warning(lambda _text: None)
    raise SystemExit(main())
