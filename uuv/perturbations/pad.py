"""Perturbation of the contact: friction and stiffness of pad and surface."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.naming import PAD_BODY, PAD_JOINT, TOOL_GEOM
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

# number of physics steps per time constant of the contact; MuJoCo needs at least two
STEPS_PER_SOLREF = 3.0
# squared phase of the pad's spring in one step; from 0.26 on the pad may bounce without decay
RESTLESS = 0.2
# [N] force at which the stiffness of pad and surface is defined; a contact stiffens with depth
WORKING_FORCE = 60.0
SOFTEST_CONTACT = 1.6  # smallest ratio of the contact's own stiffness to the requested stiffness


@dataclass(frozen=True, kw_only=True)
class Pad(Perturbation):
    """Friction between pad and surface, and stiffness of both in series."""

    friction: float | None = None  # friction coefficient; None: that of the vehicle's pad
    stiffness: float | None = None  # [N/m] None: that of the vehicle's pad

    def __post_init__(self) -> None:
        for name in ("friction", "stiffness"):
            if getattr(self, name) is not None:
                finite_number(getattr(self, name), f"Pad {name}", above=0.0)

    def on_vehicle(self, spec: mujoco.MjSpec, rng: np.random.Generator) -> Mapping[str, float]:
        """Set friction and stiffness of the pad."""
        if self.friction is None and self.stiffness is None:
            return {}
        geom = spec.geom(TOOL_GEOM)
        joint = spec.joint(PAD_JOINT)
        if geom is None or (self.stiffness is not None and joint is None):
            raise ConfigurationError(
                f"the vehicle must have a pad for friction and stiffness: a geom {TOOL_GEOM!r} on "
                f"a slide {PAD_JOINT!r}"
            )

        if self.friction is not None:
            geom.priority = 1  # contact pairs use the pad's friction, independent of the surface
            geom.friction = [self.friction, *np.array(geom.friction)[1:]]
        if self.stiffness is not None:
            self._stiffen(spec, self.stiffness)
        return {}

    @staticmethod
    def _stiffen(spec: mujoco.MjSpec, stiffness: float) -> None:
        """Set spring and contact of the pad, and the timestep that they need.

        Contact and pad spring are in series: the contact is made stiff by a short time constant,
        and the spring gives the remaining compliance. A contact that is made stiffer by `solimp`
        chatters, and so does a rigid pad. The deeper the penetration under the contact force, the
        less is contact lost when the tool vibrates. The longest time constant that is stiff enough
        is therefore best, even if the timestep is shorter for another reason.
        """
        geom = spec.geom(TOOL_GEOM)
        joint = spec.joint(PAD_JOINT)
        timestep = float(spec.option.timestep)
        drawn = spec.copy().compile()
        # not stiffer than the pad's own spring
        longest = max(STEPS_PER_SOLREF * timestep, float(geom.solref[0]))
        contact = _contact_stiffness(drawn, geom, longest)
        softest = SOFTEST_CONTACT * stiffness
        share = min(1.0, np.sqrt(contact / softest))
        geom.solref = [share * longest, 1.0]

        steps = STEPS_PER_SOLREF * timestep / (share * longest)
        sunk = _sunk(WORKING_FORCE, geom, contact / share**2)
        spring = WORKING_FORCE / (WORKING_FORCE / stiffness - sunk)
        mass = float(drawn.body(PAD_BODY).mass[0])

        phase = timestep * np.sqrt(spring / (RESTLESS * mass))
        spec.option.timestep = timestep / np.ceil(max(1.0, steps, phase) - 1e-9)
        old_spring, old_damping = (
            float(np.ravel(value)[0]) for value in (joint.stiffness, joint.damping)
        )
        # The damping ratio does not depend on the surface.
        ratio = np.sqrt(spring / old_spring) if old_spring > 0.0 else 1.0
        damping = ratio * old_damping
        joint.stiffness, joint.damping = (
            first_coefficient(joint.stiffness, spring),
            first_coefficient(joint.damping, damping),
        )


def _contact_stiffness(model: mujoco.MjModel, geom: mujoco.MjsGeom, solref: float) -> float:
    """Stiffness [N/m] of `geom` in light contact, with a time constant `solref` [s] of the contact.

    MuJoCo's constraint model (MuJoCo documentation, Computation, Parameters): at rest f = d / (1 -
    d) k r / A. Here d is the impedance at zero depth, k = 1 / (d_max solref)^2, and A the inverse
    weight of the bodies.
    """
    least, most = np.clip(np.array(geom.solimp)[:2], 1e-4, 0.9999)
    weight = float(model.body_invweight0[model.geom(geom.name).bodyid[0], 0])
    return least / (1.0 - least) / (most * solref) ** 2 / weight


def _sunk(force: float, geom: mujoco.MjsGeom, light: float) -> float:
    """Penetration [m] of a contact of `geom` under `force` [N], with the stiffness `light` [N/m] at
    zero depth.

    The impedance as a function of depth follows from `solimp` (MuJoCo documentation, Modeling,
    Solver parameters).
    """
    from scipy.optimize import brentq

    least, most, width, middle, power = np.array(geom.solimp)
    low = least / (1.0 - least)

    def excess(depth: float) -> float:
        x = min(depth / width, 1.0)
        under = x <= middle
        share = (
            x**power / middle ** (power - 1.0)
            if under
            else 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
        )

        d = least + share * (most - least)
        return light / low * d / (1.0 - d) * depth - force

    return float(brentq(excess, 0.0, force / light, xtol=1e-12))


def first_coefficient(old: float | Array, value: float) -> float | Array:
    """`value` in the shape of `old`: newer MuJoCo stores polynomials for these numbers."""
    if np.ndim(old) == 0:
        return value
    new = np.zeros_like(old)
    new[0] = value
    return new
