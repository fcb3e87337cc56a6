"""Actions of an agent: commands to thrusters, joint torques or velocities, a wrench, or tool
motion.

All actions are numbers in [-1, 1]. Thruster commands and torques are passed to the plant unchanged.
Joint velocities and the tool's motion and force are set points of the project's own controllers,
which run inside the environment at their own rates on the true state.
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from dm_env import specs

from uuv.controllers.arm.tool_motion import extrapolated
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.whole_body.work_controller import WorkController, WorkControllerState
from uuv.environments.ticks.action_ticks import keep_near
from uuv.environments.ticks.drives import ActionDrive, constant, holding
from uuv.environments.true_state import TrueState, tool_pose
from uuv.models.tools.jaw_shape import JawShape
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import curves
from uuv.own_vehicle import OwnVehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.control import Inputs, commanded
from uuv.sim.interfaces.messages import Command, JawSetpoint, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array, fitting, log_so3, shown
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.truth import Truth

_ZERO = np.zeros(3)


class Actions(Protocol):
    """Kind of action of one environment, with its state in the present episode.

    A kind with a method `drive(truth) -> ActionDrive` (`uuv.environments.ticks.drives`), which is
    called once in each episode after `start`, runs compiled within an action. For a kind without
    it, `command` is called at every step of the plant. A kind with an attribute `jaws`, a
    JawSetpoint or None, commands a gripper.
    """

    names: tuple[str, ...]  # names of the numbers of an action

    def start(self, truth: Truth) -> None:
        """Begin an episode at this state."""
        ...

    def take(self, action: Array, period: float) -> None:
        """Take an action (k,), which holds for `period` [s]."""
        ...

    def command(self, truth: Truth) -> Command:
        """Command of the next step of the plant."""
        ...


def spec(actions: Actions) -> specs.BoundedArray:
    """dm_env's specification of an action. Its name lists the numbers, as in dm_control."""
    names = actions.names
    return specs.BoundedArray(
        (len(names),), np.float64, minimum=-1.0, maximum=1.0, name="\t".join(names)
    )


def checked_action(action: Array, actions: Actions) -> Array:
    """The action (k,), clipped to [-1, 1].

    Raises:
        ConfigurationError: The action is not numeric, has another shape, or has a number that is
            not finite.
    """
    try:
        numbers = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"action: expected {len(actions.names)} numbers, got {shown(action)}"
        ) from error
    return np.clip(fitting(numbers, (len(actions.names),), "action"), -1.0, 1.0)


class ThrusterSpeeds:
    """Normalised propeller speeds as action; a PD law holds the arm folded."""

    def __init__(self, believed: OwnVehicle) -> None:
        """Take the vehicle.

        Raises:
            ConfigurationError: It has no thrusters.
        """
        self.names = believed.vehicle.thruster_names
        if not self.names:
            raise ConfigurationError(
                "actions: the vehicle must have thrusters, since the agent commands them; it has "
                "none"
            )

        self._arm = ArmHold(believed.vehicle, believed.vehicle.q_home)
        self._true = TrueState()
        self._thrusters = np.zeros(len(self.names))

    def start(self, truth: Truth) -> None:
        """Thrusters off."""
        self._thrusters = np.zeros(len(self.names))

    def take(self, action: Array, period: float) -> None:
        """Take propeller speeds (m,)."""
        self._thrusters = action

    def command(self, truth: Truth) -> Command:
        """Command of these speeds, and torques that hold the arm."""
        torque = self._arm.torque(truth)
        return Command(time=truth.time, joint_torque=torque, thrusters=self._thrusters, scan=False)

    def drive(self, truth: Truth) -> ActionDrive:
        """The same as a kernel."""
        command = commanded(len(truth.q), len(truth.thrust))

        def begin() -> None:
            command.thrusters[:] = self._thrusters

        return holding(self._arm, constant(self._true.of(truth), command, begin))


class HullWrench(ThrusterSpeeds):
    """Force (3,) and moment (3,) on the hull as action, in hull axes; thrust allocation turns them
    into commands.

    A full action along or about one axis is half of the largest force or moment that the thrusters
    can give there alone. The arm is held folded.
    """

    def __init__(self, believed: OwnVehicle) -> None:
        """Take the vehicle.

        Raises:
            ConfigurationError: It has no thrusters, or they do not span all six directions.
        """
        super().__init__(believed)
        self.names = (*(f"force_{axis}" for axis in "xyz"), *(f"moment_{axis}" for axis in "xyz"))
        self._allocation = Allocation(believed.vehicle)
        full = np.array(
            [thrust_at(curve, 1.0) for curve in curves(believed.vehicle.thruster_table)]
        )
        self._half = 0.5 * np.abs(believed.vehicle.thruster_wrench) @ full

    def start(self, truth: Truth) -> None:
        """Thrusters off."""
        self._thrusters = np.zeros(len(truth.propeller_speed))

    def take(self, action: Array, period: float) -> None:
        """Take a wrench (6,)."""
        self._thrusters = self._allocation.command(self._allocation.thrust(self._half * action))

    def drive(self, truth: Truth) -> ActionDrive:
        """The same as a kernel."""
        return super().drive(truth)


