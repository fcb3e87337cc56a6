"""Exact hydrodynamics in MuJoCo: added mass in the joint-space inertia, for every solver,
integrator and contact.

Each body obeys Kirchhoff's equations in a current [Lamb 1932, ch. VI]. With its twist nu = (v; w)
and relative twist nu_r = nu - (R^T v_c; 0), both in body axes, the momentum of the water p = A nu_r
and the acceleration nudot, the water's wrench on the body is

    f = -A (nudot - (R^T vdot_c - w x R^T v_c; 0)) - (w x p_l; w x p_a + v_r x p_l)
        - D_l nu_r - D_q |nu_r| nu_r
        + rho V R^T (vdot_c - g) at the centre of buoyancy.

The part -A nudot is linear in `qacc`, so it goes into the joint-space inertia: sum_b J_b^T A_b J_b
is added to `d.M`, which has exactly this sparsity pattern. The other terms go to `d.qfrc_passive`.
No acceleration is taken from an earlier step, so any added mass is stable.

The current is read from the simulation's `data.userdata` (`set_current`, `current`) or, without one
there, from the model: `model.opt.wind` (3,) [m/s] in world axes, with the acceleration and shear in
`model.body_user[0]` (`uuv.models.hydrodynamics.set_current`). In a flow that varies in space, the
acceleration of the water is vdot_c + (v_c . grad) v_c, evaluated at the body origin [Auton 1988].

Limits of MuJoCo:

- Its force and torque sensors do not see `qfrc_passive`; `compile` warns of them.
- `mj_setConst` replaces the contact weights by those of the dry mass; then call `set_constants`.
- The integrator "implicit" takes velocity terms of bodies implicitly, those of water explicitly.

The callbacks belong to the process. Unpickling a model installs them, and so does
`MjModel.from_...` after this module was imported, but not `MjSpec.compile`. MuJoCo alone refuses
our MJCF and names this module (`uuv.models.water.native_mark`), but simulates an MJB without water.
"""

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from uuv.models.arms import gear_friction
from uuv.models.hydrodynamics import (
    ELEMENTS,
    INDEFINITE,
    LAYOUT,
    NO_CURRENT,
    TOO_FAST,
    TOO_HIGH,
    BodyHydrodynamics,
    attach,
    carries,
    is_wet,
    unpack,
    water_density,
    world_row,
)
from uuv.models.water.bounds import LARGEST
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, PhysicsWarning
from uuv.sim.interfaces.spatial import Array, shown, skew
from uuv.sim.native import arriving_models as arriving_models  # imported for its side effects
from uuv.sim.native import passive_callback, process_callbacks
from uuv.sim.water import energy
from uuv.sim.water.water_motion import FLOW, WaterMotion, current, set_current, take_last
from uuv.sim.water.wet_inertia import BlockSums, WetInertia

__all__ = ["WaterMotion", "current", "set_current"]  # imported from `water_motion`

DRAG_SPEED = 2.0  # [m/s, rad/s] speed at which the drag rate is compared with the time step

LARGEST_START = 100.0  # [m/s, rad/s] largest speed that buoyancy may cause from rest in one step

_DRY_WEIGHTS = (
    "has the contact weights of its dry mass: compile it by uuv.sim.hydrodynamics.compile(), "
    "or call uuv.sim.hydrodynamics.set_constants() after mj_setConst"
)

# [kg/m^3] plausible densities of a body; outside them mass or volume is likely wrong
DENSITIES = 30.0, 20_000.0

# Angular over linear coefficient is a length squared (quadratic drag: cubed), near the dry body's
# radius of gyration. Per coefficient: power of that length, and largest plausible ratio to it. The
# vehicles here reach 2, 27 (REMUS 100) and 30.
_LEVERS = {"added_mass": (2, 10.0), "linear_damping": (2, 40.0), "quadratic_damping": (3, 100.0)}


def install() -> None:
    """Install the callbacks of the hydrodynamics in this process. Idempotent. The first call ever
    takes about 10 s.

    If other code replaces a callback later, a RuntimeWarning says that models move without water.

    Raises:
        HydrodynamicsError: MuJoCo's memory layout differs from its introspection data, or other
            code has set one of these callbacks.
    """
    process_callbacks.install()


