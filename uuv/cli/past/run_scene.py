"""Scene of a past run, put into its recorded poses and rendered: a still and a clip."""

import io
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from uuv.assembly import assemble
from uuv.models.vehicle import Vehicle
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import FARTHEST, Array
from uuv.sim.reporting.ray_picture import RayPicture
from uuv.sim.reporting.series_tables import PastRun
from uuv.sim.runs.saving import write_whole

WIDTH, HEIGHT = 960, 600  # [px]
FRAMES = 150  # number of frames of the clip: ten seconds
PACE = 15.0  # [frames/s]
MURK = 0.35  # [1/m] rate at which things behind the work fade into the colour of the water
# colour of the water, from top to bottom
_WATER = np.linspace([58.0, 110.0, 130.0], [16.0, 44.0, 60.0], HEIGHT)[:, None]


def render(scenario: Scenario, past: PastRun, still: Path, clip: Path) -> Iterator[Path]:
    """Renders a run into the files `still` and `clip`; yields each when it is written."""
    stage = RunScene(scenario, past)

    # The still: some seconds into the work.
    busy = [
        event.time for event in past.events if event.state in (WorkState.WORK, WorkState.INSERT)
    ]
    middle = stage.nearest(busy[0] + 5.0) if busy else len(stage.time) // 2
    write_whole(still, _encoded(stage.frame(middle), "png"))
    yield still

    # The clip, at even intervals.
    rows = np.linspace(0, len(stage.time) - 1, FRAMES).astype(int)
    first, *others = [stage.frame(row) for row in rows]
    later = [Image.fromarray(frame) for frame in others]
    pace = int(1e3 / PACE)
    write_whole(
        clip,
        _encoded(
            first, "webp", save_all=True, append_images=later, duration=pace, loop=0, quality=80
        ),
    )
    yield clip


def _encoded(frame: np.ndarray, ending: str, **options: Any) -> bytes:
    """Content of a picture file."""
    content = io.BytesIO()
    Image.fromarray(frame).save(content, format=ending, **options)
    return content.getvalue()


class GlPicture:
    """MuJoCo's renderer."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._renderer = mujoco.Renderer(model, height, width)

    def render(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> tuple[np.ndarray, Array]:
        """Colours (h, w, 3) and depth (h, w) [m]."""
        renderer = self._renderer
        renderer.update_scene(data, camera)
        colours = renderer.render()
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.disable_depth_rendering()
        return colours, depth


def _view(model: mujoco.MjModel) -> GlPicture | RayPicture:
    """MuJoCo's renderer, or ray casting where there is no OpenGL."""
    try:
        return GlPicture(model, HEIGHT, WIDTH)
    except Exception as error:  # of any kind: it depends on what is missing
        print(
            f"no OpenGL here ({one_line(str(error), 80)}): pictures by ray casting", file=sys.stderr
        )
        return RayPicture(model, HEIGHT, WIDTH)


class RunScene:
    """Scene of a past run, put into the recorded poses and rendered from the side of the arm."""

    def __init__(self, scenario: Scenario, past: PastRun) -> None:
        built = assemble(scenario)
        self._model = built.plant.model
        vehicle = Vehicle.of(built.plant.model)
        self._data = mujoco.MjData(self._model)
        self._vehicle = vehicle
        self.time = past.numbers("time", "slow")
        self._q = np.column_stack(
            [past.numbers(f"q.{name}", "slow") for name in vehicle.joint_names]
        )

        every = np.searchsorted(past.numbers("time"), self.time)
        hull = [past.numbers(f"p_WB.{axis}") for axis in "xyz"]
        hull += [past.numbers(f"quat_WB_wxyz.{part}") for part in "wxyz"]
        for series in (self._q, *hull):
            if not (np.abs(series) < FARTHEST).all():
                raise ConfigurationError(
                    f"{past.folder}: a recorded pose is not finite, or beyond {FARTHEST:g} m"
                )
        self._hull = np.column_stack(hull)[np.minimum(every, len(hull[0]) - 1)]

        light = self._model.vis.headlight
        light.ambient[:], light.diffuse[:], light.specular[:] = 0.5, 0.6, 0.1

        self._view = _view(self._model)
        self._camera = mujoco.MjvCamera()
        self._aim()

    def nearest(self, time: float) -> int:
        """Row whose time is nearest to `time` [s]."""
        return int(np.abs(self.time - time).argmin())

    def frame(self, row: int) -> np.ndarray:
        """Picture (HEIGHT, WIDTH, 3) of the scene at a row."""
        self._put(row)
        colours, depth = self._view.render(self._data, self._camera)
        clear = np.exp(-MURK * np.maximum(depth - self._camera.distance, 0.0))[..., None]
        return (clear * colours + (1.0 - clear) * _WATER).astype(np.uint8)

    def _put(self, row: int) -> None:
        at = self._vehicle.hull_qpos
        self._data.qpos[at : at + 7] = self._hull[row]
        self._data.qpos[self._vehicle.qpos] = self._q[row]
        mujoco.mj_forward(self._model, self._data)

    def _aim(self) -> None:
        """Aim at the middle of all tool and hull positions, from a distance that shows both."""
        # Sampled over the whole run.
        places: list[Array] = []
        for row in np.linspace(0, len(self.time) - 1, 20).astype(int):
            self._put(row)
            places += [
                self._data.site_xpos[self._vehicle.tip].copy(),
                self._data.xpos[self._vehicle.hull].copy(),
            ]

        low, high = np.min(places, axis=0), np.max(places, axis=0)
        camera = self._camera
        ahead = self._data.xmat[self._vehicle.hull].reshape(3, 3)[:, 0]

        camera.lookat[:] = 0.5 * (low + high) - [0.0, 0.0, 0.15]
        camera.distance = 1.5 * float(np.linalg.norm(high - low)) + 2.0
        camera.azimuth = math.degrees(math.atan2(ahead[1], ahead[0])) + 120.0
        camera.elevation = -18.0
