"""Contact of a gripper's pads with an object that they hold for minutes.

MuJoCo's friction is regularised: a contact that bears a load creeps. With elliptic cones, under a
load f [N] along the surface, it does so at

    v = (1 - d) A time f / (2 impratio)

with its impedance d, its inverse weight A [1/kg] and the time constant of friction (MuJoCo
documentation, Computation). `impratio` is therefore computed here, of the creep that is allowed.
Pyramidal cones couple friction to the normal direction instead; with an impratio of 1, MuJoCo's
own, they drop the object.

MuJoCo's solver ends when an iteration improves the cost of the whole model, over its mean inertia,
by less than a tolerance. A body that is much lighter than hull and motors may then still be out of
balance: between jaws it leaps, and meets them with more than their force. So the tolerance follows
from the mass of the body.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.models.naming import PAD_JOINT
from uuv.models.tools.gripper import FINGERS, MOTOR, PADS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number

if TYPE_CHECKING:
    import mujoco
    from numpy.typing import ArrayLike

STIFFNESS = 1e5  # [N/m] of a pad at one contact point
CREEP = 1e-4  # [m/s] at most, under the largest load that friction bears
ERROR = 1e-6  # [m/s] of the held body in one step, for which the solver goes on
STEPS = 5.0  # time constant over the timestep; a shorter one hits harder what the jaws close on
_LEAST = 0.9  # impedance of a contact, as MuJoCo's own
_MOST = 0.9999  # MuJoCo takes none above it
# The solver takes the damping of joints as if it acted without them, and springs of the last step.
# Beyond these the contact oscillates, and the object creeps out: measured at 2.0 and 1.6.
_DAMPED = 1.5  # timestep times damping over inertia of a slide
_SPRUNG = 1.0  # timestep squared times stiffness over inertia
_TURNING = 4  # condim: sliding, and turning about the normal


@dataclass(frozen=True, slots=True, kw_only=True)
class GripContact:
    """Contact of one pad with one body, in MuJoCo's parameters."""

    time: float  # [s] time constant, of the normal direction and of friction
    impedance: float
    inverse_weight: float  # [1/kg] of pad and body together

    @property
    def stiffness(self) -> float:
        """Stiffness [N/m] of one contact point."""
        return 1.0 / ((1.0 - self.impedance) * self.inverse_weight * self.time**2)

    def creep(self, load: float, impratio: float) -> float:
        """Speed [m/s] of a contact point that bears `load` [N] along the surface."""
        compliance = (1.0 - self.impedance) * self.inverse_weight * self.time
        return compliance * load / (2.0 * impratio)

    def of_pair(self, friction: "ArrayLike") -> dict[str, Any]:
        """Attributes of a contact pair, for the coefficients (3,) of friction of a pad."""
        sliding, turning, rolling = np.asarray(friction).tolist()
        return {
            "friction": [sliding, sliding, turning, rolling, rolling],
            "condim": _TURNING,
            "solref": [self.time, 1.0],
            "solreffriction": [self.time, 1.0],
            "solimp": [self.impedance, self.impedance, 0.001, 0.5, 2.0],
        }

    @classmethod
    def of(cls, inverse_weight: float, timestep: float, stiffness: float) -> "GripContact":
        """Contact of a stiffness [N/m], set by the impedance and, if soft, by a longer time
        constant.

        Args:
            inverse_weight: [1/kg] of pad and body together.
            timestep: [s] of the physics.
            stiffness: [N/m] of one contact point.
        """
        time = STEPS * timestep
        share = 1.0 / (stiffness * inverse_weight * time**2)  # 1 - impedance
        softest = 1.0 - _LEAST
        if share > softest:
            time *= math.sqrt(share / softest)

        impedance = min(max(1.0 - share, _LEAST), _MOST)
        return cls(time=time, impedance=impedance, inverse_weight=inverse_weight)


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldingContact:
    """Contact of both pads with one body, and what it asks of the solver."""

    pads: tuple[GripContact, ...]  # in the order of PADS
    impratio: float
    tolerance: float

    @classmethod
    def of(
        cls,
        model: "mujoco.MjModel",
        held: float,
        *,
        stiffness: float = STIFFNESS,
        creep: float = CREEP,
    ) -> "HoldingContact":
        """Contact of the gripper in a model with a body of an inverse weight `held` [1/kg].

        The solver's cost of an acceleration a that is wrong is m a^2 / 2, over the mean inertia and
        the number of degrees of freedom (MuJoCo documentation, Computation).

        Args:
            model: compiled, with a `Gripper`.
            held: [1/kg] inverse weight of the body.
            stiffness: [N/m] of a pad at one contact point.
            creep: [m/s] of the body at most, under the largest load that friction bears.

        Raises:
            ConfigurationError: the timestep is too long.
        """
        _check_timestep(model)
        timestep = float(model.opt.timestep)

        impratio = 1.0
        force = float(model.actuator(MOTOR).ctrlrange[1])
        pads = []
        for pad in PADS:
            finger = model.geom(pad).bodyid[0]
            weight = float(model.body_invweight0[finger, 0]) + held
            contact = GripContact.of(weight, timestep, stiffness)
            friction = float(model.geom(pad).friction[0])
            impratio = max(impratio, contact.creep(friction * force, 1.0) / creep)
            pads.append(contact)

        cost = 0.5 / held * (ERROR / timestep) ** 2
        tolerance = cost / (float(model.stat.meaninertia) * model.nv)
        return cls(pads=tuple(pads), impratio=impratio, tolerance=tolerance)