class ThrustersAndTorques:
    """Normalised propeller speeds (m,), followed by joint torques (n,) as shares of the drives'
    limits.
    """

    def __init__(self, believed: OwnVehicle) -> None:
        """Take the vehicle."""
        vehicle = believed.vehicle
        self.names = (*vehicle.thruster_names, *vehicle.joint_names)
        self._limits = vehicle.torque_limits
        self._thrusters = len(vehicle.thruster_names)
        self._action = np.zeros(len(self.names))
        self._true = TrueState()

    def start(self, truth: Truth) -> None:
        """Thrusters and motors off."""
        self._action = np.zeros(len(self.names))

    def take(self, action: Array, period: float) -> None:
        """Take speeds and torques."""
        self._action = action

    def command(self, truth: Truth) -> Command:
        """Command of these speeds and torques."""
        m = self._thrusters
        torque = self._action[m:] * self._limits
        return Command(time=truth.time, joint_torque=torque, thrusters=self._action[:m], scan=False)

    def drive(self, truth: Truth) -> ActionDrive:
        """The same for a kernel."""
        command = commanded(len(truth.q), len(truth.thrust))
        m = self._thrusters

        def begin() -> None:
            command.tau[:] = self._action[m:] * self._limits
            command.thrusters[:] = self._action[:m]

        return constant(self._true.of(truth), command, begin)


class Controlled(ABC):
    """Base of actions that are set points of `WorkController`; the hull is held at its initial
    pose.
    """

    names: tuple[str, ...] = ()

    def __init__(self, believed: OwnVehicle) -> None:
        """Compose the controller for the vehicle's model of itself.

        Raises:
            ConfigurationError: The vehicle has no arm.
        """
        if not len(believed.vehicle.joints):
            raise ConfigurationError(
                f"{type(self).__name__}: the vehicle must have an arm, it has none"
            )
        if not believed.vehicle.thruster_names:
            raise ConfigurationError(
                f"{type(self).__name__}: the vehicle must have thrusters for station keeping, it "
                "has none"
            )

        self._controller = WorkController(believed.model)
        self._true = TrueState()
        self._inputs: Inputs | None = None  # estimate that the controller gets
        self._state: WorkControllerState | None = None
        self._X_WB = np.eye(4)
        self._q = np.array(believed.vehicle.q_home)
        self.last: Command | None = None  # newest command, with the estimated contact force

    @property
    def estimate(self) -> StateEstimate | None:
        """Estimate that the newest command was made from; at first, the initial estimate."""
        return None if self._inputs is None else self._inputs.seen()

    def start(self, truth: Truth) -> None:
        """Hold hull and arm at their present poses."""
        self._inputs = Inputs(self._true.take(truth))
        estimate = self._inputs.seen()
        self._X_WB, self._q = estimate.X_WB, truth.q.copy()
        self._state = self._controller.init(estimate)
        self.last = None

    def command(self, truth: Truth) -> Command:
        """Command of the controller."""
        assert self._inputs is not None  # the command made by `start`
        assert self._state is not None

        self._true.take(truth)
        self._inputs.message = None
        estimate = self._inputs.seen()

        reference = self.reference(truth.time)
        self._state, self.last = self._controller.step(self._state, estimate, reference)
        return self.last

    def _controlled(self, truth: Truth) -> ActionDrive:
        """The controller as a kernel, for set points that change only by their velocities."""
        inputs = self._inputs
        state = self._state
        assert inputs is not None  # the reference made by `start`
        assert state is not None

        tick = self._controller.tick_on(state, inputs)
        references: list[Reference] = []

        def begin() -> None:
            inputs.message = None
            references[:] = [self.reference(truth.time)]
            tick.refer(references[0])

        def done(answer: int) -> Command:
            self.last = tick.done(inputs.seen(), references[0], answer)
            return self.last

        return ActionDrive(
            seeing=self._true.of(truth),
            command=tick.command,
            reference=state.reference,
            begin=begin,
            done=done,
            control=(tick.address, tick.memory, inputs.address),
            slots=tick.slots,
            kept=tick,
        )

    @abstractmethod
    def reference(self, time: float) -> Reference:
        """Set points at `time` [s], extrapolated from the reference's own time by its
        velocities.
        """

    def _reference(self, time: float, **set_points: Any) -> Reference:
        """Set points at `time` [s] that hold hull and joints, except for the fields that are
        given.
        """
        held: dict[str, Any] = {
            "X_WG": None,
            "v_WG_W": _ZERO,
            "w_WG_W": _ZERO,
            "q": self._q,
            "qd": np.zeros_like(self._q),
            "set_force": 0.0,
        }

        held |= set_points
        return Reference(
            time=time,
            state=WorkState.WORK,
            X_WB=self._X_WB,
            v_WB_W=_ZERO,
            force_control=held["set_force"] > 0.0,
            tare=False,
            scan=False,
            path_s=0.0,
            **held,
        )


