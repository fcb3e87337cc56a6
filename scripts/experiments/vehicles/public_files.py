"""Public vehicle files: which are read as they are, which need a mapping, which are refused, and
the time.

The files lie in a folder, one subfolder a repository of GitHub, OWNER+NAME, OWNER/NAME or NAME, at
its present state; VEHICLES names them as owner/name. Nothing is fetched here. A file that is not
there is not measured.
"""

from uuv.start import run_scenario  # isort: skip

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from uuv.experiment import Page, column, experiment, stat
from uuv.models import hydrodynamics
from uuv.models.completing.mapping import BARE_ARM, mapped
from uuv.models.files.notes import computed
from uuv.models.files.vehicle_file import read
from uuv.models.water import thrusters
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.spatial import one_of


@dataclass(frozen=True, slots=True)
class PublicVehicle:
    """Files of a repository that make one row, and what a mapping must add to them."""

    repository: str
    files: tuple[str, ...]
    added: str = ""  # to an empty mapping, in YAML


_UUV = "uuv_descriptions/robots"
_REXROV2 = "rexrov2_description/robots"
_LEGACY = "legacy/robots"
_DAVE = "urdf/robots/rexrov_description/urdf"
_BLUE = "blue_description/description"
_IOES = "models/dave_robot_models/description"
# By the kinds of things that are in them: propellers, blocks, arms, missing masses, xacro, SDF.
VEHICLES = {
    "rexrov": PublicVehicle("uuvsimulator/uuv_simulator", (f"{_UUV}/rexrov_default.xacro",)),
    "rexrov_oberon4": PublicVehicle(
        "uuvsimulator/uuv_simulator", (f"{_UUV}/rexrov_oberon4.xacro",)
    ),
    "rexrov_oberon7": PublicVehicle(
        "uuvsimulator/uuv_simulator", (f"{_UUV}/rexrov_oberon7.xacro",)
    ),
    "rexrov_two_arms": PublicVehicle(
        "uuvsimulator/uuv_simulator", (f"{_UUV}/rexrov_oberon_arms.xacro",)
    ),
    "rexrov2": PublicVehicle("uuvsimulator/rexrov2", (f"{_REXROV2}/rexrov2_default.xacro",)),
    "rexrov2_oberon7": PublicVehicle(
        "uuvsimulator/rexrov2", (f"{_REXROV2}/rexrov2_oberon7.xacro",)
    ),
    "lauv": PublicVehicle("uuvsimulator/lauv_gazebo", ("lauv_description/robots/default.xacro",)),
    "caldus": PublicVehicle(
        "Field-Robotics-Lab/dave", (f"{_LEGACY}/caldus_gazebo/urdf/caldus_gazebo.xacro",)
    ),
    "caracara": PublicVehicle(
        "Field-Robotics-Lab/dave", (f"{_LEGACY}/caracara_gazebo/urdf/caracara_gazebo.xacro",)
    ),
    "smilodon": PublicVehicle(
        "Field-Robotics-Lab/dave", (f"{_LEGACY}/smilodon_gazebo/urdf/smilodon_gazebo.xacro",)
    ),
    "dave_oberon7": PublicVehicle("Field-Robotics-Lab/dave", (f"{_DAVE}/rexrov_oberon7.xacro",)),
    "dave_predator": PublicVehicle("Field-Robotics-Lab/dave", (f"{_DAVE}/rexrov_predator.xacro",)),
    "eca_a9": PublicVehicle(
        "uuvsimulator/eca_a9", ("eca_a9_description/robots/eca_a9_default.urdf.xacro",)
    ),
    "g500_arm5": PublicVehicle(
        "uji-ros-pkg/underwater_simulation", ("uwsim/data/scenes/g500ARM5.urdf",)
    ),
    "ujione": PublicVehicle(
        "uji-ros-pkg/underwater_simulation",
        ("uwsim/data/scenes/ujione.urdf",),
        "masses: {hull: 40}",
    ),
    "orca": PublicVehicle(
        "vortexntnu/vortex-auv", ("auv_setup/description/orca.urdf.xacro",), "masses: {hull: 30}"
    ),
    "nautilus": PublicVehicle(
        "vortexntnu/vortex-auv",
        ("auv_setup/description/nautilus.urdf.xacro",),
        "masses: {hull: 30}",
    ),
    "cirtesu": PublicVehicle(
        "inesperez03/cirtesub_stonefish", ("urdf/cirtesu/cirtesu.urdf.xacro",), "masses: {hull: 30}"
    ),
    "oberon7": PublicVehicle(
        "uuvsimulator/uuv_manipulators",
        ("oberon7/oberon7_description/robots/oberon7_standalone.xacro",),
    ),
    "alpha_5_rkin": PublicVehicle(
        "RKinDLab/Reach_alpha_Blue_heavy_Sim", ("description/alpha/urdf/alpha_5_robot.urdf",)
    ),
    "alpha_5_reach": PublicVehicle(
        "Robotic-Decision-Making-Lab/reach",
        ("reach_description/description/alpha_5/standard_jaws/alpha_5.config.xacro",),
    ),
    "blue": PublicVehicle(
        "Robotic-Decision-Making-Lab/blue",
        tuple(
            f"{_BLUE}/{name}/config.xacro"
            for name in ("bluerov2", "bluerov2_heavy", "bluerov2_heavy_reach")
        ),
    ),
    "ricketts": PublicVehicle(
        "AlePuglisi/ROV-Ricketts-ros2", ("rov_ricketts_description/urdf/Ricketts.urdf.xacro",)
    ),
    "orca4": PublicVehicle("clydemcqueen/orca4", ("orca_description/models/orca4/model.sdf",)),
    "dave_sdf": PublicVehicle(
        "IOES-Lab/dave",
        tuple(f"{_IOES}/{name}/model.sdf" for name in ("bluerov2", "rexrov", "glider_slocum")),
    ),
}
READ = "read"
ADDED = "read with an addition"
WAY = "refused with a way on"
REFUSED = "refused"
BROKEN = "traceback"
ABSENT = "not measured"
# words of messages that say how to go on
WAYS = ("masses:", "balanceinertia", "ROS_PACKAGE_PATH", "exchange them", "xacro:")


