"""Socket for handles: the play of a bar in the slot, and the moment that turns it."""

import mujoco
import numpy as np
import pytest

from uuv.models.naming import PAD_BODY
from uuv.models.tools.handle_socket import HandleSocket, add_handle_socket
from uuv.sim.interfaces.errors import ConfigurationError

TURNED = np.array([0.5, -0.1, 0.7, 0.5]) / np.linalg.norm([0.5, -0.1, 0.7, 0.5])
THICK = 0.015  # [m] of the bar
STICTION = 4.0  # [N m] of the valve


HINGE = mujoco.mjtJoint.mjJNT_HINGE


def over_a_bar(
    kind: mujoco.mjtJoint = HINGE, stiction: float = STICTION
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A wrist with a socket on a hinge, over a T-bar on a stiff joint of the same axis."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    base = spec.worldbody.add_body(name="base", pos=[0.1, 0.2, -0.3], quat=TURNED)

    axis = [0.0, 0.0, 1.0]
    wrist = base.add_body(name="wrist", mass=0.5, inertia=[1e-3] * 3, explicitinertial=True)
    wrist.add_joint(name="wrist", type=HINGE, axis=axis, damping=0.5)
    tip = wrist.add_site(name="tip")
    add_handle_socket(wrist, np.zeros(3), np.array([1.0, 0, 0, 0]), tip, HandleSocket())

    bar = base.add_body(name="bar", pos=[0.0, 0.0, HandleSocket().length - 0.015])
    # so stiff that it does not creep
    sticks = [0.9999, 0.9999, 0.001, 0.5, 2.0]
    bar.add_joint(name="valve", type=kind, axis=axis, frictionloss=stiction, solimp_friction=sticks)
    size = [0.5 * THICK, 0.06, 0.01]
    geom = mujoco.mjtGeom.mjGEOM_BOX
    bar.add_geom(type=geom, size=size, mass=1.0, contype=2, conaffinity=1)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_wrist_turns_by_the_play_and_then_the_valve_turns_with_it(sense: float) -> None:
    model, data = over_a_bar()
    play = HandleSocket().backlash(THICK)
    assert play > np.radians(5.0)
    data.joint("wrist").qfrc_applied = sense * 0.5 * STICTION
    mujoco.mj_step(model, data, nstep=2000)
    turned = sense * float(data.joint("wrist").qpos[0] - data.joint("valve").qpos[0])
    assert turned == pytest.approx(play, rel=0.05)  # measured 0.01: soft walls
    assert abs(float(data.joint("valve").qpos[0])) < 1e-2

    # Beyond stiction it turns, by the wrist's moment less the damper's.
    data.joint("wrist").qfrc_applied = sense * 2.0 * STICTION
    mujoco.mj_step(model, data, nstep=300)
    assert sense * float(data.joint("valve").qpos[0]) > np.radians(20.0)
    assert abs(float(data.joint(PAD_BODY).qpos[0])) < 1e-3


def test_the_bottom_of_the_slot_bears_a_bar_that_is_pressed_home() -> None:
    model, data = over_a_bar(mujoco.mjtJoint.mjJNT_SLIDE, 0.0)
    socket = HandleSocket()
    press = 0.9 * socket.contact.most_force
    data.joint("valve").qfrc_applied = -press
    mujoco.mj_step(model, data, nstep=3000)

    give = float(data.joint(PAD_BODY).qpos[0])
    assert give == pytest.approx(-press / socket.contact.stiffness, rel=0.01)
    face = socket.length - 0.015 - 0.01 + float(data.joint("valve").qpos[0])
    assert face == pytest.approx(socket.length - socket.depth + give, abs=1e-3)


def test_the_play_is_none_for_a_bar_as_thick_as_the_slot_and_a_thicker_one_is_refused() -> None:
    socket = HandleSocket()
    assert socket.backlash(socket.slot) == pytest.approx(0.0, abs=1e-12)
    assert socket.backlash(0.010) > socket.backlash(0.020)
    with pytest.raises(ConfigurationError, match=r"at most 0.025 m thick, got 0.026 m"):
        socket.backlash(0.026)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"slot": 0.0}, "socket: slot"),
        ({"mass": -1.0}, "socket: mass"),
        ({"depth": 0.1}, "depth must be less than its length 0.1 m, got 0.1 m"),
    ],
)
def test_a_socket_that_cannot_be_built_is_refused(changed: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        HandleSocket(**changed)
