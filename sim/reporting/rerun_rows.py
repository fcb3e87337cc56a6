"""Rows of a visual log, gathered in memory and sent as columns."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import Moment
from uuv.sim.reporting.rerun_scene import LIFT
from uuv.sim.reporting.rerun_stream import LogStream

JET_SCALE = 1 / 250.0  # [m]/[N] of the thrusters' jets
# [m]/[N] of force arrows: those of the tool must be visible beyond the wrist
FORCE_SCALE = 1 / 150.0
CURRENT_SCALE = 3.0  # [m]/[m/s] of the current's arrow
_NOWHERE = np.full(3, np.nan)
_STILL = np.zeros(3)


class SeriesRows:
    """Forces along and across the tool, path error, hull drift, thrusts, joints, estimate errors.

    Before the tare a felt force is only the bias of the torque sensors: it is left out.
    """

    def __init__(self, vehicle: Vehicle, bounds: Bounds | None = None) -> None:
        """Take the vehicle, and bounds to draw."""
        judged = bounds is not None and np.isfinite(bounds.path_deviation)
        self._bound = 1e3 * bounds.path_deviation if bounds is not None and judged else None  # [mm]

        n, m = len(vehicle.joint_names), len(vehicle.thruster_names)
        self._widths = (1, 3, 3, 3, 3, 3, m, n, n, 3, 3, 3, 3)
        self._rows: list[Array] = []
        self._tared = False

    def add(self, moment: Moment) -> None:
        """Keep one step."""
        truth = moment.truth
        reference = moment.reference
        contact = moment.command.contact
        self._tared |= reference.tare

        felt, felt_W = (
            (contact.normal, contact.force_W)
            if self._tared and not reference.tare
            else (np.nan, _NOWHERE)
        )

        commanded = _NOWHERE
        if reference.state is WorkState.WORK and reference.X_WG is not None:
            commanded = reference.X_WG[:3, 3] + (truth.time - reference.time) * reference.v_WG_W

        self._rows.append(
            np.concatenate(
                (
                    (truth.time, reference.set_force, felt, truth.contact_normal),
                    truth.p_pad - commanded,
                    reference.v_WG_W,
                    truth.R_WG[:, 2],
                    truth.p_WB - reference.X_WB[:3, 3],
                    truth.thrust,
                    truth.q,
                    truth.tau_drive,
                    felt_W,
                    truth.contact_force_W,
                    moment.estimate.X_WB[:3, 3] - truth.p_WB,
                    moment.estimate.position_sigma,
                )
            )
        )

    def send(self, stream: LogStream) -> None:
        """Send the rows so far, and forget them."""
        if not self._rows:
            return

        parts = _columns(self._rows, self._widths)
        time, force, error, velocity, axis, drift, thrust, q, tau, felt_W, true_W, off, sigma = (
            parts
        )

        # Errors along and across the path, and along the tool axis.
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        tangent = np.divide(velocity, speed, out=np.full_like(velocity, np.nan), where=speed > 1e-6)
        deviation = [
            np.sum(error * way, axis=1) for way in (tangent, np.cross(axis, tangent), axis)
        ]
        across = [np.linalg.norm(np.cross(axis, of_W), axis=1) for of_W in (felt_W, true_W)]

        for name, columns in (
            ("force", force),
            ("tangential_force", np.column_stack(across)),
            ("path_error", 1e3 * np.column_stack(deviation)),
            ("hull_drift", 1e3 * drift),
            ("thrust", thrust),
            ("joint_angle", np.degrees(q)),
            ("joint_torque", tau),
            ("navigation", 1e3 * np.column_stack([off, sigma])),
        ):
            stream.columns(f"series/{name}", time[:, 0], _rr().Scalars.columns(scalars=columns))

        if self._bound is not None:
            both = np.tile([self._bound, -self._bound], (2, 1))
            stream.columns(
                "series/path_error/bound", time[[0, -1], 0], _rr().Scalars.columns(scalars=both)
            )


class PoseRows:
    """Poses of the vehicle's bodies, arrows of forces, jets and current, and the worked path."""

    def __init__(
        self, vehicle: Vehicle, moving: Sequence[tuple[int, str]], thrusters_B: Array
    ) -> None:
        """Take the bodies.

        Args:
            vehicle: the vehicle.
            moving: index and entity of each body whose pose changes.
            thrusters_B: (m, 3) [m] places of the thrusters, hull axes.
        """
        k, m = len(moving), len(thrusters_B)
        self._thrusters_B = thrusters_B
        self._pushes_B = np.asarray(vehicle.thruster_wrench)[:3].T
        self._arm_base = vehicle.arm_base
        self._bodies = np.array([body for body, _ in moving])
        self._entities = [entity for _, entity in moving]
        self._widths = (1, 1, 3 * k, 4 * k, 3, 3, 3, 3, 3, 3, 3, 9, m)

        self._rows: list[Array] = []
        self._tip: Array | None = None

    def add(self, moment: Moment) -> None:
        """Keep one step."""
        truth = moment.truth
        load = moment.command.hull_load
        working = moment.reference.state is WorkState.WORK

        self._rows.append(
            np.concatenate(
                (
                    (truth.time, working),
                    truth.xpos[self._bodies].ravel(),
                    truth.xquat[self._bodies].ravel(),
                    truth.p_pad,
                    truth.R_WG[:, 2],
                    truth.contact_force_W,
                    truth.xpos[self._arm_base],
                    truth.p_WB,
                    _STILL if load is None else truth.R_WB @ load.arm_wrench_B[:3],
                    truth.current_W,
                    truth.R_WB.ravel(),
                    truth.thrust,
                )
            )
        )

    def send(self, stream: LogStream) -> None:
        """Send the rows so far, and forget them."""
        if not self._rows:
            return

        rr = _rr()
        rows = len(self._rows)
        k = len(self._entities)
        parts = _columns(self._rows, self._widths)
        time, working, p, quat_wxyz, tip, axis, contact, base, hull, arm, current, R_WB, thrust = (
            parts
        )

        # Bodies.
        time = time[:, 0]
        p = p.reshape(rows, k, 3)
        quat_wxyz = quat_wxyz.reshape(rows, k, 4)
        for i, entity in enumerate(self._entities):
            xyzw = np.roll(quat_wxyz[:, i], -1, axis=1)  # Rerun's order
            stream.columns(
                entity, time, rr.Transform3D.columns(translation=p[:, i], quaternion=xyzw)
            )

        # Arrows.
        above = hull + np.array([0.0, 0.0, 0.6])
        for name, origin, vector in (
            ("contact", tip, FORCE_SCALE * contact),
            ("arm_on_hull", base, FORCE_SCALE * arm),
            ("current", above, CURRENT_SCALE * current),
        ):
            stream.columns(
                f"world/arrows/{name}", time, rr.Arrows3D.columns(origins=origin, vectors=vector)
            )

        # Jets, against the thrust.
        R_WB = R_WB.reshape(rows, 3, 3)
        places = np.einsum("nij,kj->nki", R_WB, self._thrusters_B) + hull[:, None]
        jets = -JET_SCALE * thrust[:, :, None] * np.einsum("nij,kj->nki", R_WB, self._pushes_B)
        arrows = rr.Arrows3D.columns(origins=places.reshape(-1, 3), vectors=jets.reshape(-1, 3))
        stream.columns("world/arrows/jets", time, arrows.partition([len(self._thrusters_B)] * rows))

        # over the planned one
        self._send_done(stream, time, working[:, 0] > 0.0, tip - 2.0 * LIFT * axis)

    def _send_done(self, stream: LogStream, time: Array, working: np.ndarray, tip: Array) -> None:
        """Send the parts of the path worked since the last pose; the view shows older ones too."""
        start = np.vstack([tip[:1] if self._tip is None else self._tip, tip[:-1]])
        self._tip = tip[-1:]
        if not working.any():
            return

        pieces = np.stack([start, tip], axis=1)[working]
        stream.columns(
            "world/path/done", time[working], _rr().LineStrips3D.columns(strips=list(pieces))
        )


def _columns(rows: list[Array], widths: Sequence[int]) -> list[Array]:
    """Columns of a table, which is emptied, as blocks of these widths."""
    table = np.array(rows)
    rows.clear()
    return np.split(table, np.cumsum(widths)[:-1], axis=1)


def _rr() -> Any:
    import rerun  # loaded by then: the stream is open

    return rerun
