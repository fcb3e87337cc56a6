"""Rendered pictures of the camera on the arm, and their motion by direct alignment.

A case is one key picture and three pictures after it. Object, place, range, texture, turbidity,
silt, motion and the error of the predicted motion are drawn.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from uuv.experiment import column
from uuv.experiment.options import at_least
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.naming import TIP_SITE
from uuv.models.objects import targets
from uuv.models.objects.target_model import TargetModel
from uuv.models.vehicles import uuv_puma
from uuv.perception.navigation.surface_alignment import Alignment, align, prepare
from uuv.sensors.rendered_arm_camera import hidden_by, picture_noise
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, rotation_from_z
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.arm_camera import (
    GRID,
    KEY_SHIFT,
    ROTATION,
    Prediction,
    beside_tool,
    predict,
    tool_in_view,
)
from uuv.sim.sensors.textured_view import SmallStereo, Texture, Turbidity, expose
from uuv.sim.sensors.visible_world import Rays, body_id, site_on_body

OBJECTS = ("barrel", "barrel", "pile", "plate", "rock", "anode")
PICTURES = 3  # after each key
PLAIN = 0.1  # share of the cases with a surface without texture
CLOUDY = 0.4  # share of the cases with silt


@dataclass(frozen=True, kw_only=True)
class KeyCase:
    """One key picture and those after it."""

    draws: int = 1
    """Seed of what is drawn, beside the number of the picture."""
    seed: int
    """Number of the first key picture."""

    def __post_init__(self) -> None:
        at_least(self, draws=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRow:
    """Result of one picture, in the axes of the present camera."""

    lost: bool  # not aligned
    seen: float  # share of the view with a surface
    error: Sequence[float]  # (3,) [m] of the motion since the key
    stated: Sequence[float]  # (9,) [1/m^2] information that the tracker states
    texture: Sequence[float]  # (36,) predicted information by texture
    shape: Sequence[float]  # (36,) by shape
    condition: Sequence[float]  # (4,) as `ErrorModel` says


@dataclass(frozen=True, kw_only=True)
class KeyRow:
    """Conditions of a key picture, and an entry for each picture after it: `PictureRow`."""

    object: str = column("object")
    contrast: float = column("contrast of the texture")
    attenuation: float = column("attenuation", "1/m")
    range: float = column("range", "m")

    lost: Sequence[bool] = column("lost")
    seen: Sequence[float] = column("seen")
    error: Sequence[Sequence[float]] = column("error", "mm", factor=1e3)
    stated: Sequence[Sequence[float]] = column("stated information", "1/m^2")
    texture: Sequence[Sequence[float]] = column("information by texture")
    shape: Sequence[Sequence[float]] = column("information by shape")
    condition: Sequence[Sequence[float]] = column("condition")


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The vehicle's own tool in the camera's view."""

    depth: Array  # (height, width) [m], inf where it is not
    hidden: np.ndarray  # (height, width) bool
    hidden_coarse: np.ndarray  # the same on the coarse grid

    @classmethod
    def of(cls, camera: SmallStereo) -> "Tool":
        """The default vehicle's pad."""
        model = uuv_puma.build().compile()
        link, X_LG = site_on_body(model, TIP_SITE, "arm camera")
        X_LC = X_LG @ beside_tool()
        at = body_id(model, link, "arm camera")
        fine, coarse = (
            tool_in_view(model, at, X_LC, Rays.of(camera.rays(step), camera.near))
            for step in (1, GRID)
        )
        return cls(fine, hidden_by(fine), np.isfinite(coarse))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _KeyView:
    """What a key picture shows, and through which water."""

    target: TargetModel
    contrast: float  # [-] of the texture
    texture: Texture
    attenuation: float  # [1/m]
    clouds: Array  # (PICTURES,) [-] of the later pictures
    X_TK: Array  # (4, 4) pose of the camera

    @classmethod
    def drawn(cls, streams: Streams) -> "_KeyView":
        """A view of one of OBJECTS."""
        target = targets.named(OBJECTS[int(streams["object"].integers(len(OBJECTS)))])
        contrast = float(np.exp(streams["contrast"].uniform(*np.log((0.02, 0.4)))))
        contrast = 0.0 if streams["plain"].uniform() < PLAIN else contrast
        clouds = streams["clouds"].uniform(0.0, 0.8, PICTURES)
        gap = float(streams["gap"].uniform(0.0, 0.15))
        gap = 0.0 if streams["touching"].uniform() < 0.6 else gap

        return cls(
            target=target,
            contrast=contrast,
            texture=Texture.of(int(streams["texture"].integers(2**31)), contrast),
            attenuation=float(np.exp(streams["attenuation"].uniform(*np.log((0.15, 2.2))))),
            clouds=clouds * (streams["cloudy"].uniform() < CLOUDY),
            X_TK=_place(target, gap, streams["place"]),
        )