class JointVelocities(Controlled):
    """Joint velocities (n,) as shares of `fastest`; station keeping holds the hull."""

    def __init__(self, believed: OwnVehicle, *, fastest: float = 0.5) -> None:
        """Take the vehicle, and the speed [rad/s] that corresponds to a full action."""
        super().__init__(believed)
        self.names = believed.vehicle.joint_names
        self._limits = believed.vehicle.q_limits
        self._fastest = fastest
        self._begin = 0.0
        self._qd = np.zeros(len(self.names))

    def start(self, truth: Truth) -> None:
        """Hold hull and arm at their present poses."""
        super().start(truth)
        self._qd, self._begin = np.zeros_like(truth.q), truth.time

    def take(self, action: Array, period: float) -> None:
        """Take velocities; a joint stops at its limits."""
        assert self.estimate is not None
        self._q, self._begin = self._joints_at(self.estimate.time), self.estimate.time
        ahead = np.clip(
            self._q + period * self._fastest * action, self._limits[:, 0], self._limits[:, 1]
        )
        self._qd = (ahead - self._q) / period

    def action_to(self, q: Array, within: float) -> Array:
        """Action (n,) that moves the joints to angles (n,) [rad] within `within` [s], clipped to
        the bounds.
        """
        q_now = self._q if self.estimate is None else self._joints_at(self.estimate.time)
        return np.clip((q - q_now) / within / self._fastest, -1.0, 1.0)

    def _joints_at(self, time: float) -> Array:
        return self._q + (time - self._begin) * self._qd

    def reference(self, time: float) -> Reference:
        """Set points with joint angles that move at the velocities."""
        del time
        return self._reference(self._begin, q=self._q, qd=self._qd)

    def drive(self, truth: Truth) -> ActionDrive:
        """The same as a kernel."""
        return self._controlled(truth)


