"""Gear friction and contacts read from MuJoCo's memory after each step, in one compiled call.

MuJoCo's binding builds new arrays of all contacts at each access, which takes as long as the
physics. The kernel reads them in place; the offsets come from `uuv.sim.native.mujoco_layout` and
are compared with the binding once.
"""

import ctypes
from functools import cache
from typing import NamedTuple

import mujoco
import numpy as np

from uuv.models.naming import OTHER_PAD, SLOT_BOTTOM, TOOL_GEOM
from uuv.models.tools.gripper import FINGERS
from uuv.models.water.mujoco_library import library
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.mujoco_layout import offset, structure
from uuv.sim.native.native_memory import f64, i32, pointer

# Entries of `contacts`, the output of `gears_and_contacts`
NORMAL, FORCE = 0, 1  # [N] on the pad; (3,) [N] of the world on the pad, W: means over the substeps
COLLISION = 4  # 1 if a part other than the pad was in contact
LEAST = 5  # [N] smallest normal force of a substep
MOST = 6  # [N] largest one
CONTACTS = 7  # number of entries

# Entries of `places`, which are integers: address of MjData, geom of the pad, type of friction
# cone, offsets, and the SIZE of a contact
(
    DATA,
    PAD,
    PYRAMIDS,
    NCON,
    NE,
    NEFC,
    CONTACT,
    EFC_FORCE,
    SIZE,
    FRAME,
    FRICTION,
    DIM,
    GEOM,
    EFC_ADDRESS,
) = range(14)
# offset in MjData; addresses of MjModel, mj_step1 and mj_step2
TIME, MODEL, STEP1, STEP2 = range(14, 18)

_PROBE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 .09"> <freejoint/> <geom size=".1" condim="4" friction=".7 .02 .001"/> </body>
  </worldbody>
