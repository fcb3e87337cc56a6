"""Base of composer tasks with a vehicle: actions, observations, judge, rewards, end."""

from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_env import specs

from uuv.environments.actions import Actions, checked_action, spec
from uuv.environments.entities import Sea, VehicleEntity
from uuv.environments.judges import Judge
from uuv.environments.sensing import BoundedNumbers
from uuv.environments.ticks.action_ticks import STEP_COLLISION, STEP_MOST
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number, fitting, pose
from uuv.sim.loop.rollout import ticks_per_period
from uuv.sim.plant.truth import Truth

CONTROL_PERIOD = 0.02  # [s] between actions
SITE_DEPTH = 5.0  # [m] depth of the suite's tasks below the surface of the sea, z = 0
BOX = 5.0  # [m] half the edge of the box about the start; outside it the episode ends
Random = np.random.RandomState


class VehicleTask(composer.Task):
    """Base of tasks: a vehicle in the sea, with goal, reward and judge.

    A user's task overrides `goal`, `shaped` and `judge`, and `begin` for its own draws. Rewards are
    in [0, 1]: `shaped` for each action or, with `sparse`, 1 as soon as the judge regards the work
    as done. An episode ends with discount 0 on damage (a collision, a force beyond the task's
    limit) and outside the BOX; success does not end it.
    """

    def __init__(
        self, sea: Sea, vehicle: VehicleEntity, actions: Actions, *, sparse: bool = False
    ) -> None:
        """Put the vehicle into the sea.

        Args:
            sea: The arena.
            vehicle: Vehicle in the arena.
            actions: Actions of the agent.
            sparse: Whether only success is rewarded.
        """
        self._sea, self.vehicle, self.actions, self._sparse = sea, vehicle, actions, sparse

        sea.add_free_entity(vehicle)
        self.set_period(CONTROL_PERIOD)
        vehicle.observe(sensors=bool(vehicle.readings.sensors))

        self._goals: OrderedDict[str, observable.Observable] = OrderedDict()
        # number of the plant's step, and the goal there
        self._goal: tuple[int, Mapping[str, Array]] | None = None
        self._X_WB = np.eye(4)

        self.largest_force = np.inf  # [N] contact force above which contact counts as damage
        self.damage = ""  # reason why the episode ended early
        self._fresh = True  # the controllers have not started yet

    # True if the judge gets every step of the physics, not only the state after each action
    in_contact = False

    # To be defined by a task

    @property
    @abstractmethod
    def judge(self) -> Judge:
        """Judge of the episode."""

    @abstractmethod
    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """Goal as numbers of the observation, by name; each (k,)."""

    @abstractmethod
    def shaped(self, truth: Truth) -> float:
        """Reward in [0, 1] of a state."""

    @abstractmethod
    def begin(self, random_state: Random) -> tuple[Array, Array | None]:
        """Draw the first hull pose X_WB (4, 4) and joint angles (n,) [rad]; None: folded."""

    # Inherited by a task

    def set_period(self, period: float) -> None:
        """Set the time [s] between actions; to be called before the environment is made.

        Raises:
            ConfigurationError: The period is not a whole multiple of the vehicle's physics step.
        """
        timestep = float(self.vehicle.own.model.opt.timestep)
        ticks_per_period(
            finite_number(period, "period [s]", above=0.0), timestep, "time between actions"
        )
        self.set_timesteps(control_timestep=period, physics_timestep=timestep)
        self._timestep = timestep

    def add_goals(self, bound: float, **sizes: int) -> None:
        """Declare the result of `goal`: the number of values of each name, and their largest
        magnitude.
        """
        for name, size in sizes.items():
            self._goals[name] = BoundedNumbers(self._reader(name, size), size, bound)
            self._goals[name].enabled = True

    def _reader(self, name: str, size: int) -> Any:
        def read(physics: Any) -> Array:
            del physics
            goal = self._present_goal()
            if name not in goal:
                stated = ", ".join(self._goals)
                raise ConfigurationError(
                    f"{type(self).__name__}.goal: must return the declared names {stated}; "
                    f"{name!r} is missing"
                )

            return fitting(
                np.atleast_1d(np.array(goal[name], dtype=np.float64)), (size,), f"goal {name}"
            )

        return read

    def _present_goal(self) -> Mapping[str, Array]:
        """`goal` of the present step, evaluated once for all its names."""
        tick = self.vehicle.plant.tick
        if self._goal is None or self._goal[0] != tick:
            self._goal = tick, self.goal(self.truth)
        return self._goal[1]

    @property
    def truth(self) -> Truth:
        """True state."""
        return self.vehicle.truth

    @property
    def sea(self) -> Sea:
        """The arena."""
        return self._sea

    @property
    def root_entity(self) -> Sea:
        """The arena."""
        return self._sea

    @property
    def task_observables(self) -> OrderedDict[str, observable.Observable]:
        """Observables with the goal of the task."""
        return self._goals

    @property
    def is_success(self) -> bool:
        """True once the work is done without damage."""
        return self.judge.done and not self.damage

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Specification of the actions."""
        return spec(self.actions)

    def initialize_episode(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Draw the episode, and place the vehicle."""
        self._X_WB, q = self.begin(random_state)
        self.vehicle.place(physics, self._X_WB, q)
        self.judge.start()
        self.damage = ""
        self._fresh = True
        self._goal = None

    def before_step(self, physics: mjcf.Physics, action: Array, random_state: Random) -> None:
        """Take the action.

        Raises:
            ConfigurationError: The action has another shape, or a number that is not finite.
        """
        action = checked_action(action, self.actions)
        if self._fresh:
            self.actions.start(self.truth)
            self._fresh = False
        self.actions.take(action, self.control_timestep)

        # A gripper has its drive in its own housing.
        jaws = getattr(self.actions, "jaws", None)
        if jaws is not None:
            self.vehicle.plant.jaws.follow(jaws)

    def before_substep(self, physics: mjcf.Physics, action: Array, random_state: Random) -> None:
        """Judge the state, and command the vehicle."""
        truth = self.vehicle.truth
        if self.in_contact:
            self.judge.watch(truth, self._timestep)
        if truth.collision or truth.contact_most > self.largest_force:
            self._damaged(truth.collision, truth.contact_most)
        self.vehicle.command = self.actions.command(truth)

    def watch_steps(self, steps: Array) -> None:
        """Judge the states before substeps, given as rows (k, STEP) of `ticks.action_ticks`."""
        judge: Any = self.judge
        if self.in_contact:
            judge.watch_steps(steps, self._timestep)

        collided = steps[:, STEP_COLLISION] != 0.0
        most = steps[:, STEP_MOST]
        spoiled = collided | (most > self.largest_force)
        if spoiled.any():
            first = int(spoiled.argmax())
            self._damaged(bool(collided[first]), float(most[first]))

    def after_step(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Judge the last state of an action."""
        truth = self.vehicle.truth
        if not self.in_contact:
            self.judge.watch(truth, self.control_timestep)
        self._damaged(truth.collision, truth.contact_most)

        offset = self._X_WB[:3, :3].T @ (truth.p_WB - self._X_WB[:3, 3])
        if not self.damage and np.abs(offset).max() > BOX:
            self.damage = "outside the allowed box"

    def _damaged(self, collision: bool, most: float) -> None:
        """Record a collision, or a largest force [N] above the limit; only the first is
        recorded.
        """
        if self.damage:
            return
        if collision:
            self.damage = "collision"
        elif most > self.largest_force:
            self.damage = f"force of {most:.0f} N"

    def get_reward(self, physics: mjcf.Physics) -> float:
        """Reward of the state after an action."""
        if self.damage:
            return 0.0
        if self._sparse:
            return float(self.judge.done)

        reward = float(self.shaped(self.truth))
        if not 0.0 <= reward <= 1.0:
            raise ConfigurationError(
                f"{type(self).__name__}.shaped: must be in [0, 1], got {reward}"
            )
        return reward

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        """True after damage."""
        return bool(self.damage)

    def get_discount(self, physics: mjcf.Physics) -> float:
        """0 after damage, else 1."""
        return 0.0 if self.damage else 1.0


def near(X_WB: Array, random_state: Random, *, offset: float, turn: float) -> Array:
    """Random hull pose (4, 4) near another: up to `offset` [m] per axis, `turn` [rad] about z."""
    yaw = random_state.uniform(-turn, turn)
    return X_WB @ pose(exp_so3([0.0, 0.0, yaw]), random_state.uniform(-offset, offset, 3))
