"""Recognition of one of several known objects in a scan, and joint identification of all of them.

`recognise` identifies each object, and compares all of them on the same pixels.

The ratio of the scan's likelihoods with two objects at their best poses shows which of them
explains the scan better. The pixels must be the same for both: all pixels that stand out for any
object that the scan does not contradict. If an object is likelier than the accepted one but not
accepted itself, another view is requested.

`identify_together` identifies all objects. An accepted object explains its pixels and occludes the
space behind it, while the other objects are searched for again.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from uuv.models.meshes.mesh_files import FORMATS
from uuv.models.meshes.surfel_files import TEXT
from uuv.perception.clouds.scan import KnownObjects, Scan, SensorModel
from uuv.perception.registration.identification import (
    APPROACH_ERROR,
    Identification,
    attempted,
    identify,
    sampled,
)
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import MIN_MARGIN, Decision
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.spatial import shown

_SHARED = 0.2  # [-] largest share of an object's pixels that also show another object
_ENDINGS = {f".{kind}" for kind in (*FORMATS, *TEXT, "pcd")}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """One of the objects, at the pose at which it fits best."""

    name: str
    found: Identification
    # [nat] log likelihood of the scan, on the pixels that all candidates share; -inf without
    # evidence
    log_likelihood: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recognition:
    """Result of `recognise`: the recognised object, its pose, and all candidates.

    If no object is accepted, the first candidate is the likeliest one, for logs only.
    """

    name: str | None  # name of the recognised object; None if none was accepted
    reason: str  # reason of the refusal; empty if an object was accepted
    decision: Decision
    candidates: tuple[Candidate, ...]  # all candidates, the likeliest first
    duration_s: float  # [s] computing time

    @property
    def accepted(self) -> bool:
        """True if one object is accepted and no other fits as well."""
        return self.name is not None

    @property
    def found(self) -> Identification:
        """The likeliest object's identification, with its pose."""
        return self.candidates[0].found

    @property
    def margin(self) -> float:
        """Log likelihood [nat] of the likeliest object minus that of the second; else inf."""
        if len(self.candidates) < 2:
            return np.inf
        first, second = (candidate.log_likelihood for candidate in self.candidates[:2])
        return first - second if np.isfinite(second) else np.inf


def recognise(
    cloud: ArrayLike | Scan,
    targets: Mapping[str, Any] | Iterable[Any] | str | Path,
    approach: ArrayLike | None = None,
    orientation: ArrayLike | None = None,
    *,
    sensor: SensorModel | None = None,
    approach_error: float = APPROACH_ERROR,
    seed: int = 0,
) -> Recognition:
    """Recognise one of several objects in a scan, with its pose.

    Args:
        cloud: As for `identify`.
        targets: Objects in any form that `identify` accepts, by name or in a sequence, or a folder
            of their files. Names must differ.
        approach: (3,) [m] coarse position of the object's centre in S; None: anywhere.
        orientation: (3, 3) coarse rotation of T in S, common to all; None: any.
        sensor: Accuracy of the sensor; None: `SensorModel()`.
        approach_error: [m] largest error of `approach`.
        seed: Seed of all random samples.

    Returns:
        The likeliest object, if its pose is accepted and it is likelier than every other object
        by MIN_MARGIN; otherwise the reason.

    Raises:
        ConfigurationError: A wrong type or shape, no targets, or two targets of the same name.
    """
    started = perf_counter()
    surfaces = models_of(targets, seed)

    scan: Any = cloud
    if not isinstance(cloud, Scan):
        with suppress(PerceptionError):  # each object states it
            scan = Scan.from_cloud(cloud)  # computed once for all objects

    # Each object alone
    attempts = {
        name: attempted(
            scan,
            surface,
            approach,
            orientation,
            sensor=sensor,
            approach_error=approach_error,
            seed=seed,
        )
        for name, surface in surfaces.items()
    }

    identified = {name: attempt.concluded() for name, attempt in attempts.items()}
    if not any(identification.accepted for identification in identified.values()):
        # Most objects are not the right one, so all starts are fitted only if no object fits.
        for name, attempt in attempts.items():
            wider = attempt.widened()
            if wider is not attempt:
                identified[name] = wider.concluded()

    # All on the same pixels
    candidates = _compared(identified)
    name = None
    reason = _doubt(candidates)
    decision = candidates[0].found.decision
    if not reason:
        name = candidates[0].name
    elif decision is Decision.ACCEPT or any(candidate.found.accepted for candidate in candidates):
        decision = Decision.RESCAN

    return Recognition(
        name=name,
        reason=reason,
        decision=decision,
        candidates=candidates,
        duration_s=perf_counter() - started,
    )


