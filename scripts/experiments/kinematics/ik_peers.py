"""Third-party inverse kinematics behind one call signature, for the IK benchmark only.

Each peer is asked for our accuracy in its own terms, and gets the joint limits if it supports them.
A peer without restarts of its own is restarted from random joint values within the limits.
ik_requirements.txt lists the packages.
"""

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

# target (4, 4), start (n,) -> joint values (n,), NaN where it failed
Solver = Callable[[Array, Array], Array]
RESTARTS = 100  # starts of a peer without restarts of its own
LOOPS = 400  # iterations of the Python loops around differential kinematics, over all restarts
PATIENCE = 40  # iterations of such a loop before a restart
DAMPING = 0.1  # damping of such a loop, times the squared error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolverTask:
    """Arm, limits and accuracy that a solver is made for."""

    arm: SerialArm
    limits: Array  # (n, 2) [rad] or [m]
    bar: tuple[float, float]  # [m], [rad] accuracy

    @property
    def weight(self) -> float:
        """Ratio of the accuracies [m/rad], for solvers that bound both errors by one number."""
        return self.bar[0] / self.bar[1]


def present() -> dict[str, bool]:
    """Installed or not, by name of the peer."""
    return {name: find_spec(module) is not None for name, (module, _) in _PEERS.items()}


def peers(task: SolverTask) -> dict[str, Solver]:
    """Solvers by name: the installed peers that support this arm."""
    solvers = {
        name: build(task)
        for name, (module, build) in _PEERS.items()
        if find_spec(module) is not None
    }
    return {name: solver for name, solver in solvers.items() if solver is not None}


