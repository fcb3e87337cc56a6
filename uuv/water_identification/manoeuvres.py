"""Manoeuvres for the identification of hydrodynamics, and their logs on a simulated vehicle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.calib.water.logs import ATTITUDE, DEPTH, FORCE, POSITION, RATE, VELOCITY, Channel, WaterLog
from uuv.calib.water.parameters import AXES, CENTER, added_mass_name
from uuv.models.water.thruster_curves import command_for, thrust_at
from uuv.sim.interfaces.spatial import GRAVITY, Array
from uuv.sim.water.current import Current
from uuv.water_identification.settings import NOISE
from uuv.water_identification.vehicle_replay import ReplayVehicle, Script

DURATION = 20.0  # [s] duration of a manoeuvre
RATE_OF_LOGS = 20.0  # [Hz]
SPEED = 0.3  # [m/s, rad/s] speed that a push reaches within the time REACHED
REACHED = 5.0  # [s]
TILT = 0.25  # [rad] of roll and pitch
SHARE = 0.6  # share of the thrusters' authority that a manoeuvre uses
SLOW, FAST = 0.1, 0.4  # [Hz] frequencies of the sines
AGAINST = 0.25  # [m/s] current in which a vehicle hovers
_FINE = 4  # number of steps of a simulated log in one step of the replay
_GUSTS_TURN = 5.0  # [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manoeuvre:
    """Wrench of the thrusters and angles of the joints over time."""

    name: str
    wrench: Array  # (N, 6) commanded wrench on the hull, hull axes
    joints: Array  # (N, n) [rad]
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s]
    # [N m/rad] stiffness of roll and pitch about level, realised by the thrusters
    stiffness: tuple[float, float] = (0.0, 0.0)

    def steadied(self, replay: ReplayVehicle, state: Array) -> Array:
        """Wrench (6,) that holds roll and pitch at a state (13,) of the hull."""
        wrench = np.zeros(6)
        a, b, c, d = state[3:7]
        # components of the hull's upright axis, about x and y
        lean = np.array([2.0 * (c * d + a * b), 2.0 * (a * c - b * d)])

        for i, stiff in enumerate(self.stiffness):
            inertia = (
                replay.water.nominal[replay.water.hull].added_mass[3 + i, 3 + i]
                + replay.model.body_inertia[replay.vehicle.hull].max()
            )
            wrench[3 + i] = -stiff * lean[i] - 1.4 * np.sqrt(stiff * inertia) * state[10 + i]
        return wrench


def menu(replay: ReplayVehicle, values: Mapping[str, float]) -> list[Manoeuvre]:
    """All manoeuvres that a vehicle with these parameters can fly.

    Args:
        replay: The vehicle.
        values: A value for each parameter, such as the fitted value.
    """
    time = _times(DURATION)
    still = np.tile(replay.vehicle.q_home, (len(time), 1))
    pushes = amplitudes(replay, values)

    def along(axis: int, shape: Array) -> Array:
        return shape[:, None] * (pushes[axis] * np.eye(6)[axis])

    manoeuvres = []
    for axis in (0, 1, 2, 5):
        if pushes[axis] <= 0.0:
            continue
        for word, shape in (
            ("steps", np.where(np.floor(time / REACHED) % 2.0 == 0.0, 1.0, -1.0)),
            ("slow sine", np.sin(2.0 * np.pi * SLOW * time)),
            ("fast sine", np.sin(2.0 * np.pi * FAST * time)),
        ):
            manoeuvres.append(
                Manoeuvre(name=f"{AXES[axis]} {word}", wrench=along(axis, shape), joints=still)
            )

    for axis in (3, 4):
        if pushes[axis] > 0.0:
            turn = np.select([time < 4.0, time < 10.0, time < 14.0], [1.0, 0.0, -1.0], 0.0)
            manoeuvres.append(
                Manoeuvre(name=f"{AXES[axis]} release", wrench=along(axis, turn), joints=still)
            )

    manoeuvres.append(
        Manoeuvre(name="drift, thrusters off", wrench=np.zeros((len(time), 6)), joints=still)
    )

    if pushes[0] > 0.0:
        drag = (
            values["linear damping surge"] * AGAINST
            + values["quadratic damping surge"] * AGAINST**2
        )
        hold = np.tile(drag * np.eye(6)[0], (len(time), 1))
        manoeuvres.append(
            Manoeuvre(
                name="hover in a current", wrench=hold, joints=still, current=(-AGAINST, 0.0, 0.0)
            )
        )

    if replay.joints:
        manoeuvres.append(
            Manoeuvre(name="arm swing", wrench=np.zeros((len(time), 6)), joints=swing(replay, time))
        )
    return manoeuvres


def survey(
    replay: ReplayVehicle,
    values: Mapping[str, float],
    seconds: float,
    rng: np.random.Generator,
    axes: Sequence[int] = range(6),
) -> Manoeuvre:
    """Sines of random frequency on all axes simultaneously, with a moving arm."""
    time = _times(seconds)
    pushes = amplitudes(replay, values)
    wrench = np.zeros((len(time), 6))
    for axis in axes:
        for f in rng.uniform([0.06, 0.2], [0.2, 0.6]):
            wrench[:, axis] += 0.6 * pushes[axis] * np.sin(2.0 * np.pi * (f * time + rng.uniform()))

    return Manoeuvre(
        name="survey",
        wrench=wrench,
        joints=swing(replay, time),
        stiffness=_stiffness(replay, values),
    )


def _stiffness(replay: ReplayVehicle, values: Mapping[str, float]) -> tuple[float, float]:
    """Stiffness [N m/rad] in roll and pitch: four times the hydrostatic one, if in reach."""
    righting = replay.water.mass * GRAVITY * max(values[CENTER[2]], 1e-3)
    roll, pitch = (
        4.0 * righting if push > 0.0 else 0.0 for push in amplitudes(replay, values)[3:5]
    )
    return roll, pitch


def amplitudes(replay: ReplayVehicle, values: Mapping[str, float]) -> Array:
    """Push (6,) [N, N m] along each axis that reaches SPEED or TILT, within the authority."""
    pushes = np.zeros(6)
    if not replay.names:
        return pushes
    most = _authority(replay)
    for i, axis in enumerate(AXES):
        inertia = values[added_mass_name(i)] + (
            replay.water.mass
            if i < 3
            else float(replay.model.body_inertia[replay.vehicle.hull].max())
        )
        drag = (
            values[f"linear damping {axis}"] * SPEED
            + values[f"quadratic damping {axis}"] * SPEED**2
        )

        push = drag + inertia * SPEED / REACHED
        if i in (3, 4):
            push = min(push, TILT * replay.water.mass * GRAVITY * max(values[CENTER[2]], 1e-3))
        pushes[i] = min(push, SHARE * most[i])
    return pushes


def swing(replay: ReplayVehicle, time: Array) -> Array:
    """Joint angles (N, n) from home towards `ready` and back, each joint with its own period."""
    home, ready = replay.vehicle.q_home, replay.vehicle.q_ready
    low, high = replay.vehicle.q_limits.T if len(replay.joints) else (home, home)

    reach = np.where(
        np.abs(ready - home) > 0.1, ready - home, np.where(high - home > home - low, 0.5, -0.5)
    )
    reach = np.clip(home + np.clip(reach, -1.2, 1.2), low, high) - home

    f = 0.07 + 0.02 * np.arange(len(home))
    return home + reach * 0.5 * (1.0 - np.cos(2.0 * np.pi * np.outer(time, f)))


def commands(replay: ReplayVehicle, wrench: Array) -> Array:
    """Commands (N, m) for a wrench (N, 6): fractions, or newtons for thrusters without a curve."""
    forces = (
        wrench @ np.linalg.pinv(replay.wrench).T if replay.names else np.zeros((len(wrench), 0))
    )
    for i in np.flatnonzero(replay.has_curve):
        forces[:, i] = [command_for(replay.curve[i], force) for force in forces[:, i]]
    return forces


def simulated(
    replay: ReplayVehicle,
    values: Mapping[str, float],
    manoeuvre: Manoeuvre,
    *,
    name: str = "log",
    rng: np.random.Generator | None = None,
    gust: float = 0.0,
    noise: Mapping[str, float] = NOISE,
    channels: Sequence[str] = (POSITION, ATTITUDE, RATE),
) -> WaterLog:
    """Log of a manoeuvre with these parameters, in steps finer than those of the replay.

    Args:
        replay: The vehicle.
        values: A value for each parameter.
        manoeuvre: Manoeuvre of the vehicle.
        name: Name of the log.
        rng: Draws noise and gusts; None: there are neither.
        gust: Standard deviation [m/s] of gusts, each axis.
        noise: Standard deviation of each channel's samples.
        channels: Channels in the log.
    """
    fine = replay.copy()
    n = len(replay.joints)
    substeps = int(np.ceil(_FINE / (RATE_OF_LOGS * replay.timestep)))
    dt = 1.0 / (RATE_OF_LOGS * substeps)
    fine.model.opt.timestep = dt

    time = np.arange(len(manoeuvre.wrench)) / RATE_OF_LOGS
    grid = np.asarray(dt * np.arange(substeps * (len(time) - 1) + 1), dtype=np.float64)

    angle, turning = _swung(manoeuvre.joints, time, grid, dt)
    flow = np.tile(manoeuvre.current, (len(grid), 1))
    if gust > 0.0 and rng is not None:
        gusts = Current((0.0, 0.0, 0.0), gust=gust, time_constant=_GUSTS_TURN, timestep=dt, rng=rng)
        flow = flow + np.array([gusts.step()[0].copy() for _ in grid])

    state = np.zeros(13)
    lag = None
    state[3] = 1.0
    states = np.zeros((len(time), 13))
    pushed = np.zeros((len(time), len(replay.names)))
    accelerations = np.zeros((len(time), 3))
    first = np.zeros(1, dtype=np.int64)
    steps = np.array([substeps])

    # Step by step, because the wrench that holds roll and pitch depends on the state.
    for k in range(len(time)):
        states[k] = state
        pushed[k] = commands(
            replay, (manoeuvre.wrench[k] + manoeuvre.steadied(replay, state))[None]
        )[0]
        if k == len(time) - 1:
            break

        at = slice(k * substeps, (k + 1) * substeps + 1)
        # The propellers begin at their first command, as in a replay, which has no earlier command.
        speed, lag = replay.followed(pushed[k], lag or (pushed[k], pushed[k]), dt, substeps + 1)
        script = Script(
            first=first,
            steps=steps,
            speed=speed,
            thrust=np.where(replay.has_curve, np.nan, np.tile(pushed[k], (substeps + 1, 1))),
            q=angle[at][:1],
            qd=turning[at][:1],
            qdd=np.vstack([np.diff(turning[at], axis=0), np.zeros((1, n))]) / dt,
        )

        rows = fine.run(values, script, state[None], flow[at])
        accelerations[k] = (rows[1, 7:10] - rows[0, 7:10]) / dt
        state = rows[-1].copy()
        state[3:7] /= np.linalg.norm(state[3:7])
    accelerations[-1] = accelerations[-2]

    samples = _sampled(states, accelerations, noise, rng)
    return WaterLog(
        name=name,
        time=time,
        channels={kind: Channel(time=time, values=samples[kind]) for kind in channels},
        commands={
            thruster: pushed[:, i] for i, thruster in enumerate(replay.names) if replay.has_curve[i]
        },
        thrusts={
            thruster: pushed[:, i]
            for i, thruster in enumerate(replay.names)
            if not replay.has_curve[i]
        },
        joints={joint: angle[::substeps, j] for j, joint in enumerate(replay.joints)},
    )


def _swung(joints: Array, time: Array, grid: Array, dt: float) -> tuple[Array, Array]:
    """Angles and speeds (K, n) at `grid`: true values, and readings of the encoders."""
    n = joints.shape[1]
    turning = (
        _smoothed(np.gradient(_at(grid, time, joints), dt, axis=0), int(0.1 / dt))
        if n
        else np.zeros((len(grid), 0))
    )
    gone = np.vstack([np.zeros((1, n)), np.cumsum(0.5 * dt * (turning[1:] + turning[:-1]), axis=0)])
    return joints[:1] + gone, turning


def _sampled(
    states: Array, accelerations: Array, noise: Mapping[str, float], rng: np.random.Generator | None
) -> dict[str, Array]:
    """Samples of each channel for states (N, 13), accelerations (N, 3) in W; noisy with `rng`."""
    R_WB = Rotation.from_quat(states[:, [4, 5, 6, 3]])
    channels = {
        POSITION: states[:, :3],
        ATTITUDE: np.zeros((len(states), 3)),
        RATE: states[:, 10:],
        VELOCITY: R_WB.inv().apply(states[:, 7:10]),
        DEPTH: -states[:, 2:3],
        FORCE: R_WB.inv().apply(accelerations + np.array([0.0, 0.0, GRAVITY])),
    }

    if rng is not None:
        channels = {
            kind: exact + rng.normal(0.0, noise[kind], exact.shape)
            for kind, exact in channels.items()
        }
    channels[ATTITUDE] = (R_WB * Rotation.from_rotvec(channels[ATTITUDE])).as_quat()
    return channels


def _at(grid: Array, time: Array, values: Array) -> Array:
    return np.array([np.interp(grid, time, column) for column in values.T]).T


def _smoothed(values: Array, count: int) -> Array:
    """Running mean over `count` rows (odd) around each row, applied twice; ends are held."""
    count = max(1, count) | 1
    for _ in range(2):
        padded = np.pad(values, ((count // 2, count // 2), (0, 0)), mode="edge")
        sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), padded]), axis=0)
        values = (sums[count:] - sums[:-count]) / count
    return values


def _times(seconds: float) -> Array:
    return np.arange(int(seconds * RATE_OF_LOGS) + 1) / RATE_OF_LOGS


def _authority(replay: ReplayVehicle) -> Array:
    """Largest push (6,) along each axis by pseudo-inverse allocation; inf without curves."""
    shares = np.linalg.pinv(replay.wrench)
    reached = replay.wrench @ shares
    limits = np.full(len(replay.names), np.inf)
    for i in np.flatnonzero(replay.has_curve):
        limits[i] = min(thrust_at(replay.curve[i], 1.0), -thrust_at(replay.curve[i], -1.0))

    authority = np.zeros(6)
    for axis in range(6):
        # the thrusters push along this axis and along no other
        if abs(reached[axis, axis] - 1.0) < 1e-6:
            authority[axis] = float(np.min(limits / np.maximum(np.abs(shares[:, axis]), 1e-9)))
    return authority