def let_gripper_hold(
    scene: "mujoco.MjSpec", body: str, *, stiffness: float = STIFFNESS, creep: float = CREEP
) -> None:
    """Set separate contact parameters between the pads of a scene's gripper and the body that they
    grip.

    The scene gets elliptic cones, at least the `impratio` that this contact needs, which holds for
    its other contacts too, and a tighter tolerance of the solver: to be called where something is
    gripped only. Weights are those
    without added mass, with which the contact is a little stiffer and creeps less.

    Args:
        scene: with a vehicle that has a `Gripper`; changed.
        body: name of the body, on joints of its own.
        stiffness: [N/m] of a pad at one contact point.
        creep: [m/s] of the body at most, under the largest load that friction bears.

    Raises:
        ConfigurationError: the scene has no gripper or no such body, the body has no geom that
            touches or has no joints, a number is out of range, or the timestep is too long.
    """
    import mujoco

    finite_number(stiffness, "grip: stiffness [N/m]", above=0.0)
    finite_number(creep, "grip: creep [m/s]", above=0.0)
    geoms = _geoms_that_touch(scene, body)
    model = scene.copy().compile()
    if any(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) < 0 for name in FINGERS):
        raise ConfigurationError("grip: the scene has no gripper; give a vehicle tool='gripper'")

    held = float(model.body_invweight0[model.body(body).id, 0])
    if not held > 0.0:
        raise ConfigurationError(f"grip: body {body!r} has no joint, so nothing can carry it")

    holding = HoldingContact.of(model, held, stiffness=stiffness, creep=creep)
    impratio = holding.impratio
    for pad, contact in zip(PADS, holding.pads, strict=True):
        for geom in geoms:
            _add_pair(scene, pad, geom, contact)

    # A user's file has MuJoCo's pyramid, under which `impratio` means something else.
    option = scene.option
    elliptic = option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = max(impratio, option.impratio) if elliptic else impratio
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.tolerance = min(option.tolerance, holding.tolerance)


def _check_timestep(model: "mujoco.MjModel") -> None:
    """Refuse a timestep with which the slides of the gripper and its mount disturb the contact."""
    longest = math.inf
    for name in (PAD_JOINT, *FINGERS):
        joint = model.joint(name)
        inertia = 1.0 / float(model.dof_invweight0[joint.dofadr[0]])
        damping = float(np.asarray(model.dof_damping).reshape(model.nv, -1)[joint.dofadr[0], 0])
        stiffness = float(np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)[joint.id, 0])
        if damping > 0.0:
            longest = min(longest, _DAMPED * inertia / damping)
        if stiffness > 0.0:
            longest = min(longest, math.sqrt(_SPRUNG * inertia / stiffness))

    timestep = float(model.opt.timestep)
    # a bound that is met to the last digit is met
    if timestep > longest * (1.0 + 1e-9):
        raise ConfigurationError(
            f"grip: the timestep must be at most {longest:.3g} s for this gripper's slides to hold "
            f"an object, got {timestep:g} s; a softer and less damped mount takes a longer one"
        )


def _geoms_that_touch(scene: "mujoco.MjSpec", body: str) -> list[str]:
    """Names of the geoms of a body that touch something; those without a name get one."""
    if scene.body(body) is None:
        raise ConfigurationError(f"grip: the scene has no body {body!r}")

    names = []
    for number, geom in enumerate(scene.body(body).geoms):
        if geom.contype or geom.conaffinity:
            geom.name = geom.name or f"{body}_gripped_{number}"
            names.append(geom.name)
    if not names:
        raise ConfigurationError(f"grip: body {body!r} has no geom that touches anything")
    return names


def _add_pair(scene: "mujoco.MjSpec", pad: str, geom: str, contact: GripContact) -> None:
    """Add the contact pair of two geoms, which replaces a pair of the same geoms in the scene."""
    for pair in list(scene.pairs):
        if {pair.geomname1, pair.geomname2} == {pad, geom}:
            scene.delete(pair)

    pair = scene.add_pair(geomname1=pad, geomname2=geom)
    for name, setting in contact.of_pair(scene.geom(pad).friction).items():
        setattr(pair, name, setting)