def urdf(task: SolverTask) -> str:
    """The arm as URDF, from "base" to "tip"."""
    parts = ['<robot name="arm"><link name="base"/>']
    for i, X in enumerate(task.arm.origins()):
        rpy = roll_pitch_yaw(X[:3, :3])
        last = i == task.arm.n
        kind = "fixed" if last else {"r": "revolute", "p": "prismatic"}[task.arm.joint_types[i]]
        lower, upper = (0.0, 0.0) if last else task.limits[i]
        parts.append(
            f'<link name="{"tip" if last else f"link{i}"}"/><joint name="joint{i}" '
            f'type="{kind}"><parent link="{f"link{i - 1}" if i else "base"}"/><child '
            f'link="{"tip" if last else f"link{i}"}"/><origin xyz="{X[0, 3]!r} {X[1, 3]!r} '
            f'{X[2, 3]!r}" rpy="{rpy[0]!r} {rpy[1]!r} {rpy[2]!r}"/><axis xyz="0 0 1"/><limit '
            f'lower="{lower!r}" upper="{upper!r}" effort="1" velocity="1e6"/></joint>'
        )
    return "".join(parts).replace("np.float64(", "").replace(")", "") + "</robot>"


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Angles [rad] with Rz(yaw) Ry(pitch) Rx(roll) = R (3, 3); yaw is 0 at a pitch of 90 deg, where
    it is arbitrary.
    """
    level = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if level > 1e-9 else 0.0
    c, s = math.cos(yaw), math.sin(yaw)
    # R without its yaw is Ry(pitch) Rx(roll), whose second row is (0, cos roll, -sin roll).
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return roll, math.atan2(-R[2, 0], level), yaw


def mjcf(task: SolverTask) -> Any:
    """The arm as a compiled MuJoCo model with a site "tip"."""
    mujoco = import_module("mujoco")
    spec = mujoco.MjSpec()
    body = spec.worldbody
    frames = task.arm.origins()
    for i, X in enumerate(frames[:-1]):
        body = body.add_body(pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]))
        kind = (
            mujoco.mjtJoint.mjJNT_SLIDE
            if task.arm.joint_types[i] == "p"
            else mujoco.mjtJoint.mjJNT_HINGE
        )
        body.add_joint(type=kind, axis=[0, 0, 1], range=task.limits[i], limited=True)
        body.add_geom(size=[0.01, 0, 0], mass=1.0)
    X = frames[-1]
    body.add_site(name="tip", pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]))
    spec.compiler.degree = False
    return spec.compile()


def _eaik(task: SolverTask) -> Solver | None:
    """EAIK: closed form, the branch within the limits that is nearest to the start; six hinges of
    known kinds only.
    """
    arm = task.arm
    if arm.joint_types != "r" * 6:
        return None
    theta, d, a, alpha = arm.dh.T
    robot = import_module("eaik.IK_DH").DhRobot(alpha, a, d)
    if not robot.hasKnownDecomposition():
        return None
    to_flange = np.linalg.inv(arm.X_n_flange)

    def solver(target: Array, q0: Array) -> Array:
        branches = robot.IK(target @ to_flange)
        answers = np.asarray(branches.Q)
        if answers.size:
            # least squares: not at the target
            answers = answers[~np.asarray(branches.is_LS, dtype=bool)]
        return _nearest(answers - theta if answers.size else answers, task, q0)

    return solver


def _ikdh(task: SolverTask) -> Solver | None:
    """Algebraic method of [Husty 2007] by ikdh, followed from the start ("solve_from_seed"); six
    hinges only.
    """
    arm = task.arm
    if arm.joint_types != "r" * 6:
        return None
    ikdh = import_module("ikdh")
    dh = arm.dh
    solve = ikdh.Solver(ikdh.DHTable(*(list(dh[:, k]) for k in (2, 1, 3, 0)))).solve_from_seed
    to_flange = np.linalg.inv(arm.X_n_flange)

    def solver(target: Array, q0: Array) -> Array:
        answers = solve(target @ to_flange, np.degrees(q0))
        return _nearest(np.radians(np.asarray(answers)[:1]), task, q0)

    return solver


def _nearest(answers: Array, task: SolverTask, q0: Array) -> Array:
    """Of joint values (k, n), those within the limits that are nearest to the start; NaN if there
    are none.
    """
    if answers.size == 0:
        return np.full(task.arm.n, np.nan)
    q = folded(answers, task)
    q = q[np.all((q >= task.limits[:, 0]) & (q <= task.limits[:, 1]), axis=1)]
    return q[int(np.argmin(np.abs(q - q0).max(axis=1)))] if len(q) else np.full(task.arm.n, np.nan)


def _hinges(arm: SerialArm) -> np.ndarray:
    return ~arm.slides


def folded(q: Array, task: SolverTask) -> Array:
    """Joint values, hinges moved by whole turns to within half a turn of the limits' middle."""
    middle = np.where(np.isfinite(task.limits).all(axis=1), 0.5 * task.limits.sum(axis=1), 0.0)
    return np.where(
        _hinges(task.arm), (q - middle + math.pi) % (2.0 * math.pi) - math.pi + middle, q
    )


def _trac_ik(task: SolverTask) -> Solver:
    """TRAC-IK with its defaults, "Speed", 5 ms for a call; its accuracy holds per coordinate;
    restarts by itself.
    """
    trac = import_module("pytracik")
    robot = trac.TRAC_IK(
        "base", "tip", urdf(task), 0.005, task.bar[0] / math.sqrt(3.0), trac.SolveType.Speed
    )
    call = trac.ik

    def solver(target: Array, q0: Array) -> Array:
        w, x, y, z = quat_wxyz_from_rotation(target[:3, :3])
        answer = call(robot, q0, *target[:3, 3], x, y, z, w)
        # [0]: number of solutions
        return answer[1:] if answer[0] >= 0.0 else np.full(len(q0), np.nan)

    return solver


