"""Reinforcement-learning interface: the plant as a dm_env environment through `dm_control.rl.control`.

    environment = hover(seed=0)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep.observation))

It advances the same `Plant.step` as `uuv.sim.loop.rollout`. An agent observes the true state: noise, delay and
estimation belong to `uuv.sim.loop.rollout`. Frames: W world, B hull, H the hull pose to hold.
"""

from collections import OrderedDict

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.site import scenes
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.extras import without_dm_control
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, checked, exp_so3, inverse, log_so3, pose
from uuv.sim.loop.rollout import ticks_per_period
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.plant import Plant, Truth
from uuv.sim.water.current import Current

try:
    from dm_control.rl import control
    from dm_control.utils import rewards
    from dm_env import specs
except Exception as error:  # of any type: dm_control generates its classes from MuJoCo's names
    raise without_dm_control(error) from error

CURRENT_SPEED = 0.15  # [m/s] horizontal, from a new direction each episode
START_OFFSET = 0.5  # [m] largest per axis, from the pose to hold
START_TURN = 0.3  # [rad] largest, about the vertical
BOX = 1.5  # [m] half edge of the box about the pose to hold; outside it the episode ends
CLOSE = 0.05, 0.5  # [m] position error up to which the reward is full, and further error at which it is a tenth
ALIGNED = 0.05, 0.5  # [rad] the same for the attitude error

Observation = OrderedDict[str, Array]


class PlantPhysics(control.Physics):
    """The plant behind dm_control's `Physics`: `observe` and `step` in the order of `uuv.sim.loop.rollout`.

    The control signal is one command per thruster. A PD law at the plant's rate (`ArmHold`) holds the arm at home.
    """

    def __init__(self, plant: Plant) -> None:
        """Take a plant, whose current and pose `place` sets.

        Raises:
            ConfigurationError: The vehicle has no thrusters.
        """
        vehicle = plant.vehicle
        self.thruster_names = vehicle.thruster_names
        if not self.thruster_names:
            raise ConfigurationError("the vehicle has no thrusters, so an agent has nothing to command")
        self._plant = plant
        self._still = Current(np.zeros(3), timestep=plant.timestep)
        self._arm = ArmHold(vehicle, vehicle.q_home)
        self._thrusters = np.zeros(len(self.thruster_names))

    @property
    def truth(self) -> Truth:
        """The current true state; live views, as `uuv.sim.plant.plant.Truth` says."""
        return self._plant.truth

    def place(self, *, current: Current, X_WB: Array | None = None) -> None:
        """Restart at rest with the arm at home, in `current`, hull at `X_WB` (4, 4); default: the model's pose."""
        self._plant.reset(current=current, X_WB=X_WB)
        self._plant.observe()
        self._thrusters = np.zeros(len(self.thruster_names))

    def set_control(self, control: ArrayLike) -> None:
        """Set the normalised propeller speeds (m,) to command; values beyond [-1, 1] saturate.

        Raises:
            ConfigurationError: The shape is wrong, or a number is not finite.
        """
        self._thrusters = checked(control, (len(self.thruster_names),), "action")

    def step(self, n_sub_steps: int = 1) -> None:
        """Advance by `n_sub_steps` steps of the plant under the control that was set.

        Raises:
            control.PhysicsError: Of dm_control; the simulation diverged.
        """
        plant, truth = self._plant, self._plant.truth
        for _ in range(n_sub_steps):
            torque = self._arm.torque(truth)
            plant.step(Command(time=truth.time, joint_torque=torque, thrusters=self._thrusters, scan=False))
            try:
                plant.observe()
            except HydrodynamicsError as error:
                raise control.PhysicsError(str(error)) from error

    def time(self) -> float:
        """Time since the start of the episode [s]."""
        return self.truth.time

    def timestep(self) -> float:
        """Step of the plant [s]."""
        return self._plant.timestep

    def reset(self) -> None:
        """Restart in still water with the hull at the model's pose."""
        self.place(current=self._still)

    def after_reset(self) -> None:
        """Do nothing: `place` has updated the kinematics."""


