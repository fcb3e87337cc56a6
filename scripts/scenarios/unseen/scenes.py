"""Seeded scenes with an unseen object, or with something else in its place, as one frame of a sensor.

    scene = build(present(seed=0, index=17))
    found = identify(scene.scan, scene.target, scene.approach, sensor=scene.sensor.model)

The world is the camera's frame C. Frame F stands under the object's centre with z up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from models.meshes.closed_shells import box, joined, sphere
from models.meshes.ray_casting import RayScene
from models.objects.target_model import Symmetry, TargetModel
from perception.clouds.scan import Scan
from scenarios.object_scenes import FOCAL, SENSORS, Camera, Imager
from scenarios.unseen.grammar import KINDS, UnseenShape, any_rotation, unseen_shape
from scenarios.unseen.likeness import Likeness
from scenarios.unseen.solids import Solid3, cylinder, moved, scaled
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.spatial import Array, exp_so3, inverse, pose, readonly, rotation_from_z, transform_points
from sim.sensors.depth_camera import DepthCamera, Optics
from sim.sensors.stereo_noise import StereoNoise

Rng = np.random.Generator
Content = Literal["present", "absent", "other", "mirrored", "resized", "pile"]
Around = Literal["alone", "clutter", "touching", "pile"]
WRONG: tuple[Content, ...] = ("absent", "other", "mirrored", "resized")
SURROUNDINGS: tuple[Around, ...] = ("alone", "clutter", "touching")
HIDDEN: Mapping[str, tuple[float, float]] = {  # classes of occlusion: share of the object's image that others hide
    "none": (0.0, 0.005),
    "little": (0.005, 0.2),
    "much": (0.2, 0.6),
}
DEPTH_SENSORS: Mapping[str, Camera | Imager] = {
    "white": SENSORS["white"],
    "stereo": SENSORS["stereo"],
    "quantised": Camera(stereo=StereoNoise(disparity_sigma=0.1, correlation=1.0, disparity_step=0.25)),
}
UNSEEN_SENSORS: Mapping[str, Camera | Imager] = {**DEPTH_SENSORS, "sonar": SENSORS["sonar"]}
PILE = 5  # objects of a pile
RESIZED = 0.05  # [-] by which a resized object is larger or smaller
_ORDER = ("none", "much", "little", "none", "little", "much", "none", "little", "much", "none")  # 40, 30, 30 %
_HAND = 0.04  # [-] least share in which a shape differs from its mirror image, for a scene with that
_APPROACH = 0.3  # [m] largest error of the coarse position
_TILT = np.deg2rad(45.0)  # [rad] largest error of the coarse attitude
_RANGES = (1.0, 2.0)  # [m] from the camera to the object
_VIEW = 2.3  # [radii] least distance, so that the object fits in the image
_NEAR_SMALL = 6.0  # [extents] largest distance of a small object
_CLIMB = (np.deg2rad(15.0), np.deg2rad(75.0))  # [rad] of the camera above the horizon
_ROLL = np.deg2rad(15.0)  # [rad] largest roll of the camera, either way
_IN_VIEW = 0.98  # [-] least share of the object's corners within the image
_LEAST_PIXELS = 1200  # of the object's image, occluded parts included
_ATTEMPTS = 40  # draws of a scene until it meets its conditions
_GOAL = 0.05  # [-] by which the occlusion may miss its goal
_COARSE = 4  # [px] between the rays by which occluders are placed
_AFAR = 4.0  # [m] from which a body is pushed towards the others
_TRIES = 8  # places tried for each object of a pile
_TOUCH = 600  # points of each body that look for the first contact


@dataclass(frozen=True, slots=True)
class UnseenCase:
    """All that a scene depends on; a case of the study."""

    content: Content  # what stands in the object's place
    kind: str  # class of the shape, a name in `grammar.KINDS`
    hidden: str  # class of occlusion, a name in HIDDEN; of a pile: as it falls
    sensor: str  # name in UNSEEN_SENSORS
    around: Around  # what surrounds the object
    seed: int  # of the study
    index: int  # of the scene among those of this content
    member: int = 0  # which object of a pile is searched for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnseenScene:
    """One frame with the truth, and what identification is given."""

    case: UnseenCase
    target: TargetModel  # the model that is searched for
    shape: UnseenShape  # its shape
    likeness: Likeness  # of that shape to itself
    there: UnseenShape | None  # what stands in its place; None: nothing
    sensor: Camera | Imager
    scan: Scan
    exact: Array  # (h, w) [m] depth of the whole scene without noise, inf where there is nothing
    seen: np.ndarray  # (h, w) pixels of an ideal camera that show what is in the object's place
    X_CT: Array  # (4, 4) true pose of what is in its place
    approach: Array  # (3,) [m] coarse position of the target's centre, in C
    orientation: Array  # (3, 3) coarse rotation of T in C
    range_m: float  # [m] from the camera to the object
    hidden: float  # share of the object's image that is hidden, 0 if it is absent
    declared: bool  # the target declares its geometric symmetry


def present(seed: int, index: int, sensor: str | None = None) -> UnseenCase:
    """Case `index` with the object in its place: classes, occlusion, sensors and surroundings in turn."""
    kinds, block = tuple(KINDS), index // len(KINDS)
    k = index % len(kinds)
    names = tuple(DEPTH_SENSORS)
    return UnseenCase(
        content="present",
        kind=kinds[k],
        hidden=_ORDER[(block + 3 * k) % len(_ORDER)],
        sensor=sensor or names[(block + k) % len(names)],
        around=SURROUNDINGS[(block // 3 + k // 3) % len(SURROUNDINGS)],
        seed=seed,
        index=index,
    )


def wrong(seed: int, index: int, sensor: str | None = None) -> UnseenCase:
    """Case `index` with nothing, another object, the mirrored or the resized one in the object's place, in turn."""
    case = present(seed, index // len(WRONG) + 3 * (index % len(WRONG)), sensor)
    return replace(case, content=WRONG[index % len(WRONG)], index=index)


def piled(seed: int, index: int) -> UnseenCase:
    """Case `index` of the objects in piles of PILE: five cases in a row have the same pile and another member."""
    pile, member = divmod(index, PILE)
    case = present(seed, PILE * pile)
    sensor = tuple(DEPTH_SENSORS)[pile % len(DEPTH_SENSORS)]
    return replace(case, content="pile", hidden="", around="pile", sensor=sensor, index=pile, member=member)


def build(case: UnseenCase) -> UnseenScene:
    """The scene of a case; the same case always gives the same scene.

    Raises:
        ConfigurationError: A name in the case is unknown, or no draw of the scene meets its conditions.
    """
    if case.sensor not in UNSEEN_SENSORS:
        raise ConfigurationError(f"no sensor {case.sensor!r}; there are {', '.join(UNSEEN_SENSORS)}")
    if case.kind not in KINDS:
        raise ConfigurationError(f"no class of shapes {case.kind!r}; there are {', '.join(KINDS)}")
    if case.content != "pile" and case.hidden not in HIDDEN:
        raise ConfigurationError(f"no class of occlusion {case.hidden!r}; there are {', '.join(HIDDEN)}")
    for attempt in range(_ATTEMPTS):
        drawn = _Draw(case, attempt).scene()
        if drawn is not None:
            return drawn
    raise ConfigurationError(f"{case}: none of {_ATTEMPTS} draws meets its conditions")


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """A body in the scene."""

    solid: Solid3  # in F
    rays: RayScene
    points: Array  # (n, 3) [m] on its surface, in F

    @classmethod
    def of(cls, solid: Solid3, rng: Rng) -> "_Body":
        vertices, triangles = solid
        corner = vertices[triangles]
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        which = rng.choice(len(area), _TOUCH, p=area / area.sum())
        points = np.einsum("ni,nij->nj", rng.dirichlet(np.ones(3), _TOUCH), corner[which])
        some = rng.permutation(len(vertices))[:_TOUCH]
        return cls(solid, RayScene(vertices, triangles), np.vstack([points, vertices[some]]))

    def moved(self, p: Array) -> "_Body":
        """The body shifted by `p` (3,) [m]."""
        solid = moved(self.solid, pose(p=p))
        return _Body(solid, RayScene(*solid), self.points + p)


class _Draw:
    """One draw of a scene, with a stream of random numbers for each part of it."""

    def __init__(self, case: UnseenCase, attempt: int) -> None:
        contents = ("present", *WRONG, "pile")
        streams = np.random.SeedSequence([case.seed, contents.index(case.content), case.index, attempt]).spawn(6)
        kinds = tuple(KINDS)
        self.case = case
        # Not every class has shapes with a hand; then the next class is tried.
        later = attempt // 4 if case.content == "mirrored" else 0
        self.kind = kinds[(kinds.index(case.kind) + later) % len(kinds)]
        self.model, self.view, self.others, self.veil, self.noise, self.start = map(np.random.default_rng, streams)

    def scene(self) -> UnseenScene | None:
        """The scene; None if it does not meet the conditions of its case."""
        case = self.case
        shape, there = self._shapes()
        likeness = Likeness(shape)
        if case.content == "mirrored" and likeness.mirror_share < _HAND:
            return None
        rests = case.around in ("touching", "pile") or self.model.random() < 0.5
        stand_in = there or shape  # where nothing is, it is as if the object were taken away
        R = resting_attitude(stand_in, self.model) if rests else any_rotation(self.model)
        gap = 0.0 if rests else float(self.model.uniform(0.03, 0.4))
        bodies: list[_Body] = []
        if case.content == "pile":
            shapes = [shape if k == case.member else self._member(k) for k in range(PILE)]
            poses = _heaped(shapes, self.others)
            X_FT = poses[case.member]
            object_ = (transform_points(X_FT, shape.vertices), shape.triangles)
            bodies = [
                _Body.of((transform_points(X, s.vertices), s.triangles), self.others)
                for k, (s, X) in enumerate(zip(shapes, poses, strict=True))
                if k != case.member
            ]
            ground = 0.0
        else:
            X_FT = pose(R)
            object_ = (transform_points(X_FT, stand_in.vertices), stand_in.triangles)
            ground = float(object_[0][:, 2].min()) - gap
        X_CF, range_m = self._camera(X_FT[:3, 3], stand_in)
        if not _in_view(X_CF, object_[0]):
            return None
        body = _Body.of(object_, self.others)
        if case.around in ("clutter", "touching"):
            bodies += self._neighbours(body, X_CF, ground)
        if case.content != "pile" or self.others.random() < 0.5:
            bodies += [self._stone(body, ground) for _ in range(int(self.others.integers(0, 4)))]
        seabed = _seabed(ground, self.others) if case.around != "alone" or self.others.random() < 0.8 else []
        veil = self._occluders(body, bodies, X_CF) if case.content != "pile" else []
        if veil is None:
            return None
        return self._taken(shape, there, likeness, X_CF, X_FT, body, [*bodies, *veil], seabed, range_m)

    def _shapes(self) -> tuple[UnseenShape, UnseenShape | None]:
        """Shape that is searched for, and the one in its place, None if it is absent."""
        case = self.case
        if case.content == "pile":
            shape = self._member(case.member)
            return shape, shape
        shape = unseen_shape(self.kind, self.model)
        if case.content == "absent":
            return shape, None
        if case.content == "other":
            return shape, unseen_shape(self.kind, self.model, (0.8 * shape.extent, 1.2 * shape.extent))
        if case.content == "mirrored":
            return shape, shape.mirrored()
        if case.content == "resized":
            return shape, shape.resized(1.0 + RESIZED * (1.0 if self.model.random() < 0.5 else -1.0))
        return shape, shape

    def _member(self, k: int) -> UnseenShape:
        """Shape `k` of a pile; no two are of one class."""
        rng = np.random.default_rng([self.case.seed, 1000 + self.case.index, k])
        order = np.random.default_rng([self.case.seed, 1000 + self.case.index]).permutation(len(KINDS))
        return unseen_shape(tuple(KINDS)[order[k]], rng, (0.25, 0.6))

    def _camera(self, p_F: Array, shape: UnseenShape) -> tuple[Array, float]:
        """X_CF (4, 4) of a camera that looks at `p_F` (3,) [m], or a little beside it, and its distance [m]."""
        near = max(_RANGES[0], _VIEW * shape.radius)
        far = max(near + 0.1, min(_RANGES[1], _NEAR_SMALL * shape.extent))
        rng = self.view
        range_m = float(rng.uniform(near, far))
        up = rng.uniform(*np.sin(_CLIMB))
        heading, roll = rng.uniform([-np.pi, -_ROLL], [np.pi, _ROLL])
        flat = np.sqrt(1.0 - up**2)
        eye = p_F + range_m * np.array([flat * np.cos(heading), flat * np.sin(heading), up])
        z = p_F + rng.normal(0.0, 0.02 * range_m, 3) - eye
        R = rotation_from_z(z, np.cross(z, [0.0, 0.0, 1.0])) @ exp_so3([0.0, 0.0, roll])
        return inverse(pose(R, eye)), range_m

    def _neighbours(self, body: _Body, X_CF: Array, ground: float) -> list[_Body]:
        """Shapes of the same and other classes beside the object, on the ground; they touch it, or stand clear."""
        touching = self.case.around == "touching"
        away = -inverse(X_CF)[:2, 2]  # horizontally towards the camera
        heading_camera = float(np.arctan2(away[1], away[0]))
        extent = float(np.ptp(body.solid[0], axis=0).max())
        bodies: list[_Body] = []
        for _ in range(int(self.others.integers(1, 4 if touching else 5))):
            kind = self.kind if self.others.random() < 0.6 else _one_of(tuple(KINDS), self.others)
            size = float(np.clip(extent * self.others.uniform(0.4, 1.0), 0.15, 0.8))
            shape = unseen_shape(kind, self.others, (size, 1.01 * size))
            R = resting_attitude(shape, self.others)
            vertices = shape.vertices @ R.T
            vertices[:, 2] += ground - vertices[:, 2].min()
            # Beside and behind rather than in front: what hides the object is drawn apart.
            spread = np.pi if self.case.hidden == "much" else 0.6 * np.pi
            heading = heading_camera + np.pi + self.others.uniform(-spread, spread)
            way = np.array([np.cos(heading), np.sin(heading), 0.0])
            gap = 0.0 if touching else float(self.others.uniform(0.02, 0.25))
            start = _Body.of((vertices, shape.triangles), self.others)
            placed = _slid(start, [body, *bodies], -way, gap)
            if placed is None and touching and not bodies:  # it passes the object, so it is lifted to its height
                lift = float(np.mean(body.points[:, 2]) - np.mean(start.points[:, 2]))
                placed = _slid(start.moved(np.array([0.0, 0.0, lift])), [body], -way, gap)
            if placed is None and not touching:
                reach = float(np.linalg.norm(body.solid[0][:, :2], axis=1).max())
                placed = start.moved((reach + shape.radius + gap) * way)
            if placed is not None:
                bodies.append(placed)
        return bodies

    def _stone(self, body: _Body, ground: float) -> _Body:
        """Ellipsoid half in the seabed, clear of the object."""
        rng = self.others
        size = rng.uniform(0.02, 0.12, 3)
        vertices, triangles = scaled(sphere(3), size)
        reach = float(np.linalg.norm(body.solid[0][:, :2], axis=1).max()) + size.max() + rng.uniform(0.03, 0.6)
        heading = rng.uniform(-np.pi, np.pi)
        X = pose(exp_so3(rng.normal(0.0, 0.4, 3)), [reach * np.cos(heading), reach * np.sin(heading), ground])
        return _Body.of(moved((vertices, triangles), X), rng)

    def _occluders(self, body: _Body, others: Sequence[_Body], X_CF: Array) -> list[_Body] | None:
        """Rods, boards and stones between camera and object that hide it as the case asks; None if that fails."""
        rng = self.veil
        low, high = HIDDEN[self.case.hidden]
        rays = pinhole(_COARSE)
        X_FC = inverse(X_CF)
        ways = rays.reshape(-1, 3) @ X_FC[:3, :3].T
        t = body.rays.distance(X_FC[:3, 3], ways)
        on = np.isfinite(t)
        if not on.any():
            return None
        ways, t = ways[on], t[on]
        hidden = np.zeros(len(t), dtype=bool)
        for other in others:
            hidden |= other.rays.distance(X_FC[:3, 3], ways) < t
        goal = 0.0 if high < 0.01 else float(rng.uniform(max(low, 0.03), high - 0.02))
        veil: list[_Body] = []
        seen = X_FC[:3, 3] + t[:, None] * ways
        spread = float(np.linalg.norm(seen - seen.mean(axis=0), axis=1).max())
        for _ in range(60):
            if abs(hidden.mean() - goal) < _GOAL and low <= hidden.mean() <= high:
                return veil
            if hidden.mean() > goal:
                return None
            nearness = rng.uniform(0.45, 0.85)
            at = X_FC[:3, 3] + nearness * (seen[rng.integers(len(seen))] - X_FC[:3, 3])
            solid = _occluder(rng, nearness * spread)
            new = _Body.of(moved(solid, pose(any_rotation(rng), at)), rng)
            now = hidden | (new.rays.distance(X_FC[:3, 3], ways) < t)
            if now.mean() <= goal + 0.8 * _GOAL:
                hidden = now
                veil.append(new)
        return None

    def _taken(
        self,
        shape: UnseenShape,
        there: UnseenShape | None,
        likeness: Likeness,
        X_CF: Array,
        X_FT: Array,
        body: _Body,
        others: Sequence[_Body],
        seabed: Sequence[Solid3],
        range_m: float,
    ) -> UnseenScene | None:
        """The frame and its truth; None if occlusion or size of the image are not those of the case."""
        case = self.case
        rest = [solid for other in others for solid in (other.solid,)]
        whole = [*rest, *seabed] if there is None else [body.solid, *rest, *seabed]
        model = _compiled([moved(solid, X_CF) for solid in whole])
        exact, alone = _depth(model), _depth(_compiled([moved(body.solid, X_CF)]))
        image = np.isfinite(alone)
        seen = image & (exact > alone - 1e-4) if there is not None else np.zeros_like(image)
        hidden = 0.0 if there is None else 1.0 - float(seen.sum() / max(1, image.sum()))
        if image.sum() < _LEAST_PIXELS:
            return None
        if (
            case.content != "pile"
            and there is not None
            and not HIDDEN[case.hidden][0] <= hidden <= HIDDEN[case.hidden][1]
        ):
            return None
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        sensor = UNSEEN_SENSORS[case.sensor]
        try:
            scan = sensor.look(model, data, self.noise)
        except PerceptionError:  # an empty ping
            return None
        X_CT = X_CF @ X_FT
        declared = bool(self.start.random() < 0.5)
        target = shape.target(likeness.symmetry if declared else Symmetry())
        aside, axis = self.start.normal(size=(2, 3))
        distance, angle = self.start.uniform(size=2) * (_APPROACH, _TILT)
        approach = transform_points(X_CT, target.center) + distance * aside / np.linalg.norm(aside)
        return UnseenScene(
            case=case,
            target=target,
            shape=shape,
            likeness=likeness,
            there=there,
            sensor=sensor,
            scan=scan,
            exact=readonly(exact),
            seen=seen,
            X_CT=readonly(X_CT),
            approach=readonly(approach),
            orientation=readonly(exp_so3(angle * axis / np.linalg.norm(axis)) @ X_CT[:3, :3]),
            range_m=range_m,
            hidden=hidden,
            declared=declared,
        )


def resting_attitude(shape: UnseenShape, rng: Rng) -> Array:
    """Rotation (3, 3) in which a shape rests on flat ground, z up: on a side of its convex hull that carries it."""
    hull = ConvexHull(shape.vertices)
    normals, offsets = hull.equations[:, :3], -hull.equations[:, 3]
    feet = normals * offsets[:, None]  # of the centroid, which is the origin, on each side
    stable = (feet @ normals.T <= offsets + 1e-6 * shape.radius).all(axis=1)
    sides = normals[stable]
    down = sides[np.argmax(sides @ any_rotation(rng)[0])]
    R = rotation_from_z(-down, np.eye(3)[np.argmin(np.abs(down))]).T
    return exp_so3([0.0, 0.0, rng.uniform(-np.pi, np.pi)]) @ R


def _one_of(names: Sequence[str], rng: Rng) -> str:
    return names[int(rng.integers(len(names)))]


def _free_way(body: _Body, others: Sequence[_Body], way: Array) -> float:
    """Distance [m] by which a body can move along the unit vector `way` until it meets another; inf if it does not."""
    free = np.inf
    for other in others:
        free = min(free, float(other.rays.distance(body.points, np.broadcast_to(way, body.points.shape)).min()))
        back = body.rays.distance(other.points, np.broadcast_to(-way, other.points.shape))
        free = min(free, float(back.min()))
    return free


def _slid(body: _Body, others: Sequence[_Body], way: Array, gap: float) -> _Body | None:
    """A body pushed from afar along `way` up to `gap` [m] before the first of `others`; None if it passes them."""
    start = body.moved(-_AFAR * way)
    free = _free_way(start, others, way)
    return start.moved((free - gap) * way) if np.isfinite(free) else None


def _heaped(shapes: Sequence[UnseenShape], rng: Rng) -> list[Array]:
    """Poses X_FT (4, 4) of shapes that touch each other; each is let down on the others, or pushed against them."""
    poses: list[Array] = []
    bodies: list[_Body] = []
    for shape in shapes:
        R = resting_attitude(shape, rng)
        standing = _Body.of((shape.vertices @ R.T, shape.triangles), rng)
        standing = standing.moved(np.array([0.0, 0.0, -standing.solid[0][:, 2].min()]))
        options: list[_Body] = []
        for _ in range(_TRIES) if bodies else ():
            if len(bodies) % 2 == 1:  # along the ground
                heading = rng.uniform(-np.pi, np.pi)
                way = np.array([np.cos(heading), np.sin(heading), 0.0])
                pushed = _slid(standing, bodies, way, 0.0)
            else:  # from above
                aside = rng.normal(0.0, 0.3 * shape.extent, 2)
                above = standing.moved(np.array([*aside, 3.0]))
                fall = _free_way(above, bodies, np.array([0.0, 0.0, -1.0]))
                pushed = above.moved(np.array([0.0, 0.0, -fall])) if fall < 3.0 else None
            if pushed is not None:
                options.append(pushed)
        # The lowest one, and of those on the ground the one nearest to the middle.
        body = min(options, key=_height_and_reach, default=standing)
        X = pose(R, body.solid[0][0] - R @ shape.vertices[0])
        poses.append(X)
        bodies.append(body)
    return poses


def _height_and_reach(body: _Body) -> tuple[float, float]:
    middle = body.points.mean(axis=0)
    return round(float(middle[2]), 6), float(np.hypot(*middle[:2]))


def _occluder(rng: Rng, spread: float) -> Solid3:
    """Rod, board or stone around the origin that hides a part of an object of that spread [m]."""
    form = _one_of(("rod", "board", "stone"), rng)
    size = spread * rng.uniform(0.08, 0.45)
    if form == "rod":
        return cylinder(0.3 * size, 1.5, 16)
    if form == "board":
        return box([size, size * rng.uniform(0.5, 2.0), 0.01], np.zeros(3))
    return scaled(sphere(2), size * rng.uniform(0.5, 1.0, 3))


def _seabed(ground: float, rng: Rng) -> list[Solid3]:
    """Seabed at height `ground` [m] in F: flat, or with ripples below that height."""
    count, half = 110, 3.0
    grid = np.linspace(-half, half, count)
    x, y = np.meshgrid(grid, grid)
    height = np.zeros_like(x)
    if rng.random() < 0.5:
        deep, length = rng.uniform(0.003, 0.012), rng.uniform(0.25, 0.6)
        c, s = np.cos(turn := rng.uniform(0.0, np.pi)), np.sin(turn)
        wave = c * x + s * y + 0.05 * np.sin(3.0 * (c * y - s * x))
        height = deep * (np.sin(2.0 * np.pi * wave / length) - 1.0)
    index = np.arange(count * count).reshape(count, count)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return [(np.column_stack([x.ravel(), y.ravel(), ground + height.ravel()]), faces)]


def _in_view(X_CF: Array, vertices: Array) -> bool:
    p = transform_points(X_CF, vertices)
    limits = np.array([319.5, 239.5]) / FOCAL
    inside = (p[:, 2] > 0.3) & (np.abs(p[:, :2]) < limits * p[:, 2:]).all(axis=1)
    return bool(inside.mean() >= _IN_VIEW)


def pinhole(step: int) -> Array:
    """Lines of sight (h, w, 3) in C of every `step`-th pixel of the camera, scaled to a depth of 1."""
    x, y = np.meshgrid((np.arange(0, 640, step) - 319.5) / FOCAL, (np.arange(0, 480, step) - 239.5) / FOCAL)
    return np.asarray(np.stack([x, y, np.ones(x.shape)], axis=-1), dtype=np.float64)


def _compiled(solids: Sequence[Solid3]) -> mujoco.MjModel:
    """Model of visible meshes in C, fixed in the world."""
    spec = mujoco.MjSpec()
    vertices, triangles = joined(solids)
    spec.add_mesh(
        name="scene",
        uservert=vertices.astype(np.float32).ravel(),
        userface=triangles.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="scene", contype=0, conaffinity=0)
    return spec.compile()


def _depth(model: mujoco.MjModel) -> np.ndarray:
    """Depth (480, 640) [m] that an ideal camera sees, inf where there is nothing."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = DepthCamera(model, "world", np.eye(4), optics=Optics(focal=FOCAL), noise=None)
    return camera.render(data.xpos, data.xmat)[0]
