"""Motion of the water in `mjData`: a current for each simulation, which replaces the model's
default.

The current is stored in the last `FLOW.size` entries of `data.userdata`, behind those of the user.
`uuv.sim.hydrodynamics.compile` reserves these entries, and the world's row holds their index
(`LAYOUT.flow`). The first entry is the kind of the motion. It is 0 after `mj_resetData`; the motion
is then the default of the model, which is `opt.wind` with the acceleration and the shear of
`uuv.models.hydrodynamics.set_current`.

Other kinds may follow, such as velocities for each body in a table behind the uniform part, so more
entries than `FLOW.size` may be reserved.
"""

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.hydrodynamics import LAYOUT, ORIGIN, carries, is_wet, world_row
from uuv.models.water.bounds import LARGEST
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, real_array, shown

if TYPE_CHECKING:
    from mujoco.batch import Batch

# Index of each entry, counted behind the user's entries in `data.userdata`.
FLOW: Final = SimpleNamespace(
    kind=0,  # 0: the model's default applies
    velocity=1,  # 3
    acceleration=4,  # 3
    shear=7,  # 3
    size=10,
    # Kinds of motion. The numbers are arbitrary, so that other values in these entries are not
    # taken for a current.
    uniform=620264.0,
)


class WaterMotion(NamedTuple):
    """Motion of the water in world axes, evaluated at the origin of each body.

    Each field is (3,), or (..., 3) for many simulations.
    """

    velocity_W: Array  # [m/s] at z = 0
    acceleration_W: Array  # [m/s^2]
    shear: Array  # [1/s] dv/dz


def set_current(
    model: mujoco.MjModel,
    data: "mujoco.MjData | Batch | Array",
    velocity_W: ArrayLike,
    acceleration_W: ArrayLike = ORIGIN,
    shear: ArrayLike = ORIGIN,
) -> None:
    """Set the current of one simulation; `mj_resetData` restores the default of the model.

    The current is part of the state `mjSTATE_USERDATA`, which is part of `mjSTATE_INTEGRATION` and
    `mjSTATE_USER`. `mj_copyData`, `mj_copyState`, pickle and `mujoco.batch` copy it.
    `mjSTATE_FULLPHYSICS` and the start state of `mujoco.rollout` do not contain it. A rollout uses
    the current of the MjData that it works on, or the current in its controls
    (`control_spec=mjSTATE_USERDATA`).

        set_current(model, data, [0.3, 0.0, 0.0])
        set_current(model, batch, velocities)  # (nsim, 3), of a mujoco.batch.Batch
        set_current(model, control, velocities[:, None])  # (nsim, nstep, nuserdata), of a rollout

    Args:
        model: Model compiled by `uuv.sim.hydrodynamics.compile`.
        data: A simulation of `model`, a batch of simulations, or an array (..., nuserdata) of their
            userdata; changed in place.
        velocity_W: (3,) [m/s] at z = 0; like the other two, it may be (..., 3).
        acceleration_W: (3,) [m/s^2].
        shear: (3,) [1/s] dv/dz.

    Raises:
        ConfigurationError: The model has no place for a current, `data` does not belong to the
            model, or numbers have another shape, are not finite or exceed `LARGEST`.
    """
    rows = _rows(model, data)
    if rows is None:
        raise ConfigurationError(
            "set_current: this model keeps no current in its data; compile it by "
            "uuv.sim.hydrodynamics.compile(). A steady current may also be set as opt.wind"
        )

    # All three are checked before the first is written.
    shape = rows.shape[:-1]
    numbers = (
        (FLOW.velocity, _fitted(velocity_W, shape, "current velocity_W [m/s]")),
        (FLOW.acceleration, _fitted(acceleration_W, shape, "current acceleration_W [m/s^2]")),
        (FLOW.shear, _fitted(shear, shape, "current shear [1/s]")),
    )
    for first, vectors in numbers:
        rows[..., first : first + 3] = vectors
    rows[..., FLOW.kind] = FLOW.uniform


