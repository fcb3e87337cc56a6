"""Seeded scenes with an unseen object, or with something else in its place, as one frame of a
sensor.

    scene = build(present(seed=0, index=17))
    found = identify(scene.scan, scene.target, scene.approach, sensor=scene.sensor.model)

The world is the camera's frame C. Frame F stands under the object's centre with z up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from experiments.identification.unseen.grammar import KINDS, UnseenShape, unseen_shape
from experiments.identification.unseen.likeness import Likeness
from uuv.clouds.frames import (
    FOCAL,
    MIDDLE,
    SENSORS,
    Camera,
    Imager,
    ObjectScene,
    camera_pose,
    coarse_pose,
    meshed,
    viewpoint,
)
from uuv.clouds.object_scenes import RANGES
from uuv.clouds.placing import (
    COARSE,
    Body,
    any_rotation,
    beside,
    heaped,
    hidden_by,
    resting_attitude,
    seabed,
    stone,
    veil,
)
from uuv.models.meshes.closed_shells import Shell, moved
from uuv.models.objects.target_model import Symmetry
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.spatial import Array, inverse, one_of, pose, readonly, transform_points
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.stereo_noise import StereoNoise

Content = Literal["present", "absent", "other", "mirrored", "resized", "pile"]
Around = Literal["alone", "clutter", "touching", "pile"]
WRONG: tuple[Content, ...] = ("absent", "other", "mirrored", "resized")
SURROUNDINGS: tuple[Around, ...] = ("alone", "clutter", "touching")
# classes of occlusion: share of the object's image that others hide
HIDDEN: Mapping[str, tuple[float, float]] = {
    "none": (0.0, 0.005),
    "little": (0.005, 0.2),
    "much": (0.2, 0.6),
}
DEPTH_SENSORS: Mapping[str, Camera | Imager] = {
    "white": SENSORS["white"],
    "stereo": SENSORS["stereo"],
    "quantised": Camera(
        stereo=StereoNoise(disparity_sigma=0.1, correlation=1.0, disparity_step=0.25)
    ),
}
UNSEEN_SENSORS: Mapping[str, Camera | Imager] = {**DEPTH_SENSORS, "sonar": SENSORS["sonar"]}
PILE = 5  # objects of a pile
RESIZED = 0.05  # [-] by which a resized object is larger or smaller
_CONTENTS = ("present", *WRONG, "pile")
# 40, 30, 30 %
_ORDER = ("none", "much", "little", "none", "little", "much", "none", "little", "much", "none")
# [-] least share in which a shape differs from its mirror image, for a scene with that
_HAND = 0.04
# share of the objects that lie on the seabed where nothing touches them; others hang above it
_RESTS = 0.5
_HANGS = (0.03, 0.4)  # [m] above the seabed
_GROUND = 0.8  # share of the scenes without neighbours that show a seabed
_SIMILAR = 0.6  # share of the neighbours that are of the object's class
_DECLARED = 0.5  # share of the targets that declare their geometric symmetry
_OF_PILE = (0.2, 0.45)  # [m] extents of the objects of a pile
_APPROACH = 0.3  # [m] largest error of the coarse position
_TILT = np.deg2rad(45.0)  # [rad] largest error of the coarse attitude
_VIEW = 2.3  # [radii] least distance, so that the object fits in the image
_NEAR_SMALL = 6.0  # [extents] largest distance of a small object
_CLIMB = (np.deg2rad(15.0), np.deg2rad(75.0))  # [rad] of the camera above the horizon
_ROLL = np.deg2rad(15.0)  # [rad] largest roll of the camera, either way
# [-] of the range, by which the camera looks beside the object, one standard deviation
_ASIDE = 0.02
_IN_VIEW = 0.98  # [-] least share of the object's corners within the image
_LEAST_PIXELS = 1200  # of the object's image, occluded parts included
_IDEAL = Camera()  # without noise
_ATTEMPTS = 40  # draws of a scene until it meets its conditions


@dataclass(frozen=True, kw_only=True)
class UnseenCase:
    """All that a scene depends on."""

    content: Content  # what stands in the object's place
    kind: str  # class of the shape, a name in `grammar.KINDS`
    hidden: str  # class of occlusion, a name in HIDDEN; of a pile: as it falls
    sensor: str  # name in UNSEEN_SENSORS
    around: Around  # what surrounds the object
    seed: int  # of all scenes
    index: int  # of the scene among those of this content
    member: int = 0  # which object of a pile is searched for
    streams: tuple[tuple[str, str], ...] = ()  # states of its draws, from a file; none: by the seed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnseenScene(ObjectScene):
    """One frame with the truth, and what identification is given."""

    case: UnseenCase
    likeness: Likeness  # of its shape to itself
    there: UnseenShape | None  # what stands in its place; None: nothing
    exact: Array  # (h, w) [m] depth of the whole scene without noise, inf where there is nothing
    seen: np.ndarray  # (h, w) pixels of an ideal camera that show what is in the object's place
    declared: bool  # the target declares its geometric symmetry

    @property
    def shape(self) -> UnseenShape:
        """The shape that is searched for."""
        return self.likeness.shape


def present(seed: int, index: int, sensor: str | None = None) -> UnseenCase:
    """Case `index` with the object in its place: classes, occlusion, sensors and surroundings in
    turn.
    """
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
    """Case `index` with nothing, another object, the mirrored or the resized one in the object's
    place, in turn.
    """
    case = present(seed, index // len(WRONG) + 3 * (index % len(WRONG)), sensor)
    return replace(case, content=WRONG[index % len(WRONG)], index=index)


def piled(seed: int, index: int) -> UnseenCase:
    """Case `index` of the objects in piles of PILE: five cases in a row have the same pile and
    another member.
    """
    pile, member = divmod(index, PILE)
    case = present(seed, PILE * pile)
    sensor = tuple(DEPTH_SENSORS)[pile % len(DEPTH_SENSORS)]

    return replace(
        case, content="pile", hidden="", around="pile", sensor=sensor, index=pile, member=member
    )


def build(case: UnseenCase) -> UnseenScene:
    """The scene of a case; the same case always gives the same scene.

    Raises:
        ConfigurationError: A name in the case is unknown, or no draw of the scene meets its
            conditions.
    """
    one_of(case.sensor, UNSEEN_SENSORS, "sensor")
    one_of(case.kind, KINDS, "kind, the class of shapes")
    if case.content != "pile":
        one_of(case.hidden, HIDDEN, "hidden, the class of occlusion")

    attempts = 1 if case.streams else _ATTEMPTS
    for attempt in range(attempts):
        drawn = _Draw(case, attempt).scene()
        if drawn is not None:
            return drawn

    raise ConfigurationError(f"{case}: none of {attempts} draws meets its conditions")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Layout:
    """Where everything is."""

    likeness: Likeness  # of the shape that is searched for
    there: UnseenShape | None  # in its place
    body: Body  # the object, or where it is absent the one that was taken away
    visible: Sequence[Shell]  # everything in the scene, in F
    X_CF: Array
    X_FT: Array


class _Draw:
    """One draw of a scene, with a stream of random numbers for each thing that is drawn."""

    def __init__(self, case: UnseenCase, attempt: int) -> None:
        key = [case.seed, _CONTENTS.index(case.content), case.index, attempt]
        kinds = tuple(KINDS)
        self.case = case

        # Not every class has shapes with a hand; after some attempts the next class is tried.
        later = attempt // 4 if case.content == "mirrored" else 0

        self.kind = kinds[(kinds.index(case.kind) + later) % len(kinds)]
        self.streams = Streams(*key, states=case.streams)

    def scene(self) -> UnseenScene | None:
        """The scene; None if it does not meet the conditions of its case."""
        layout = self._pile() if self.case.content == "pile" else self._single()
        return None if layout is None else self._taken(layout)

    def _single(self) -> _Layout | None:
        """An object, or what is in its place, with its surroundings."""
        case, streams = self.case, self.streams

        shape, there = self._shapes()
        likeness = Likeness(shape)
        if case.content == "mirrored" and not likeness.has_hand(_HAND):
            return None

        stand_in = there or shape  # where nothing is, it is as if the object were taken away
        rests = case.around == "touching" or streams["rests"].random() < _RESTS
        turn = streams["attitude"]
        R = resting_attitude(stand_in, turn) if rests else any_rotation(turn)
        gap = 0.0 if rests else float(streams["gap"].uniform(*_HANGS))
        body = Body.of((stand_in.vertices @ R.T, stand_in.triangles), streams["points"])
        ground = float(body.solid[0][:, 2].min()) - gap

        X_CF = self._camera(np.zeros(3), stand_in.radius, stand_in.extent)
        if not _in_view(X_CF, body.solid[0]):
            return None

        others = self._neighbours(body, X_CF, ground) if case.around != "alone" else []
        stones = int(streams["stones"].integers(0, 4))
        others += [stone(body, ground, streams[f"stone {k}"]) for k in range(stones)]
        on_ground = case.around != "alone" or streams["ground"].random() < _GROUND
        occluders = veil(body, others, X_CF, HIDDEN[case.hidden], streams["veil"])
        if occluders is None:
            return None

        floor = [seabed(ground, streams["seabed"])] if on_ground else []
        return _Layout(
            likeness=likeness,
            there=there,
            body=body,
            visible=[
                *([] if there is None else [body.solid]),
                *(body.solid for body in (*others, *occluders)),
                *floor,
            ],
            X_CF=X_CF,
            X_FT=pose(R),
        )

    def _pile(self) -> _Layout | None:
        """Touching objects of as many classes, the whole pile in view, and none of them hidden for
        the most part.
        """
        streams = self.streams
        kinds = streams["kinds"].permutation(tuple(KINDS))[:PILE]
        shapes = [
            unseen_shape(str(kind), streams[f"shape {k}"], _OF_PILE) for k, kind in enumerate(kinds)
        ]
        poses = heaped(shapes, streams["heap"])
        bodies = [
            Body.of((transform_points(X, shape.vertices), shape.triangles), streams[f"points {k}"])
            for k, (shape, X) in enumerate(zip(shapes, poses, strict=True))
        ]

        corners = np.vstack([body.solid[0] for body in bodies])
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        radius = float(np.linalg.norm(corners - middle, axis=1).max())
        X_CF = self._camera(middle, radius, 2.0 * radius)
        if not _in_view(X_CF, corners):
            return None

        for k, body in enumerate(bodies):
            visible, hidden = hidden_by(body, [*bodies[:k], *bodies[k + 1 :]], X_CF)
            if len(visible) * COARSE**2 < _LEAST_PIXELS or hidden.mean() > HIDDEN["much"][1]:
                return None

        k = self.case.member
        return _Layout(
            likeness=Likeness(shapes[k]),
            there=shapes[k],
            body=bodies[k],
            # the same order for all its members
            visible=[*(body.solid for body in bodies), seabed(0.0, streams["seabed"])],
            X_CF=X_CF,
            X_FT=poses[k],
        )

    def _shapes(self) -> tuple[UnseenShape, UnseenShape | None]:
        """Shape that is searched for, and the one in its place, None if it is absent."""
        streams = self.streams
        shape = unseen_shape(self.kind, streams["shape"])
        match self.case.content:
            case "absent":
                return shape, None
            case "other":
                size = (0.8 * shape.extent, 1.2 * shape.extent)
                return shape, unseen_shape(self.kind, streams["other"], size)
            case "mirrored":
                return shape, shape.mirrored()
            case "resized":
                sign = 1.0 if streams["size"].random() < 0.5 else -1.0
                return shape, shape.resized(1.0 + RESIZED * sign)
        return shape, shape

    def _camera(self, p_F: Array, radius: float, extent: float) -> Array:
        """X_CF (4, 4) of a camera that looks at `p_F` (3,) [m], or a little beside it."""
        rng, near = self.streams["camera"], max(RANGES[0], _VIEW * radius)
        range_m = rng.uniform(near, max(near + 0.1, min(RANGES[1], _NEAR_SMALL * extent)))

        up = rng.uniform(*np.sin(_CLIMB))
        heading, roll = rng.uniform([-np.pi, -_ROLL], [np.pi, _ROLL])
        eye = p_F + viewpoint(range_m, up, heading)
        return camera_pose(eye, p_F + rng.normal(0.0, _ASIDE * range_m, 3), roll)

    def _neighbours(self, body: Body, X_CF: Array, ground: float) -> list[Body]:
        """Shapes of the same and other classes beside the object, on the ground; they touch it, or
        stand clear.
        """
        touching = self.case.around == "touching"
        away = inverse(X_CF)[:2, 2]  # horizontally from the camera
        # Beside and behind rather than in front, unless much is to be hidden.
        spread = np.pi if self.case.hidden == "much" else 0.6 * np.pi

        bodies: list[Body] = []
        for k in range(int(self.streams["neighbours"].integers(1, 4 if touching else 5))):
            rng = self.streams[f"neighbour {k}"]
            kind = self.kind if rng.random() < _SIMILAR else str(rng.choice(tuple(KINDS)))
            size = float(np.clip(body.extent * rng.uniform(0.4, 1.0), 0.15, 0.8))
            shape = unseen_shape(kind, rng, (size, size))

            heading = float(np.arctan2(away[1], away[0]) + rng.uniform(-spread, spread))
            gap = 0.0 if touching else float(rng.uniform(0.02, 0.25))
            placed = beside(body, bodies, shape, heading, gap, ground, rng)
            if placed is not None:
                bodies.append(placed)

        return bodies

    def _taken(self, layout: _Layout) -> UnseenScene | None:
        """The frame and its truth; None if it is empty, or not as the case wants it."""
        case, X_CF, likeness, there = self.case, layout.X_CF, layout.likeness, layout.there
        if not layout.visible:  # the object is absent, and so is everything else
            return None

        # Two renderings: the whole scene, and the object alone without what hides it.
        model = meshed([moved(solid, X_CF) for solid in layout.visible])
        exact = _IDEAL.exact(model)
        alone = _IDEAL.exact(meshed([moved(layout.body.solid, X_CF)]))
        image = np.isfinite(alone)

        if case.content != "pile" and image.sum() < _LEAST_PIXELS:
            return None

        visible, hidden = np.zeros_like(image), 0.0
        if there is not None:
            visible = image & (exact > alone - 1e-4)
            hidden = 1.0 - float(visible.sum() / image.sum())
            low, high = HIDDEN.get(case.hidden, (0.0, 1.0))
            if not low <= hidden <= high:
                return None

        sensor = UNSEEN_SENSORS[case.sensor]
        try:
            scan = sensor.look(model, self.streams["noise"])
        except PerceptionError:  # an empty ping
            return None

        X_CT = X_CF @ layout.X_FT
        declared = bool(self._start("declared").random() < _DECLARED)
        target = likeness.shape.target(likeness.symmetry if declared else Symmetry())

        # The coarse start: a displaced position and a turned attitude.
        aside = self._start("approach direction").normal(size=3)
        axis = self._start("turn axis").normal(size=3)
        distance = self._start("approach distance").uniform() * _APPROACH
        angle = self._start("turn angle").uniform() * _TILT

        approach, orientation = coarse_pose(target, X_CT, (distance, aside), (angle, axis))

        return UnseenScene(
            case=case,
            target=target,
            likeness=likeness,
            there=there,
            sensor=sensor,
            model=model,
            scan=scan,
            exact=readonly(exact),
            seen=visible,
            X_CT=readonly(X_CT),
            seed=case.seed,
            approach=approach,
            orientation=orientation,
            range_m=float(np.linalg.norm(X_CT[:3, 3])),
            hidden=hidden,
            declared=declared,
        )

    def _start(self, name: str) -> np.random.Generator:
        """Stream of a draw of the coarse start, which each object of a pile has for itself."""
        return self.streams[f"{name} {self.case.member}"]


def _in_view(X_CF: Array, vertices: Array) -> bool:
    """Whether nearly all of `vertices` (V, 3) [m] in F lie within the image."""
    p = transform_points(X_CF, vertices)
    within = (p[:, 2] > 0.3) & (np.abs(p[:, :2]) < MIDDLE / FOCAL * p[:, 2:]).all(axis=1)
    return bool(within.mean() >= _IN_VIEW)