def uninstall() -> None:
    """Remove our callbacks; callbacks of other code stay."""
    process_callbacks.uninstall()


def is_installed() -> bool:
    """Return True if the callbacks of this process are those of the hydrodynamics."""
    return process_callbacks.is_installed()


def check_installed(model: mujoco.MjModel) -> bool:
    """Return True if water and gear forces of `model` act correctly; otherwise warn, return False.

    The RuntimeWarning has one line and one of these causes: a callback that the model needs is not
    installed, `check` refuses its options, or its contact weights are those of the dry mass (it was
    compiled without `compile`, or reset by `mj_setConst`).
    """
    if process_callbacks.needed_by(model) and not is_installed():
        problem = f"this model carries {process_callbacks.left_out(model)}"
    elif not _carriers(model):
        return True
    elif settings := _refused(model):
        problem = f"this model carries hydrodynamics but cannot be run with {'; '.join(settings)}"
    elif _has_dry_weights(model):
        problem = f"this model carries hydrodynamics but {_DRY_WEIGHTS}"
    else:
        return True
    warnings.warn(problem, RuntimeWarning, 2)
    return False


def check_constants(model: mujoco.MjModel) -> None:
    """Raise HydrodynamicsError if `model` has hydrodynamic coefficients but contact weights of its
    dry mass.
    """
    if _carriers(model) and _has_dry_weights(model):
        raise HydrodynamicsError(f"this model carries hydrodynamics but {_DRY_WEIGHTS}")


