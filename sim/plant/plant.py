"""The plant: one vehicle in one MjModel, advanced at the loop's rate, and its ground truth."""

import copy
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from uuv.models.hydrodynamics import LAYOUT, world_row
from uuv.models.naming import HOME_KEY, USUAL_NAMES, PartNames
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, PhysicsWarning
from uuv.sim.interfaces.kernels.slots import RAISED, PythonSlots, Slot, empty_slot
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, checked_pose, fitting, quat_wxyz_from_rotation
from uuv.sim.native.passive_callback import WET_MARK
from uuv.sim.plant.compiled_step import PlantRecord, Watch, next_flow, verdict
from uuv.sim.plant.driven_water import DrivenWater, WithWater, check_current
from uuv.sim.plant.jaw_drive import JawDrive
from uuv.sim.plant.reaction_wrench import ReactionWrench
from uuv.sim.plant.readout import CONTACTS, Readout, colliding_geoms, gears_and_contacts, places_of
from uuv.sim.plant.soil_contact import SoilContact, feel_soil
from uuv.sim.plant.supply import Supply, feed, fill_up
from uuv.sim.plant.thrusters import Drive, command_thrusters, read_thrusters
from uuv.sim.plant.truth import Truth, spacing
from uuv.sim.water.current import Current


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantHooks:
    """Functions of a plant's wrappers that are called at every compiled step."""

    placed: tuple[Callable[[], None], ...] = ()  # place bodies, before `observe`
    # change `Plant.commanded`, before the commands are applied
    commanded: tuple[Callable[[], None], ...] = ()


NO_HOOKS = PlantHooks()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantState:
    """Everything that changes in a plant."""

    data: mujoco.MjData  # a copy
    arrays: tuple[Array, ...]  # arrays of `Plant._changing`
    tick: int
    current: dict[str, Any]


