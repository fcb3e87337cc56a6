"""A reader who follows one thing through the code enters few files, and comes back to few of
them.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from reading_walk import walk
from uuv.arm_identification.calibration_case import CalibrationCase, nominal
from uuv.arm_identification.calibration_command import calibrate
from uuv.arm_identification.calibration_options import CalibrationOptions
from uuv.arm_identification.calibration_outcome import CalibrationOutcome
from uuv.arm_identification.simulated_touches import simulated
from uuv.calib import Calibration
from uuv.calib.touch_files import Touches, write_touches
from uuv.components.contact_parts import believed_and_built
from uuv.jobs import clean_barrel
from uuv.models.files.urdf import UrdfRobot
from uuv.models.files.vehicle_file import VehicleFile
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import VehicleSetup
from uuv.sim import hydrodynamics
from uuv.sim.runs.terminal import PlainConsole

# What the steps of a vehicle's way use as they use MuJoCo itself.
OPERATIONS = (
    "sim/interfaces/",
    "models/hydrodynamics.py",
    "models/water/",
    "models/naming.py",
    "models/files/keyframes.py",
    "models/files/notes.py",
    "models/files/holding.py",
    "models/files/mesh_shapes.py",
)
# The arm's kinematics, and what is printed of a calibration beside the arm.
BESIDE_A_CALIBRATION = (
    "sim/",
    "models/arms/",
    "uuv/arm_identification/calibration_figures.py",
    "uuv/arm_identification/calibration_remarks.py",
)
LINK = """<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="0.4"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0 0 0.1"/><geometry><box size="0.04 0.04 0.16"/></geometry></collision>
    </link>
"""
JOINT = """<joint name="{name}" type="revolute"><origin xyz="0 0 {z}"/><parent link="{parent}"/>
  <child link="{child}"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.2" effort="9" velocity="1"/></joint>
"""
URDF = (
    '<robot name="rov">'
    + LINK.format(name="base").replace("0.4", "20.0")
    + "".join(LINK.format(name=name) for name in ("upper", "lower"))
    + '<link name="bracket"/><joint name="fixed" type="fixed"><origin xyz="0.15 0.02 -0.2" '
    'rpy="3.1 0 0.1"/>'
    + '<parent link="base"/><child link="bracket"/></joint>'
    + JOINT.format(name="lift", z=0, parent="bracket", child="upper")
    + JOINT.format(name="bend", z=0.2, parent="upper", child="lower")
    + "</robot>"
)
PARTS = """
arm_base: bracket
tip: {body: lower, pos: [0, 0, 0.19]}
joints: {lift: 9, bend: 5}
thrusters: [{name: ahead, pos: [-0.2, 0, 0.05], direction: [1, 0, 0]}]
trim: 0.05
"""
WATER = (
    "bodies: {base: {box: {size: [0.4, 0.3, 0.2]}}, upper: {sphere: {radius: 0.03}}, lower: "
    "{sphere: {radius: 0.03}}}\n"
)


def test_the_way_of_a_urdf_into_a_job_is_straight(tmp_path: Path) -> None:
    file = tmp_path / "rov.urdf"
    file.write_text(URDF, encoding="utf-8")
    (tmp_path / "rov.parts.yaml").write_text(PARTS, encoding="utf-8")
    (tmp_path / "rov.water.yaml").write_text(WATER, encoding="utf-8")
    scenario = clean_barrel(vehicle=str(file), tool="small_pad")
    models: list[mujoco.MjModel] = []

    def way() -> None:  # as `uuv.assembly.assemble` takes it
        believed, built, _ = believed_and_built(scenario.vehicle, scenario.belief, scenario.task)
        models.append(OwnVehicle.of(believed, scenario.task.spares).model)
        models.append(hydrodynamics.compile(built))

    def is_vehicle(thing: Any) -> bool:
        kinds = (VehicleSetup, UrdfRobot, VehicleFile, mujoco.MjSpec)
        return isinstance(thing, kinds) or (
            isinstance(thing, str | Path) and str(thing) == str(file)
        )

    path = walk(way, is_vehicle, OPERATIONS)
    assert [model.nu for model in models] == [3, 3]
    assert path.files[:3] == [
        "uuv/components/contact_parts.py",
        "uuv/own_vehicle.py",
        "models/files/vehicle_file.py",
    ]
    assert path.files[-1] == "sim/hydrodynamics.py"
    assert len(path.files) <= 12, str(path)
    assert path.returns <= 11, str(path)


def test_the_way_of_touches_to_an_arm_is_straight(tmp_path: Path) -> None:
    drawn = simulated(
        nominal("ur10e", tmp_path, None, None),
        points=3,
        touches=9,
        noise=1e-4,
        pin="off-axis",
        known=True,
        errors=3,
        rng=np.random.default_rng(2),
    )
    files = write_touches(
        tmp_path / "touches",
        drawn.touches.names,
        drawn.touches.series,
        drawn.source.arm.joint_names,
    )
    length = drawn.distances[0][2]
    known = tuple(
        (drawn.touches.names[i], drawn.touches.names[j], length) for i, j, *_ in drawn.distances
    )
    options = CalibrationOptions(touches=(files,), distance=known, record=False)
    arm = tmp_path / "arm"
    arm.mkdir()

    def way() -> None:
        assert calibrate(options, arm, PlainConsole(), np.random.default_rng(0)) == 0

    def is_touches(thing: Any) -> bool:
        if isinstance(thing, str | Path):
            return str(thing).startswith(str(files))
        if isinstance(thing, list | tuple):
            return any(map(is_touches, thing))
        if isinstance(thing, np.ndarray):
            return any(
                np.shape(thing) == np.shape(q) and np.allclose(thing, q)
                for q in drawn.touches.series
            )
        kinds = (CalibrationOptions, Touches, CalibrationCase, Calibration, CalibrationOutcome)
        return isinstance(thing, kinds)

    path = walk(way, is_touches, BESIDE_A_CALIBRATION)
    assert (arm / "arm.yaml").is_file()
    assert path.files[:3] == [
        "uuv/arm_identification/calibration_command.py",
        "uuv/arm_identification/calibration_case.py",
        "calib/touch_files.py",
    ]
    assert path.files[-1] == "calib/results.py"
    visits = [file for file, _ in path.visits]
    for file in ("calib/touch_files.py", "calib/touches.py", "calib/results.py"):
        assert visits.count(file) == 1, str(path)
    assert len(path.files) <= 10, str(path)
    assert path.returns <= 31, str(path)


def test_a_walk_enters_a_function_once_and_counts_the_way_back() -> None:
    def follows(thing: Any) -> bool:
        return isinstance(thing, mujoco.MjSpec)

    def way() -> None:
        for _ in range(2):
            OwnVehicle.of(spec, ("camera", "pad", "home", "ready", "tip", "arm_base", "thrusters"))
        hydrodynamics.compile(spec)

    text = (
        '<mujoco><worldbody><body name="hull"><freejoint/><geom '
        'size="0.1"/></body></worldbody></mujoco>'
    )
    spec = mujoco.MjSpec.from_string(text)
    path = walk(way, follows)
    assert path.files == ["uuv/own_vehicle.py", "sim/hydrodynamics.py"]
    assert path.returns == 0
    assert str(path).endswith("2 files, 0 returns")