def aligned_pictures(case: KeyCase) -> KeyRow:
    """Renders the pictures of a case and aligns them."""
    streams = Streams(case.draws, case.seed)
    camera = SmallStereo()
    tool = Tool.of(camera)
    drawn = _KeyView.drawn(streams)
    X_TK = drawn.X_TK
    scene = RayScene(drawn.target.vertices, drawn.target.triangles)

    # The key picture.
    clear = Turbidity(attenuation=drawn.attenuation)
    key_hits = _hits(scene, camera, X_TK, tool)
    range_m = (
        float(np.median(key_hits[0][np.isfinite(key_hits[0]) & ~tool.hidden]))
        if _seen(key_hits, tool)
        else 0.17
    )
    noise = picture_noise(camera, drawn.attenuation, range_m)
    key = expose(camera, key_hits, X_TK, drawn.texture, clear, streams["key picture"])
    prepared = prepare(key.intensity, key.depth, tool.hidden, camera.focal, noise)

    # Later ones, aligned with it.
    pictures: list[PictureRow] = []
    for k, cloud in enumerate(drawn.clouds):
        water = Turbidity(attenuation=drawn.attenuation, cloud=float(cloud))
        X_KC = _motion(camera, range_m, streams[f"motion {k}"])
        X_TC = X_TK @ X_KC
        hits = _hits(scene, camera, X_TC, tool)
        picture = expose(camera, hits, X_TC, drawn.texture, water, streams[f"picture {k}"])

        guess = X_KC @ pose(exp_so3(ROTATION * streams[f"guessed turn {k}"].standard_normal(3)))
        guess[:3, 3] += 2e-3 * streams[f"guessed shift {k}"].standard_normal(3)
        later = prepare(picture.intensity, picture.depth, tool.hidden, camera.focal, noise)
        alignment = align(prepared, later, guess, ROTATION, noise)

        # What the simulated sensor would predict of this pair.
        step = slice(GRID // 2, None, GRID)
        depth = np.where(tool.hidden_coarse, np.inf, hits[0][step, step])
        across = float(np.hypot(X_KC[0, 3], X_KC[1, 3]))
        view = predict(camera, depth, tool.hidden_coarse, drawn.texture, water, across)
        pictures.append(_picture(alignment, X_KC, view))

    columns = [asdict(picture) for picture in pictures]
    return KeyRow(
        object=drawn.target.name,
        contrast=drawn.contrast,
        attenuation=drawn.attenuation,
        range=range_m,
        **{name: [picture[name] for picture in columns] for name in columns[0]},
    )


def _seen(hits: tuple[Array, Array], tool: Tool) -> bool:
    return bool((np.isfinite(hits[0]) & ~tool.hidden).any())


def _place(target: TargetModel, gap: float, rng: np.random.Generator) -> Array:
    """Pose X_TC (4, 4) of the camera with the tool somewhere on a path of the object, `gap` [m]
    above it.
    """
    path = next(iter(target.paths.values()))
    i = int(rng.integers(len(path.p)))
    z = np.asarray(path.a[i])
    X_TG = pose(rotation_from_z(z, rng.standard_normal(3)), np.asarray(path.p[i]) - gap * z)
    return X_TG @ pose(exp_so3(np.append(0.02 * rng.standard_normal(2), 0.0))) @ beside_tool()


def _motion(camera: SmallStereo, range_m: float, rng: np.random.Generator) -> Array:
    """Pose X_KC (4, 4) of a later picture in the key camera's axes."""
    heading = rng.uniform(-np.pi, np.pi)
    shift = rng.uniform(0.0, KEY_SHIFT) * camera.width / camera.focal * range_m
    p = shift * np.array([np.cos(heading), np.sin(heading), 0.0]) + [
        0.0,
        0.0,
        2e-3 * rng.standard_normal(),
    ]
    return pose(exp_so3(0.02 * rng.standard_normal(3)), p)


def _hits(scene: RayScene, camera: SmallStereo, X_TC: Array, tool: Tool) -> tuple[Array, Array]:
    """Exact depth and cosine of incidence (height, width); the tool is before the object."""
    ways = camera.rays().reshape(-1, 3) @ X_TC[:3, :3].T
    hit = scene.cast(np.broadcast_to(X_TC[:3, 3], ways.shape), ways)
    cosine = np.abs(np.sum(hit["normal"] * ways, axis=1)) / np.linalg.norm(ways, axis=1)
    depth = hit["t"].astype(np.float64).reshape(tool.depth.shape)
    nearer = tool.depth < depth
    return np.where(nearer, tool.depth, depth), np.where(nearer, 0.7, cosine.reshape(depth.shape))


def _picture(alignment: Alignment | None, X_KC: Array, view: Prediction) -> PictureRow:
    """Row of one picture."""
    lost = alignment is None or not alignment.settled
    error = np.zeros(3)
    stated = np.zeros((3, 3))
    if alignment is not None:
        R = X_KC[:3, :3]
        error = R.T @ (alignment.p_KC - X_KC[:3, 3])
        stated = R.T @ alignment.information_K @ R

    return PictureRow(
        lost=bool(lost),
        seen=view.seen,
        error=error.tolist(),
        stated=stated.ravel().tolist(),
        texture=view.texture.ravel().tolist(),
        shape=view.shape.ravel().tolist(),
        condition=view.condition.tolist(),
    )