def identify_together(
    cloud: ArrayLike | Scan,
    targets: Mapping[str, Any] | Iterable[Any] | str | Path,
    approaches: Mapping[str, ArrayLike] | None = None,
    *,
    sensor: SensorModel | None = None,
    approach_error: float = APPROACH_ERROR,
    seed: int = 0,
) -> dict[str, Identification]:
    """Identify several objects that all are in one scan, such as a heap in which they touch.

    An accepted object explains its part of the scan. The others are searched for again in the rest,
    and may be behind it; this is repeated until no further object is accepted. A pixel shows one
    object: of two objects that claim the same pixels the likelier is accepted.

    Args:
        cloud: As for `identify`.
        targets: As for `recognise`.
        approaches: (3,) [m] coarse positions of objects' centres in S, by name; without: anywhere.
        sensor: Accuracy of the sensor; None: `SensorModel()`.
        approach_error: [m] largest error of the coarse positions.
        seed: Seed of all random samples.

    Returns:
        The identification of each object, by name.

    Raises:
        ConfigurationError: A wrong type or shape, no targets, or two targets of the same name.
    """
    surfaces = models_of(targets, seed)

    approaches = dict(approaches or {})
    if stray := sorted(set(approaches) - set(surfaces)):
        raise ConfigurationError(
            f"approaches: no object is named {shown(stray[0])}; there are {sorted(surfaces)}"
        )

    scan: Any = cloud
    if not isinstance(cloud, Scan):
        with suppress(PerceptionError):  # each object states it
            scan = Scan.from_cloud(cloud)

    identified: dict[str, Identification] = {}

    sought = list(surfaces)
    while sought:
        for name in sought:
            identified[name] = identify(
                scan,
                surfaces[name],
                approaches.get(name),
                sensor=sensor,
                approach_error=approach_error,
                seed=seed,
            )

        left = [name for name in sought if not identified[name].accepted]

        # Accepted objects explain their pixels, the likelier object first
        for name in sorted(
            set(sought) - set(left), key=lambda name: -identified[name].hypotheses[0].log_likelihood
        ):
            known = _shown(scan, identified[name])
            if (
                scan.known is not None
                and (known.shown & scan.known.shown).sum() > _SHARED * known.shown.sum()
            ):
                identified[name] = replace(
                    identified[name], accepted=False, reason="its evidence shows another object"
                )
                left.append(name)
            else:
                scan = replace(
                    scan, known=known if scan.known is None else known.joined(scan.known)
                )

        if len(left) == len(sought):
            break
        sought = left
    return identified


def _shown(scan: Scan, found: Identification) -> KnownObjects:
    """The pixels of the scan that show an accepted object."""
    assert found.evidence is not None  # the object was accepted, so it has these

    depth = found.surface.depth(found.X_sensor_target, scan)
    off = np.abs(scan.depth - depth)
    z = np.where(np.isfinite(depth), depth, 1.0)

    with np.errstate(invalid="ignore"):
        shown = off < 3.0 * found.evidence.noise.sigma(z)
        shown |= ndimage.binary_dilation(shown) & (off < 3.0 * found.evidence.sensor.sigma(z))
    return KnownObjects(np.where(np.isfinite(depth), depth, np.inf), shown)