def _optik(task: SolverTask) -> Solver | None:
    """OptIK, "speed", one thread; restarts by itself, for 0.1 s at most; no slides."""
    if "p" in task.arm.joint_types:
        return None
    optik = import_module("optik")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(urdf(task))
        robot = optik.Robot.from_urdf_file(str(file), "base", "tip")
    robot.set_parallelism(1)
    config = optik.SolverConfig(
        "speed",
        max_time=0.1,
        tol_f=task.bar[0] ** 2,
        linear_weight=[1.0] * 3,
        angular_weight=[task.weight] * 3,
    )

    def solver(target: Array, q0: Array) -> Array:
        answer = robot.ik(config, target, q0)
        return np.full(len(q0), np.nan) if answer is None else np.asarray(answer[0])

    return solver


def _toolbox(task: SolverTask) -> Solver:
    """Robotics Toolbox, `ik_LM` with the damping of [Chan 1988] (C++); restarts by itself."""
    tools = import_module("roboticstoolbox")
    E = tools.ET
    chain = tools.ETS()
    for (theta, d, a, alpha), kind, limits in zip(
        task.arm.dh, task.arm.joint_types, task.limits, strict=True
    ):
        joint = E.tz(qlim=limits) if kind == "p" else E.Rz(qlim=limits)
        chain = chain * E.Rz(theta) * E.tz(d) * joint * E.tx(a) * E.Rx(alpha)
    chain = chain * E.SE3(task.arm.X_n_flange)
    mask = np.array([1.0] * 3 + [task.weight**2] * 3)
    tolerance = 0.5 * task.bar[0] ** 2

    def solver(target: Array, q0: Array) -> Array:
        answer = chain.ik_LM(target, q0=q0, tol=tolerance, mask=mask, k=0.1)
        return answer.q if answer.success else np.full(len(q0), np.nan)

    return solver


def _kdl(task: SolverTask) -> Solver:
    """KDL's Levenberg-Marquardt, without limits; restarted where it fails or ends beyond them."""
    kdl = import_module("PyKDL")
    rng = np.random.default_rng(0)
    chain = kdl.Chain()
    frames = task.arm.origins()
    kinds = {"r": kdl.Joint.RotZ, "p": kdl.Joint.TransZ}
    for kind, X in zip(task.arm.joint_types, frames[1:], strict=True):
        chain.addSegment(kdl.Segment(kdl.Joint(kinds[kind]), _kdl_frame(kdl, X)))
    # Its default weights, 1 and 0.01 m: setting others requires a numpy before 2.
    method = kdl.ChainIkSolverPos_LMA(chain, min(task.bar[0], 0.01 * task.bar[1]), 100, 1e-12)
    start = kdl.JntArray(task.arm.n)
    solution = kdl.JntArray(task.arm.n)

    def solver(target: Array, q0: Array) -> Array:
        n = chain.getNrOfJoints()  # read from the chain to keep it alive: `method` does not
        goal = _kdl_frame(kdl, target)
        q = q0
        for _ in range(RESTARTS):
            for i in range(n):
                start[i] = q[i]
            if method.CartToJnt(start, goal, solution) >= 0:
                q = folded(np.array([solution[i] for i in range(n)]), task)
                if np.all((q >= task.limits[:, 0]) & (q <= task.limits[:, 1])):
                    return q
            q = rng.uniform(*task.limits.T)
        return np.full(n, np.nan)

    return solver


def _kdl_frame(kdl: Any, X: Array) -> Any:
    return kdl.Frame(kdl.Rotation(*X[:3, :3].ravel().tolist()), kdl.Vector(*X[:3, 3].tolist()))


