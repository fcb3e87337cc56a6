"""The seat of a plug: it breaks away at the friction that was asked for, and holds when stuck."""

import mujoco
import numpy as np
import pytest

from uuv.models.site.plug_site import plug_site
from uuv.models.site.plugged_panel import PluggedPanel, Seat
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose
from uuv.sim.plant.true_receptacles import TrueReceptacles

SPEED = 0.01  # [m/s] of the pull
SERVO = 2e4, 200.0  # [N/m], [N s/m] of the spring that pulls


def pulled(seat: Seat, way: float) -> tuple[np.ndarray, np.ndarray]:
    """Pull on the plug [N], and force on its receptacle (N, 3) [N], over a way [m] along z of the
    panel, without weight.
    """
    spec = vehicle_spec("uuv_puma", None, None, "gripper")
    X_WT = pose(exp_so3([0.08, -0.05, 0.4]), [0.3, 0.1, -1.5])
    model = hydrodynamics.compile(plug_site(spec, PluggedPanel(), X_WT, seat))
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    views = TrueReceptacles.of(data)

    plug = model.body("target")
    joint = model.joint(int(plug.jntadr[0]))
    at = slice(int(joint.qposadr[0]), int(joint.qposadr[0]) + 3)
    dof = slice(int(joint.dofadr[0]), int(joint.dofadr[0]) + 3)
    axis = X_WT[:3, 2]

    # The spring pulls at the plug's middle, so that it does not turn it.
    rows, forces = [], []
    for tick in range(round(way / SPEED / model.opt.timestep)):
        ahead = SPEED * tick * model.opt.timestep - axis @ (data.qpos[at] - X_WT[:3, 3])
        force = SERVO[0] * ahead + SERVO[1] * (SPEED - axis @ data.qvel[dof])
        data.xfrc_applied[plug.id, :3] = force * axis
        mujoco.mj_step(model, data)
        rows.append(force)
        forces.append(views.force[0].copy())
    return np.array(rows), np.array(forces)


@pytest.mark.parametrize("friction", [12.0, 40.0])
def test_the_seat_breaks_away_at_its_friction_and_the_sensor_reads_it(friction: float) -> None:
    pull, force = pulled(Seat(friction=friction), 0.012)
    sliding = slice(len(pull) // 2, None)
    assert pull[sliding].mean() == pytest.approx(friction, rel=0.06)  # measured 2.8 %
    # All of the pull is on the receptacle, against its inward axis, but for the plug's inertia.
    assert -force[sliding, 2].mean() == pytest.approx(pull[sliding].mean(), rel=0.02)
    assert np.abs(force[sliding, :2]).max() < 0.05 * friction


def test_a_plug_that_is_out_of_its_seat_is_free() -> None:
    pull, _ = pulled(Seat(friction=20.0), 0.05)
    assert np.abs(pull[-50:]).max() < 0.5


def test_a_stuck_plug_does_not_move() -> None:
    pull, _ = pulled(Seat(friction=20.0, stuck=True), 0.006)
    assert pull[-1] > 100.0


@pytest.mark.parametrize("friction", [0.0, -1.0, 1e4, float("nan")])
def test_a_friction_that_cannot_be_is_refused(friction: float) -> None:
    with pytest.raises(ConfigurationError, match=r"panel: friction \[N\]"):
        Seat(friction=friction)