class ToolTwist(Controlled):
    """Action of velocity (3,) and angular velocity (3,), as shares of limits in tool axes, and of
    force and compliance.

    The seventh number is the set force as a share of `largest` [N]; the force is not controlled if
    it is 0 or negative. If the eighth number is above 0, the tool is compliant across its axis.
    Station keeping holds the hull. The tool's set point stays within `LEASH` of the tool.
    """

    LEASH = 0.15  # [m]
    SPEED, TURN = 0.05, 0.3  # [m/s], [rad/s] velocities that correspond to full actions

    def __init__(self, believed: OwnVehicle, *, largest: float = 100.0) -> None:
        """Take the vehicle, and the force [N] that corresponds to a full action."""
        super().__init__(believed)
        self.names = (
            *(f"v_{axis}" for axis in "xyz"),
            *(f"w_{axis}" for axis in "xyz"),
            "force",
            "compliance",
        )

        self.largest = largest
        self._set_force = 0.0
        self._compliant = False
        self._X_WG = np.eye(4)
        self._v_WG_W = np.zeros(3)
        self._w_WG_W = np.zeros(3)
        self._begin = 0.0

    def start(self, truth: Truth) -> None:
        """Hold hull and tool at their present poses."""
        super().start(truth)
        self._X_WG, self._begin = tool_pose(truth), truth.time
        self._v_WG_W, self._w_WG_W, self._set_force, self._compliant = (
            np.zeros(3),
            np.zeros(3),
            0.0,
            False,
        )

    def take(self, action: Array, period: float) -> None:
        """Take a twist and a force."""
        assert self.estimate is not None

        # The new twist begins at the present set point of the tool.
        self._X_WG = self.tool_at(self.estimate.time)
        self._begin = self.estimate.time
        R_WG = self._X_WG[:3, :3]
        self._v_WG_W, self._w_WG_W = self.SPEED * R_WG @ action[:3], self.TURN * R_WG @ action[3:6]

        self._set_force, self._compliant = (
            max(0.0, self.largest * float(action[6])),
            bool(action[7] > 0.0),
        )

    def tool_at(self, time: float) -> Array:
        """Set point X_WG (4, 4) of the tool at `time` [s]."""
        return extrapolated(self._X_WG, self._v_WG_W, self._w_WG_W, time - self._begin, 0.0, _ZERO)

    def command(self, truth: Truth) -> Command:
        """Command of the controller, with a set point that is kept near the tool."""
        keep_near(self._X_WG, self._v_WG_W, truth.time - self._begin, truth.p_WG, self.LEASH)
        return super().command(truth)

    def reference(self, time: float) -> Reference:
        """Set points with the tool moving at its twist."""
        del time
        return self._reference(
            self._begin,
            X_WG=self._X_WG.copy(),
            v_WG_W=self._v_WG_W,
            w_WG_W=self._w_WG_W,
            set_force=self._set_force,
            compliant=self._compliant,
        )

    def drive(self, truth: Truth) -> ActionDrive:
        """The same as a kernel."""
        drive = self._controlled(truth)
        finish = drive.done

        def done(answer: int) -> Command:
            self._X_WG[:] = drive.reference.X_WG  # the limit of distance has moved the set point
            return finish(answer)

        return replace(drive, leash=self.LEASH, done=done)

    def action_to(self, X_WG: Array, force: float, compliant: bool, period: float) -> Array:
        """The action (8,) that moves the set point to a pose (4, 4) in `period` [s], clipped to the
        bounds.

        Args:
            X_WG: (4, 4) tool pose at the end.
            force: [N] Set force; 0: the force is not controlled.
            compliant: Whether the tool yields across its axis.
            period: [s] Duration of the action.
        """
        assert self.estimate is not None

        X_WG_now = self.tool_at(self.estimate.time)
        R_GW = X_WG_now[:3, :3].T
        v = R_GW @ (X_WG[:3, 3] - X_WG_now[:3, 3]) / period / self.SPEED
        w = log_so3(R_GW @ X_WG[:3, :3]) / period / self.TURN

        return np.clip(
            np.concatenate([v, w, [force / self.largest, 1.0 if compliant else 0.0]]), -1.0, 1.0
        )


class ToolAndJaws(ToolTwist):
    """Action of `ToolTwist`, and of driven jaws: their opening and the force of their motor.

    The ninth number is the set opening, from shut at -1 to wide open at 1; the tenth the largest
    force of the motor, from 0 at -1 to its most at 1.
    """

    CLOSING = 0.012  # [m/s] of the opening, while the jaws close
    OPENING = 0.05  # [m/s] while they open

    def __init__(self, believed: OwnVehicle, *, largest: float = 100.0) -> None:
        """Same as `ToolTwist`.

        Raises:
            ConfigurationError: The vehicle has no arm, or no gripper.
        """
        super().__init__(believed, largest=largest)
        self.names = (*self.names, "opening", "grip")
        self.shape = JawShape.of(believed.model)
        self.jaws: JawSetpoint | None = None
        self._opening = np.zeros(1)  # [m] true, a view

    def start(self, truth: Truth) -> None:
        """Hold hull, tool and jaws."""
        super().start(truth)
        self.jaws = None
        self._opening = truth.jaws.opening

    def take(self, action: Array, period: float) -> None:
        """Take a twist, a force, and a set point of the jaws."""
        super().take(action[:8], period)
        opening = 0.5 * (1.0 + float(action[8])) * self.shape.opening
        closes = opening < float(self._opening[0])
        self.jaws = JawSetpoint(
            opening=opening,
            speed=self.CLOSING if closes else self.OPENING,
            force=0.5 * (1.0 + float(action[9])) * self.shape.force,
        )

    def jaws_to(self, setpoint: JawSetpoint | None) -> Array:
        """The last two numbers (2,) of an action for a set point; without one, wide open."""
        opening = self.shape.opening if setpoint is None else setpoint.opening
        force = self.shape.force if setpoint is None else setpoint.force
        shares = np.array([opening / self.shape.opening, force / self.shape.force])
        return np.clip(2.0 * shares - 1.0, -1.0, 1.0)

    def drive(self, truth: Truth) -> ActionDrive:
        """The same as a kernel."""
        return super().drive(truth)
