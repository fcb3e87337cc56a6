"""The water's motion in `mjData`: a current for each simulation, in place of its model's default.

It is held in `data.userdata`, in the last `FLOW.size` numbers, behind those of the user. The row
of the world says where (`LAYOUT.flow`), and `uuv.sim.hydrodynamics.compile` reserves the numbers.
The first of them is the kind of the motion. It is 0 after `mj_resetData`: then the default of the
model holds, which is `opt.wind` with the acceleration and the shear of
`uuv.models.hydrodynamics.set_current`.

Velocities by body would be another kind, with a table behind the uniform part: the numbers reserved
may be more than `FLOW.size`.
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

# Index of each number behind the user's own in `data.userdata`.
FLOW: Final = SimpleNamespace(
    kind=0,  # 0: the model's default holds
    velocity=1,  # 3
    acceleration=4,  # 3
    shear=7,  # 3
    size=10,
    # Kinds; arbitrary, so that numbers which something else writes are not taken for a current.
    uniform=620264.0,
)


class WaterMotion(NamedTuple):
    """Motion of the water in world axes; a body is exposed to it at its own origin.

    Each is (3,), or (..., 3) where many simulations are meant.
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
    """Set the current of one simulation until `mj_resetData` brings back the default of its model.

    The state that holds it is `mjSTATE_USERDATA`, a part of `mjSTATE_INTEGRATION` and
    `mjSTATE_USER`. `mj_copyData`, `mj_copyState`, pickle and `mujoco.batch` carry it.
    `mjSTATE_FULLPHYSICS` leaves it out, and so does the start state of `mujoco.rollout`: there the
    current is that of the MjData which does the work, or it comes with the controls
    (`control_spec=mjSTATE_USERDATA`).

        set_current(model, data, [0.3, 0.0, 0.0])
        set_current(model, batch, velocities)  # (nsim, 3), of a mujoco.batch.Batch
        set_current(model, control, velocities[:, None])  # (nsim, nstep, nuserdata), of a rollout

    Args:
        model: Compiled by `uuv.sim.hydrodynamics.compile`.
        data: A simulation of `model`, a batch of them, or an array (..., nuserdata) in their place;
            changed in place.
        velocity_W: (3,) [m/s] at z = 0, or (..., 3), as the other two.
        acceleration_W: (3,) [m/s^2].
        shear: (3,) [1/s] dv/dz.

    Raises:
        ConfigurationError: The model has no place for it, `data` is not of the model, or numbers
            have another shape, are not finite or exceed `LARGEST`.
    """
    rows = _rows(model, data)
    if rows is None:
        raise ConfigurationError(
            "set_current: this model keeps no current in its data; compile it by "
            "uuv.sim.hydrodynamics.compile(). A steady one may go into opt.wind"
        )

    # All are looked at before the first is written.
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
    """Current that the bodies of a simulation are exposed to: its own, else its model's default.

    Args:
        model: With hydrodynamics.
        data: As of `set_current`.

    Returns:
        Copies.

    Raises:
        ConfigurationError: The model has no hydrodynamics, or `data` is not of the model.
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
    """Index in `data.userdata` of the current of a simulation, -1 if there is no place for it."""
    row = model.body_user[0]
    if not carries(row):
        return -1

    # What does not end with the userdata is not ours: a user has set another number of them.
    first, count = (int(number) for number in row[LAYOUT.flow :][:2])
    ends = first - 1 + count == model.nuserdata
    return first - 1 if first > 0 and count >= FLOW.size and ends else -1


def users_numbers(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """View of `data.userdata` without the current at its end."""
    first = place_of(model)
    return data.userdata[:first] if first >= 0 else data.userdata


def take_last(model: mujoco.MjModel, total: int) -> None:
    """Give the last numbers of `userdata` in a compiled model to the current of each simulation.

    Args:
        model: Compiled; without hydrodynamics nothing happens.
        total: Numbers of `userdata` that include those; nothing happens if `model` has another
            number, for then something else has asked for them.
    """
    if is_wet(model) and model.nuserdata == total:
        world_row(model)[LAYOUT.flow :][:2] = 1 + total - FLOW.size, FLOW.size


def _default(model: mujoco.MjModel) -> Array:
    """Velocity, acceleration and shear (9,) of the model."""
    numbers = np.zeros(9)
    numbers[:3] = model.opt.wind

    # MuJoCo alone has loaded the model from MJCF if the world has no row.
    row = model.body_user[0]
    if carries(row):
        numbers[3:6] = row[LAYOUT.current_acceleration :][:3]
        numbers[6:] = row[LAYOUT.current_shear :][:3]
    return numbers


def _rows(model: mujoco.MjModel, data: "mujoco.MjData | Batch | Array") -> Array | None:
    """View (..., FLOW.size) of the current in `data`; None if `model` has no place for one.

    Raises:
        ConfigurationError: The model has no hydrodynamics, or `data` is not of the model.
    """
    if not (isinstance(model, mujoco.MjModel) and is_wet(model)):
        raise ConfigurationError(
            f"current: expected a compiled model with hydrodynamics, got {shown(model)}"
        )

    numbers: Any = getattr(data, "userdata", data)
    if not (isinstance(numbers, np.ndarray) and numbers.dtype == np.float64 and numbers.ndim):
        raise ConfigurationError(
            f"current: expected an MjData or a userdata of float64, got {shown(data)}"
        )
    if numbers.shape[-1] != model.nuserdata:
        raise ConfigurationError(
            f"current: data with {numbers.shape[-1]} numbers of userdata is not of this model, "
            f"which has {model.nuserdata}"
        )
    first = place_of(model)
    return None if first < 0 else numbers[..., first : first + FLOW.size]


def _fitted(values: ArrayLike, many: tuple[int, ...], name: str) -> Array:
    """Vectors (*many, 3), of which one may stand for all.

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