class Plant(WithWater):
    """Vehicle and its world, advanced by commands one `timestep` [s] at a time, in `substeps`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        current: Current,
        X_WB: Array | None = None,
        reaction_ticks: int = 0,
        substeps: int = 1,
        data: mujoco.MjData | None = None,
        names: PartNames = USUAL_NAMES,
    ) -> None:
        """Set up the plant and install the process's callbacks.

        Args:
            model: Model compiled by `uuv.sim.hydrodynamics.compile`.
            current: Current of the water.
            X_WB: Initial hull pose (4, 4); default: the model's.
            reaction_ticks: Measure the wrench of the arm on the hull (`reaction_wrench`) every so
                many steps; 0: never.
            substeps: Physics steps per `timestep`, under one command; stiff contact needs several.
            data: State of `model` that another simulation owns and steps: it calls `begin` and
                `finish` around its own step. None: the plant has its own.
            names: What the vehicle's parts are called in `model`.

        Raises:
            ConfigurationError: An argument is invalid, or the model has no vehicle
                (`uuv.models.vehicle`).
            HydrodynamicsError: `uuv.sim.hydrodynamics.check` refuses the model, its contact weights
                are those of the dry mass, or the wrench cannot be measured.

        Warns:
            PhysicsWarning: The vehicle has no hydrodynamic coefficients, and the model does not use
                MuJoCo's fluid model.
        """
        _check(model, substeps)
        _make_ready(model)
        self.model = model
        self.vehicle = vehicle = Vehicle.of(model, names)
        self.data = mujoco.MjData(model) if data is None else data
        self.substeps = substeps
        self.timestep = substeps * float(model.opt.timestep)
        # [s] a smaller advance of the time means a reset
        least_gain = self.timestep - 0.5 * float(model.opt.timestep)

        # Current, and the marks by which a failed simulation is detected. A model without
        # coefficients has no row for them, and needs none.
        wet = hydrodynamics.carries_hydrodynamics(model)
        if not wet:
            _warn_of_a_fall(model, vehicle)
        water = world_row(model) if wet else np.zeros(LAYOUT.size)
        self._watch = _watch_of(model, self.data, water, least_gain)

        # Thrusters, tool and soil.
        thrusters = vehicle.thruster_actuators, vehicle.thruster_table
        self._drive = Drive.of(model, self.data, thrusters)
        self.supply = Supply.of(model, self.data, thrusters, self.timestep)
        self._pad_geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, names.tool)
        face = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, names.tool_face)
        if face < 0:
            face = vehicle.tip
        self._contacts = np.zeros(CONTACTS)
        self._joint_ctrl = _block(vehicle.actuators)

        # Measurements every `reaction_ticks` steps, and functions called in Python at every step.
        measured = reaction_ticks > 0 and vehicle.joints.size > 0
        self._reaction = (
            ReactionWrench(model, vehicle.arm_base, frame=vehicle.hull) if measured else None
        )
        self._reaction_ticks, self.hooks = reaction_ticks, PythonSlots()  # these of `record`
        self._soil = SoilContact.of(model, self.data)
        self.jaws = JawDrive.of(model, self.data, self.timestep, names.gripper)
        self.truth = truth = Truth.of(self.data, vehicle, self._drive, self._contacts, face, names)
        self._start = X_WB
        self._water = DrivenWater(model, self.data, truth.current_W)
        self._readout = Readout(
            places=places_of(self.data, model, self._pad_geom),
            gears=_rows_of_friction(model, vehicle),
            own_geom=colliding_geoms(model, vehicle.hull, names.tool),
            added=self._soil.force,
            tau_friction=truth.tau_friction,
            contacts=self._contacts,
            collided=truth.collided,
        )

        # State outside `data`: in the model, in the truth, and in the records of the kernels.
        self._changing = (
            *(model.opt.wind, water, self._drive.speed, self._drive.thrust, self._contacts),
            *(self._soil.force, truth.tau_friction, truth.current_W, truth.arm_wrench_B),
            truth.collided,
            *(self._watch.time, self._watch.observed, self._drive.saturated, self.supply.state),
            self.jaws.memory,
        )
        if data is None:
            self.reset(current=current, X_WB=X_WB)
        else:
            check_current(current, self.timestep)
            self.start(current)

    def reset(self, *, current: Current, X_WB: Array | None = None) -> None:
        """Restart at time 0 and at rest, arm at home, like a new plant. Call `observe` next.

        Args:
            current: Current of the water.
            X_WB: Initial hull pose (4, 4); default: the initial pose of the plant.

        Raises:
            ConfigurationError: `current` is not a Current or has another timestep, or `X_WB` is not
                a pose.
        """
        check_current(current, self.timestep)
        X_WB = self._start if X_WB is None else X_WB
        if X_WB is not None:
            X_WB = checked_pose(X_WB, "X_WB")

        data = self.data
        key = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_KEY, HOME_KEY)
        if key >= 0:
            mujoco.mj_resetDataKeyframe(self.model, data, key)
        else:
            mujoco.mj_resetData(self.model, data)

        if X_WB is not None:
            address = self.vehicle.hull_qpos
            data.qpos[address : address + 3] = X_WB[:3, 3]
            data.qpos[address + 3 : address + 7] = quat_wxyz_from_rotation(X_WB[:3, :3])

        self.start(current)

    def start(self, current: Current) -> None:
        """Begin at the present state of `data`, with propellers at rest.

        Args:
            current: Current of the water.
        """
        data, truth = self.data, self.truth
        self._flow = self._water.start(current)
        self._watch.tick[0], self._watch.failed[0] = 0, False

        # In calls from Python, records are passed to kernels as plain tuples, since numba needs
        # more time to find the type of a NamedTuple.
        records = self._drive, self._readout, self._flow, self._soil, self.supply
        self._as_tuples = tuple(tuple(record) for record in records)

        self._drive.stop()
        self.supply.start()
        self.jaws.start()
        self._soil.reset()
        self._blow()  # overwrite the flow of the last step

        self._watch.time[0] = data.time
        self._watch.observed[0] = False

        truth.arm_wrench_B[:] = np.nan
        # none yet, although `data` may still have constraints
        truth.tau_friction[:] = self._contacts[:] = 0.0
        truth.collided[:] = -1.0

        self.publish()

    def save(self) -> PlantState:
        """Everything that changes, not copied except for `data`: copy it before the next step."""
        return PlantState(
            data=copy.copy(self.data),
            arrays=self._changing,
            tick=self.tick,
            current=self._water.current.save(),
        )

    def resume(self, saved: PlantState, _command: Command | None = None) -> None:
        """Continue from a result of `save` of a plant with an equal model."""
        mujoco.mj_copyData(self.data, self.model, saved.data)
        for array, saved_array in zip(self._changing, saved.arrays, strict=True):
            array[...] = saved_array
        self._watch.tick[0] = saved.tick

        self._water.current.resume(saved.current, steps=saved.tick + 1)
        self.publish()

    def observe(self, *, again: bool = False) -> Truth:
        """Update the kinematics to the current time and return the truth; `again` repeats it.

        Warns as `uuv.sim.hydrodynamics.check_motion` does.

        Raises:
            HydrodynamicsError: The simulation diverged, or the water no longer acts because the
                callback was replaced.
        """
        mujoco.mj_step1(self.model, self.data)
        time = float(self.data.time)

        watch, truth = self._watch, self.truth
        warned = watch.seen[0] != watch.told[0]
        before = truth.time - self.timestep if again else truth.time

        if watch.failed[0] or verdict.py_func(
            time, before, watch.least_gain, warned, watch.mark[0]
        ):
            self.check()

        truth.time = watch.time[0] = time
        watch.observed[0] = True
        return truth

    def check(self) -> None:
        """Warn or raise an error like `observe`, after `compiled_step.observe` has requested it."""
        if self._watch.failed[0]:
            self._watch.failed[0] = False
            self.hooks.check(RAISED)

        hydrodynamics.check_motion(self.model, self.data)
        self._water.check_reset()
        if self._watch.mark[0] != WET_MARK:
            hydrodynamics.check_wet(self.model, self.data)

    def step(self, command: Command) -> None:
        """Apply the command for one `timestep`; call `observe` before each step.

        Raises:
            ConfigurationError: `observe` was not called, or a command has the wrong shape or is not
                finite.
        """
        if not self._watch.observed[0]:
            raise ConfigurationError(
                "plant: observe() must be called before each step(), which integrates its forces"
            )

        self.begin(command)
        model, data, truth, last = self.model, self.data, self.truth, self.substeps - 1
        _, readout, _, soil, _ = self._as_tuples

        for substep in range(last):
            feel_soil(soil)
            mujoco.mj_step2(model, data)
            gears_and_contacts(readout, substep, last + 1)
            mujoco.mj_step1(model, data)

        feel_soil(soil)

        if self._reaction is not None and self.tick % self._reaction_ticks == 0:
            before = data.qvel.copy()
            mujoco.mj_step2(model, data)
            truth.arm_wrench_B[:] = self._reaction.wrench(data, before, self._soil.force[1:])
        else:
            mujoco.mj_step2(model, data)

        self.finish()

    def begin(self, command: Command) -> None:
        """Apply the command to MuJoCo's controls: the part of a step before the integration.

        Raises:
            ConfigurationError: A command has the wrong shape or is not finite.
        """
        truth = self.truth
        joint_torque = fitting(
            command.joint_torque, self.vehicle.actuators.shape, "joint torque command [N m]"
        )
        thrusters = fitting(command.thrusters, truth.propeller_speed.shape, "thruster command")

        self._drive.commanded[:] = thrusters if feed(self._as_tuples[4]) else 0.0
        truth.saturated = command_thrusters(self._as_tuples[0])
        self.data.ctrl[self._joint_ctrl] = joint_torque
        self.jaws.act()

    def finish(self) -> None:
        """Read contacts, set the next current: the part of a step after the integration."""
        drive, readout, flow, _, _ = self._as_tuples
        last = self.substeps - 1

        self._watch.observed[0] = False
        self._watch.tick[0] += 1

        self._water.check()
        read_thrusters(drive)
        gears_and_contacts(readout, last, last + 1)

        if self._water.current.beyond_rows():
            self._blow()
        else:
            self._water.current.ready()
            next_flow(flow)

        self._contact()

    def spans(self) -> str:
        """Reason why `compiled_step` cannot advance this plant; empty if it can."""
        if spacing(self.vehicle.dof) > 1:
            return "other joints lie between the joints of the arm"
        return ""

    def ready(self) -> int:
        """Number of compiled steps possible before the next call; generates gusts ahead."""
        self._water.check()
        steps = self._water.current.ready()
        return steps if self._reaction is None else min(steps, -self.tick % self._reaction_ticks)

    def record(self, hooks: PlantHooks = NO_HOOKS) -> PlantRecord:
        """Arrays for the functions of `compiled_step`, valid until the next `reset`.

        Args:
            hooks: Functions of the wrappers of this plant, called at every step.
        """
        beyond = (self._blow,) if self._water.current.beyond_rows() else ()
        driven = (lambda: self.jaws.act(),) if self.jaws.motor >= 0 else ()

        return PlantRecord(
            drive=self._drive,
            supply=self.supply,
            readout=self._readout,
            flow=self._flow,
            watch=self._watch,
            soil=self._soil,
            joints=self.vehicle.actuators,
            substeps=self.substeps,
            placed=self._hooked(hooks.placed),
            commanded=self._hooked((*hooks.commanded, *driven)),
            flowed=self._hooked(beyond),
        )

    def _hooked(self, functions: tuple[Callable[[], None], ...]) -> Slot:
        """Slot that calls functions one after another; empty if there are none."""
        if not functions:
            return empty_slot()

        def all_of_them() -> None:
            for function in functions:
                function()

        return empty_slot()._replace(address=self.hooks.add(all_of_them))

    @property
    def tick(self) -> int:
        """Steps taken since the start."""
        return int(self._watch.tick[0])

    @property
    def commanded(self) -> Array:
        """Thruster commands (m,) of the present step, not copied: a hook may still change them."""
        return self._drive.commanded

    @property
    def time(self) -> float:
        """Time [s] of the last `observe`, also between compiled steps."""
        return float(self._watch.time[0])

    def publish(self) -> None:
        """Update the numbers of `truth` after compiled steps; its arrays are views."""
        self.truth.time = float(self._watch.time[0])
        self.truth.saturated = bool(self._drive.saturated[0])
        self._contact()

    def _contact(self) -> None:
        """Write the contacts of the finished step into the truth."""
        truth = self.truth
        truth.contact_normal, _, _, _, collision, truth.contact_least, truth.contact_most = (
            self._contacts.tolist()
        )
        truth.collision = bool(collision)

    def _blow(self) -> None:
        """Write the current of the next step, before `observe` computes its forces."""
        at = self.vehicle.hull_qpos
        # The joint is already at the start of the next step, the body still at the start of the
        # last one.
        self._water.write(self.data.qpos[at : at + 3], self.tick * self.timestep)


def parts_in_python(plant: Any) -> tuple[str, ...]:
    """Components in plain Python that a plant calls at every compiled step: wrappers and current.

    Args:
        plant: A `Plant`, or a wrapper of one.
    """
    names: list[str] = []
    while not isinstance(plant, Plant):
        names.append(type(plant).__name__)
        plant = plant.plant

    current = plant.current
    if current.beyond_rows():
        names.append(type(current.flows[0] if current.flows else current).__name__)
    return tuple(names)


def _check(model: mujoco.MjModel, substeps: int) -> None:
    """Refuse a model or a number of substeps that the plant cannot advance."""
    if not isinstance(model, mujoco.MjModel):
        raise ConfigurationError(f"plant: expected a compiled mujoco.MjModel, got {model!r}")
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise ConfigurationError(
            "the integrator must be Euler, implicit or implicitfast, got RK4, which cannot split "
            "a step in two"
        )
    if not isinstance(substeps, int) or substeps < 1:
        raise ConfigurationError(f"plant: substeps must be a whole number >= 1, got {substeps!r}")


def _warn_of_a_fall(model: mujoco.MjModel, vehicle: Vehicle) -> None:
    """Warn of a free hull without coefficients, unless MuJoCo's own fluid model carries it."""
    if vehicle.hull_dof >= 0 and not model.opt.density and np.any(model.opt.gravity):
        warnings.warn(
            "the vehicle has no hydrodynamic coefficients: it falls as in a vacuum",
            PhysicsWarning,
            3,
        )


