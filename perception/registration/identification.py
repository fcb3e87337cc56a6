"""Identification of a known object in a scan: entry of registration [Konoplin 2022, eq. 1, 2].

Steps: crop around the coarse detection, remove background and outliers, find initial poses, ICP,
remove hidden model points, ICP again, PoseCheck by projected trajectories.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.likely_causes import far_approach, with_cause
from uuv.perception.clouds.scan import (
    MIN_POINTS,
    Scan,
    SensorModel,
    background,
    near_any,
    without_flying_pixels,
)
from uuv.perception.pose_card import PoseCard
from uuv.perception.registration.evidence import Evidence, score, seen_noise, surface_noise
from uuv.perception.registration.initialiser import Expected, initial_poses
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import MAX_SIZE, MIN_MARGIN, Decision, PoseCheck, check
from uuv.perception.registration.pose_covariance import PoseCovariance, pose_covariance
from uuv.perception.registration.pose_search import (
    REFINED,
    Found,
    Hypothesis,
    likeliest_pose,
    weighed_again,
)
from uuv.perception.registration.projective_fit import polished_rows
from uuv.perception.registration.published.paper_check import published_criterion
from uuv.perception.registration.published.paper_icp import laid_on, paper_fit, required_error
from uuv.perception.registration.rival_shapes import (
    MIN_HAND,
    MirrorImage,
    best_mirror_image,
    is_told_again,
    resized_log_likelihood,
)
from uuv.perception.registration.slipping import with_slip
from uuv.perception.registration.symmetry import resolve_symmetry
from uuv.perception.registration_method import Method
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    finite_number,
    one_of,
    pose,
    readonly,
    shown,
    transform_points,
    whole_number,
)

_FARTHEST = 1e5  # [m] largest accepted distance of an object from the sensor
APPROACH_ERROR = 0.3  # [m] largest error of a coarse detection, unless the caller states another
_NOMINAL = 0.005  # [-] difference of the best scale from 1, above which another size is tried
# number of initial poses that get a rough fit if the scan contradicts the best of a few
_REFINED_LATER = 120
# largest number of rotations of a symmetry found in a mesh, of which each is compared by the scan
_TURNS = 24
# [-] ratio of the information of all pixels to that used by the search, above which the noise of
# the scan itself is used
_BETTER = 2.0
# [model radii] around the centre of an initial pose, within which scan points are used
_AROUND = 1.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeMotion:
    """Degrees of freedom that the scan does not determine, and how they were chosen."""

    axis: Array | None  # (3,) unit, in T: the model looks the same after rotations about this axis
    turns: int  # number of discrete rotations after which the model looks the same, 1 for none
    twists: Array  # (k, 6) free twists (linear; angular x radius) in S about the model's centre
    angle_known: bool  # True: the angle about the axis was measured; False: it was chosen
    policy: str  # how the free part was chosen, as text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification(PoseCard):
    """Identified pose of an object in one scan: decision, covariance, reason.

    A pose that was not accepted is the best one found, for logs only.
    """

    X_sensor_target: Array  # (4, 4) pose of T in S
    accepted: bool
    reason: str  # reason of the refusal; empty if accepted
    check: PoseCheck | None  # None if there was nothing to check
    # covariance of the pose; None if there was too little to estimate it from
    covariance: PoseCovariance | None
    symmetry: FreeMotion
    X_sensor_start: Array  # (4, 4) coarse pose that was given, else the initial pose of the search
    cloud: Array  # (n, 3) [m] scan points used in ICP, thinned, in S
    model_before: Array  # (m, 3) [m] all model points at the start, in S
    model_after: Array  # (k, 3) [m] visible model points at the fitted pose, in S
    # scan and mask of the object; a tool path is projected on this surface
    evidence: Evidence | None
    surface: ModelSurface  # model as sampled for ICP
    score: float  # [-] share of the model confirmed plus share of the scan explained, up to 2
    # distinct poses, most likely first: the first one is reported
    hypotheses: tuple[Hypothesis, ...]
    duration_s: float  # [s] computing time
    # mirror image of the model, where it fits best; None if it is no rival in this view
    mirror: MirrorImage | None = None

    @property
    def model_note(self) -> str:
        """Note on how the model was made, if it was given as a cloud; empty for a mesh."""
        cloud = self.surface.target.cloud
        return "" if cloud is None else f"model {self.surface.target.name!r}: {cloud.note}"

    @property
    def margin(self) -> float:
        """Log likelihood [nat] above that of the best other hypothesis; inf if there is none."""
        if len(self.hypotheses) < 2:
            return np.inf
        return self.hypotheses[0].log_likelihood - self.hypotheses[1].log_likelihood

    @property
    def decision(self) -> Decision:
        """Decision for the supervisor: accept, scan again from another position, or refuse."""
        if self.accepted:
            return Decision.ACCEPT
        if self.check is None or self.check.decision is Decision.ACCEPT:
            return Decision.REFUSE  # nothing to verify, or a good fit outside the admitted poses
        return self.check.decision


def identify(
    cloud: ArrayLike | Scan,
    target: TargetModel | ModelSurface | str | Path | np.ndarray | Any,
    approach: ArrayLike | None = None,
    orientation: ArrayLike | None = None,
    *,
    sensor: SensorModel | None = None,
    approach_error: float = APPROACH_ERROR,
    seed: int = 0,
    method: Method = "planes",
    thorough: bool = True,
) -> Identification:
    """Pose of the known object `target` in one scan of a depth sensor, with verification.

    An object that is absent, or an empty cloud, gives an Identification that is not accepted, with
    a reason. The same input with the same seed gives the same result.

    Args:
        cloud: Points (n, 3) or organised (h, w, 3) [m] in the sensor frame S (OpenCV axes, NaN
            allowed), or a Scan.
        target: A TargetModel, a mesh or cloud file [m], an object with `vertices` and `faces`
            (trimesh) or `triangles` [m], or a cloud: points (n, 3) [m], (n, 6) with outward
            normals, or an object with `points` and optional `normals` (Open3D). A cloud is meshed;
            `model_note` describes how.
        approach: (3,) [m] coarse position of the target's centre in S; None: anywhere.
        orientation: (3, 3) coarse rotation of T in S, with an error of up to 45 deg; None: any.
        sensor: Accuracy of the sensor, from which the limits follow; None: `SensorModel()`.
        approach_error: [m] largest error of `approach`.
        seed: Seed of all random samples.
        method: "planes"; "paper" for the published ICP (`paper_icp`), which has no search and needs
            `orientation`; "paper-scan" for the same with pairs from scan to model; "paper-q" for
            the published threshold on Q (`paper_check`) in place of `pose_check`.
        thorough: True: all starts are fitted if the scan contradicts the best of a few, which takes
            seconds.

    Returns:
        The pose with its PoseCheck, evidence and other hypotheses.

    Raises:
        ConfigurationError: An argument has a wrong type or shape.
        MissingLibraryError: There is no ray caster.
    """
    attempt = attempted(
        cloud,
        target,
        approach,
        orientation,
        sensor=sensor,
        approach_error=approach_error,
        seed=seed,
        method=method,
    )
    return (attempt.widened() if thorough else attempt).concluded()


def attempted(
    cloud: ArrayLike | Scan,
    target: Any,
    approach: ArrayLike | None = None,
    orientation: ArrayLike | None = None,
    *,
    sensor: SensorModel | None = None,
    approach_error: float = APPROACH_ERROR,
    seed: int = 0,
    method: Method = "planes",
) -> "Attempt":
    """Search from the likeliest starts; arguments as for `identify`, whose first step it is."""
    started = perf_counter()
    p_approach = None if approach is None else checked(approach, (3,), "approach")
    if p_approach is not None and np.abs(p_approach).max() > _FARTHEST:
        raise ConfigurationError(
            f"approach: must lie within {_FARTHEST:g} m of the sensor, got {shown(p_approach)}"
        )

    R_prior = None if orientation is None else checked(orientation, (3, 3), "orientation")
    if R_prior is not None and (
        np.abs(R_prior).max() > 2.0
        or np.abs(R_prior @ R_prior.T - np.eye(3)).max() > 1e-3
        or not np.linalg.det(R_prior) > 0.0
    ):
        raise ConfigurationError(f"orientation: expected a rotation matrix, got {shown(R_prior)}")

    seed = whole_number(seed, "seed")
    approach_error = finite_number(approach_error, "approach_error [m]", above=0.0, most=_FARTHEST)
    one_of(method, get_args(Method), "method")
    if sensor is not None and not isinstance(sensor, SensorModel):
        raise ConfigurationError(f"sensor: expected a SensorModel, got {shown(sensor)}")

    # The object, and where it is searched
    surface = sampled(target, seed)
    X_prior = pose(R_prior if R_prior is not None else np.eye(3), p_approach)
    if p_approach is not None:
        X_prior[:3, 3] -= X_prior[:3, :3] @ surface.center
    question = _Question(
        surface=surface,
        sensor=sensor or SensorModel(),
        expected=Expected(p=p_approach, error=1.5 * approach_error, R=R_prior),
        X_prior=X_prior,
        method=method,
        started=started,
    )

    # Pixels that may be the object, and the search in them
    doubt = ""
    try:
        scan = cloud if isinstance(cloud, Scan) else Scan.from_cloud(cloud)
        doubt = scan.doubt
        rng = np.random.default_rng(seed)
        mask = segment(scan, surface.target, p_approach, question.sensor, approach_error, rng)
        return _first_search(question, scan, mask)
    except PerceptionError as error:
        return _Refusal(question=question, reason=with_cause(str(error), doubt))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Question:
    """An object to search for in a scan, with its expected pose."""

    surface: ModelSurface
    sensor: SensorModel
    expected: Expected
    X_prior: Array  # (4, 4) expected pose of T in S; identity where nothing is expected
    method: Method
    started: float  # [s] by `perf_counter`

    @property
    def knows_pose(self) -> bool:
        """True if both position and attitude are expected."""
        return self.expected.p is not None and self.expected.R is not None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Refusal:
    """An attempt without points to which the model could be fitted."""

    question: _Question
    reason: str

    def widened(self) -> "_Refusal":
        """Return itself, since there is nothing more to search."""
        return self

    def concluded(self, earlier: Identification | None = None) -> Identification:
        """Identification with the reason of the refusal."""
        return _refused(
            self.question.surface, self.question.X_prior, self.reason, self.question.started
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """An attempt that fitted the model from some starts, with the verdict on the likeliest pose."""

    question: _Question
    starts: list[Array]  # (4, 4) poses of T in S
    given: list[Array]  # (4, 4) poses that are tried whatever their likelihood
    searched: Evidence  # evidence with which the search ranked poses
    evidence: Evidence  # evidence with the noise with which the poses were ranked last
    found: Found
    X_start: Array  # (4, 4) expected pose, else the pose at which the search began
    judged: "_Judged"

    @classmethod
    def of(
        cls,
        question: _Question,
        searched: Evidence,
        starts: list[Array],
        given: list[Array],
        most: int,
    ) -> "_Search":
        """Search from `most` of the starts."""
        surface = question.surface

        if question.method == "planes":
            evidence, likeliest = _search(searched, surface, starts, given, most)
        else:
            evidence = searched
            from_scan = question.method == "paper-scan"
            fit = paper_fit(searched, surface, starts[0], from_scan=from_scan)
            score = log_likelihood(searched, surface, fit.X_ST)
            likeliest = Found(fit.X_ST, None, starts[0], score, asks=fit.asks)

        X_start = question.X_prior if question.knows_pose else likeliest.X_start
        X_near = X_start if question.expected.R is None else question.X_prior
        return cls(
            question=question,
            starts=starts,
            given=given,
            searched=searched,
            evidence=evidence,
            found=likeliest,
            X_start=X_start,
            judged=_judge(evidence, surface, likeliest, X_near),
        )

    def widened(self) -> "_Search":
        """Search from all starts if the scan contradicts the result of a few; otherwise this one.

        Then the part of the scan most similar to the model is not the object, as in a heap.
        """
        question = self.question
        if (
            question.method != "planes"
            or not self.judged.verdict.contradicted
            or len(self.starts) <= REFINED
        ):
            return self
        wider = _Search.of(question, self.searched, self.starts, self.given, _REFINED_LATER)
        return self if wider.judged.verdict.contradicted else wider

    def concluded(self, earlier: Identification | None = None) -> Identification:
        """The pose with its verdict, after comparison with other shapes.

        Args:
            earlier: Identification of the same object before, for its mirror image.
        """
        question = self.question
        surface = self.question.surface
        evidence = self.evidence
        likeliest = self.found
        X_ST, X_told, doubt, verdict = self.judged

        # The rules of the paper, if they are asked for
        if question.method == "paper-q":
            verdict = _by_criterion(verdict, evidence, surface, X_ST)
        if likeliest.asks and verdict.decision is Decision.ACCEPT:
            verdict = replace(verdict, decision=Decision.RESCAN, reason=likeliest.asks)

        # Other shapes are compared for an accepted pose only
        mirror = None
        if question.method == "planes" and verdict.decision is Decision.ACCEPT:
            mirror = self._mirror_image(earlier)
            verdict = self._against_other_shapes(verdict, mirror)

        reason = verdict.reason
        if not reason and not question.expected.admits(X_ST[None], surface)[0]:
            reason = "position or orientation is too far from the expected pose"

        visible = surface.visible(X_ST, evidence.scan, question.sensor.max_incidence)
        return Identification(
            X_sensor_target=readonly(X_ST),
            accepted=not reason,
            reason=with_cause(reason, evidence.scan.doubt),
            check=verdict,
            covariance=doubt,
            symmetry=_free_motion(
                surface, verdict.free, X_told is not None, question.expected.R is not None
            ),
            X_sensor_start=readonly(self.X_start),
            cloud=readonly(evidence.points),
            model_before=readonly(transform_points(self.X_start, surface.points)),
            model_after=readonly(transform_points(X_ST, surface.points[visible])),
            evidence=evidence,
            surface=surface,
            score=score(evidence, surface, X_ST),
            hypotheses=(
                Hypothesis(X_sensor_target=readonly(X_ST), log_likelihood=likeliest.log_likelihood),
                *likeliest.others,
            ),
            duration_s=perf_counter() - question.started,
            mirror=mirror,
        )

    def _mirror_image(self, earlier: Identification | None) -> MirrorImage | None:
        """The mirror image of the model as rival: the earlier result if it is still valid."""
        surface = self.question.surface
        X_ST = self.judged.X_ST
        expected = self.question.expected

        known = None
        if earlier is not None and earlier.accepted and earlier.surface == surface:
            known = earlier.mirror
        if known is not None and is_told_again(self.evidence, surface, X_ST, known):
            return known
        return best_mirror_image(
            self.searched, self.evidence, surface, X_ST, replace(expected, R=None)
        )

    def _against_other_shapes(self, verdict: PoseCheck, mirror: MirrorImage | None) -> PoseCheck:
        """Verdict on an accepted pose: rescan if the mirror image or another size fits as well."""
        surface = self.question.surface
        evidence = self.evidence
        if mirror is not None and mirror.hand < MIN_HAND:
            how = "better" if mirror.hand < -MIN_HAND else "as well"
            return replace(verdict, decision=Decision.RESCAN, reason=f"its mirror image fits {how}")

        if abs(verdict.size - 1.0) <= _NOMINAL:
            return verdict

        # Twice as far from the nominal size as the limit of the check, to the side that fits better
        size = 1.0 + float(np.copysign(2.0 * MAX_SIZE, verdict.size - 1.0))
        least = log_likelihood(evidence, surface, self.judged.X_ST) - MIN_MARGIN
        if resized_log_likelihood(evidence, surface, size, self.found) > least:
            return replace(
                verdict,
                decision=Decision.RESCAN,
                reason=f"at {size:.2f} times its size it fits as well",
            )
        return verdict


Attempt = _Search | _Refusal


def _first_search(question: _Question, scan: Scan, mask: np.ndarray) -> _Search:
    """Search from the likeliest starts.

    Raises:
        PerceptionError: Too little of the scan may be the object.
    """
    surface = question.surface
    sensor = question.sensor
    expected = question.expected
    if question.method == "planes":
        starts = initial_poses(scan, mask, surface, sensor, expected)
        priors = [question.X_prior] if question.knows_pose else []
    else:
        starts = [laid_on(scan.points[mask], surface, question.X_prior[:3, :3])]
        priors = []

    # Evidence: the pixels around any start
    standing = mask
    mask = mask & _around(starts or priors, surface, scan)
    _need(mask, "lie where the object could be")
    evidence = Evidence.of(scan, mask, 0.8 * surface.spacing, sensor, standing)
    if question.method == "planes":
        evidence = evidence.with_noise(surface_noise(scan, mask, sensor))
    if len(evidence.points) < MIN_POINTS:
        raise PerceptionError(
            f"only {len(evidence.points)} points are left of the object; need {MIN_POINTS}"
        )
    return _Search.of(question, evidence, starts, priors, REFINED)


def _search(
    searched: Evidence, surface: ModelSurface, starts: list[Array], given: list[Array], most: int
) -> tuple[Evidence, Found]:
    """The likeliest pose from `most` of the starts, and the evidence that ranked it last."""
    likeliest = likeliest_pose(searched, surface, starts, given, most=most)

    # Noise of the scan itself, if it is much less than stated
    noise = seen_noise(searched, surface, likeliest.X_ST)
    if noise.information <= _BETTER * searched.noise.information:
        return searched, likeliest
    evidence = searched.with_noise(noise)
    return evidence, weighed_again(evidence, surface, likeliest)


class _Judged(NamedTuple):
    """An estimated pose and its verdict; modulo symmetry, the pose that the scan shows."""

    X_ST: Array  # (4, 4)
    X_told: Array | None  # (4, 4) if parts in view show the angle about an axis of symmetry
    doubt: PoseCovariance | None
    verdict: PoseCheck


def _judge(evidence: Evidence, surface: ModelSurface, found: Found, X_near: Array) -> _Judged:
    """Verdict on an estimated pose; modulo symmetry, the one nearest to `X_near` (4, 4)."""
    # Among poses equal by symmetry: the nearest, the likeliest, the one that parts in view show
    X_ST = surface.symmetry.nearest_pose(found.X_ST, X_near[:3, :3])
    X_ST = _likeliest_turn(evidence, surface, X_ST)
    X_told = resolve_symmetry(evidence, surface, X_ST)
    if X_told is not None:
        X_ST = X_told

    second = found.others[0].log_likelihood if found.others else -np.inf

    doubt = None
    if found.fit is not None:
        doubt = pose_covariance(
            evidence, surface, X_ST, found.fit.free, polished_rows(evidence, surface, X_ST)
        )
        doubt = doubt and with_slip(evidence, surface, X_ST, doubt)
    return _Judged(X_ST, X_told, doubt, check(evidence, surface, X_ST, found.fit, second, doubt))


def _likeliest_turn(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> Array:
    """Among poses equal by an undeclared symmetry of the mesh, another one if it is far likelier.

    Such a symmetry holds within a tolerance; many pixels may resolve smaller differences.
    """
    if not surface.target.symmetry.is_none or not 1 < len(surface.symmetry.rotations) <= _TURNS:
        return X_ST

    poses = [X_ST @ surface.symmetry.about_center(G) for G in surface.symmetry.rotations]
    likelihoods = [log_likelihood(evidence, surface, X) for X in poses]
    best = int(np.argmax(likelihoods))
    return (
        poses[best]
        if likelihoods[best] > log_likelihood(evidence, surface, X_ST) + MIN_MARGIN
        else X_ST
    )


def segment(
    scan: Scan,
    target: TargetModel,
    approach: Array | None,
    sensor: SensorModel,
    approach_error: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Mask of the pixels that may be the target: near the approach, not background, in patches.

    Args:
        scan: The scan.
        target: Model of the object, for its radius.
        approach: (3,) [m] coarse position of the target's centre in S; None: anywhere.
        sensor: Accuracy of the sensor.
        approach_error: [m] largest error of `approach`.
        rng: Source of the random samples.

    Returns:
        Mask (h, w).

    Raises:
        PerceptionError: Fewer than MIN_POINTS are left at any stage.
    """
    usable = without_flying_pixels(scan)
    _need(usable, "of the scan form a surface")
    if scan.known is not None:
        usable &= ~scan.known.shown

    # Off the background, near the approach
    mask = usable & ~background(scan, usable, 2.4 * target.radius, sensor, rng)
    if approach is not None:
        reach = target.radius + approach_error
        mask &= near_any(scan.points, approach[None], reach)
        _need(mask, "lie near the approach", far_approach(scan.points[usable], approach, reach))
    else:
        _need(mask, "stand out from the background")

    # Patches of a few pixels remain from flying pixels and from the roughness of the background.
    label, count = ndimage.label(mask, structure=np.ones((3, 3)))
    size = np.bincount(label.ravel(), minlength=count + 1)
    size[0] = 0
    mask &= (size >= max(20, 0.005 * size.max()))[label]
    _need(mask, "form patches of more than a few pixels")
    return mask


