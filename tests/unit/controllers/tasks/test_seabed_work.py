"""The planner of seabed work, its tool led through soil as it asks."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from led_tool import LedTool
from scripted_world import UNTOUCHED, ScriptedWorld
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.seabed_height import WorkHeight
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks import seabed_work
from uuv.controllers.tasks.seabed_work import SeabedJob, SeabedWork
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import core_tube, depth_for, mud, sand
from uuv.models.vehicle import Vehicle
from uuv.models.vehicles import uuv_puma
from uuv.perception.seabed.terrain_path import core_path
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import ContactEstimate, Reference, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, pose, readonly

PERIOD = 0.01  # [s]
SCAN_POSE, WORK_POSE = pose(p=[0.0, 0.0, 2.5]), pose(p=[0.1, 0.0, 1.6])
OWN = uuv_puma.build("sampler").compile()
VEHICLE = Vehicle.of(OWN)
CHAIN = Chain.from_mjcf(OWN, ARM_BASE_BODY, TIP_SITE, exclude=["pad", "mount_x", "mount_y"])
FLAT = Seabed(
    kind="flat", heights=np.zeros((3, 3)), half=2.0, center_W=np.zeros(3), rocks=np.zeros((0, 3))
)
TUBE = core_tube(0.018, 0.002)
BEFORE = [
    WorkState.SETTLE,
    WorkState.SCAN,
    WorkState.CLOSE_IN,
    WorkState.TARE,
    WorkState.APPROACH,
    WorkState.INSERT,
]
CORE = core_path(
    np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]), 0.18
)


def profile() -> ToolPath:
    """Along y over a gentle hump, square to it."""
    y = np.linspace(-0.15, 0.15, 80)
    z = 0.1 * (0.0225 - y**2)
    slope = -0.2 * y
    p = np.column_stack([np.full(80, 0.5), y, z])
    x = np.column_stack([np.zeros(80), np.ones(80), slope]) / np.sqrt(1.0 + slope**2)[:, None]
    down = np.column_stack([np.zeros(80), slope, -np.ones(80)]) / np.sqrt(1.0 + slope**2)[:, None]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    return ToolPath(
        s=readonly(s),
        p=readonly(p),
        z=readonly(down),
        x=readonly(x),
        on_scan=np.ones(80, dtype=bool),
    )


@dataclass
class Script(ScriptedWorld):
    """A world whose tool is where it is asked to be, and a hull that is where it should be."""

    job: SeabedJob
    path: ToolPath = CORE
    world: LedTool = field(default_factory=lambda: LedTool(FLAT, sand(), TUBE))
    refusal: str = ""
    drift: float = 0.0  # [m] of the hull once it works
    forces: list[float] = field(default_factory=list)
    pressed_in: float = field(default=0.0, init=False)  # [m] by the force control

    def run(self, seconds: float = 150.0) -> "Script":
        work_vehicle = WorkVehicle(vehicle=VEHICLE, chain=CHAIN, hull_box=np.zeros((2, 3)))
        planner = SeabedWork(work_vehicle, self.job, X_WB_scan=SCAN_POSE, period=PERIOD)
        return self.drive(planner, SCAN_POSE, seconds, VEHICLE.q_home)

    def hull_at(self, X_WB: Array, reference: Reference) -> Array:
        del X_WB
        aside = self.drift if reference.state is WorkState.INSERT else 0.0
        return pose(reference.X_WB[:3, :3], reference.X_WB[:3, 3] + [aside, 0.0, 0.0])

    def look(self, time: float) -> Target:
        return Target(
            time=time,
            X_WT=np.eye(4),
            accepted=not self.refusal,
            check_m=0.001,
            range_m=2.5,
            reason=self.refusal,
            path=None if self.refusal else self.path,
            ground=np.zeros((4, 3)),
        )

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        del time
        if reference.X_WG is None:
            self.forces.append(0.0)
            return UNTOUCHED

        z = reference.X_WG[:3, 2]
        f_W = self.world.step(reference.X_WG[:3, 3] + self.pressed_in * z, z).copy()
        normal = -float(f_W @ z)
        if reference.force_control:
            self.pressed_in += 2e-4 * PERIOD * (reference.set_force - normal)
        else:
            self.pressed_in = 0.0
        self.forces.append(normal)
        return ContactEstimate(force_W=f_W, normal=normal)

    def tips(self, *states: WorkState) -> Array:
        """(N, 3) [m] tip references in `states`."""
        return np.array(
            [r.X_WG[:3, 3] for r in self.references if r.state in states and r.X_WG is not None]
        )


@pytest.fixture(autouse=True)
def placed(monkeypatch: pytest.MonkeyPatch) -> list[ToolPath]:
    """The choice of the height has its own tests: here every path is within reach from
    WORK_POSE.
    """
    paths = []

    def choose(own: WorkVehicle, path: ToolPath, **_: object) -> WorkHeight:
        paths.append(path)
        placement = Placement(
            X_WB=WORK_POSE,
            travel_W=np.zeros(3),
            roll=0.4,
            q_start=own.vehicle.q_ready,
            margin=1.0,
            reached=1.0,
        )
        return WorkHeight(placement=placement, aside=0.0, hull_gap=1.0, jet_height=1.0, shear=0.0)

    monkeypatch.setattr(seabed_work, "choose_height", choose)
    return paths


def test_a_core_goes_where_the_soil_bears_the_push(within):
    script = Script(job=SeabedJob()).run()
    assert script.states == [
        *BEFORE,
        WorkState.PRESS,
        WorkState.WORK,
        WorkState.WITHDRAW,
        WorkState.DONE,
    ]
    assert script.end.note == ""
    work = [i for i, r in enumerate(script.references) if r.state is WorkState.WORK]
    within("push while held [N]", np.array(script.forces)[work] - 50.0, 2.5)
    inside = script.tips(WorkState.INSERT, WorkState.PRESS, WorkState.WORK)
    within("aside [m]", inside[:, :2] - [0.5, 0.0], 1e-12)
    closed = depth_for(sand(), TUBE, 0.9 * 50.0)  # where the force loop is closed
    within("depth [m]", inside[:, 2].min() + closed, 2e-3)
    within("stand-off at the end [m]", script.tips(WorkState.DONE)[-1, 2] - 0.1, 1e-3)
    assert not script.end.v_WG_W.any()


def test_a_tube_that_is_full_is_drawn_out():
    script = Script(job=SeabedJob(push=70.0, depth=0.06)).run()
    assert script.states[-1] is WorkState.ABORT
    assert "the tube is full at 60 mm, the soil bears" in script.end.note
    assert script.tips(WorkState.INSERT)[:, 2].min() > -0.061


def test_a_tool_is_dragged_at_its_depth(within, placed):
    path = profile()
    world = LedTool(FLAT, mud(), TUBE)
    script = Script(job=SeabedJob(depth=0.03, drag=True), path=path, world=world).run()
    assert script.states == [*BEFORE, WorkState.WORK, WorkState.WITHDRAW, WorkState.DONE]
    tips = script.tips(WorkState.WORK)
    foot = path.p + 0.03 * path.z
    off = np.linalg.norm(tips[:, None] - foot[None], axis=2).min(axis=1)
    within("off the profile at its depth [m]", off, 2.5e-3)  # its samples are 3.8 mm apart
    within("ends [m]", tips[[0, -1]] - foot[[0, -1]], 5e-4)
    within("place was asked for at that depth [m]", placed[0].p - foot, 1e-12)
    moving = script.of(WorkState.WORK)
    step = np.diff(tips, axis=0) / PERIOD
    within("speed as told [m/s]", step - [r.v_WG_W for r in moving][:-1], 1e-3)
    assert np.linalg.norm(step, axis=1).max() < 0.021


@pytest.mark.parametrize(
    ("change", "said"),
    [
        pytest.param(
            {"refusal": "two layers"}, "not identified in 3 views: two layers", id="bad cloud"
        ),
        pytest.param(
            {"drift": 0.3},
            "the hull cannot hold its position: error 0.300 m, above the limit of 0.08 m",
            id="carried away",
        ),
    ],
)
def test_what_ends_the_work(change, said):
    script = Script(job=SeabedJob(), **change).run(400.0)
    assert script.states[-1] is WorkState.ABORT
    assert script.end.note == said


def test_a_refused_cloud_leaves_the_vehicle_where_it_scanned(within):
    script = Script(job=SeabedJob(), refusal="a hole under B_1").run(400.0)
    within("height [m]", [r.X_WB[2, 3] - 2.5 for r in script.references], 1e-12)
    assert all(r.X_WG is None for r in script.references)  # and the arm folded


def test_something_in_the_way_is_noticed():
    """A table 80 mm over the ground as scanned."""
    table = Seabed(
        kind="flat",
        heights=np.full((3, 3), 0.08),
        half=2.0,
        center_W=np.zeros(3),
        rocks=np.zeros((0, 3)),
    )
    script = Script(job=SeabedJob(), world=LedTool(table, mud(strength=2e4), TUBE)).run()
    assert script.states[-1] is WorkState.ABORT
    assert "above the scanned ground" in script.end.note


def test_no_place_is_no_descent(monkeypatch, within):
    def nowhere(*_: object, **__: object) -> WorkHeight:
        raise ReachError("no feasible working height")

    monkeypatch.setattr(seabed_work, "choose_height", nowhere)
    script = Script(job=SeabedJob()).run()
    assert script.end.note == "no feasible working height"
    within("height [m]", [r.X_WB[2, 3] - 2.5 for r in script.references], 1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth": -0.1}, "depth: must be > 0"),
        ({"push": 100.0}, "at most half the limit"),
        ({"guard": 0.2}, "standoff > guard"),
    ],
)
def test_jobs_that_cannot_be_are_refused(change, said):
    with pytest.raises(ConfigurationError, match=said):
        SeabedJob(**change)
