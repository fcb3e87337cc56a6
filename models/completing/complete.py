"""What is computed where a vehicle lacks it: camera, folded and ready posture; and its ballast."""

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.completing.hull_box import hull_box
from uuv.models.completing.postures import FoundPosture, PostureSearch
from uuv.models.files.notes import COMPUTED, forget, note
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, HOME_KEY, HULL_BODY, READY_KEY, TIP_SITE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import quat_wxyz_from_rotation

COMPUTABLE = (CAMERA_SITE, HOME_KEY, READY_KEY)  # of a vehicle with an arm
# OpenCV axes in hull axes
_LOOK_AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_TRIMMED = 2.0  # largest factor by which ballast changes the hull's volume
_BEFORE = 0.02  # [m] of the default camera before the hull's bow


def complete(spec: mujoco.MjSpec, *, trim: float | None = None, name: str = "vehicle") -> list[str]:
    """Add what a vehicle lacks and can be computed: site `camera`, keyframes `home` and `ready`.

    The vehicle stays as it is where it has these, and where it has no arm by the contract: who
    needs that says so. What was added stands in text elements of the spec too
    (`uuv.models.files.notes.computed`).

    Args:
        spec: vehicle, changed in place.
        trim: [m] metacentric height to which the hull is ballasted, neutral at `home`; None: it
            stays as it is.
        name: with which errors begin.

    Returns:
        One line for each part that was added, and for the ballast.

    Raises:
        ConfigurationError: the hull cannot be ballasted.
    """
    lines = _add_missing(spec, trimmed=trim is not None) if is_armed(spec) else {}
    for part, line in lines.items():
        forget(spec, part)
        spec.add_text(name=COMPUTED + part, data=line)

    if trim is None:
        return list(lines.values())

    ballast = _ballast(spec, trim, name)
    note(spec, [ballast])
    return [*lines.values(), ballast]


def _add_missing(spec: mujoco.MjSpec, *, trimmed: bool) -> dict[str, str]:
    """Add what an armed vehicle lacks of COMPUTABLE; returns a line by the name of each part."""
    lines: dict[str, str] = {}
    if CAMERA_SITE not in {site.name for site in spec.sites}:
        bow = _bow(spec)
        spec.body(HULL_BODY).add_site(
            name=CAMERA_SITE,
            pos=bow,
            quat=quat_wxyz_from_rotation(_LOOK_AHEAD),
            group=4,
            size=[0.01, 0.01, 0.01],
        )
        lines[CAMERA_SITE] = (
            f"site camera: none given; {bow[0]:.2f} m ahead of the hull's origin, looking ahead"
        )

    keys = {key.name for key in spec.keys}
    if not {HOME_KEY, READY_KEY} <= keys and (search := _search(spec, trimmed)) is not None:
        for key, find in ((HOME_KEY, search.home), (READY_KEY, search.ready)):
            if key not in keys:
                posture = find()
                _add_key(spec, search, key, posture)
                angles = ", ".join(f"{q:.2f}" for q in posture.q)
                lines[key] = f"keyframe {key}: none given; [{angles}]: {posture.said}"
    return lines


def is_armed(spec: mujoco.MjSpec) -> bool:
    """True if a vehicle has an arm by the contract, so that what else it lacks can be computed."""
    bodies = {body.name for body in spec.bodies}
    sites = {site.name for site in spec.sites}
    return {ARM_BASE_BODY, HULL_BODY} <= bodies and TIP_SITE in sites


def _search(spec: mujoco.MjSpec, trimmed: bool) -> PostureSearch | None:
    """Search of postures; None for an arm that cannot be read, as where a joint has no range."""
    try:
        return PostureSearch(spec.compile(), trimmed=trimmed)
    except ConfigurationError:
        return None


def _add_key(spec: mujoco.MjSpec, search: PostureSearch, name: str, posture: FoundPosture) -> None:
    qpos = np.array(search.model.qpos0)
    qpos[search.vehicle.qpos] = posture.q
    spec.add_key(name=name, qpos=qpos)


def _bow(spec: mujoco.MjSpec) -> list[float]:
    """Place [m] in hull axes just before the middle of the bow of the hull's shapes."""
    model = spec.compile()
    arm_base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, ARM_BASE_BODY)
    box = hull_box(model, model.body(HULL_BODY).id, arm_base)
    return [max(0.0, float(box[1, 0])) + _BEFORE, 0.0, 0.0]


def _ballast(spec: mujoco.MjSpec, metacentric_height: float, name: str) -> str:
    """Trim the hull in the posture `home`; returns a line about what that changed.

    Raises:
        ConfigurationError: The hull has no coefficients, or a volume that is not near to one that
            floats the vehicle.
    """
    if HULL_BODY not in hydrodynamics.attached(spec):
        raise ConfigurationError(
            f"{name}: trim: the hull has no hydrodynamic coefficients that could be trimmed; "
            "`uuv wet FILE --free` makes those of a file"
        )

    home = next((key.qpos for key in spec.keys if key.name == HOME_KEY), None)
    before = hydrodynamics.attached(spec)[HULL_BODY].volume
    after = hydrodynamics.trim(
        spec, HULL_BODY, metacentric_height=metacentric_height, qpos=home
    ).volume

    if before > 0.0 and not 1.0 / _TRIMMED < after / before < _TRIMMED:
        raise ConfigurationError(
            f"{name}: trim: the hull's volume is {before:.4g} m^3, and {after:.4g} m^3 would make "
            f"the vehicle weightless; at most a factor of {_TRIMMED:g} is trimmed, and volumes "
            "are in m^3"
        )

    return f"trim: the hull's volume from {1e3 * before:.4g} to {1e3 * after:.4g} litres"