def current(model: mujoco.MjModel, data: mujoco.MjData | Array) -> WaterMotion:
    """Current that acts on the bodies of a simulation: its own or, without one, the model's
    default.

    Args:
        model: Model with hydrodynamics.
        data: As for `set_current`.

    Returns:
        Copies.

    Raises:
        ConfigurationError: The model has no hydrodynamics, or `data` does not belong to the model.
    """
    rows = _rows(model, data)
    numbers = _default(model)
    if rows is not None:
        is_set = rows[..., FLOW.kind, None] == FLOW.uniform
        numbers = np.where(is_set, rows[..., FLOW.velocity : FLOW.size], numbers)
    velocity = numbers[..., :3]
    acceleration = numbers[..., 3:6]
    shear = numbers[..., 6:]
    return WaterMotion(velocity.copy(), acceleration.copy(), shear.copy())


def place_of(model: mujoco.MjModel) -> int:
    """Index in `data.userdata` of the current of a simulation; -1 if the model has no place for
    it.
    """
    row = model.body_user[0]
    if not carries(row):
        return -1

    # Entries that do not end with the userdata are invalid, since a user has changed the number of
    # entries.
    first, count = (int(number) for number in row[LAYOUT.flow :][:2])
    ends = first - 1 + count == model.nuserdata
    return first - 1 if first > 0 and count >= FLOW.size and ends else -1


def users_numbers(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """View of `data.userdata` without the current at its end."""
    first = place_of(model)
    return data.userdata[:first] if first >= 0 else data.userdata


def take_last(model: mujoco.MjModel, total: int) -> None:
    """Reserve the last entries of `userdata` in a compiled model for the current of each
    simulation.

    Args:
        model: Compiled model; without hydrodynamics nothing happens.
        total: Number of entries of `userdata`, including those. Nothing happens if `model` has
            another number, because other code has then requested entries.
    """
    if is_wet(model) and model.nuserdata == total:
        world_row(model)[LAYOUT.flow :][:2] = 1 + total - FLOW.size, FLOW.size


def _default(model: mujoco.MjModel) -> Array:
    """Velocity, acceleration and shear (9,) of the model."""
    numbers = np.zeros(9)
    numbers[:3] = model.opt.wind

    # If the world has no row, MuJoCo itself has loaded the model from MJCF.
    row = model.body_user[0]
    if carries(row):
        numbers[3:6] = row[LAYOUT.current_acceleration :][:3]
        numbers[6:] = row[LAYOUT.current_shear :][:3]
    return numbers


def _rows(model: mujoco.MjModel, data: "mujoco.MjData | Batch | Array") -> Array | None:
    """View (..., FLOW.size) of the current in `data`; None if `model` has no place for one.

    Raises:
        ConfigurationError: The model has no hydrodynamics, or `data` does not belong to the model.
    """
    if not (isinstance(model, mujoco.MjModel) and is_wet(model)):
        raise ConfigurationError(
            f"current: expected a compiled model with hydrodynamics, got {shown(model)}"
        )

    numbers: Any = getattr(data, "userdata", data)
    if not (isinstance(numbers, np.ndarray) and numbers.dtype == np.float64 and numbers.ndim):
        raise ConfigurationError(
            f"current: expected an MjData or an array of userdata in float64, got {shown(data)}"
        )
    if numbers.shape[-1] != model.nuserdata:
        raise ConfigurationError(
            f"current: expected data of this model, with {model.nuserdata} numbers of userdata, "
            f"got {numbers.shape[-1]}"
        )
    first = place_of(model)
    return None if first < 0 else numbers[..., first : first + FLOW.size]


def _fitted(values: ArrayLike, many: tuple[int, ...], name: str) -> Array:
    """Vectors (*many, 3); a single vector is used for all.

    Raises:
        ConfigurationError: They have another shape, or a number is not finite or beyond LARGEST.
    """
    vectors = real_array(values, name, f"{(*many, 3)} numbers")
    try:
        fitted = np.broadcast_to(vectors, (*many, 3))
    except ValueError:
        fitted = None
    if fitted is None or vectors.shape[-1:] != (3,):
        raise ConfigurationError(f"{name}: expected shape {(*many, 3)}, got {vectors.shape}")
    if not np.all(np.abs(vectors) <= LARGEST):
        raise ConfigurationError(
            f"{name}: must be finite and at most {LARGEST:g} in size, got {shown(vectors)}"
        )
    return fitted
