"""Keyframes of a model, kept valid while joints are added or removed."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array

# numbers of a joint in qpos and in qvel, for joints with more than one
_WIDTHS = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}


@contextmanager
def keyframes_kept(spec: mujoco.MjSpec) -> Iterator[None]:
    """Context in which joints of `spec` may be added and deleted; on exit its keyframes are
    adapted.

    Each joint that was there before keeps its position and its velocity in every keyframe, each
    actuator its control and its activation. A new joint gets its position in the model's reference
    configuration. Joints are identified by their names, or, if a joint has no name, by the name of
    its body.
    """
    if not spec.keys:
        yield
        return

    before = spec.copy().compile()
    states = [_State.of(before, key) for key in range(before.nkey)]

    yield

    for key in spec.keys:
        key.qpos = key.qvel = key.act = key.ctrl = np.zeros(0)
    after = spec.copy().compile()
    for number, key in enumerate(spec.keys):
        state = _State.of(after, number)
        state.take(states[number])
        key.qpos = state.qpos

        # What is zero may be left unstated, and then fits any model.
        key.qvel, key.act, key.ctrl = (
            numbers if numbers.any() else np.zeros(0)
            for numbers in (state.qvel, state.act, state.ctrl)
        )


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """State of a keyframe, as arrays in the order of the model and as views of them by part."""

    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    parts: dict[tuple[str, str], Array]  # by the array and the name of the joint or actuator

    @classmethod
    def of(cls, model: mujoco.MjModel, key: int) -> Self:
        """State of a keyframe of a compiled model."""
        qpos, qvel, act, ctrl = (
            np.array(numbers[key])
            for numbers in (model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl)
        )
        parts: dict[tuple[str, str], Array] = {}

        for joint in range(model.njnt):
            name = model.joint(joint).name or model.body(model.jnt_bodyid[joint]).name
            wide, free = _WIDTHS.get(mujoco.mjtJoint(model.jnt_type[joint]), (1, 1))
            first = int(model.jnt_qposadr[joint])
            dof = int(model.jnt_dofadr[joint])
            parts["qpos", name] = qpos[first : first + wide]
            parts["qvel", name] = qvel[dof : dof + free]

        for actuator in range(model.nu):
            name = model.actuator(actuator).name
            parts["ctrl", name] = ctrl[actuator : actuator + 1]
            if (first := int(model.actuator_actadr[actuator])) >= 0:
                parts["act", name] = act[first : first + int(model.actuator_actnum[actuator])]

        return cls(qpos, qvel, act, ctrl, parts)

    def take(self, other: "_State") -> None:
        """Set the parts that another state has too."""
        for name, part in self.parts.items():
            if len(stated := other.parts.get(name, ())) == len(part):
                part[:] = stated