def _pinocchio(task: SolverTask) -> Solver:
    """Damped least squares in Python on Pinocchio's Jacobian, as in its documentation; restarts,
    clamped steps.
    """
    pin = import_module("pinocchio")
    rng = np.random.default_rng(0)
    model = pin.buildModelFromXML(urdf(task))
    data, tip, (lower, upper) = model.createData(), model.getFrameId("tip"), task.limits.T

    def solver(target: Array, q0: Array) -> Array:
        goal = pin.SE3(target)
        q = q0
        for loop in range(1, LOOPS + 1):
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[tip].actInv(goal)
            twist = pin.log6(error).vector
            if _within(twist, task):
                return q
            if loop % PATIENCE == 0:
                q = rng.uniform(lower, upper)
                continue
            J = pin.computeFrameJacobian(model, data, q, tip, pin.ReferenceFrame.LOCAL)
            J = -pin.Jlog6(error.inverse()) @ J
            step = -J.T @ np.linalg.solve(J @ J.T + DAMPING * (twist @ twist) * np.eye(6), twist)
            q = np.clip(folded(q + step, task), lower, upper)
        return np.full(len(q0), np.nan)

    return solver


def _mink(task: SolverTask) -> Solver:
    """Differential kinematics with mink on MuJoCo, a QP for each step (daqp); a Python loop,
    restarted.
    """
    mink = import_module("mink")
    model = mjcf(task)
    rng = np.random.default_rng(0)
    state = mink.Configuration(model)
    goal = mink.FrameTask(
        "tip", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=DAMPING
    )
    bounds = [mink.ConfigurationLimit(model)]

    def solver(target: Array, q0: Array) -> Array:
        goal.set_target(mink.SE3.from_matrix(target))
        state.update(q0)
        for loop in range(1, LOOPS + 1):
            if _within(goal.compute_error(state), task):
                return state.q.copy()
            if loop % PATIENCE == 0:
                state.update(rng.uniform(*task.limits.T))
                continue
            state.integrate_inplace(
                mink.solve_ik(state, [goal], 1.0, "daqp", 1e-6, limits=bounds), 1.0
            )
        return np.full(len(q0), np.nan)

    return solver


def _pink(task: SolverTask) -> Solver:
    """Differential kinematics with pink on Pinocchio, a QP for each step (daqp); a Python loop,
    restarted.
    """
    pink = import_module("pink")
    pin = import_module("pinocchio")
    rng = np.random.default_rng(0)
    model = pin.buildModelFromXML(urdf(task))
    state = pink.Configuration(model, model.createData(), task.limits.mean(axis=1))
    goal = import_module("pink.tasks").FrameTask(
        "tip", position_cost=1.0, orientation_cost=1.0, lm_damping=DAMPING
    )

    def solver(target: Array, q0: Array) -> Array:
        goal.set_target(pin.SE3(target))
        state.update(q0)
        for loop in range(1, LOOPS + 1):
            if _within(goal.compute_error(state), task):
                return np.array(state.q)
            if loop % PATIENCE == 0:
                state.update(rng.uniform(*task.limits.T))
                continue
            velocity = pink.solve_ik(
                state, [goal], 1.0, solver="daqp", damping=1e-6, safety_break=False
            )
            state.update(np.clip(state.integrate(velocity, 1.0), *task.limits.T))
        return np.full(len(q0), np.nan)

    return solver


def _within(twist: Array, task: SolverTask) -> bool:
    """True if a (linear; angular) error is within the accuracy."""
    linear = twist[:3]
    angular = twist[3:]
    return (
        float(linear @ linear) <= task.bar[0] ** 2 and float(angular @ angular) <= task.bar[1] ** 2
    )


_PEERS: dict[str, tuple[str, Callable[[SolverTask], Solver | None]]] = {
    "EAIK": ("eaik", _eaik),
    "ikdh seed": ("ikdh", _ikdh),
    "RTB ik_LM": ("roboticstoolbox", _toolbox),
    "KDL LMA": ("PyKDL", _kdl),
    "OptIK": ("optik", _optik),
    "TRAC-IK": ("pytracik", _trac_ik),
    "Pinocchio loop": ("pinocchio", _pinocchio),
    "mink loop": ("mink", _mink),
    "pink loop": ("pink", _pink),
}
