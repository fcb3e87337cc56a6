"""Identifiable parameters of a vehicle's hydrodynamics, with priors, and their conversion back into
the model.

Nominal values are those of the vehicle at hand. Mass, centre of mass and inertia are assumed to be
known. The parameters of the hull are the diagonals of added mass and of both dampings, the net
buoyancy, and the centre of buoyancy relative to the hull's centre of mass. Off-diagonal numbers are
scaled with their diagonals, so that matrices stay semidefinite. An arm has one factor for the drag
and one for the added mass of all its links.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from uuv.calib.water.named_fit import NamedParameter
from uuv.models.hydrodynamics import LAYOUT, BodyHydrodynamics, carries, pack, unpack, water_density
from uuv.models.naming import USUAL_NAMES, PartNames
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY, Array

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
ARM_DRAG, ARM_ADDED_MASS = "arm drag", "arm added mass"
NET_BUOYANCY = "net buoyancy"
CENTER = tuple(f"center of buoyancy {axis}" for axis in "xyz")
GROUPS = ("added mass", "linear damping", "quadratic damping", "trim", "thrusters", "arm")
# Prior standard deviations; for factors, of their logarithms. Published sets of one vehicle differ
# by such shares.
ADDED_MASS, LINEAR, QUADRATIC, GAIN, LINK_DRAG, LINK_ADDED_MASS = 0.4, 0.7, 0.5, 0.15, 0.5, 0.4
UNTABLED = 1.0  # of a damping that no table states
DECAY = 0.05  # [1/s], [1/m] of M + A: damping assumed where the vehicle has none
BUOYANCY = 0.005  # net buoyancy, as a share of the weight
LOPSIDED, HEIGHT = 0.2, 0.4  # as a share of the height of the centre of buoyancy; of its logarithm
# as a share of the volume's cube root, for a centre of buoyancy at or below that of mass
_SMALL = 0.01


def group_of(name: str) -> str:
    """Group of a parameter: one of GROUPS, or "nuisance"."""
    if name.startswith("arm "):
        return "arm"
    if name.startswith("gain of "):
        return "thrusters"
    if name == NET_BUOYANCY or name in CENTER:
        return "trim"

    words = name.rpartition(" ")[0]
    return (
        "added mass"
        if words in ("added mass", "added inertia")
        else words
        if words in GROUPS
        else "nuisance"
    )


def added_mass_name(axis: int) -> str:
    """Name of a diagonal of the added mass."""
    return f"added {'mass' if axis < 3 else 'inertia'} {AXES[axis]}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleWater:
    """The nominal hydrodynamics of one vehicle, and the parameters by which they may differ."""

    hull: int  # body
    nominal: Mapping[int, BodyHydrodynamics]  # by body
    mass: float  # [kg] of the whole vehicle
    center_of_mass: Array  # (3,) [m] of the hull
    density: float  # [kg/m^3]
    thrusters: tuple[str, ...]  # names of actuators that act on the hull, in the model's order
    parameters: tuple[NamedParameter, ...]

    @classmethod
    def of(
        cls, model: mujoco.MjModel, *, gains: Iterable[str], names: PartNames = USUAL_NAMES
    ) -> Self:
        """Parameters of the vehicle in a compiled model.

        Args:
            model: Compiled model with hydrodynamics.
            gains: Names of the thrusters that have a gain.
            names: Names of the vehicle's parts in the model.

        Raises:
            ConfigurationError: There is no hull, or it has no hydrodynamics.
        """
        hull = Vehicle.of(model, names).hull
        nominal = {i: unpack(row) for i, row in enumerate(model.body_user) if i and carries(row)}
        if hull not in nominal:
            raise ConfigurationError(f"body {names.hull!r}: must have nominal hydrodynamics")
        density = water_density(model)

        water = nominal[hull]
        center = np.array(model.body_ipos[hull])
        inertia = _dry_diagonal(model, hull) + np.diag(water.added_mass)
        gains = tuple(gains)

        # Added mass.
        factors = [
            _factor(
                added_mass_name(i),
                "kg" if i < 3 else "kg m^2",
                float(max(water.added_mass[i, i], 0.02 * inertia[i])),
                ADDED_MASS,
            )
            for i in range(6)
        ]

        # Damping.
        for kind, diagonal, sigma, units in (
            ("linear damping", np.diag(water.linear_damping), LINEAR, ("N s/m", "N m s")),
            ("quadratic damping", water.quadratic_damping, QUADRATIC, ("N s^2/m^2", "N m s^2")),
        ):
            for i, axis in enumerate(AXES):
                tabled = diagonal[i] > 0.0
                prior = sigma if tabled else UNTABLED
                coefficient = float(diagonal[i]) if tabled else DECAY * float(inertia[i])
                factors.append(_factor(f"{kind} {axis}", units[i >= 3], coefficient, prior))

        # Net buoyancy.
        mass = float(np.sum(model.body_mass))
        displaced = density * sum(body.volume for body in nominal.values())
        factors.append(
            _offset(NET_BUOYANCY, "N", GRAVITY * (displaced - mass), BUOYANCY * GRAVITY * mass)
        )

        # Centre of buoyancy: if it is above the centre of mass, its height is a factor.
        off = water.center_of_buoyancy - center
        height = float(off[2])
        small = _SMALL * float(np.cbrt(max(water.volume, 1e-9)))
        aside = LOPSIDED * height if height > 0.0 else small
        factors += [
            _offset(name, "m", float(x), aside) for name, x in zip(CENTER[:2], off[:2], strict=True)
        ]
        factors.append(
            _factor(CENTER[2], "m", height, HEIGHT)
            if height > 0.0
            else _offset(CENTER[2], "m", height, small)
        )

        # Thrusters, and the links of the arm.
        factors += [_factor(f"gain of {name}", "1", 1.0, GAIN) for name in gains]
        if len(nominal) > 1:
            factors += [
                _factor(ARM_DRAG, "1", 1.0, LINK_DRAG),
                _factor(ARM_ADDED_MASS, "1", 1.0, LINK_ADDED_MASS),
            ]

        return cls(
            hull=hull,
            nominal=nominal,
            mass=mass,
            center_of_mass=center,
            density=density,
            thrusters=gains,
            parameters=tuple(factors),
        )

    def bodies(self, values: Mapping[str, float]) -> dict[int, BodyHydrodynamics]:
        """Coefficients by body, for given values of the parameters.

        Raises:
            ConfigurationError: The values are impossible, such as a volume below zero.
        """
        # The hull has the displaced volume that the links leave.
        bodies = {i: self._link(body, values) for i, body in self.nominal.items() if i != self.hull}
        here = self.nominal[self.hull]
        displaced = (self.mass + values[NET_BUOYANCY] / GRAVITY) / self.density
        added = np.array([values[added_mass_name(i)] for i in range(6)])

        linear = np.array([values[f"linear damping {axis}"] for axis in AXES])
        bodies[self.hull] = replace(
            here,
            volume=displaced - sum(body.volume for body in bodies.values()),
            center_of_buoyancy=self.center_of_mass + [values[name] for name in CENTER],
            added_mass=_with_diagonal(here.added_mass, added),
            linear_damping=_with_diagonal(here.linear_damping, linear),
            quadratic_damping=np.array([values[f"quadratic damping {axis}"] for axis in AXES]),
        )

        return bodies

    def write(self, model: mujoco.MjModel, values: Mapping[str, float]) -> None:
        """Write the coefficients into a compiled model; the model's contact constants are not
        changed.
        """
        for i, body in self.bodies(values).items():
            row = pack(body)
            row[LAYOUT.body_density] = self.density
            model.body_user[i, : LAYOUT.size] = row

    def gains(self, values: Mapping[str, float]) -> Array:
        """Factor (m,) of each thruster."""
        return np.array([values[f"gain of {name}"] for name in self.thrusters])

    @staticmethod
    def _link(link: BodyHydrodynamics, values: Mapping[str, float]) -> BodyHydrodynamics:
        drag = values[ARM_DRAG]
        strips = tuple(
            replace(s, normal=drag * s.normal, tangential=drag * s.tangential)
            for s in link.segments
        )

        return replace(
            link,
            strips=strips,
            added_mass=values[ARM_ADDED_MASS] * link.added_mass,
            linear_damping=drag * link.linear_damping,
            quadratic_damping=drag * link.quadratic_damping,
        )


def _factor(name: str, unit: str, nominal: float, sigma: float) -> NamedParameter:
    return NamedParameter(name=name, unit=unit, nominal=nominal, sigma=sigma, factor=True)


def _offset(name: str, unit: str, nominal: float, sigma: float) -> NamedParameter:
    return NamedParameter(name=name, unit=unit, nominal=nominal, sigma=sigma)


def _with_diagonal(matrix: Array, diagonal: Array) -> Array:
    """The matrix with another diagonal; an off-diagonal entry scales with the roots of the two
    diagonal entries that it couples.
    """
    old = np.diag(matrix)
    roots = np.sqrt(np.where(old > 0.0, diagonal / np.where(old > 0.0, old, 1.0), 1.0))
    scaled = roots[:, None] * matrix * roots
    return scaled + np.diag(diagonal - np.diag(scaled))


def _dry_diagonal(model: mujoco.MjModel, hull: int) -> Array:
    """Diagonal (6,) of the whole vehicle's dry inertia at the hull's origin, at qpos0."""
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    first = int(model.jnt_dofadr[model.body_jntadr[model.body_rootid[hull]]])
    diagonal = np.empty(6)

    for i in range(6):
        unit, product = np.zeros(model.nv), np.zeros(model.nv)
        unit[first + i] = 1.0
        mujoco.mj_mulM(model, data, product, unit)
        diagonal[i] = product[first + i]

    return diagonal
