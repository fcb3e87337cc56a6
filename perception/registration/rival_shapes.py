"""Other shapes as rivals of a model: its mirror image and other sizes, which may fit nearly as
well.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from uuv.models.objects.mesh_symmetry import has_mirror_plane
from uuv.models.objects.target_model import Symmetry, TargetModel
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.initialiser import Expected, initial_poses
from uuv.perception.registration.likelihood import difference, log_likelihood
from uuv.perception.registration.model_surface import MODELS, ModelSurface
from uuv.perception.registration.pose_search import Found, likeliest_of, weighed_again
from uuv.perception.registration.symmetry import ambiguous_poses
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, inverse, pose, readonly

MIN_HAND = 3.0  # [nat] log likelihood above that of the mirror image: odds of 20
_NEAR = 7  # number of other hypotheses from which a model of another size is fitted too
# number of poses similar to the model's pose from which its mirror image is fitted too
_ALIKE_POSES = 24
# [nat] margin over the mirror image, from which on a later scan from the same position need not
# search it
_BEYOND_DOUBT = 100.0
# [-] motion of the sensor around the object, as a share of the range, up to which it sees the same
# side
_SAME_PLACE = 0.1
_LOST = 0.5  # [-] share of the margin over the mirror image that a later scan may lose
# [nat] expected difference of log likelihood, below which this view cannot distinguish the two
_ALIKE = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MirrorImage:
    """The mirror image of a model at the pose at which it fits a scan best, compared with the
    model's own pose.
    """

    X_TM: Array  # (4, 4) pose of the mirror image M in T
    log_likelihood: float  # [nat] log likelihood of the scan with the model itself
    hand: float  # [nat] difference by which the scan is less likely with the mirror image
    p_TS: Array  # (3,) [m] position of the sensor, in T


def best_mirror_image(
    searched: Evidence, evidence: Evidence, surface: ModelSurface, X_ST: Array, expected: Expected
) -> MirrorImage | None:
    """The mirror image of the model, fitted near a pose of the model and by a search of its own.

    Args:
        searched: Scan of the object with the noise as stated.
        evidence: The same scan with the noise with which the pose was ranked last.
        surface: Sampled model.
        X_ST: (4, 4) fitted pose of T in S.
        expected: Prior knowledge of the pose.

    Returns:
        The mirror image at its best pose; None if it is the same shape, or looks the same in this
            view.
    """
    rival = mirror_image(surface)
    if rival is None:
        return None

    # Starts: reflections near the pose, and a separate search
    alike = ambiguous_poses(surface)
    alike = (np.eye(4), *alike[:: -(-len(alike) // _ALIKE_POSES) or 1])
    starts = [X_ST @ G @ turn for G in alike for turn in _turns(surface)]
    starts += initial_poses(searched.scan, searched.mask, rival, searched.sensor, expected)

    fitted = likeliest_of(searched, rival, starts, log_likelihood(searched, surface, X_ST))
    if evidence is not searched:
        fitted = weighed_again(evidence, rival, fitted)

    if difference(evidence, (surface, X_ST), (rival, fitted.X_ST)) < _ALIKE:
        return None

    X_TS = inverse(X_ST)
    likelihood = log_likelihood(evidence, surface, X_ST)
    return MirrorImage(
        X_TM=readonly(X_TS @ fitted.X_ST),
        log_likelihood=likelihood,
        hand=likelihood - fitted.log_likelihood,
        p_TS=readonly(X_TS[:3, 3]),
    )


def is_told_again(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, earlier: MirrorImage
) -> bool:
    """True if a scan excludes the mirror image as clearly as an earlier scan from the same position
    did.

    The handedness of an object does not change between two scans, so its mirror image need not be
    searched for again. But the object may have been replaced, or something may have come before it.
    Therefore the model must explain this scan about as well as the earlier one, and the mirror
    image at its best pose as badly.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) fitted pose of T in S.
        earlier: Mirror image in an earlier scan of the same object.
    """
    rival = mirror_image(surface)
    if rival is None or earlier.hand < _BEYOND_DOUBT:
        return False

    # The sensor must be at the same position
    p_TS = inverse(X_ST)[:3, 3]
    moved = float(np.linalg.norm(p_TS - earlier.p_TS))
    if moved > _SAME_PLACE * float(np.linalg.norm(p_TS - surface.center)):
        return False

    # The model explains the scan about as well as before, and the mirror image as badly
    likelihood = log_likelihood(evidence, surface, X_ST)
    if likelihood < earlier.log_likelihood - _LOST * earlier.hand:
        return False

    hand = likelihood - log_likelihood(evidence, rival, X_ST @ earlier.X_TM)
    return hand > max(_BEYOND_DOUBT, (1.0 - _LOST) * earlier.hand)


def resized_log_likelihood(
    evidence: Evidence, surface: ModelSurface, size: float, found: Found
) -> float:
    """Log likelihood [nat] of the scan with the model at another size, fitted near the poses of
    `found`.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        size: [-] ratio of the other size to that of the model.
        found: Result of the search with the model.
    """
    rival = resized(surface, size)
    near = [found.X_ST, *(hypothesis.X_sensor_target for hypothesis in found.others[:_NEAR])]
    starts = [pose(X[:3, :3], X[:3, 3] + (1.0 - size) * X[:3, :3] @ surface.center) for X in near]

    return likeliest_of(
        evidence, rival, starts, log_likelihood(evidence, surface, found.X_ST)
    ).log_likelihood


@remembered(16, owners=MODELS)
def resized(surface: ModelSurface, size: float) -> ModelSurface:
    """The model scaled by `size` about the origin of T."""
    target = surface.target
    symmetry = surface.symmetry
    return replace(
        surface,
        target=TargetModel(
            name=target.name, vertices=size * target.vertices, triangles=target.triangles
        ),
        points=size * surface.points,
        spacing=size * surface.spacing,
        center=size * surface.center,
        radius=size * surface.radius,
        scene=type(surface.scene)(size * target.vertices, target.triangles),
        hull=size * surface.hull,
        border=None if surface.border is None else cKDTree(size * surface.border.data),
        symmetry=replace(symmetry, center=size * symmetry.center),
    )


@remembered(16, owners=MODELS)
def mirror_image(surface: ModelSurface) -> ModelSurface | None:
    """The model reflected in the plane x = 0 of T; None if it has a plane of symmetry."""
    vertices, triangles = surface.target.vertices, surface.target.triangles
    if has_mirror_plane(vertices, triangles, np.random.default_rng(0), surface.resolution):
        return None

    flip = np.array([-1.0, 1.0, 1.0])
    symmetry = surface.symmetry
    return replace(
        surface,
        target=TargetModel(
            name=surface.target.name, vertices=vertices * flip, triangles=triangles[:, ::-1]
        ),
        points=surface.points * flip,
        normals=surface.normals * flip,
        center=surface.center * flip,
        scene=type(surface.scene)(vertices * flip, triangles[:, ::-1]),
        hull=surface.hull * flip,
        border=None if surface.border is None else cKDTree(surface.border.data * flip),
        symmetry=Symmetry(
            axis=None if symmetry.axis is None else symmetry.axis * flip,
            rotations=np.diag(flip) @ symmetry.rotations @ np.diag(flip),
            center=symmetry.center * flip,
        ),
    )


@remembered(16, owners=MODELS)
def _turns(surface: ModelSurface) -> tuple[Array, ...]:
    """Poses (4, 4) of the mirror image in T on the model: reflected in each principal plane."""
    middle, axes = _principal(surface)
    flip = np.diag([-1.0, 1.0, 1.0])
    turns: list[Array] = []

    for axis in axes:
        reflection = np.eye(3) - 2.0 * np.outer(axis, axis)
        turns.append(pose(reflection @ flip, middle - reflection @ middle))
    return tuple(turns)


def _principal(surface: ModelSurface) -> tuple[Array, Array]:
    """Centroid (3,) [m] of the surface in T, and its principal axes (3, 3) as rows."""
    middle = surface.points.mean(axis=0)
    return middle, np.linalg.eigh(np.cov((surface.points - middle).T))[1].T
