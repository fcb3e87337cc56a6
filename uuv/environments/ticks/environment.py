"""Environment of dm_control with compiled substeps, if no Python code acts at every substep.

    environment = suite.load("barrel", "wipe")
    environment.slow_part  # what keeps it from that; empty: nothing

dm_control requests one substep after another. The first request runs all substeps up to the next
observation that is due; dm_control's requests for the others then do nothing. A hook, task, judge
or action of a user that acts at every substep makes the substeps run one by one, with the same
bits.
"""

import sys
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation.updater import Updater

from uuv.environments.entities import VehicleEntity
from uuv.environments.ticks import action_ticks
from uuv.environments.ticks.action_ticks import ActionRecord, run_substeps
from uuv.environments.ticks.drives import ActionDrive
from uuv.environments.vehicle_task import VehicleTask
from uuv.sim.interfaces.kernels.control import REFUSED
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import FINE, gives_kernel


class Substeps:
    """Compiled substeps of one episode."""

    def __init__(self, task: VehicleTask, physics: mjcf.Physics, most: int) -> None:
        """Take the arrays that the substeps change, after the actions have begun.

        Args:
            task: Task of the environment.
            physics: Physics of the environment.
            most: Number of substeps of an action.
        """
        self._task = task
        self._physics = physics
        self.plant = task.vehicle.plant
        truth = self.plant.truth
        actions: Any = task.actions
        self._drive: ActionDrive = actions.drive(truth)
        self._rows = np.zeros((most, action_ticks.STEP))

        drive = self._drive
        record = ActionRecord(
            plant=self.plant.record(),
            sight=drive.seeing.sight,
            estimate=drive.seeing.estimate,
            p_WG=truth.p_WG,
            p_pad=truth.p_pad,
            control=np.array(drive.control),
            reference=drive.reference,
            leash=drive.leash,
            command=drive.command,
            rows=self._rows,
            warnings=physics.data.ptr.warning.number,
            kinematics=action_ticks.address_of_kinematics(),
        )
        self._box = action_ticks.action_box(as_annotated(record))

    def run(self, substeps: int) -> int:
        """Run `substeps` substeps; return the number that was run, which is less if MuJoCo has
        warned.

        Raises:
            control.PhysicsError: Exception of dm_control; the simulation diverged.
            ConfigurationError: A command is not finite.
        """
        total = 0
        answer = FINE
        self._drive.begin()
        with self._physics.check_invalid_state():
            while total < substeps and answer == FINE:
                # The rows of the current may end during an action.
                count = min(substeps - total, self.plant.ready())
                done, answer = run_substeps(self._box, count)
                self._drive.slots.check(answer)
                total += done

                # Update of the data that Python code reads.
                self._task.watch_steps(self._rows[:done])
                command = self._task.vehicle.command = self._drive.done(answer)
                self.plant.publish()
                if answer == REFUSED:
                    self.plant.begin(command)  # raises an error with the reason
        return total


class DueUpdater(Updater):
    """Updater of dm_control's observations that knows when the next observation is due."""

    _due = 0  # number of the substep after which the next observation is due

    def prepare_for_next_control_step(self) -> None:
        """Plan the next action."""
        super().prepare_for_next_control_step()
        self._look_ahead()

    def update(self) -> None:
        """Take the observations that are due."""
        if self._step_counter + 1 < self._due:
            self._step_counter += 1
            return
        super().update()
        self._look_ahead()

    def substeps(self) -> int:
        """Number of substeps up to the next observation that is due; at least 1."""
        return max(self._due - self._step_counter, 1)

    def _look_ahead(self) -> None:
        schedules = (enabled.update_schedule for enabled in self._enabled_list)
        firsts = (schedule[0][0] for schedule in schedules if schedule)
        self._due = min(firsts, default=sys.maxsize)


class Environment(composer.Environment):
    """Environment of a task, compiled within an action if no Python code acts at every substep."""

    _taken = 0  # number of substeps of the present action that dm_control has requested
    _ahead = 0  # number of substeps that have run before dm_control has requested them
    _substeps: Substeps | None = None
    _slow: str | None = None  # `slow_part` of the present episode

    @property
    def slow_part(self) -> str:
        """Reason why Python code must run at every substep; empty if there is none."""
        return _slow_part(self._task, self._hooks, self._physics)

    def step(self, action: Any) -> Any:
        """Same as in dm_control."""
        self._taken = self._ahead = 0
        return super().step(action)

    def add_extra_hook(self, hook_name: str, hook_callable: Any) -> None:
        """Same as in dm_control."""
        super().add_extra_hook(hook_name, hook_callable)
        self._slow = None

    def close(self) -> None:
        """Same as in dm_control."""
        self._substeps = None
        super().close()

    def _reset_attempt(self) -> Any:
        self._substeps = self._slow = None
        return super()._reset_attempt()

    def _make_observation_updater(self) -> Updater:
        updater = super()._make_observation_updater()
        updater.__class__ = DueUpdater
        return updater

    def _substep(self, action: Any) -> None:
        self._taken += 1
        if self._ahead:
            self._ahead -= 1
            return
        if self._slow is None:
            self._slow = self.slow_part

        # MuJoCo's own callbacks, called between the two halves of a step, may be set and removed.
        called = mujoco.get_mjcb_control() is not None or mujoco.get_mjcb_sensor() is not None
        if self._slow or called:
            super()._substep(action)
        else:
            self._run()

    def _run(self) -> None:
        """Run all substeps up to the next observation."""
        left = self._n_sub_steps - self._taken + 1
        count = min(left, self._observation_updater.substeps())
        if self._substeps is None or self._substeps.plant is not self._task.vehicle.plant:
            self._substeps = Substeps(self._task, self._physics, self._n_sub_steps)
        self._ahead = max(self._substeps.run(count) - 1, 0)


def _slow_part(task: Any, hooks: Any, physics: mjcf.Physics) -> str:
    """Reason why Python code must run at every substep of a task; empty if there is none."""
    if not isinstance(task, VehicleTask):
        return f"task {type(task).__name__}"

    # Hooks.
    vehicle = task.vehicle
    if not _as_in(VehicleTask, task, "before_substep", "after_substep", "watch_steps"):
        return f"hook of {type(task).__name__}"
    if not _as_in(VehicleEntity, vehicle, "before_substep", "after_substep"):
        return f"hook of {type(vehicle).__name__}"
    ours = [vehicle.before_substep], [], [vehicle.after_substep], []
    before = hooks._before_substep.entity_hooks, hooks._before_substep.extra_hooks
    after = hooks._after_substep.entity_hooks, hooks._after_substep.extra_hooks
    if ours != before + after:
        return "hooks of substeps"

    # Components.
    if not gives_kernel(task.actions, "drive"):
        return f"actions {type(task.actions).__name__}"
    if task.in_contact and not gives_kernel(task.judge, "watch_steps"):
        return f"judge {type(task.judge).__name__}"
    if not _as_in(mjcf.Physics, physics, "step") or physics.legacy_step:
        return "step of the physics"
    return vehicle.plant.spans()


def _as_in(base: type, part: object, *names: str) -> bool:
    """True if a component has the methods of a class unchanged."""
    ours = (getattr(type(part), name, None) is getattr(base, name, None) for name in names)
    return all(ours) and not set(names) & set(vars(part))
