"""The parts of the contract that are computed where a vehicle lacks them: camera, folded and ready posture."""

import mujoco
import numpy as np

from uuv.models.completing.hull_box import hull_box
from uuv.models.completing.postures import FoundPosture, PostureSearch
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, HOME_KEY, HULL_BODY, READY_KEY, TIP_SITE, TOOL_GEOM
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import quat_wxyz_from_rotation

COMPUTABLE = (CAMERA_SITE, HOME_KEY, READY_KEY)  # of a vehicle with an arm
COMPUTED = "computed_"  # begins the name of a text element that tells a computed part
_LOOK_AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # OpenCV axes in hull axes
_BEFORE = 0.02  # [m] of the default camera before the hull's bow


def complete(spec: mujoco.MjSpec) -> list[str]:
    """Add what a vehicle lacks and can be computed: site `camera`, keyframes `home` and `ready`.

    The vehicle stays as it is where it has these, and where it has no arm by the contract: who needs that says so. What
    was added stands in text elements of the spec too (`computed`).

    Args:
        spec: vehicle, changed in place.

    Returns:
        One line for each part that was added.
    """
    sites = {site.name for site in spec.sites}
    keys = {key.name for key in spec.keys}
    if not is_armed(spec):
        return []
    said: dict[str, str] = {}
    if CAMERA_SITE not in sites:
        bow = _bow(spec)
        spec.body(HULL_BODY).add_site(
            name=CAMERA_SITE, pos=bow, quat=quat_wxyz_from_rotation(_LOOK_AHEAD), group=4, size=[0.01, 0.01, 0.01]
        )
        said[CAMERA_SITE] = f"site camera: none given; {bow[0]:.2f} m ahead of the hull's origin, looking ahead"
    if not {HOME_KEY, READY_KEY} <= keys and (search := _search(spec)) is not None:
        for name, find in ((HOME_KEY, search.home), (READY_KEY, search.ready)):
            if name not in keys:
                found = find()
                _add_key(spec, search, name, found)
                angles = ", ".join(f"{q:.2f}" for q in found.q)
                said[name] = f"keyframe {name}: none given; [{angles}]: {found.said}"
    for name, line in said.items():
        forget(spec, name)
        spec.add_text(name=COMPUTED + name, data=line)
    return list(said.values())


def is_armed(spec: mujoco.MjSpec) -> bool:
    """True if a vehicle has an arm by the contract, so that what else it lacks can be computed."""
    bodies, sites = {body.name for body in spec.bodies}, {site.name for site in spec.sites}
    return {ARM_BASE_BODY, HULL_BODY} <= bodies and TIP_SITE in sites


def forget(spec: mujoco.MjSpec, name: str = "") -> None:
    """Delete what a spec tells of a computed part, or of all: a saved MJCF may tell of another state."""
    for text in [each for each in spec.texts if each.name.startswith(COMPUTED)]:
        if name in ("", text.name.removeprefix(COMPUTED)):
            spec.delete(text)


def computed(spec: mujoco.MjSpec) -> dict[str, str]:
    """What `complete` added to a spec: one line by the name of the part."""
    return {text.name.removeprefix(COMPUTED): text.data for text in spec.texts if text.name.startswith(COMPUTED)}


def note(spec: mujoco.MjSpec, lines: list[str]) -> None:
    """Keep lines about a vehicle's file in its spec, for `computed`."""
    for i, line in enumerate(lines, start=1 + sum(name.startswith("note_") for name in computed(spec))):
        spec.add_text(name=f"{COMPUTED}note_{i}", data=line)


def tool_kind(spec: mujoco.MjSpec) -> mujoco.mjtGeom | None:
    """Shape of the tool that a vehicle has; None: it has none."""
    return next((mujoco.mjtGeom(geom.type) for geom in spec.geoms if geom.name == TOOL_GEOM), None)


def _search(spec: mujoco.MjSpec) -> PostureSearch | None:
    """Search of postures; None for an arm that cannot be read, for instance because a joint has no range."""
    try:
        return PostureSearch(spec.compile())
    except ConfigurationError:
        return None


def _add_key(spec: mujoco.MjSpec, search: PostureSearch, name: str, found: FoundPosture) -> None:
    qpos = np.array(search.model.qpos0)
    qpos[search.vehicle.qpos] = found.q
    spec.add_key(name=name, qpos=qpos)


def _bow(spec: mujoco.MjSpec) -> list[float]:
    """Place [m] in hull axes just before the middle of the bow of the hull's shapes."""
    model = spec.compile()
    arm_base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, ARM_BASE_BODY)
    box = hull_box(model, model.body(HULL_BODY).id, arm_base)
    return [max(0.0, float(box[1, 0])) + _BEFORE, 0.0, 0.0]