def models_of(
    targets: Mapping[str, Any] | Iterable[Any] | str | Path, seed: int = 0
) -> dict[str, ModelSurface]:
    """Sampled models by name; arguments and errors as those of `recognise`."""
    if isinstance(targets, (str, Path)):
        named: list[tuple[str | None, Any]] = [(None, file) for file in model_files(targets)]
    elif isinstance(targets, Mapping):
        named = [(str(name), target) for name, target in targets.items()]
    elif isinstance(targets, Iterable) and not isinstance(targets, np.ndarray):
        named = [(None, target) for target in targets]
    else:
        raise ConfigurationError(
            f"targets: must be several models, or the name of a folder, got {shown(targets)}"
        )

    models: dict[str, ModelSurface] = {}
    for k, (name, target) in enumerate(named):
        try:
            surface = sampled(target, seed)
        except ConfigurationError as error:
            raise ConfigurationError(f"targets, {name or f'number {k + 1}'}: {error}") from error

        name = name or surface.target.name
        if name in models:
            raise ConfigurationError(
                f"targets: every model must have a different name, but {name!r} occurs twice"
            )
        models[name] = surface

    if not models:
        raise ConfigurationError("targets: must have at least one model, got none")
    return models


def model_files(folder: str | Path) -> list[Path]:
    """The mesh and cloud files of a folder, by name.

    Raises:
        ConfigurationError: There is no such folder, or no such file in it.
    """
    path = Path(folder)
    if not path.is_dir():
        raise ConfigurationError(
            f"targets: must be several models, or the name of a folder, got {shown(str(folder))}"
        )
    files = sorted(
        file for file in path.iterdir() if file.suffix.lower() in _ENDINGS and file.is_file()
    )

    if not files:
        raise ConfigurationError(
            f"targets: folder {shown(str(folder))} has no model; the endings of model files are "
            f"{sorted(_ENDINGS)}"
        )
    return files


def _compared(found: Mapping[str, Identification]) -> tuple[Candidate, ...]:
    """The candidates compared on common pixels, the likeliest first.

    The noise is estimated from the best. Candidates without evidence come last.
    """
    evidences = {
        name: identification.evidence
        for name, identification in found.items()
        if identification.evidence is not None
    }
    rivals = [
        evidence
        for name, evidence in evidences.items()
        if found[name].decision is not Decision.REFUSE
    ]

    # Pixels of all rivals, with the least noise that any of them shows
    common = None
    for evidence in rivals or list(evidences.values()):
        if common is None:
            common = evidence
        noise = max(common.noise, evidence.noise, key=lambda noise: noise.information)
        common = replace(common, standing=common.standing | evidence.standing, noise=noise)

    candidates = [
        Candidate(
            name=name,
            found=identification,
            log_likelihood=-np.inf
            if common is None or identification.evidence is None
            else log_likelihood(common, identification.surface, identification.X_sensor_target),
        )
        for name, identification in found.items()
    ]
    return tuple(
        sorted(
            candidates,
            key=lambda candidate: (-candidate.log_likelihood, not candidate.found.accepted),
        )
    )


def _doubt(candidates: tuple[Candidate, ...]) -> str:
    """Reason why the likeliest candidate is not accepted; empty if it is accepted."""
    first = candidates[0]

    if not any(candidate.found.accepted for candidate in candidates):
        return (
            f"none of {len(candidates)} objects is accepted; the likeliest, {first.name}: "
            f"{first.found.reason}"
        )
    if not first.found.accepted:
        return f"{first.name} is the likeliest, but not accepted: {first.found.reason}"

    for other in candidates[1:]:
        ahead = first.log_likelihood - other.log_likelihood
        if ahead < MIN_MARGIN:
            return (
                f"{other.name} fits as well as {first.name}: {ahead:.1f} nat between them, "
                f"need {MIN_MARGIN:g}"
            )
    return ""
