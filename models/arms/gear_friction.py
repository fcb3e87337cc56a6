"""Dry friction in the gears of an arm by Stribeck's curve, stored on the joints of an MjSpec.

At speed v a gear resists with

    f(v) = viscous v + sign(v) (coulomb + (stiction - coulomb) exp(-(v / stribeck_speed)^2)),

and at rest with any friction up to `stiction` [Olsson 1998, eq. 2.5]. A torque sensor on the gear
output is between this friction and the link, so it does not measure the friction.

MuJoCo treats the dry part as a constraint (`frictionloss`), solved with the contacts, so a joint at
rest stays at rest. The constraint is soft, so a held joint creeps. `_HARD` and a time constant of
two steps keep the creep below 1e-4 rad/s. The bound in the model is one number per joint, the
sliding friction. The curve is stored in `joint.userdata`, and in every step the callback of
`uuv.sim.hydrodynamics` sets the bound to the value of the curve. In a process without the callback
the gears have Coulomb friction only.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.native_mark import mark
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, number, readonly

STAMP = 745520.0  # marks user data that `attach` wrote
ROW = 4  # number of entries: the stamp, sliding and sticking friction [N m], Stribeck speed [rad/s]
# relative difference of a `frictionloss` from the curve's that is accepted, as MJCF writes six
# digits
ROUNDED = 1e-5
_HARD = 0.9999  # impedance of the constraint


@dataclass(frozen=True, slots=True, kw_only=True)
class GearFriction:
    """Dry friction of one gear, at its joint; the viscous part is the joint's `damping`.

    For a slide the units are N and m/s.

    Raises:
        ConfigurationError: a figure is not finite or negative, stiction is below `coulomb`, or
            stiction is above it while `stribeck_speed` or `coulomb` is zero.
    """

    coulomb: float  # [N m] sliding friction
    stiction: float  # [N m] break-away friction
    stribeck_speed: float  # [rad/s] scale of the transition from stiction to coulomb

    def __post_init__(self) -> None:
        for field in fields(self):
            figure = number(getattr(self, field.name), f"gear friction {field.name}")
            if not (np.isfinite(figure) and figure >= 0.0):
                raise ConfigurationError(
                    f"gear friction {field.name}: must be finite and >= 0, got {figure}"
                )
            object.__setattr__(self, field.name, figure)

        if self.stiction < self.coulomb:
            raise ConfigurationError(
                f"gear friction stiction: must be at least coulomb = {self.coulomb} N m, got "
                f"{self.stiction} N m"
            )
        if self.stiction > self.coulomb and not (self.stribeck_speed > 0.0 and self.coulomb > 0.0):
            raise ConfigurationError(
                "gear friction: if stiction is above coulomb, stribeck_speed and coulomb must be "
                f"> 0, got stribeck_speed {self.stribeck_speed} and coulomb {self.coulomb}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DryFriction:
    """Dry friction of all gears of an arm, as read-only arrays (n,)."""

    coulomb: Array  # [N m]
    stiction: Array  # [N m]
    stribeck_speed: Array  # [rad/s]

    def bound(self, qd: ArrayLike) -> Array:
        """Greatest dry friction (n,) [N m] at the joint speeds `qd` (n,) [rad/s]."""
        return self.coulomb + (self.stiction - self.coulomb) * np.exp(
            -((np.asarray(qd) / self.stribeck_speed) ** 2)
        )


def attach(spec: mujoco.MjSpec, gears: Mapping[str, GearFriction]) -> None:
    """Store gear friction on the joints of a spec, in place of their `frictionloss`.

    Args:
        spec: model, changed in place.
        gears: friction by name of the joint.

    Raises:
        ConfigurationError: `spec` has no joint of that name, or the user data of a joint holds
            other data already.
    """
    joints = {joint.name: joint for joint in spec.joints}
    for name, gear in gears.items():
        if name not in joints:
            raise ConfigurationError(
                f"gear friction {name!r}: there is no joint of that name; the joints are "
                f"{sorted(joints)}"
            )
        joint = joints[name]
        if np.any(joint.userdata) and not _carries(joint.userdata):
            raise ConfigurationError(
                f"gear friction {name!r}: the user data of its joint holds other data already"
            )

        # In a process without the callback the gears would slide without stiction.
        mark(spec)
        joint.frictionloss = gear.coulomb
        joint.solref_friction = [2.0 * spec.option.timestep, 1.0]
        joint.solimp_friction = [_HARD, _HARD, 0.001, 0.5, 2.0]
        joint.userdata = [STAMP, gear.coulomb, gear.stiction, gear.stribeck_speed]


def read(model: mujoco.MjModel, joints: np.ndarray) -> DryFriction:
    """Read the dry friction of joints from a compiled model.

    Where `frictionloss` differs from the stored curve, it is read as Coulomb friction without
    stiction.

    Args:
        model: compiled model.
        joints: (n,) indices.

    Returns:
        The friction of the n joints.
    """
    coulomb = np.array(model.dof_frictionloss)[np.asarray(model.jnt_dofadr, dtype=np.int64)[joints]]
    stiction = coulomb.copy()
    speed = np.ones(len(joints))

    # Curves of `attach`, where the model's bound still belongs to them.
    for row, joint in enumerate(joints):
        if not _carries(model.jnt_user[joint]):
            continue
        _, sliding, breakaway, over = model.jnt_user[joint, :ROW]
        if breakaway > sliding and abs(coulomb[row] - sliding) <= ROUNDED * sliding:
            coulomb[row] = sliding
            stiction[row] = breakaway
            speed[row] = over

    return DryFriction(
        coulomb=readonly(coulomb), stiction=readonly(stiction), stribeck_speed=readonly(speed)
    )


def has_curves(model: mujoco.MjModel) -> bool:
    """True if a joint of a compiled model has the friction of `attach`, even if it is switched
    off.
    """
    return any(_carries(row) for row in model.jnt_user)


def _carries(row: Array) -> bool:
    return len(row) >= ROW and row[0] == STAMP
