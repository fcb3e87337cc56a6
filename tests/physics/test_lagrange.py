"""Underwater double pendulum and acrobot against Lagrange's equations, derived by hand.

Two links in a vertical plane: hinges along z, gravity along -y, each link along its x axis from its
hinge. With the planar inertia G (3, 3) over (v_x, v_y, w) of a link and its water about its hinge,
the twist of the second link is S(b) (a', b') with S = [[l s, 0], [l c, 0], [1, 1]] (s, c of the
elbow angle b), so the kinetic energy is 1/2 (a', b') M(b) (a', b') with M = S^T G2 S + diag(G1_ww,
0), and

    M (a'', b'') + (M11' a' b' + M12' b'^2, -1/2 M11' a'^2) + grad V = torques    (' of M: over b)
"""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.random_trees import semidefinite
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array

DENSITY, GRAVITY, LENGTH = 1000.0, 9.81, 0.8
# [kg, kg m^2 about the centre of mass, m]
MASS, INERTIA, CENTER = (4.0, 3.0), (0.3, 0.2), (0.35, 0.3)
VOLUME, LIFTED_AT = (0.003, 0.0035), (0.4, 0.25)  # [m^3, m]
# of the acrobot's elbow drive [N m/rad, N m s/rad, rad]
STIFFNESS, DAMPING, TARGET = 25.0, 1.5, 1.2

LINKS = f"""
<mujoco>
  <option timestep="0.001" integrator="RK4" gravity="0 -{GRAVITY} 0"/>
  <worldbody>
    <body name="upper"> <joint axis="0 0 1"/>
      <inertial pos="{CENTER[0]} 0 0" mass="{MASS[0]}" diaginertia=".3 .3 {INERTIA[0]}"/>
      <body name="lower" pos="{LENGTH} 0 0"> <joint name="elbow" axis="0 0 1"/>
        <inertial pos="{CENTER[1]} 0 0" mass="{MASS[1]}" diaginertia=".2 .2 {INERTIA[1]}"/>
      </body>
    </body>
  </worldbody>
  <actuator> <position joint="elbow" kp="{STIFFNESS}" kv="{DAMPING}"/> </actuator>
</mujoco>
"""


def pendulum(rng: np.random.Generator) -> tuple[mujoco.MjModel, list[Array]]:
    """The links in water of full random added masses, and those."""
    added = [semidefinite(rng, 0.5), semidefinite(rng, 0.5)]
    spec = mujoco.MjSpec.from_string(LINKS)
    bodies = {
        name: BodyHydrodynamics(
            volume=VOLUME[i],
            center_of_buoyancy=np.array([LIFTED_AT[i], 0.0, 0.0]),
            added_mass=added[i],
        )
        for i, name in enumerate(("upper", "lower"))
    }
    water.attach(spec, bodies, DENSITY)
    return hydrodynamics.compile(spec), added


def lagrange(added: list[Array], q: Array, qd: Array, torque: Array) -> Array:
    """The accelerations (2,)."""
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    G1, G2 = (A[plane].copy() for A in added)
    for G, m, inertia, c in zip((G1, G2), MASS, INERTIA, CENTER, strict=True):
        G += [[m, 0.0, 0.0], [0.0, m, m * c], [0.0, m * c, inertia + m * c**2]]
    s = np.sin(q[1])
    c = np.cos(q[1])
    L = LENGTH
    reach = G2[0, 2] * s + G2[1, 2] * c
    turn = G2[0, 2] * c - G2[1, 2] * s
    M12 = L * reach + G2[2, 2]
    M11 = (
        G1[2, 2]
        + L**2 * (G2[0, 0] * s**2 + 2 * G2[0, 1] * s * c + G2[1, 1] * c**2)
        + 2 * L * reach
        + G2[2, 2]
    )
    dM11 = 2 * L**2 * ((G2[0, 0] - G2[1, 1]) * s * c + G2[0, 1] * (c**2 - s**2)) + 2 * L * turn
    dM12 = L * turn
    net = [m - DENSITY * V for m, V in zip(MASS, VOLUME, strict=True)]
    lever = [
        m * c - DENSITY * V * b for m, c, V, b in zip(MASS, CENTER, VOLUME, LIFTED_AT, strict=True)
    ]
    falls = GRAVITY * lever[1] * np.cos(q[0] + q[1])
    forces = torque - [
        dM11 * qd[0] * qd[1]
        + dM12 * qd[1] ** 2
        + GRAVITY * (lever[0] + net[1] * L) * np.cos(q[0])
        + falls,
        -0.5 * dM11 * qd[0] ** 2 + falls,
    ]
    return np.linalg.solve(np.array([[M11, M12], [M12, G2[2, 2]]]), forces).astype(np.float64)


@pytest.mark.check(
    "underwater double pendulum: acceleration", "Lagrange's equations, derived by hand"
)
def test_acceleration(rng, within):
    model, added = pendulum(rng)
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data = mujoco.MjData(model)
    worst = 0.0
    for _ in range(100):
        data.qpos = rng.uniform(-np.pi, np.pi, 2)
        data.qvel = 2.0 * rng.normal(size=2)
        data.qfrc_applied = 10.0 * rng.normal(size=2)
        mujoco.mj_forward(model, data)
        expected = lagrange(added, data.qpos, data.qvel, data.qfrc_applied)
        worst = max(worst, float(np.max(np.abs(data.qacc - expected)) / np.max(np.abs(expected))))
    within("relative", worst, 1e-12)  # measured up to 8e-14 over 250 seeds, 6e-15 in half of them


@pytest.mark.parametrize(
    ("driven", "tolerance"),  # measured 1.1e-12 and 1.7e-11
    [
        pytest.param(
            False,
            1e-11,
            marks=pytest.mark.check(
                "underwater double pendulum: 3 s", "Lagrange's equations, SciPy"
            ),
        ),
        pytest.param(
            True,
            2e-10,
            marks=pytest.mark.check("underwater acrobot: 3 s", "Lagrange's equations, SciPy"),
        ),
    ],
)
def test_motion(driven, tolerance, within):
    """The acrobot has a servo at the elbow and nothing at the shoulder."""
    model, added = pendulum(np.random.default_rng(1))
    if not driven:
        model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_ACTUATION

    def rates(_: float, x: Array) -> Array:
        servo = STIFFNESS * (TARGET - x[1]) - DAMPING * x[3]
        return np.concatenate(
            [x[2:], lagrange(added, x[:2], x[2:], np.array([0.0, servo if driven else 0.0]))]
        )

    start = np.array([0.3, -0.5, 1.0, -2.0])
    exact = solve_ivp(rates, (0.0, 3.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    data = mujoco.MjData(model)
    data.qpos = start[:2]
    data.qvel = start[2:]
    data.ctrl = TARGET
    mujoco.mj_step(model, data, 3000)
    assert np.linalg.norm(exact - start) > 1.0
    within("angles and rates", np.concatenate([data.qpos, data.qvel]) - exact, tolerance)
