"""Point touching for kinematic calibration: the arm presses its ball tip into fixed nests under joint-torque control.

Free motion follows joint angles. Over the nest the tip is held by a soft spring. In the nest the spring's end then
follows the tip, so that no side force remains, and a small constant force presses the ball home. The joint torques bear
the arm's weight in water.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from controllers.mkps import Chain, solve
from controllers.tuning import TOUCH, TouchTuning
from models.vehicle import Vehicle
from sim.interfaces.errors import ReachError
from sim.interfaces.messages import Command, Reference, StateEstimate, Target, WorkState
from sim.interfaces.spatial import Array, inverse, pose, rotation_from_z


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nest:
    """Nest as the vehicle knows it, in W."""

    p_WN: Array  # (3,) [m] position of a seated tip
    z_WN: Array  # (3,) unit axis, out of the nest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch: which nest, and the direction of the tool."""

    nest: int  # index
    R_WG: Array  # (3, 3) wanted tool frame, z out of the tool


def draw_touches(
    chain: Chain,
    X_AW: Array,
    nests: Sequence[Nest],
    count: int,
    rng: np.random.Generator,
    q_start: Array,
    *,
    cone: float = np.deg2rad(65.0),
    lift: float = TOUCH.lift,
    tries: int = 4000,
) -> list[Touch]:
    """Draw random, reachable tool directions for each nest.

    Every direction lies within `cone` of the nest's axis and is reachable at the nest and above it. Consecutive touches
    of a nest are ordered by nearest joint angles.

    Args:
        chain: the arm, base to tool.
        X_AW: (4, 4) pose of W in the arm's base frame A.
        nests: the nests.
        count: touches per nest.
        rng: random generator.
        q_start: (n,) [rad] start of the inverse kinematics.
        cone: [rad] largest angle from the nest's axis.
        lift: [m] height above the nest.
        tries: largest number of directions drawn per nest.

    Returns:
        The touches, nest by nest.

    Raises:
        ReachError: if too few directions of a nest are within reach.
    """
    out = []
    for k, nest in enumerate(nests):
        found: list[tuple[Array, Touch]] = []
        for _ in range(tries):
            if len(found) == count:
                break
            R_WG = _direction(nest.z_WN, cone, rng)
            above = pose(R_WG, nest.p_WN + lift * nest.z_WN)
            over, seated = (solve(chain, X_AW @ X, q_start, 1e-4, 1e-3) for X in (above, pose(R_WG, nest.p_WN)))
            if over.converged and seated.converged:
                found.append((over.q, Touch(nest=k, R_WG=R_WG)))
        if len(found) < count:
            raise ReachError(
                f"nest {k + 1} at {np.round(nest.p_WN, 2)} m: {len(found)} of {count} directions within reach"
            )
        at = q_start
        while found:  # next the one nearest in joint angles
            q, touch = found.pop(int(np.argmin([np.abs(q - at).max() for q, _ in found])))
            out.append(touch)
            at = q
    return out


