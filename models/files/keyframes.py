"""Keyframes of a model, kept valid while joints are added or removed."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array

# numbers of a joint in qpos, for joints with more than one
_WIDTH = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}


@contextmanager
def keyframes_kept(spec: mujoco.MjSpec) -> Iterator[None]:
    """Context in which joints of `spec` may be added and deleted; on exit its keyframes are
    adapted.

    Each joint that was there before keeps its position in every keyframe. A new joint gets its
    position in the model's reference configuration. Joints are identified by their names, or, if a
    joint has no name, by the name of its body.
    """
    if not spec.keys:
        yield
        return

    before = spec.copy().compile()
    positions = {
        key.name: dict(_positions(before, before.key_qpos[i])) for i, key in enumerate(spec.keys)
    }

    yield

    for key in spec.keys:
        key.qpos = np.zeros(0)
    after = spec.copy().compile()
    for key in spec.keys:
        qpos = np.array(after.qpos0)
        for name, part in _positions(after, qpos):
            part[:] = positions[key.name].get(name, part)
        key.qpos = qpos


def _positions(model: mujoco.MjModel, qpos: Array) -> Iterator[tuple[str, Array]]:
    """Name of each joint, or of its body if it has none, and its part of `qpos`, as a view."""
    for joint in range(model.njnt):
        start = int(model.jnt_qposadr[joint])
        yield (
            model.joint(joint).name or model.body(model.jnt_bodyid[joint]).name,
            qpos[start : start + _WIDTH.get(mujoco.mjtJoint(model.jnt_type[joint]), 1)],
        )
