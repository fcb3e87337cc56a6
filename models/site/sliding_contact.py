"""Contact parameters with which a tool slides on the target without lifting, however stiff both
are.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.naming import TOOL_GEOM

if TYPE_CHECKING:
    import mujoco

TARGET_BODY = "target"
FRICTION_TIME = 0.045  # [s] time constant of friction under a firmly pressed tool
# [s] time constant under a light or fast tool; `friction_time` states the drawback of a long one
LONGEST = 0.5
# factor on the penetration that just keeps a tool in contact at its mean speed and force, since
# both vary
PRESSED = 3.0
# MuJoCo's impratio: the pad creeps at less than 2 mm/s under 0.8 of the friction limit
FRICTION_STIFFNESS = 100.0


def let_tool_slide(scene: "mujoco.MjSpec", *, speed: float = 0.0, force: float = math.inf) -> None:
    """Set separate contact parameters for the tool and the target of a scene.

    MuJoCo's friction is convex: sliding at v [m/s] with the coefficient mu causes a separating
    acceleration mu (b v + r). Here b is the rate of the friction constraint and r its
    regularisation. If the acceleration from the penetration is no larger, contact is lost every few
    steps. This happens under a small force, at high speed, or on a stiff surface. Friction
    therefore gets a separate, slow rate (`friction_time`) and little regularisation. A geom of
    higher priority than the tool's keeps its own contact parameters.

    Args:
        scene: has a geom TOOL_GEOM and a body TARGET_BODY; changed in place.
        speed: [m/s] at which the tool slides.
        force: [N] least force that presses the tool.
    """
    import mujoco

    pad = scene.geom(TOOL_GEOM)
    target = scene.body(TARGET_BODY)
    light = speed > 0.0 and math.isfinite(force)
    time = (
        friction_time(scene.copy().compile(), speed=speed, force=force) if light else FRICTION_TIME
    )

    # the file of a user has MuJoCo's pyramidal cone, which uses neither parameter
    scene.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    scene.option.impratio = friction_stiffness(time)

    for geom in target.geoms:
        if not (geom.contype or geom.conaffinity) or geom.priority > pad.priority or not geom.name:
            continue
        pair = scene.add_pair(geomname1=TOOL_GEOM, geomname2=geom.name)
        sliding, spinning, rolling = np.array(pad.friction)
        pair.friction = [sliding, sliding, spinning, rolling, rolling]
        pair.condim = pad.condim
        pair.solref = pad.solref
        pair.solimp = pad.solimp
        pair.solreffriction = [time, 1.0]


def friction_time(model: "mujoco.MjModel", *, speed: float, force: float) -> float:
    """Time constant [s] of friction with which a sliding tool stays in contact.

    Sliding causes a separating acceleration mu b v, with b = 2 / (d_max time). The reference
    acceleration of a contact pressed in at rest is (1 - d) / d A f, with the inverse weight A of
    the body (MuJoCo documentation, Computation, Parameters). Friction opposes b v plus the
    acceleration along the surface. If the tool decelerates by 0.04 m/s^2, friction therefore
    reverses below 2 mm/s with a time constant of 0.11 s (5 N at 2 cm/s, mu 0.3), and below 14 mm/s
    with LONGEST. If even LONGEST is too short, contact is lost again: in 2 % of the steps with 5 N
    at 8 cm/s and mu 0.9.

    Args:
        model: has a geom TOOL_GEOM.
        speed: [m/s] at which the tool slides.
        force: [N] least force that presses the tool.
    """
    pad = model.geom(TOOL_GEOM)

    least, most = np.clip(pad.solimp[:2], 1e-4, 0.9999)
    pressed = (1.0 - least) / least * float(model.body_invweight0[pad.bodyid[0], 0]) * force
    time = (
        PRESSED * 2.0 * float(pad.friction[0]) * speed / most / pressed
        if pressed > 0.0
        else LONGEST
    )

    return float(np.clip(time, FRICTION_TIME, LONGEST))


def friction_stiffness(time: float) -> float:
    """MuJoCo's impratio with which a tool creeps as slowly at the friction time constant `time` [s]
    as at the usual one.
    """
    return FRICTION_STIFFNESS * (time / FRICTION_TIME)