def _need(mask: np.ndarray, what: str, cause: str = "") -> None:
    if (count := int(mask.sum())) < MIN_POINTS:
        reason = f"no object in view: only {count} points {what}; need {MIN_POINTS}"
        raise PerceptionError(with_cause(reason, cause))


def _around(poses: list[Array], surface: ModelSurface, scan: Scan) -> np.ndarray:
    """Mask (h, w) of the pixels near the model at any of the initial `poses`."""
    # there may be no such pose
    centers = np.array([transform_points(X, surface.center) for X in poses]).reshape(-1, 3)
    return near_any(scan.points, centers, _AROUND * surface.radius)


def _by_criterion(
    verdict: PoseCheck, evidence: Evidence, surface: ModelSurface, X_ST: Array
) -> PoseCheck:
    """The figures of `verdict` with the published decision: accept below a threshold on Q.

    Above it a new scan is requested. The paper chooses the threshold by experiment, for object and
    sensor. Here it is the required error of the ICP at each of the rays that Q sums up.
    """
    criterion = published_criterion(evidence, surface, X_ST)
    most = float(np.sqrt(criterion.rays)) * required_error(evidence, surface)

    reason = ""
    if criterion.rays == 0:
        reason = "no ray of the check trajectory meets both surfaces"
    elif criterion.q_m > most:
        reason = (
            f"Q is {1e3 * criterion.q_m:.1f} mm over {criterion.rays} rays; "
            f"at most {1e3 * most:.1f} mm are allowed"
        )

    decision = Decision.RESCAN if reason else Decision.ACCEPT
    return replace(
        verdict, decision=decision, reason=reason, figure_m=criterion.q_m, threshold_m=most
    )


