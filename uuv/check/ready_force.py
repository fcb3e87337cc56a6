"""Load of a job's push on arm, tool and thrusters in `ready`: the fast part of a verdict."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.check.statics import tip_force
from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.models.naming import TOOL_GEOM
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import Scenario
from uuv.tasks.collecting import CollectTask
from uuv.tasks.plugging import MovePlugTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask
from uuv.tasks.surface_work import SurfaceWorkTask
from uuv.tasks.turning import TurnValveTask

VIEW = 0.5  # share of the camera's view that may be on the vehicle itself
# ratio of a job's push to the capacity in `ready`, above which no other posture is tried
BEYOND = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadyForce:
    """Load of a job's push on arm, tool and thrusters in the posture `ready`."""

    force: float  # [N] set force of the job
    bears: float  # [N] force along the tool that the drives can apply
    by: str  # joint that limits this force
    spring: float  # [N] at which the tool's spring reaches its limit
    used: float  # largest share of a thruster's limit

    @classmethod
    def of(cls, scenario: Scenario, believed: OwnVehicle) -> Self:
        """Figures of a scenario, by the vehicle's model of itself."""
        force = push_of(scenario)
        ready = np.array(believed.vehicle.q_ready)
        tip = tip_force(believed.model, believed.vehicle, ready)
        used = ThrustMargin.of(believed.model, drag=0.0).used(ready, np.eye(3), [0.0, 0.0, -force])
        return cls(
            force=force, bears=tip.along, by=tip.by, spring=_spring_limit(believed), used=used
        )

    def refusal(self, beyond: float = 1.0) -> tuple[str, str, float] | None:
        """Code, sentence and figure of a part that bears less than `beyond` times the push, or
        None.
        """
        if self.spring < self.force:
            message = (
                f"the tool's spring bottoms out at {self.spring:.0f} N, the set force is "
                f"{self.force:.0f} N"
            )
            return "force", message, self.spring

        if beyond * self.bears < self.force:
            message = (
                f"the available tip force is {self.bears:.0f} N in the ready posture ({self.by}), "
                f"the set force is {self.force:.0f} N"
            )
            return "force", message, self.bears

        if self.used > beyond:
            message = (
                f"the set force of {self.force:.0f} N needs {self.used:.0%} of a thruster's limit "
                "in the ready posture"
            )
            return "thrust", message, self.used

        return None


def push_of(scenario: Scenario) -> float:
    """Largest set force [N] of a job, or the load that it lifts; of a turn, along the
    tool.
    """
    task = scenario.task
    if isinstance(task, SurfaceWorkTask):
        return max(task.forces)
    if isinstance(task, SeabedSamplingTask):
        return task.push
    if isinstance(task, CollectTask):
        return task.load
    if isinstance(task, MovePlugTask):
        return max(task.pull, task.push)
    if isinstance(task, TurnValveTask):
        from uuv.controllers.tasks.grasping.turning import TurnJob

        return TurnJob().push
    from uuv.controllers.tasks.insertion import InsertionJob

    return InsertionJob().force


def _spring_limit(believed: OwnVehicle) -> float:
    """Force [N] along the tool at which a spring behind it reaches its limit; inf without one."""
    model = believed.model
    limits = [np.inf]

    # Bodies from the tool to the hull.
    body = int(model.geom(TOOL_GEOM).bodyid[0])
    carriers = []
    while body != believed.vehicle.hull and body > 0:
        carriers.append(body)
        body = int(model.body_parentid[body])

    for name in believed.passive_joints:
        j = model.joint(name).id
        k = float(model.jnt_stiffness.reshape(model.njnt, -1)[j, 0])
        slides = (
            model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE and model.jnt_bodyid[j] in carriers
        )
        if slides and k > 0.0 and model.jnt_limited[j]:
            limits.append(k * float(np.abs(model.jnt_range[j]).max()))

    return min(limits)


def looks_by_camera(scenario: Scenario) -> bool:
    """True if a job identifies its object by the camera on the hull, not by sonar or survey."""
    return not scenario.task.spares and scenario.sensing.sensor == "camera"
