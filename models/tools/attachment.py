"""Attaches a tool to the tip of any arm, in place of the present tool."""

from dataclasses import replace

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.files.keyframes import keyframes_kept
from uuv.models.hydrodynamics import BodyHydrodynamics, carries, density_of, unpack
from uuv.models.naming import HOME_KEY, HULL_BODY, PAD_BODY, TIP_SITE, TOOL_FACE_SITE, TOOL_GEOM
from uuv.models.tools import gripper, handle_socket, heads, sampler
from uuv.models.tools.tools import Tool
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def attach(spec: mujoco.MjSpec, tool: Tool) -> None:
    """Attach a tool to the tip of the vehicle's arm, z out of the tool; changes the spec in place.

    A body `pad` on a slide, the tool that many vehicles have, is taken off first; another geom
    `pad` stays as a part of the vehicle. The tip moves to the end of the tool. If the vehicle is
    wet the tool is so too, and foam on the hull takes its weight in water: force and moment on the
    vehicle at home stay as they were.

    Raises:
        ConfigurationError: the vehicle has no site `tip`.
    """
    tip = next((site for site in spec.sites if site.name == TIP_SITE), None)
    if tip is None:
        raise ConfigurationError(f"a tool needs a site {TIP_SITE!r} of the arm, z out of the tool")

    wet = HULL_BODY in hydrodynamics.attached(spec)
    before = _at_home(spec) if wet else None
    with keyframes_kept(spec):
        bodies = _put_on(spec, tip, tool)
    if before is not None:
        hydrodynamics.attach(spec, bodies)
        _keep(spec, before)


def _put_on(spec: mujoco.MjSpec, tip: mujoco.MjsSite, tool: Tool) -> dict[str, BodyHydrodynamics]:
    model = spec.copy().compile()
    at = model.site(TIP_SITE)
    link = tip.parent
    mount = np.array(at.pos)
    turn = np.array(at.quat)

    # A tool on springs is taken off, with its mount.
    old = next((body for body in spec.bodies if body.name == PAD_BODY), None)
    if old is not None and old.joints and all(joint.stiffness[0] for joint in old.joints):
        mount = _foot(model, old, link, mount, turn)
        spec.delete(_first_of(old, link))

    # The new tool gets its names.
    for geom in spec.geoms:
        if geom.name == TOOL_GEOM:
            geom.name = f"{TOOL_GEOM}_of_the_model"
    for site in list(spec.sites):
        if site.name == TOOL_FACE_SITE:
            spec.delete(site)

    tip.quat = turn
    tip.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT

    if isinstance(tool, heads.Head):
        return heads.add_head(link, mount, turn, tip, tool)
    if isinstance(tool, heads.Jaws):
        return heads.add_jaws(spec, link, mount, turn, tip, tool)
    if isinstance(tool, gripper.Gripper):
        return gripper.add_gripper(spec, link, mount, turn, tip, tool)
    if isinstance(tool, handle_socket.HandleSocket):
        return handle_socket.add_handle_socket(link, mount, turn, tip, tool)
    return sampler.add(link, mount, turn, np.array([0.0, 0.0, 1.0]), tip, tool, _IDENTITY)


def _first_of(body: mujoco.MjsBody, link: mujoco.MjsBody) -> mujoco.MjsBody:
    """Body of the tool's mount, a child of the link."""
    while body.parent.name != link.name:
        body = body.parent
        if body.name == "world":
            raise ConfigurationError(
                f"the tool's body {PAD_BODY!r} must be carried by the body of site {TIP_SITE!r}"
            )
    return body


def _foot(
    model: mujoco.MjModel, old: mujoco.MjsBody, link: mujoco.MjsBody, tip: Array, turn: Array
) -> Array:
    """Position (3,) [m] in the link, on the tool's axis, of the old tool's base."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    carrier = data.body(link.name)
    mounted = data.body(old.name)
    p = carrier.xmat.reshape(3, 3).T @ (mounted.xpos - carrier.xpos)

    R = np.empty(9)
    mujoco.mju_quat2Mat(R, turn)
    z = R.reshape(3, 3)[:, 2]
    return tip + z * float(z @ (p - tip))


def _at_home(spec: mujoco.MjSpec) -> tuple[float, Array]:
    """Mass [kg] minus displaced water, its moment (3,) [kg m] about the hull's origin, at home."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, HOME_KEY)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)

    hull = model.body(HULL_BODY).id
    density = density_of(spec)
    R_WB = data.xmat[hull].reshape(3, 3)
    p_WB = data.xpos[hull]

    mass = 0.0
    moment = np.zeros(3)
    for i in np.flatnonzero(model.body_rootid == model.body_rootid[hull]):
        mass += float(model.body_mass[i])
        moment += float(model.body_mass[i]) * (data.xipos[i] - p_WB)
        if carries(model.body_user[i]):
            water = unpack(model.body_user[i])
            p_W = data.xpos[i] + data.xmat[i].reshape(3, 3) @ water.center_of_buoyancy
            mass -= density * water.volume
            moment -= density * water.volume * (p_W - p_WB)

    return mass, R_WB.T @ moment


def _keep(spec: mujoco.MjSpec, before: tuple[float, Array]) -> None:
    """Set the hull's volume and centre of buoyancy so that weight and moment equal `before`."""
    after = _at_home(spec)
    density = density_of(spec)
    hull = hydrodynamics.attached(spec)[HULL_BODY]
    displaced = density * hull.volume + after[0] - before[0]  # [kg]
    if not displaced > 0.0:
        raise ConfigurationError(
            f"the hull displaces {density * hull.volume:.3g} kg, too little to bear the tool"
        )

    moment = density * hull.volume * np.array(hull.center_of_buoyancy) + after[1] - before[1]
    hydrodynamics.attach(
        spec,
        {
            HULL_BODY: replace(
                hull, volume=displaced / density, center_of_buoyancy=moment / displaced
            )
        },
    )