</mujoco>
"""


def colliding_geoms(model: mujoco.MjModel, hull: int, tool: str) -> np.ndarray:
    """Mask (ngeom,), True for geoms of the vehicle whose contacts are collisions.

    The tool's own geom is True. Other parts of the project's gripper or socket that touch the tool
    are False: the opposite pad or wall, and the bottom of the slot.

    Args:
        model: Compiled model.
        hull: Body of the hull.
        tool: Name of the tool's geom, with the prefix of an attached vehicle if there is one.
    """
    root = np.asarray(model.body_rootid)
    body = np.asarray(model.geom_bodyid)
    mask = root[body] == root[hull]
    prefix = tool.removesuffix(TOOL_GEOM)
    if prefix == tool:
        return mask  # the model has none of these geoms

    kind = mujoco.mjtObj.mjOBJ_GEOM
    pad, across, bottom = (
        mujoco.mj_name2id(model, kind, tool + part) for part in ("", OTHER_PAD, SLOT_BOTTOM)
    )
    finger = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, prefix + FINGERS[1])
    socket = min(pad, across, bottom) >= 0 and body[pad] == body[across] == body[bottom]
    gripper = min(across, finger) >= 0 and model.jnt_bodyid[finger] == body[across]

    if socket:
        mask[[across, bottom]] = False
    elif gripper:
        mask[across] = False

    return mask


def places_of(data: mujoco.MjData, model: mujoco.MjModel, pad: int) -> np.ndarray:
    """Addresses and offsets for compiled code that reads or steps the physics.

    Args:
        data: Data; it must exist as long as the result is used.
        model: Model of `data`.
        pad: Geom of the pad, or -1.

    Returns:
        `places` (18,) of integers.

    Raises:
        HydrodynamicsError: This MuJoCo stores contacts at other offsets than its introspection data
            say.
    """
    places = np.array(_offsets(), dtype=np.int64)

    places[DATA] = data._address
    places[MODEL] = model._address
    places[PAD] = pad
    places[PYRAMIDS] = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    return places


@cache
def _offsets() -> tuple[int, ...]:
    in_data = [offset("mjData", name) for name in ("ncon", "ne", "nefc", "contact", "efc_force")]
    names = ("frame", "friction", "dim", "geom", "efc_address")
    in_contact = [offset("mjContact", name) for name in names]

    _compare(names)
    steps = [
        ctypes.cast(getattr(library(), name), ctypes.c_void_p).value or 0
        for name in ("mj_step1", "mj_step2")
    ]

    size = ctypes.sizeof(structure("mjContact"))
    return (0, 0, 0, *in_data, size, *in_contact, offset("mjData", "time"), 0, *steps)


def _compare(names: tuple[str, ...]) -> None:
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)

    of_data = structure("mjData").from_address(data._address)
    kind = structure("mjContact")
    counts = {
        name: getattr(of_data, name) == getattr(data, name)
        for name in ("time", "ncon", "ne", "nefc")
    }
    counts["efc_force"] = of_data.efc_force == data.efc_force.ctypes.data

    live = data.contact[0]
    as_read = kind.from_address(of_data.contact)
    for name in names:
        counts[name] = np.array_equal(
            np.ravel(getattr(live, name)), np.ravel(getattr(as_read, name))
        )

    if not all(counts.values()):
        wrong = ", ".join(name for name, equal in counts.items() if not equal)
        raise HydrodynamicsError(
            f"MuJoCo {mujoco.__version__}: contacts are not at the offsets of its introspection "
            f"data: {wrong}"
        )


class Readout(NamedTuple):
    """Gears and contacts of one plant; the last three fields are outputs."""

    places: np.ndarray  # (18,) result of `places_of`
    # (n,) row of each joint's gear among the friction constraints; -1 without friction, or (0,)
    gears: np.ndarray
    own_geom: np.ndarray  # (ngeom,) mask, True for geoms of the vehicle
    added: Array  # (4,) [N] normal force, and force in W, to be added to those of each substep
    tau_friction: Array  # (n,) [N m] friction torque on each joint
    contacts: Array  # (CONTACTS,) accumulated over the substeps
    # (3,) geoms of the vehicle and of the world that collided first, and the time [s]; negative if
    # there was no collision
    collided: Array


@kernel
def gears_and_contacts(readout, substep, substeps):
    """Read friction and contacts of the substep that has ended.

    The means in `contacts` are complete after the last of `substeps`; `substep` 0 starts a new
    step.

    Args:
        readout: `Readout`, or its fields as a plain tuple.
        substep: Index of the substep, from 0.
        substeps: Number of substeps.
    """
    places, rows, own_geom, added, tau_friction, contacts, collided = readout

    d = places[DATA]
    efc_force = pointer(d, places[EFC_FORCE])

    # Friction of the gears.
    first = i32(d + places[NE], 0)
    end = i32(d + places[NEFC], 0)
    for j in range(rows.shape[0]):
        if rows[j] >= 0:
            tau_friction[j] = f64(efc_force, first + rows[j]) if first + rows[j] < end else 0.0

    if substep == 0:
        contacts[:] = 0.0
        contacts[LEAST] = np.inf
        contacts[MOST] = -np.inf

    # Contacts of the vehicle with the world.
    contact_at = pointer(d, places[CONTACT])
    force = np.empty(3)
    total = np.zeros(4)
    for _ in range(i32(d + places[NCON], 0)):
        geom_1 = i32(contact_at + places[GEOM], 0)
        geom_2 = i32(contact_at + places[GEOM], 1)
        address = i32(contact_at + places[EFC_ADDRESS], 0)

        if own_geom[geom_1] != own_geom[geom_2] and address >= 0:
            if places[PAD] == geom_1 or places[PAD] == geom_2:
                _contact_force(
                    efc_force + 8 * address,
                    contact_at + places[FRICTION],
                    i32(contact_at + places[DIM], 0),
                    places[PYRAMIDS],
                    force,
                )

                total[NORMAL] += force[0]
                sign = 1.0 if geom_2 == places[PAD] else -1.0
                for k in range(3):  # the rows of the contact frame are the axes of the force
                    at = contact_at + places[FRAME]
                    turned = (
                        f64(at, k) * force[0]
                        + f64(at, 3 + k) * force[1]
                        + f64(at, 6 + k) * force[2]
                    )
                    total[FORCE + k] += sign * turned
            else:
                contacts[COLLISION] = 1.0
                if collided[0] < 0.0:
                    collided[0], collided[1] = (
                        (geom_1, geom_2) if own_geom[geom_1] else (geom_2, geom_1)
                    )
                    collided[2] = f64(d + places[TIME], 0)

        contact_at += places[SIZE]

    # Means over the substeps, and the extremes of the normal force.
    for k in range(4):
        total[k] += added[k]
        contacts[k] += total[k]
        if substep == substeps - 1:
            contacts[k] /= substeps

    contacts[LEAST], contacts[MOST] = (
        min(contacts[LEAST], total[NORMAL]),
        max(contacts[MOST], total[NORMAL]),
    )


@kernel
def _contact_force(efc_force, friction, dim, pyramids, force):
    """Normal and tangential forces (3,) [N] of one contact in its frame, from constraint forces."""
    force[1] = force[2] = 0.0
    if dim == 1 or not pyramids:
        for k in range(min(dim, 3)):
            force[k] = f64(efc_force, k)
        return

    # Pyramid: the normal force is the sum over its edges.
    force[0] = 0.0
    for k in range(2 * (dim - 1)):  # edges of the friction pyramid, two along each direction
        force[0] += f64(efc_force, k)

    for k in range(min(dim - 1, 2)):
        force[1 + k] = (f64(efc_force, 2 * k) - f64(efc_force, 2 * k + 1)) * f64(friction, k)