def check_motion(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise an error if the simulation diverged, and warn once of speeds or heights beyond the
    model's validity.

    MuJoCo resets a diverged simulation and reports that only in a log file and in `data.warning`. A
    PhysicsWarning is given once for drag that changes faster than the step can follow, and once for
    buoyant bodies above the water.

    Args:
        model: Model of `data`.
        data: State after a step.

    Raises:
        HydrodynamicsError: MuJoCo met numbers that are not finite or too large, or the inertia with
            the added mass was not positive definite, and the message names the entry and the body;
            or `data.userdata` holds no valid current.
    """
    kinds = mujoco.mjtWarning
    water = model.body_user[0] if carries(model.body_user[0]) else np.zeros(LAYOUT.size)
    marks, reported = int(water[LAYOUT.seen]), int(water[LAYOUT.told])
    water[LAYOUT.told] = marks
    new, singular = marks & ~reported, data.warning[kinds.mjWARN_INERTIA]

    # An inertia that is not positive definite, or a stored current that is missing.
    if singular.number or new & INDEFINITE:
        at = (
            f" (body {model.body(model.dof_bodyid[singular.lastinfo]).name!r})"
            if singular.number
            else ""
        )
        raise HydrodynamicsError(
            f"the inertia with the added mass was not positive definite near t = {data.time:g} "
            f"s{at}; call uuv.sim.hydrodynamics.set_constants() after changing coefficients: it "
            "checks them"
        )
    if new & NO_CURRENT:
        first = int(water[LAYOUT.flow]) - 1
        raise HydrodynamicsError(
            f"data.userdata has no current from index {first} on; use set_current()"
        )

    # Values that MuJoCo itself found to be invalid, after which it has reset the simulation.
    for kind, array_name in (
        (kinds.mjWARN_BADQPOS, "qpos"),
        (kinds.mjWARN_BADQVEL, "qvel"),
        (kinds.mjWARN_BADQACC, "qacc"),
    ):
        if data.warning[kind].number:
            index = int(data.warning[kind].lastinfo)
            if array_name == "qpos":  # a free joint has seven qpos for six degrees of freedom
                joint = int(np.searchsorted(model.jnt_qposadr, index, side="right")) - 1
                body = int(model.jnt_bodyid[joint])
            else:
                body = int(model.dof_bodyid[index])
            raise HydrodynamicsError(
                f"the simulation became unstable near t = {data.time:g} s: {array_name}[{index}] "
                f"(body {model.body(body).name!r}) was not "
                f"finite or too large; timestep {model.opt.timestep:g} s may be too long for drag "
                "or contact"
            )

    # Limits of validity. Exceeding one gives one warning.
    if new & TOO_FAST:
        limit = (1.0 / model.opt.timestep - water[LAYOUT.drag_rate]) / water[LAYOUT.drag_rate + 1]
        warnings.warn(
            f"a body moved through the water faster than {max(limit, 0.0):.3g} m/s or rad/s, up "
            f"to which a timestep of {model.opt.timestep:g} s can follow the drag: the motion may "
            "overshoot or blow up",
            PhysicsWarning,
            2,
        )
    if new & TOO_HIGH:
        warnings.warn(
            f"a body rose more than {water[LAYOUT.ceiling]:g} m above z = 0 and is still buoyant: "
            "no free surface",
            PhysicsWarning,
            2,
        )


def check_wet(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise an error if the last forward pass left out hydrodynamics or gear friction of `model`.

    Raises:
        HydrodynamicsError: The callback has been removed, replaced, or disabled by MuJoCo's flags.
    """
    if leaves_mark(model) and data.crb[0, 0] != passive_callback.WET_MARK:
        raise HydrodynamicsError(f"this model carries {process_callbacks.left_out(model)}")


def leaves_mark(model: mujoco.MjModel) -> bool:
    """True if the callback marks each forward pass: for water on movable bodies and for gears."""
    # MuJoCo's flag disables the gear friction.
    without_loss = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    return bool(_bodies(model)) or (gear_friction.has_curves(model) and not without_loss)


def doubts(model: mujoco.MjModel) -> list[str]:
    """List implausible properties of a wet model, one line each; empty for a model without
    coefficients.

    Bodies fixed to each other count as one, since one may have the coefficients of all.

    - Movable bodies with mass and shape but no coefficients, in one tree with bodies that have
      them.
    - A body whose mass over volume is outside DENSITIES.
    - Coefficients whose linear and angular parts look swapped. A body of about 1 m cannot show
      this.
    - Cross terms that add energy, more than the other damping of their body dissipates, at a motion
      found by sampling.
    - Force and torque sensors, which do not measure the water's forces.
    """
    return _doubts(model, _bodies(model))


def _doubts(model: mujoco.MjModel, wet: dict[int, BodyHydrodynamics]) -> list[str]:
    """Implementation of `doubts` for a model with the coefficients `wet`."""
    trees, fixed = model.body_treeid.tolist(), model.body_weldid.tolist()
    wet_trees = {trees[i] for i in wet}
    names = [model.body(i).name or f"body {i}" for i in range(model.nbody)]

    # Mass and volume of bodies that are fixed to each other, by the topmost of them.
    masses = np.bincount(fixed, weights=model.body_mass).tolist()
    volumes: dict[int, float] = {}
    for i, body in wet.items():
        volumes[fixed[i]] = volumes.get(fixed[i], 0.0) + body.volume

    shaped = (model.body_mass > 0.0) & (model.body_geomnum > 0)
    dry = [
        names[i]
        for i in np.flatnonzero(shaped).tolist()
        if i and trees[i] in wet_trees and fixed[i] not in volumes
    ]
    doubts = [f"movable bodies without water: {', '.join(dry)}"] if dry else []

    # Density, levers and cross terms of each body.
    for i, body in wet.items():
        mass = float(model.body_mass[i])
        together, volume = masses[fixed[i]], volumes[fixed[i]]
        if body.volume > 0.0 and not DENSITIES[0] <= together / volume <= DENSITIES[1]:
            doubts.append(
                f"{names[i]}: {together:.4g} kg in {volume:.4g} m^3 make {together / volume:.3g} "
                f"kg/m^3, outside {DENSITIES[0]:g} to {DENSITIES[1]:g}; check volume [m^3]"
            )

        gyration = math.sqrt(_largest_inertia(model, i) / mass) if mass > 0.0 else math.inf  # [m]
        for name, (power, most) in _LEVERS.items():
            numbers = getattr(body, name)
            diagonal = np.diag(numbers) if numbers.ndim == 2 else numbers
            linear, angular = float(diagonal[:3].max()), float(diagonal[3:].max())
            lever = angular / linear if linear > 0.0 else 0.0
            if lever > most * gyration**power:
                doubts.append(
                    f"{names[i]}: angular over linear {name} is {lever:.3g} m^{power}, though the "
                    f"body's radius of gyration is {gyration:.3g} m; six-vectors are (linear; "
                    "angular)"
                )

        if fed := energy.largest_power(body):
            power, twist = fed[0], ", ".join(f"{x:.2g}" for x in fed[1])
            doubts.append(
                f"{names[i]}: at the twist ({twist}) m/s, rad/s relative to the water its cross "
                f"terms add {power:.3g} W more than its other damping dissipates: a motion may "
                "grow without bound"
            )

    # Sensors of force on a wet body, or on a body that supports it, measure the dry part alone.
    kinds = int(mujoco.mjtSensor.mjSENS_FORCE), int(mujoco.mjtSensor.mjSENS_TORQUE)
    holding = _with_ancestors(model, wet)
    blind = [
        model.sensor(k).name or f"sensor {k}"
        for k in range(model.nsensor)
        if model.sensor_type[k] in kinds
        and int(model.site_bodyid[model.sensor_objid[k]]) in holding
    ]
    if blind:
        doubts.append(
            f"force and torque sensors that do not see the water: {', '.join(blind)}; "
            "take the wrench on a wet body from uuv.sim.plant.reaction_wrench"
        )
    return doubts


def carries_hydrodynamics(model: mujoco.MjModel) -> bool:
    """Return True if any body of `model` has coefficients, whether or not `compile` compiled it."""
    return is_wet(model)


def compile(spec: mujoco.MjSpec) -> mujoco.MjModel:  # noqa: A001 (always called with its module's name)
    """Compile `spec`, recompute MuJoCo's derived constants for the wet inertia, and check the
    result.

    These are recomputed from M + A at qpos0: `body_invweight0`, `dof_invweight0`,
    `tendon_invweight0` (softness of contacts, limits and equalities), `dof_M0`, `actuator_acc0`,
    `stat.meaninertia`, and the damping of position actuators that is given by `dampratio`.

    A spec without coefficients is compiled as it is. If only bodies have hydrodynamic data (the
    spec came from MJCF, or was attached to this one), the world body's row is made from theirs. A
    model with water, gear friction, thrusters or soil installs the callbacks in the process. Each
    of its `doubts` gives a PhysicsWarning. The cost is linear in the number of kinematic trees.

    Raises:
        ConfigurationError: `spec` is no MjSpec, its bodies have different water densities, or it
            has custom elements with hydrodynamic data that was not attached.
        HydrodynamicsError: As `install` and `check` do.
    """
    if not isinstance(spec, mujoco.MjSpec):
        raise ConfigurationError(f"compile: expected a mujoco.MjSpec, got {spec!r}")
    users = spec.nuserdata
    if any(carries(body.userdata) for body in spec.bodies):
        install()
        attach(spec, {})
        spec.nuserdata += FLOW.size  # behind the user's entries; the spec keeps only these
    try:
        model = spec.compile()
    finally:
        spec.nuserdata = users
    take_last(model, users + FLOW.size)
    if process_callbacks.needed_by(model):
        install()
    _refuse_unread_elements(model)
    if not carries_hydrodynamics(model):
        return model
    bodies = _bodies(model)
    _set_constants(model, _checked(model, bodies), _damping_ratios(spec))
    for doubt in _doubts(model, bodies):
        warnings.warn(doubt, PhysicsWarning, 2)
    return model


def set_constants(model: mujoco.MjModel) -> None:
    """Recompute the constants of `compile` after `mj_setConst` or a change of mass or coefficients.

    This also works for a model that MuJoCo itself has loaded; the world body's row is then made.
    The damping of position actuators is left unchanged.

    Raises:
        HydrodynamicsError: As for `check`.
    """
    if carries_hydrodynamics(model):
        _set_constants(model, _checked(model, _bodies(model)), {})


def check(model: mujoco.MjModel) -> None:
    """Refuse settings under which the hydrodynamics would be wrong or unstable; the message gives
    name and number.

    Drag is integrated explicitly. Its rate, the largest eigenvalue of the slope of drag over M + A
    at qpos0, must therefore not exceed 1 / timestep. Call it again after changing `model.opt`.

    Raises:
        HydrodynamicsError: A setting is refused, or the callback is not installed.
        ConfigurationError: `BodyHydrodynamics` would refuse the row of a body, or the model has
            custom elements with hydrodynamic data that was not attached.
    """
    _refuse_unread_elements(model)
    if carries_hydrodynamics(model):
        _checked(model, _bodies(model))


def added_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Joint-space added mass sum_b J_b^T A_b J_b (nv, nv) at `data`, whose kinematics and comPos
    are up to date.
    """
    return BlockSums(model, data, _bodies(model)).dense(lambda body: body.added_mass)


def drag_slope(model: mujoco.MjModel, data: mujoco.MjData, speed: float) -> Array:
    """Derivative of drag with respect to joint velocity (nv, nv), symmetric, with every component
    of the body twists at `speed`.

    Args:
        model: Compiled model.
        data: State whose kinematics and comPos are up to date.
        speed: [m/s, rad/s], the same for all components.

    Returns:
        Joint-space damping matrix (nv, nv).
    """
    return BlockSums(model, data, _bodies(model)).dense(lambda body: _body_drag_slope(body, speed))


def _with_ancestors(model: mujoco.MjModel, bodies: Iterable[int]) -> set[int]:
    """`bodies` and all their parents, except the world."""
    parents, reached = model.body_parentid.tolist(), {0}
    for body in bodies:
        while body not in reached:
            reached.add(body)
            body = parents[body]
    return reached - {0}


def _largest_inertia(model: mujoco.MjModel, body: int) -> float:
    """Largest principal moment [kg m^2] of the dry body about its origin."""
    R, p = np.zeros(9), model.body_ipos[body]
    mujoco.mju_quat2Mat(R, model.body_iquat[body])
    R = R.reshape(3, 3)
    about_origin = R @ np.diag(model.body_inertia[body]) @ R.T - model.body_mass[body] * skew(
        p
    ) @ skew(p)
    return max(float(np.linalg.eigvalsh(about_origin)[-1]), 0.0)


def _body_drag_slope(body: BodyHydrodynamics, speed: float) -> Array:
    """Drag slope of one body with respect to its twist (6, 6), in body axes at its origin."""
    slope = 0.5 * (body.linear_damping + body.linear_damping.T) + np.diag(
        2.0 * speed * body.quadratic_damping
    )
    for strip in body.segments if speed > 0.0 else ():
        nodes, weights = _stations(strip.stations)
        length = float(np.linalg.norm(strip.end - strip.start))
        axis = (strip.end - strip.start) / length
        along = np.outer(axis, axis)
        local = 2.0 * speed * (strip.normal * (np.eye(3) - along) + strip.tangential * along)
        for node, weight in zip(nodes, weights, strict=True):
            p = strip.start + 0.5 * (1.0 + node) * (strip.end - strip.start)
            to_point = np.hstack([np.eye(3), -skew(p)])
            slope += 0.5 * weight * length * to_point.T @ local @ to_point
    for form in body.terms:
        slope += form.slope(speed)
    return slope


@cache
def _stations(number: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes (n,) on [-1, 1] and weights (n,)."""
    return np.polynomial.legendre.leggauss(number)


def _carriers(model: mujoco.MjModel) -> list[int]:
    """Indices of the bodies that have coefficients, movable or not."""
    return [i for i in range(1, model.nbody) if carries(model.body_user[i])]


def _has_dry_weights(model: mujoco.MjModel) -> bool:
    water = model.body_user[0]
    return not carries(water) or bool(water[LAYOUT.compiled] != model.dof_invweight0.sum())


def _refused(model: mujoco.MjModel) -> list[str]:
    """Names of the settings under which the hydrodynamics would be wrong."""
    option, disable, enable = model.opt, mujoco.mjtDisableBit, mujoco.mjtEnableBit
    water = (
        model.body_user[0, : LAYOUT.size] if carries(model.body_user[0]) else np.zeros(LAYOUT.size)
    )
    numbers = {
        "gravity": option.gravity,
        "wind (the current)": option.wind,
        "current acceleration": water[LAYOUT.current_acceleration :][:3],
        "current shear": water[LAYOUT.current_shear :][:3],
    }
    pgs = option.solver == mujoco.mjtSolver.mjSOL_PGS
    noslip = option.noslip_iterations
    density = option.density
    viscosity = option.viscosity
    sleep = option.enableflags & enable.mjENBL_SLEEP
    exact = option.enableflags & enable.mjENBL_DIAGEXACT
    uncalled = option.disableflags & disable.mjDSBL_SPRING
    uncalled = uncalled and option.disableflags & disable.mjDSBL_DAMPER
    step = option.timestep

    refused = {
        "solver PGS (it whitens the dry inertia); use Newton or CG": pgs,
        f"noslip_iterations {noslip} (it uses the dry inertia); use 0": noslip > 0,
        f"density {density} (MuJoCo's own fluid would act too); use 0": density > 0.0,
        f"viscosity {viscosity} (MuJoCo's own fluid would act too); use 0": viscosity > 0.0,
        "flag sleep (a sleeping tree keeps an old inertia)": sleep,
        "flag diagexact (it is computed from the dry inertia)": exact,
        "flags spring and damper both disabled (MuJoCo then calls no passive callback)": uncalled,
        f"timestep {step:g} s; it must be positive": not 0.0 < step < np.inf,
    }
    out_of_range = [
        f"{name} {array.tolist()}; it must be finite and below {LARGEST:g}"
        for name, array in numbers.items()
        if not np.all(np.abs(array) <= LARGEST)
    ]
    return [name for name, present in refused.items() if present] + out_of_range


def _bodies(model: mujoco.MjModel) -> dict[int, BodyHydrodynamics]:
    """Coefficients of the movable bodies, by body index."""
    return {
        i: unpack(model.body_user[i])
        for i in range(1, model.nbody)
        if model.body_treeid[i] >= 0 and carries(model.body_user[i])
    }


def _damping_ratios(spec: mujoco.MjSpec) -> dict[int, float]:
    """Damping ratio by actuator index, for actuators whose damping the compiler derives from the
    inertia.

    `spec` has been compiled, so its actuators have their indices.
    """
    return {
        actuator.id: actuator.biasprm[2]
        for actuator in spec.actuators
        if actuator.biasprm[2] > 0.0 and actuator.gainprm[0] == -actuator.biasprm[1]
    }


@dataclass(frozen=True, slots=True, eq=False)
class _AtRest:
    """Quantities that `check` computes for a model with degrees of freedom, at qpos0."""

    inertia: WetInertia
    drag_rate: float  # [1/s] at DRAG_SPEED


def _refuse_unread_elements(model: mujoco.MjModel) -> None:
    """Refuse a model that MuJoCo read from a file with hydrodynamic data in custom elements, since
    it would move without water.

    Raises:
        ConfigurationError: There is such an element.
    """
    for i in range(model.nnumeric):
        name = model.numeric(i).name
        if name.startswith(ELEMENTS):
            raise ConfigurationError(
                f"the custom element {shown(name)} holds water or thrusters that MuJoCo alone "
                "does not read; read the file by uuv.own_vehicle.vehicle_spec"
            )


def _checked(model: mujoco.MjModel, bodies: dict[int, BodyHydrodynamics]) -> _AtRest | None:
    """Implementation of `check` for a model with the coefficients `bodies`; None without degrees of
    freedom.
    """
    if not is_installed():
        raise HydrodynamicsError(f"this model carries {process_callbacks.left_out(model)}")
    if refused := _refused(model):
        raise HydrodynamicsError(f"hydrodynamics cannot be run with {'; '.join(refused)}")
    for i in bodies:
        if model.body_simple[i]:
            raise HydrodynamicsError(
                f"{model.body(i).name}: compiled as a simple body; attach() sets simple = 0"
            )

    if model.nv == 0:
        return None
    data = mujoco.MjData(model)
    # As MuJoCo does for its own constants: without contacts, since a heap of bodies has many of
    # them at qpos0.
    for stage in (
        mujoco.mj_kinematics,
        mujoco.mj_comPos,
        mujoco.mj_tendon,
        mujoco.mj_makeM,
        mujoco.mj_transmission,
    ):
        stage(model, data)
    sums = BlockSums(model, data, bodies)
    inertia = WetInertia(sums)

    rate = inertia.drag_rate(lambda body: _body_drag_slope(body, DRAG_SPEED))
    if not model.opt.timestep * rate <= 1.0:
        raise HydrodynamicsError(
            f"timestep {model.opt.timestep:g} s times the rate of the drag at {DRAG_SPEED:g} m/s, "
            f"{rate:.4g} 1/s, is {model.opt.timestep * rate:.4g}, more than 1; use at most "
            f"{1.0 / rate:.3g} s"
        )

    lift = water_density(model) * model.opt.gravity

    def buoyancy(i: int, body: BodyHydrodynamics) -> Array:
        force = -body.volume * (data.xmat[i].reshape(3, 3).T @ lift)
        return np.hstack([force, skew(body.center_of_buoyancy) @ force])

    start = float(np.max(np.abs(inertia.accelerations(np.arange(model.nv), sums.force(buoyancy)))))
    if not start * model.opt.timestep < LARGEST_START:
        raise HydrodynamicsError(
            f"buoyancy alone would bring this model to {start * model.opt.timestep:.3g} m/s or "
            f"rad/s in one step, more than {LARGEST_START:g}: mass and volume cannot belong "
            "together"
        )
    return _AtRest(inertia, rate)


def _set_constants(
    model: mujoco.MjModel, at_rest: _AtRest | None, damping_ratios: dict[int, float]
) -> None:
    """Computation of MuJoCo's engine_setconst.c, with M + A in place of M."""
    water = world_row(model)
    if at_rest is None:
        return
    inertia, data = at_rest.inertia, at_rest.inertia.sums.data

    # Contact weights: mean mobility of each body, and of each degree of freedom.
    for i in np.flatnonzero(model.body_weldid).tolist():
        mobility = inertia.of_body(i)
        model.body_invweight0[i] = mobility[:3].mean(), mobility[3:].mean()
    mobility = inertia.of_dofs()
    blocks = {int(mujoco.mjtJoint.mjJNT_FREE): [3, 3], int(mujoco.mjtJoint.mjJNT_BALL): [3]}
    for first, kind in zip(model.jnt_dofadr.tolist(), model.jnt_type.tolist(), strict=True):
        for block in blocks.get(kind, [1]):
            model.dof_invweight0[first : first + block] = mobility[first : first + block].mean()
            first += block
    model.dof_M0 = inertia.diagonal
    model.stat.meaninertia = inertia.diagonal.mean()

    # The world's row: stamp of these weights, ratio of drag to inertia, no warnings yet.
    water[LAYOUT.compiled] = model.dof_invweight0.sum()
    still = inertia.drag_rate(lambda body: _body_drag_slope(body, 0.0))
    water[LAYOUT.drag_rate :][:2] = still, (at_rest.drag_rate - still) / DRAG_SPEED
    water[LAYOUT.seen] = water[LAYOUT.told] = 0.0

    for i in range(model.ntendon):
        entries = slice(model.ten_J_rowadr[i], model.ten_J_rowadr[i] + model.ten_J_rownnz[i])
        model.tendon_invweight0[i] = inertia.along(model.ten_J_colind[entries], data.ten_J[entries])
    for i in range(len(model.actuator_acc0)):
        entries = slice(data.moment_rowadr[i], data.moment_rowadr[i] + data.moment_rownnz[i])
        columns, moment = data.moment_colind[entries], data.actuator_moment[entries]
        model.actuator_acc0[i] = np.linalg.norm(inertia.accelerations(columns, moment))
        if i in damping_ratios:
            reflected = 1.0 / inertia.along(columns, moment)
            model.actuator_biasprm[i, 2] = (
                -damping_ratios[i] * 2.0 * np.sqrt(model.actuator_gainprm[i, 0] * reflected)
            )