def _free_motion(surface: ModelSurface, twists: Array, told: bool, with_prior: bool) -> FreeMotion:
    symmetry = surface.symmetry
    policy = "none needed"
    if told:
        policy = "resolved by visible parts that break the symmetry"
    elif symmetry.axis is not None or len(symmetry.rotations) > 1:
        origin = "the coarse orientation" if with_prior else "the start with the best fit"
        policy = f"of the equivalent orientations, the one nearest to {origin}"
    return FreeMotion(
        axis=symmetry.axis,
        turns=len(symmetry.rotations),
        twists=readonly(twists),
        angle_known=told or symmetry.axis is None,
        policy=policy,
    )


def _refused(surface: ModelSurface, X_prior: Array, reason: str, started: float) -> Identification:
    nothing = readonly(np.zeros((0, 3)))
    return Identification(
        X_sensor_target=readonly(X_prior),
        accepted=False,
        reason=reason,
        check=None,
        covariance=None,
        symmetry=_free_motion(surface, np.zeros((0, 6)), False, True),
        X_sensor_start=readonly(X_prior),
        cloud=nothing,
        model_before=readonly(transform_points(X_prior, surface.points)),
        model_after=nothing,
        evidence=None,
        surface=surface,
        score=-1.0,
        hypotheses=(),
        duration_s=perf_counter() - started,
    )