class HoverTask(control.Task):
    """Task: hold the model's initial hull pose in a current, from a random start nearby.

    As in dm_control's own tasks, all random numbers come from `_random`, which a wrapper may replace to seed it anew.
    Shimmy does so, with a RandomState, in Gymnasium's `reset(seed=...)`.

    Action: normalised propeller speeds (m,) in [-1, 1]. Observation, in hull axes:

    - position (3,) [m] of the pose to hold
    - attitude (3,) [rad] rotation vector from the hull to the pose to hold
    - velocity (3,) [m/s] of the hull over ground
    - angular_velocity (3,) [rad/s] of the hull
    - joints (n,) [rad]
    - joint_velocity (n,) [rad/s]
    - propeller_speed (m,) normalised; lags the action

    The reward is in [0, 1]: 1 within CLOSE and ALIGNED, else a product of one factor for the position error and one for
    the attitude error. The episode ends with discount 0 when the hull's origin leaves the BOX.
    """

    def __init__(self, rng: np.random.Generator, *, current_speed: float = CURRENT_SPEED) -> None:
        """Set up the random source and the speed of the current.

        Args:
            rng: Source of all random numbers.
            current_speed: [m/s]; the direction is random.

        Raises:
            ConfigurationError: The speed is negative or not finite.
        """
        if not (np.isfinite(current_speed) and current_speed >= 0.0):
            raise ConfigurationError(f"current_speed: must be finite and >= 0 m/s, got {current_speed}")
        self._random: np.random.Generator | np.random.RandomState = rng  # dm_control's name for it, used to seed
        self._current_speed = current_speed
        self._X_WH = np.eye(4)

    def initialize_episode(self, physics: PlantPhysics) -> None:
        """Draw the current and the start; `physics` has just been reset, so its hull is at the pose to hold."""
        self._X_WH = _hull_pose(physics.truth)
        heading = self._random.uniform(-np.pi, np.pi)
        flow_W = self._current_speed * np.array([np.cos(heading), np.sin(heading), 0.0])
        turn = exp_so3([0.0, 0.0, self._random.uniform(-START_TURN, START_TURN)])
        offset = self._random.uniform(-START_OFFSET, START_OFFSET, 3)
        X_HB = pose(turn, offset)
        physics.place(current=Current(flow_W, timestep=physics.timestep()), X_WB=self._X_WH @ X_HB)

    def before_step(self, action: ArrayLike, physics: PlantPhysics) -> None:
        """Pass the action (m,) to the physics.

        Raises:
            ConfigurationError: As `PlantPhysics.set_control` does.
        """
        physics.set_control(action)

    def action_spec(self, physics: PlantPhysics) -> specs.BoundedArray:
        """Specification of the action: one number in [-1, 1] per thruster.

        Its name lists the thrusters in order, as dm_control's own does.
        """
        names = physics.thruster_names
        return specs.BoundedArray((len(names),), np.float64, minimum=-1.0, maximum=1.0, name="\t".join(names))

    def get_observation(self, physics: PlantPhysics) -> Observation:
        """The observation that the class describes."""
        truth = physics.truth
        X_BH = self._X_BH(physics)
        return OrderedDict(
            position=X_BH[:3, 3],
            attitude=log_so3(X_BH[:3, :3]),
            velocity=truth.R_WB.T @ truth.v_WB_W,
            angular_velocity=truth.w_WB_B.copy(),
            joints=truth.q.copy(),
            joint_velocity=truth.qd.copy(),
            propeller_speed=truth.propeller_speed.copy(),
        )

    def get_reward(self, physics: PlantPhysics) -> float:
        """The reward that the class describes."""
        X_BH = self._X_BH(physics)
        distance = float(np.linalg.norm(X_BH[:3, 3]))
        angle = float(np.linalg.norm(log_so3(X_BH[:3, :3])))
        close = rewards.tolerance(distance, bounds=(0.0, CLOSE[0]), margin=CLOSE[1])
        aligned = rewards.tolerance(angle, bounds=(0.0, ALIGNED[0]), margin=ALIGNED[1])
        return close * aligned

    def get_termination(self, physics: PlantPhysics) -> float | None:
        """Discount 0 outside the box, whose edges are along the axes of the pose to hold; else None."""
        p_HB = inverse(self._X_BH(physics))[:3, 3]
        return 0.0 if np.max(np.abs(p_HB)) > BOX else None

    def _X_BH(self, physics: PlantPhysics) -> Array:
        """X_BH (4, 4), the pose to hold in hull axes."""
        return inverse(_hull_pose(physics.truth)) @ self._X_WH


def hover(
    vehicle: str = "uuv_puma",
    seed: int | np.random.Generator | np.random.RandomState | None = None,
    *,
    time_limit: float = 30.0,
    control_period: float = 0.02,
    current_speed: float = CURRENT_SPEED,
) -> control.Environment:
    """Environment for `HoverTask` with `vehicle`.

    An episode ends with discount 1 at the first action that reaches `time_limit`.

    Args:
        vehicle: Name from `uuv.models.available()`, or an MJCF file.
        seed: A Generator is used as it is and shared with the caller. A RandomState is drawn from once. None gives
            episodes that cannot be repeated.
        time_limit: [s], may be infinite.
        control_period: Time between actions [s].
        current_speed: [m/s]

    Returns:
        The dm_control environment.

    Raises:
        ConfigurationError: The vehicle is unknown or has no thrusters, the control period is no whole multiple of the
            physics step, or the time limit or the speed of the current is invalid.
    """
    if not time_limit > 0.0:
        raise ConfigurationError(f"time_limit: must be > 0 s, got {time_limit}")
    task = HoverTask(_generator(seed), current_speed=current_speed)
    model = hydrodynamics.compile(scenes.vehicle_spec(vehicle))
    sub_steps = ticks_per_period(control_period, float(model.opt.timestep), "control_period")
    physics = PlantPhysics(Plant(model, current=Current(np.zeros(3))))
    return control.Environment(physics, task, time_limit=time_limit, n_sub_steps=sub_steps)


def _generator(seed: int | np.random.Generator | np.random.RandomState | None) -> np.random.Generator:
    if isinstance(seed, np.random.RandomState):
        return np.random.default_rng(seed.randint(2**32, size=4, dtype=np.uint32))
    return np.random.default_rng(seed)


def _hull_pose(truth: Truth) -> Array:
    """X_WB (4, 4)."""
    return pose(truth.R_WB, truth.p_WB)
