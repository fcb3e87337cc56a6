"""Poses of the bodies of a model over a run, as recorded, and the points to be seen in them."""

import mujoco
import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import FARTHEST, Array
from uuv.sim.loop.recording import RecordedSeries

SERIES = "body_pose"
AROUND = 0.9  # [m] of the tool's places within which an object is part of the work
AROUND_HULL = 2.0  # [m] likewise of the hull's, where no tool works


class Poses:
    """Recorded poses of all bodies, put into a model's data without any dynamics."""

    def __init__(self, model: mujoco.MjModel, recorded: RecordedSeries) -> None:
        """Take the poses of a run.

        Args:
            model: The plant's.
            recorded: The run.

        Raises:
            ConfigurationError: They were not recorded, are those of another model, not finite, or
                beyond FARTHEST.
        """
        if SERIES not in recorded:
            raise ConfigurationError("a picture needs the poses of a run recorded in full")
        series = recorded[SERIES]
        if series.value.shape[1] != 7 * model.nbody or not len(series.time):
            raise ConfigurationError(
                f"its poses are of {series.value.shape[1] / 7:g} bodies, its scenario has "
                f"{model.nbody}"
            )
        poses = series.value.reshape(-1, model.nbody, 7)
        if not (np.abs(poses) < FARTHEST).all():
            raise ConfigurationError(f"a recorded pose is not finite, or beyond {FARTHEST:g} m")

        self.time = series.time  # (N,) [s]
        self.data = mujoco.MjData(model)
        self.vehicle = Vehicle.of(model)
        self._model = model
        self._poses = poses
        grounds = [int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)]
        self._ground = np.isin(model.geom_type, grounds)  # (geoms,)

    def row(self, time: float) -> int:
        """Row whose time is nearest to `time` [s]."""
        return int(np.abs(self.time - time).argmin())

    def put(self, row: int) -> None:
        """Places the bodies and geoms of `data` as in a row."""
        model = self._model
        data = self.data
        data.xpos[:] = self._poses[row, :, :3]
        data.xquat[:] = self._poses[row, :, 3:]

        # Matrices of bodies, and geoms on them.
        for body in range(model.nbody):
            mujoco.mju_quat2Mat(data.xmat[body], data.xquat[body])
        turn = np.empty(4)
        for geom in range(model.ngeom):
            body = model.geom_bodyid[geom]
            mujoco.mju_rotVecQuat(data.geom_xpos[geom], model.geom_pos[geom], data.xquat[body])
            data.geom_xpos[geom] += data.xpos[body]
            mujoco.mju_mulQuat(turn, data.xquat[body], model.geom_quat[geom])
            mujoco.mju_quat2Mat(data.geom_xmat[geom], turn)

    def extent(self, rows: np.ndarray, tool_W: Array) -> Array:
        """Points (N, 3) [m] in W about hull, arm, tool, and the object near the tool's places.

        Args:
            rows: Rows to be seen.
            tool_W: (M, 3) [m] places of the tool; none: the object near the hull.
        """
        model = self._model
        hull = self.vehicle.hull
        points = []
        around = AROUND if len(tool_W) else AROUND_HULL
        for row in rows:
            self.put(int(row))
            points.append(self.data.xpos[None, hull].copy())
            near_W = tool_W if len(tool_W) else self.data.xpos[None, hull]
            for geom in np.flatnonzero((model.geom_rgba[:, 3] > 0.0) & ~self._ground):
                corners = self._corners(int(geom))
                if model.body_rootid[model.geom_bodyid[geom]] == model.body_rootid[hull]:
                    points.append(corners)
                else:  # of a large object, what is near the work
                    low = near_W.min(axis=0) - around
                    high = near_W.max(axis=0) + around
                    if (corners.max(axis=0) > low).all() and (corners.min(axis=0) < high).all():
                        points.append(np.clip(corners, low, high))

        return np.concatenate(points)

    def _corners(self, geom: int) -> Array:
        """Corners (8, 3) [m] in W of the box about a geom."""
        middle = self._model.geom_aabb[geom, :3]
        half = self._model.geom_aabb[geom, 3:]
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        R_WG = self.data.geom_xmat[geom].reshape(3, 3)
        return (middle + signs * half) @ R_WG.T + self.data.geom_xpos[geom]