def sampled(target: Any, seed: int = 0) -> ModelSurface:
    """Sample `target`, in any of the forms that `identify` accepts.

    Raises:
        ConfigurationError: It is in none of these forms, or is not a model.
    """
    if isinstance(target, ModelSurface):
        return target
    if isinstance(target, TargetModel):
        return ModelSurface.of(target, seed)
    if isinstance(target, (str, Path)):
        return ModelSurface.of(TargetModel.from_file(target), seed)

    faces = next((name for name in ("faces", "triangles") if hasattr(target, name)), None)
    # `triangles` of a trimesh are corners (t, 3, 3)
    if hasattr(target, "vertices") and faces is not None:
        return ModelSurface.of(
            TargetModel(name="mesh", vertices=target.vertices, triangles=getattr(target, faces)),
            seed,
        )

    if hasattr(target, "points"):
        normals = getattr(target, "normals", None)
        points = np.asarray(target.points)
        normals = None if normals is None else np.asarray(normals)
        return ModelSurface.of(
            TargetModel.from_cloud(
                points, normals if normals is not None and normals.size else None
            ),
            seed,
        )

    if isinstance(target, np.ndarray) and target.ndim == 2 and target.shape[1] in (3, 6):
        return ModelSurface.of(
            TargetModel.from_cloud(target[:, :3], target[:, 3:] if target.shape[1] == 6 else None),
            seed,
        )

    kind = (
        f"an array of shape {target.shape}"
        if isinstance(target, np.ndarray)
        else type(target).__name__
    )
    raise ConfigurationError(
        "target: expected a TargetModel, a mesh or cloud file, a mesh (vertices, faces), or a "
        "cloud: an array (n, 3), or (n, 6) with normals, or an object with points and normals; "
        f"got {kind}"
    )