@dataclass(frozen=True, kw_only=True)
class PublicFiles:
    """Which files."""

    folder: Path
    """Folder of the repositories."""
    names: tuple[str, ...] = field(default=tuple(VEHICLES))
    """Names of rows."""


@dataclass(frozen=True, kw_only=True)
class PublicFileCase:
    """One row: the files of one vehicle."""

    name: str
    folder: Path

    def __post_init__(self) -> None:
        one_of(self.name, VEHICLES, "--names")


@dataclass(frozen=True, kw_only=True)
class PublicFileRow:
    """What became of them; figures are of the first file."""

    outcome: str = column("outcome")
    seconds: float | None = column("time of all files", "s", digits=1, tolerance=None, default=None)
    mass: float | None = column("mass", "kg", digits=1, default=None)
    thrusters: int | None = column("thrusters of the file", default=None)
    wet: int | None = column("links with water of the file", default=None)
    arm: bool | None = column("named as a bare arm", default=None)
    refusal: str = column("refusal", default="")


def cases(options: PublicFiles) -> Iterator[PublicFileCase]:
    """Each vehicle once."""
    for name in options.names:
        yield PublicFileCase(name=name, folder=options.folder)


def broken(case: PublicFileCase, error: str) -> PublicFileRow:
    """Row of files that raised something else than a refusal."""
    del case
    return PublicFileRow(outcome=BROKEN, refusal=error[-300:])


@experiment("public_files", cases=cases, failed=broken)
def public_files(case: PublicFileCase) -> PublicFileRow:
    """Reads the files of one vehicle as they are, or else with what its mapping adds."""
    vehicle = VEHICLES[case.name]
    owner, _, repository = vehicle.repository.partition("/")
    places = (f"{owner}+{repository}", vehicle.repository, repository)
    folder = next((case.folder / p for p in places if (case.folder / p).is_dir()), None)
    files = [] if folder is None else [folder / file for file in vehicle.files]
    if not files or not all(file.is_file() for file in files):
        return PublicFileRow(outcome=ABSENT)

    started = time.perf_counter()
    with _packages_of(case.folder):
        rows = [_row(file, "") for file in files]
        refused = [row for row in rows if row.outcome != READ]
        if refused and vehicle.added:
            rows = [_row(file, vehicle.added) for file in files]
            refused = [row for row in rows if row.outcome != ADDED]

    first = refused[0] if refused else rows[0]

    return PublicFileRow(
        outcome=first.outcome,
        seconds=time.perf_counter() - started,
        mass=first.mass,
        thrusters=first.thrusters,
        wet=first.wet,
        arm=first.arm,
        refusal=first.refusal,
    )


def _row(file: Path, added: str) -> PublicFileRow:
    """What becomes of one file with a mapping of `added`; empty: without one."""
    with TemporaryDirectory() as folder:
        parts = None
        if added:
            parts = Path(folder) / "added.parts.yaml"
            parts.write_text(added, encoding="utf-8")

        try:
            source = read(file, parts=parts)
            spec = mapped(source)
            model = spec.compile()
        except UuvError as error:
            reason = " ".join(str(error).split())
            way = any(word in reason for word in WAYS)
            return PublicFileRow(outcome=WAY if way else REFUSED, refusal=reason[:300])

    return PublicFileRow(
        outcome=ADDED if added else READ,
        mass=float(model.body_subtreemass[1]),
        thrusters=int(sum(thrusters.carries(row) for row in model.actuator_user)),
        wet=len(hydrodynamics.attached(spec)),
        arm=any(line.startswith(BARE_ARM) for line in computed(spec).values()),
    )


@contextmanager
def _packages_of(folder: Path) -> Iterator[None]:
    """Context in which the packages of all repositories are found."""
    before = os.environ.get("ROS_PACKAGE_PATH")
    os.environ["ROS_PACKAGE_PATH"] = str(folder)

    try:
        yield
    finally:
        if before is None:
            del os.environ["ROS_PACKAGE_PATH"]
        else:
            os.environ["ROS_PACKAGE_PATH"] = before


public_files.page = Page().table(
    "Public files",
    by=("name",),
    columns=[
        stat("value", "outcome"),
        stat("value", "seconds"),
        stat("value", "mass"),
        stat("value", "thrusters"),
        stat("value", "wet"),
        stat("value", "arm"),
    ],
)

if __name__ == "__main__":
    run_scenario(public_files.main)