def _make_ready(model: mujoco.MjModel) -> None:
    """Install the callbacks, check the model's hydrodynamics, and charge its battery."""
    hydrodynamics.install()
    hydrodynamics.check(model)
    hydrodynamics.check_constants(model)
    fill_up(model)


def _watch_of(model: mujoco.MjModel, data: mujoco.MjData, water: Array, least_gain: float) -> Watch:
    """Marks of one simulation. `water` is the world's row, `least_gain` [s] the one of `Watch`."""
    return Watch(
        time=np.zeros(1),
        observed=np.zeros(1, dtype=np.bool_),
        seen=water[LAYOUT.seen :][:1],
        told=water[LAYOUT.told :][:1],
        mark=data.crb[0, :1] if hydrodynamics.leaves_mark(model) else np.array([WET_MARK]),
        tick=np.zeros(1, dtype=np.int64),
        failed=np.zeros(1, dtype=np.bool_),
        least_gain=least_gain,
    )


def _rows_of_friction(model: mujoco.MjModel, vehicle: Vehicle) -> np.ndarray:
    """Row (n,) of each joint's gear among the friction constraints, or -1; empty without
    friction.
    """
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS:
        return np.zeros(0, dtype=np.int64)

    dry = np.asarray(model.dof_frictionloss) > 0.0
    rows = np.where(dry, np.cumsum(dry) - 1, -1)[vehicle.dof]
    return rows if np.any(rows >= 0) else np.zeros(0, dtype=np.int64)


def _block(addresses: np.ndarray) -> slice | np.ndarray:
    """Addresses as a slice if they are consecutive, since a slice is faster to write through."""
    if len(addresses) and np.array_equal(
        addresses, np.arange(addresses[0], addresses[0] + len(addresses))
    ):
        return slice(int(addresses[0]), int(addresses[0]) + len(addresses))
    return addresses
