"""Contact of a tool that slides on the target without lifting, however stiff both are."""

import math
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.naming import TOOL_GEOM

if TYPE_CHECKING:
    import mujoco

TARGET_BODY = "target"
FRICTION_TIME = 0.045  # [s] time constant of friction under a pressed tool
LONGEST = 0.5  # [s] under a light or fast one: `friction_time` says what a long one costs
PRESSED = 3.0  # times what just keeps a tool in contact at its mean speed and force: both vary
# MuJoCo's impratio: the pad creeps less than 2 mm/s under 0.8 of the friction limit
FRICTION_STIFFNESS = 100.0


def let_tool_slide(scene: "mujoco.MjSpec", *, speed: float = 0.0, force: float = math.inf) -> None:
    """Give tool and target of a scene a contact of their own.

    MuJoCo's friction is convex: sliding at v [m/s] with the coefficient mu causes a separating
    acceleration mu (b v + r). Here b is the rate of the friction constraint and r its
    regularisation. A contact that is pressed in by no more than that is lost every few steps: under
    a small force, at speed, or on a stiff surface. Friction therefore gets a slow rate of its own
    (`friction_time`), and little regularisation. A geom of higher priority than the tool's keeps
    its own contact.

    Args:
        scene: with a geom TOOL_GEOM and a body TARGET_BODY; changed.
        speed: [m/s] at which the tool slides.
        force: [N] the least that presses it.
    """
    import mujoco

    pad = scene.geom(TOOL_GEOM)
    target = scene.body(TARGET_BODY)
    light = speed > 0.0 and math.isfinite(force)
    time = (
        friction_time(scene.copy().compile(), speed=speed, force=force) if light else FRICTION_TIME
    )

    # a user's file has MuJoCo's pyramid, which knows neither
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
    """Time constant [s] of friction with which a tool stays in contact.

    Sliding separates by mu b v, with b = 2 / (d_max time). Pressed in at rest, the contact's
    reference acceleration is (1 - d) / d A f, with the inverse weight A of the body (MuJoCo
    documentation, Computation, Parameters). Friction opposes b v plus the acceleration along the
    surface: where the tool slows down by 0.04 m/s^2 it turns over below 2 mm/s with 0.11 s (5 N at
    2 cm/s, mu 0.3), below 14 mm/s with LONGEST. Where that is too short, contact is lost again: 2 %
    of the steps with 5 N at 8 cm/s and mu 0.9.

    Args:
        model: with a geom TOOL_GEOM.
        speed: [m/s] at which the tool slides.
        force: [N] the least that presses it.
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
    """MuJoCo's impratio: at friction's `time` constant [s] a tool creeps as at the usual one."""
    return FRICTION_STIFFNESS * (time / FRICTION_TIME)