def _direction(z: Array, cone: float, rng: np.random.Generator) -> Array:
    """Random tool frame, its z against `z` within `cone`, uniform over the cap, with a uniform angle about itself."""
    height = rng.uniform(np.cos(cone), 1.0)
    turn, spin = rng.uniform(0.0, 2.0 * np.pi, 2)
    side = np.sqrt(1.0 - height**2)
    R = rotation_from_z(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    along = -R @ [side * np.cos(turn), side * np.sin(turn), height]
    R = rotation_from_z(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    c, s = np.cos(spin), np.sin(spin)
    return R @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(slots=True, eq=False)
class TouchState:
    """State of the touch sequence."""

    at: int = 0  # index of the touch
    phase: int = 0  # 0 over the nest, 1 down, 2 press, 3 up
    since: float = 0.0  # [s] time at which the phase began
    q_from: Array = field(default_factory=lambda: np.zeros(0))  # (n,) [rad] start of the joint motion
    way: list[Array] = field(default_factory=list)  # (n,) [rad] joint angles still to reach, the last over the nest
    duration: float = 0.0  # [s] of the joint motion
    offsets: dict[int, list[Array]] = field(default_factory=dict)  # (3,) [m] per nest: found minus known position, W


class TouchSequence:
    """Planner (`sim.interfaces.protocols.Planner`) that asks for one touch after the other."""

    period = 0.004

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        nests: Sequence[Nest],
        touches: Sequence[Touch],
        X_WB: Array,
        tuning: TouchTuning | None = None,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            nests: the nests.
            touches: touches to make, in this order.
            X_WB: (4, 4) hull pose in W, held throughout.
            tuning: motion, stiffness and force of the touches.
        """
        self._vehicle, self._chain, self._nests, self._touches = vehicle, chain, tuple(nests), tuple(touches)
        self._X_WB = X_WB
        self._X_WA = X_WB @ np.array(vehicle.X_BA)
        self.tuning = tuning or TouchTuning()

    def init(self, estimate: StateEstimate) -> TouchState:
        """State at the start, with the joint motion to over the first nest planned."""
        state = TouchState(q_from=np.array(estimate.q))
        self._begin(state, estimate)
        return state

    def _begin(self, state: TouchState, estimate: StateEstimate) -> None:
        """Plan the joint motion to over the next nest.

        It passes through the ready posture if the straight motion would strike a nest.
        """
        q, ready = np.array(estimate.q), np.array(self._vehicle.q_ready)
        if state.at < len(self._touches):
            touch = self._touches[state.at]
            over = self._aim(state, touch) + self.tuning.lift * self._nests[touch.nest].z_WN
            goal = solve(self._chain, inverse(self._X_WA) @ pose(touch.R_WG, over), ready, 1e-4, 1e-3).q
            state.way = [goal] if self._clear(q, goal) else [ready, goal]
        else:
            state.way = [ready]
        self._depart(state, estimate)

    def _depart(self, state: TouchState, estimate: StateEstimate) -> None:
        """Begin the motion to the next joint angles of the plan."""
        state.phase, state.since, state.q_from = 0, estimate.time, np.array(estimate.q)
        # A quintic's peak speed is 15/8 of its mean.
        state.duration = max(0.5, 1.875 * float(np.abs(state.way[0] - state.q_from).max()) / self.tuning.move_speed)

    def _clear(self, q_from: Array, q_to: Array) -> bool:
        """True if the pin keeps clear of every nest on the straight line in joint space."""
        for share in np.linspace(0.0, 1.0, 30):
            X_WG = self._X_WA @ self._chain.forward(q_from + share * (q_to - q_from))
            for nest in self._nests:
                apart = X_WG[:3, 3] - nest.p_WN
                if float(np.linalg.norm(apart)) < 0.12 and float(apart @ nest.z_WN) < 0.7 * self.tuning.lift:
                    return False
        return True

    def _aim(self, state: TouchState, touch: Touch) -> Array:
        """Position p_WN (3,) of the nest by the vehicle's own arm model: corrected by the last touches of it."""
        found = state.offsets.get(touch.nest)
        nest = self._nests[touch.nest].p_WN
        return nest if not found else nest + np.mean(found[-5:], axis=0)

    def step(
        self, state: TouchState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[TouchState, Reference]:
        """Advance the sequence by one period.

        Args:
            state: state of the sequence, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification; not used.
            last: the controller's last command; not used.

        Returns:
            The state and the reference for the controller. Its `touch` is the index of the touch while the encoders are
            to be read.
        """
        tuning, t = self.tuning, estimate.time - state.since
        if state.at >= len(self._touches):
            if state.phase == 0 and t >= state.duration:
                return state, self._reference(estimate, WorkState.DONE, q=state.way[-1])
            return state, self._over(state, estimate, t)
        touch = self._touches[state.at]
        nest, aim = self._nests[touch.nest], self._aim(state, touch)
        way_down = tuning.lift + tuning.beyond
        if state.phase == 0:
            if t < state.duration + (0.3 if len(state.way) == 1 else 0.0):
                return state, self._over(state, estimate, t)
            if len(state.way) > 1:
                state.way.pop(0)
                self._depart(state, estimate)
                return state, self._over(state, estimate, 0.0)
            state.phase, state.since, t = 1, estimate.time, 0.0
        if state.phase == 1:
            if t < way_down / tuning.descent:
                p = aim + (tuning.lift - tuning.descent * t) * nest.z_WN
                return state, self._reference(estimate, WorkState.APPROACH, X_WG=pose(touch.R_WG, p))
            state.phase, state.since, t = 2, estimate.time, 0.0
        if state.phase == 2:
            if t < tuning.settle + tuning.reading:
                p = aim - tuning.beyond * nest.z_WN
                reading = state.at if t >= tuning.settle else None
                X_WG = pose(touch.R_WG, p)
                return state, self._reference(estimate, WorkState.PRESS, X_WG=X_WG, force=tuning.push, touch=reading)
            X_WG = estimate.X_WB @ self._vehicle.X_BA @ self._chain.forward(estimate.q)
            offset = X_WG[:3, 3] - nest.p_WN
            if float(np.linalg.norm(offset)) < tuning.believable:
                state.offsets.setdefault(touch.nest, []).append(offset)
            state.phase, state.since, t = 3, estimate.time, 0.0
        up = tuning.lift + tuning.beyond
        if t < up / (2.0 * tuning.descent):
            p = aim + (2.0 * tuning.descent * t - tuning.beyond) * nest.z_WN
            return state, self._reference(estimate, WorkState.RETREAT, X_WG=pose(touch.R_WG, p))
        state.at += 1
        self._begin(state, estimate)
        return state, self._over(state, estimate, 0.0)

    def _over(self, state: TouchState, estimate: StateEstimate, t: float) -> Reference:
        """Reference of the joint motion, `t` [s] after its start: a quintic in time."""
        s = min(1.0, t / state.duration)
        blend, rate = s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) ** 2 / state.duration
        way = state.way[0] - state.q_from
        return self._reference(estimate, WorkState.CLOSE_IN, q=state.q_from + blend * way, qd=rate * way)

    def _reference(
        self,
        estimate: StateEstimate,
        work: WorkState,
        *,
        q: Array | None = None,
        qd: Array | None = None,
        X_WG: Array | None = None,
        force: float = 0.0,
        touch: int | None = None,
    ) -> Reference:
        """Reference for the controller; the hull pose is always the same."""
        rest = np.zeros(len(estimate.q))
        return Reference(
            time=estimate.time,
            state=work,
            X_WB=self._X_WB,
            v_WB_W=np.zeros(3),
            X_WG=X_WG,
            v_WG_W=np.zeros(3),
            w_WG_W=np.zeros(3),
            q=rest if q is None else q,
            qd=rest if qd is None else qd,
            force=force,
            force_control=False,
            tare=False,
            scan=False,
            path_s=0.0,
            touch=touch,
        )
