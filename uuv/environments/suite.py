"""Registry of the tasks, like dm_control's `suite`: domains and tasks by name, with tags.

    environment = suite.load("barrel", "press", seed=0)

`ALL_TASKS` and `BY_TAG` list the names.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypedDict, Unpack

import mujoco
import numpy as np
from dm_control import composer
from dm_control.composer.variation import distributions

from uuv.environments.actions import (
    Actions,
    HullWrench,
    JointVelocities,
    ThrustersAndTorques,
    ThrusterSpeeds,
    ToolAndJaws,
    ToolTwist,
)
from uuv.environments.contact_tasks import (
    BELOW,
    InsertSampler,
    PressPoint,
    TapPoints,
    WipePath,
    place_at_hole,
    place_on,
)
from uuv.environments.entities import Sea, VehicleEntity
from uuv.environments.free_tasks import GoToWaypoint, HoldStation, ReachPose
from uuv.environments.hands.hand_tasks import GraspObject, TurnValve, place_at_stone, place_at_valve
from uuv.environments.ticks.environment import Environment
from uuv.environments.vehicle_task import VehicleTask
from uuv.models.naming import TOOL_GEOM, find
from uuv.models.objects import targets
from uuv.models.objects.manifold import manifold
from uuv.own_vehicle import OwnVehicle
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.evaluation.insertion_metrics import TrueHole
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import number, shown, whole_number
from uuv.tasks.surface_work import TAP_FORCE, TAPPED

FORCE = 60.0  # [N] set force of pressing and wiping
WIPED = 0.3  # [m] length of the path to wipe
# insertion: name of the hole, depth to reach [m], radial clearance [m]
HOLE, DEPTH, CLEARANCE = "a", 0.06, 2e-3
FASTEST_CURRENT, GUST = 0.2, 0.02  # [m/s] current in free water; half of it at work
Seed = int | np.random.RandomState | None

ACTIONS: dict[str, Callable[[OwnVehicle], Actions]] = {
    "thrusters": ThrusterSpeeds,
    "hull_wrench": HullWrench,
    "thrusters_torques": ThrustersAndTorques,
    "joint_velocity": JointVelocities,
    "tool": ToolTwist,
    "tool_jaws": ToolAndJaws,
}


class Fitting(TypedDict, total=False):
    """Equipment of a vehicle of `load`; each item may be left out."""

    tool: str | None  # of `uuv.models.tools.tools.TOOLS`; None: the task's, or the vehicle's own
    sensors: Sequence[Sensor]  # whose readings are observed in place of the true state
    perturbations: Sequence[Perturbation]  # of the vehicle, drawn anew in each episode


@dataclass(frozen=True, slots=True, kw_only=True)
class SuiteEntry:
    """One task of the suite."""

    make: Callable[[VehicleEntity, Actions, bool], VehicleTask]
    actions: str  # default kind of action
    time_limit: float  # [s] default duration of an episode
    tags: tuple[str, ...]
    tool: str | None = None  # tool in place of the vehicle's own


def _free(
    kind: type[HoldStation] | type[ReachPose],
) -> Callable[[VehicleEntity, Actions, bool], VehicleTask]:
    def make(vehicle: VehicleEntity, actions: Actions, sparse: bool) -> VehicleTask:
        return kind(
            Sea(distributions.Uniform(0.0, FASTEST_CURRENT), GUST), vehicle, actions, sparse=sparse
        )

    return make


def _working_sea(depth: float) -> Sea:
    return Sea(distributions.Uniform(0.0, 0.5 * FASTEST_CURRENT), 0.5 * GUST, depth=depth)


def _on_barrel(
    kind: type[PressPoint] | type[WipePath], vehicle: VehicleEntity, actions: Actions, sparse: bool
) -> VehicleTask:
    work_place = place_on(vehicle, targets.barrel(line_length=WIPED), "longitudinal", force=FORCE)
    return kind(
        _working_sea(work_place.depth), vehicle, actions, work_place, force=FORCE, sparse=sparse
    )


def _tap(vehicle: VehicleEntity, actions: Actions, sparse: bool) -> VehicleTask:
    work_place = place_on(
        vehicle, targets.barrel(line_length=WIPED), "longitudinal", force=TAP_FORCE
    )
    sea = _working_sea(work_place.depth)
    return TapPoints(
        sea, vehicle, actions, work_place, force=TAP_FORCE, points=TAPPED, sparse=sparse
    )


def _insert(vehicle: VehicleEntity, actions: Actions, sparse: bool) -> VehicleTask:
    tool = find(vehicle.own.model, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM)
    if vehicle.own.model.geom_type[tool] != mujoco.mjtGeom.mjGEOM_CAPSULE:
        raise ConfigurationError(
            f"insertion: the vehicle's tool, which is its geom {TOOL_GEOM!r}, must be a capsule (a "
            "sampler)"
        )

    radius = float(vehicle.own.model.geom_size[tool, 0])
    block = manifold(radius + CLEARANCE)
    work_place = place_at_hole(vehicle, block, HOLE, DEPTH)
    bore = block.hole(HOLE)

    hole = TrueHole(
        X_WH=bore.pose(work_place.X_WT), radius=bore.radius, tool_radius=radius, depth=DEPTH
    )
    return InsertSampler(
        _working_sea(work_place.depth), vehicle, actions, work_place, hole, sparse=sparse
    )


def _grasp(vehicle: VehicleEntity, actions: Actions, sparse: bool) -> VehicleTask:
    work_place, grasp, loose = place_at_stone(vehicle.own)
    sea = _working_sea(-float(BELOW[2, 3]))
    return GraspObject(sea, vehicle, actions, work_place, grasp, loose, sparse=sparse)


def _turn(vehicle: VehicleEntity, actions: Actions, sparse: bool) -> VehicleTask:
    work = place_at_valve(vehicle.own)
    return TurnValve(_working_sea(work.place.depth), vehicle, actions, work, sparse=sparse)


TASKS: dict[tuple[str, str], SuiteEntry] = {
    ("water", "hover"): SuiteEntry(
        make=_free(HoldStation), actions="thrusters", time_limit=30.0, tags=("free", "easy")
    ),
    ("water", "waypoint"): SuiteEntry(
        make=_free(GoToWaypoint), actions="thrusters", time_limit=40.0, tags=("free",)
    ),
    ("water", "reach"): SuiteEntry(
        make=_free(ReachPose), actions="joint_velocity", time_limit=10.0, tags=("free", "arm")
    ),
    ("barrel", "press"): SuiteEntry(
        make=partial(_on_barrel, PressPoint),
        actions="tool",
        time_limit=30.0,
        tags=("contact", "arm"),
    ),
    ("barrel", "wipe"): SuiteEntry(
        make=partial(_on_barrel, WipePath),
        actions="tool",
        time_limit=50.0,
        tags=("contact", "arm", "path"),
    ),
    ("barrel", "tap"): SuiteEntry(
        make=_tap, actions="tool", time_limit=70.0, tags=("contact", "arm", "path")
    ),
    ("manifold", "insert"): SuiteEntry(
        make=_insert, actions="tool", time_limit=50.0, tags=("contact", "arm"), tool="sampler"
    ),
    ("seabed", "grasp"): SuiteEntry(
        make=_grasp,
        actions="tool_jaws",
        time_limit=40.0,
        tags=("contact", "arm", "hand"),
        tool="gripper",
    ),
    ("valve", "turn"): SuiteEntry(
        make=_turn,
        actions="tool",
        time_limit=60.0,
        tags=("contact", "arm", "hand"),
        tool="handle_socket",
    ),
}
ALL_TASKS: tuple[tuple[str, str], ...] = tuple(TASKS)
BY_TAG: dict[str, tuple[tuple[str, str], ...]] = {
    tag: tuple(name for name, entry in TASKS.items() if tag in entry.tags)
    for tag in sorted({tag for entry in TASKS.values() for tag in entry.tags})
}


def load(
    domain: str,
    task: str = "",
    *,
    seed: Seed = None,
    vehicle: str = "uuv_puma",
    actions: str | None = None,
    sparse: bool = False,
    time_limit: float | None = None,
    period: float | None = None,
    **fitted: Unpack[Fitting],
) -> composer.Environment:
    """Environment of the suite, by domain and task.

    Args:
        domain: "water", "barrel", "manifold", "seabed" or "valve".
        task: A task of it, see ALL_TASKS; or both in the first argument, as "water/hover".
        seed: Of all random numbers; None: other ones every time.
        vehicle: A name of `uuv.models.available()`, or a file, MJCF, URDF, xacro or SDF.
        actions: A kind of ACTIONS; None: the task's usual one.
        sparse: Reward success alone.
        time_limit: [s] of an episode; None: the task's usual one.
        period: [s] between actions; None: 0.02.
        fitted: Tool, sensors and perturbations of the vehicle, as `Fitting` has them.

    Returns:
        dm_control's environment.

    Raises:
        ConfigurationError: There is no such task or kind of action, or the vehicle lacks a part
            that the task needs.
        ReachError: The vehicle's arm does not reach the work from any hull pose.
    """
    if not task and isinstance(domain, str) and "/" in domain:
        domain, task = domain.split("/", 1)
    name = f"{domain}/{task}"

    if (domain, task) not in TASKS:
        known = tuple("/".join(names) for names in TASKS)
        raise ConfigurationError(
            f"unknown task {shown(name)}; there are {', '.join(known)}{did_you_mean(name, known)}"
        )

    entry = TASKS[domain, task]
    kind = actions or entry.actions
    if kind not in ACTIONS:
        raise ConfigurationError(f"unknown actions {shown(kind)}; there are {', '.join(ACTIONS)}")

    tool = fitted.get("tool") or entry.tool
    body = VehicleEntity(
        vehicle,
        tool=tool,
        sensors=fitted.get("sensors", ()),
        perturbations=fitted.get("perturbations", ()),
    )
    vehicle_task = entry.make(body, ACTIONS[kind](body.own), sparse)
    if period is not None:
        vehicle_task.set_period(period)

    return environment(
        vehicle_task, seed=seed, time_limit=entry.time_limit if time_limit is None else time_limit
    )


def environment(
    task: composer.Task, *, seed: Seed = None, time_limit: float = np.inf
) -> composer.Environment:
    """dm_control's environment of a task whose model stays the same in all episodes.

    Observations have no buffer axis.

    Args:
        task: Task of this package, or a user's own.
        seed: Seed of all random numbers; None: a new seed every time.
        time_limit: [s] Duration of an episode.

    Raises:
        ConfigurationError: The time limit is not above 0, or the seed is neither a whole number nor
            a RandomState.
    """
    limit = number(time_limit, "time_limit [s]")
    if not limit > 0.0:
        raise ConfigurationError(f"time_limit: must be > 0 s, got {time_limit}")

    if seed is not None and not isinstance(seed, np.random.RandomState):
        seed = whole_number(seed, "seed", least=0, most=2**32 - 1)

    return Environment(
        task,
        # times are sums of steps, and may be a little above or below the exact value
        time_limit=limit - 0.5 * task.physics_timestep,
        random_state=seed,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
        delayed_observation_padding=composer.ObservationPadding.INITIAL_VALUE,
    )
