"""Point-to-plane ICP from the scan to the visible part of a known model.

[Konoplin 2022] matches the model's points to the scan and removes hidden ones after the first pass.
Matching the scan to planes of the visible model is 3 to 10 times as accurate. Planes do not
determine some motions: sliding along a plate, or along a barrel seen from the side. Depth edges of
scan and model determine these motions. Both are computed on the same pixel grid, so that their bias
cancels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import Pairing, PairRows
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points

# [spacings] distance within which points are paired, in the first and in the last round
GATES = (8.0, 3.0)
_NUDGES = 3  # number of steps of ICP, after which a start is ranked
_AT_REST = 0.01  # [spacings] step, below which ICP with the same pairs has converged
_STALE = 0.2  # [spacings] motion of the model, after which nearest points are searched again
# [-] share of the largest eigenvalue of the normal equations, below which a motion is free
_FREE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class IcpFit:
    """Result of ICP at convergence."""

    X_ST: Array  # (4, 4) pose of T in S
    free: Array  # (k, 6) free unit twists (linear; angular x radius) in S, about the model's centre
    residual: float  # [m] robust rms of the point-to-plane distance
    size: float  # [-] scale of the object relative to the model that would minimise the residual
    size_sigma: float  # [-] standard deviation of `size`, from the sensor's noise
    pairing: Pairing | None = None  # pairing of the last round; None if the model is out of view


def nudged(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> Array:
    """Pose (4, 4) after a few steps of ICP on planes, at which a start can be ranked more
    reliably.
    """
    pairing = Pairing.of(evidence, surface, X_ST, with_edges=False)
    gate = GATES[0] * surface.spacing
    if pairing is None:
        return X_ST
    for _ in range(_NUDGES):
        H, g, _ = pairing.terms(X_ST, gate, pairing.nearest(X_ST, gate))
        X_ST = _moved(X_ST, H, g, surface)[0]
    return X_ST


def fine_fit(
    evidence: Evidence,
    surface: ModelSurface,
    X_ST: Array,
    gates: Sequence[float] = GATES,
    inner: int = 5,
) -> IcpFit:
    """Full ICP on point-to-plane distances and depth edges; hidden points are removed before each
    round.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) initial pose of T in S.
        gates: [spacings] distances within which points are paired, one for each pairing with the
            visible model.
        inner: Largest number of Gauss-Newton steps in a round.

    Returns:
        The pose at convergence, its free twists, residual and best scale.
    """
    pairing = None
    X_paired = X_ST
    gate = 0.0
    for gate in np.array(gates) * surface.spacing:
        pairing = Pairing.of(evidence, surface, X_ST)
        X_paired = X_ST
        if pairing is None:
            break
        index = pairing.nearest(X_ST, gate)
        X_looked_up = X_ST

        # Gauss-Newton steps; nearest points are looked up again once the model has moved
        for _ in range(inner):
            if _step(X_looked_up, X_ST, surface) > _STALE * surface.spacing:
                index = pairing.nearest(X_ST, gate)
                X_looked_up = X_ST
            H, g, _ = pairing.terms(X_ST, gate, index)
            X_before = X_ST
            X_ST, _ = _moved(X_ST, H, g, surface)
            if _step(X_before, X_ST, surface) < _AT_REST * surface.spacing:
                break

    # Free twists are computed with the pairs at the final pose, since ICP may have slid away from
    # all that held it before.
    if pairing is not None and _step(X_paired, X_ST, surface) > surface.spacing:
        pairing = Pairing.of(evidence, surface, X_ST)
    if pairing is None:
        return IcpFit(X_ST, np.zeros((0, 6)), np.inf, 1.0, np.inf)

    H, g, residual = pairing.terms(X_ST, gate, pairing.nearest(X_ST, gate))
    return IcpFit(X_ST, _moved(X_ST, H, g, surface)[1], residual, *_size(H, g, surface), pairing)


def icp_rows(evidence: Evidence, surface: ModelSurface, fit: IcpFit) -> PairRows | None:
    """The pairs of the last round at the pose of a fit; None if the model was out of view."""
    pairing = fit.pairing or Pairing.of(evidence, surface, fit.X_ST)
    if pairing is None:
        return None
    gate = GATES[-1] * surface.spacing
    return pairing.rows(fit.X_ST, gate, pairing.nearest(fit.X_ST, gate))


def _moved(X_ST: Array, H: Array, g: Array, surface: ModelSurface) -> tuple[Array, Array]:
    """One Gauss-Newton step in the observed directions, and the free directions (k, 6)."""
    H = H[:6, :6]
    g = g[:6]
    radius = surface.radius
    center = transform_points(X_ST, surface.center)

    axis = surface.symmetry.axis
    spin = np.zeros((0, 6))
    if axis is not None:
        # Free by the declared symmetry; otherwise the facets of the mesh would act as evidence of
        # the angle.
        axis_S = X_ST[:3, :3] @ axis
        spin = np.concatenate(
            [
                np.cross(axis_S, center - transform_points(X_ST, surface.symmetry.center)),
                radius * axis_S,
            ]
        )[None]
        spin /= np.linalg.norm(spin)
        P = np.eye(6) - spin.T @ spin
        H = P @ H @ P
        g = P @ g

    # Step along the directions that the equations determine
    eigenvalues, vectors = np.linalg.eigh(H)
    held = eigenvalues > _FREE * max(eigenvalues[-1], 1e-12)
    step = vectors[:, held] @ ((vectors[:, held].T @ g) / eigenvalues[held])
    # A longer step is due to a handful of pairs; the next iteration pairs again.
    step *= min(1.0, 0.5 * radius / max(float(np.linalg.norm(step)), 1e-12))

    R = exp_so3(step[3:] / radius)
    X_SS = pose(R, center + step[:3] - R @ center)
    return X_SS @ X_ST, vectors[:, ~held].T


def _size(H: Array, g: Array, surface: ModelSurface) -> tuple[float, float]:
    """Best scale of the object and its standard deviation [-]; free directions stay unchanged."""
    eigenvalues, vectors = np.linalg.eigh(H)
    if not eigenvalues[-1] > 0.0:
        return 1.0, np.inf

    inverted = vectors[6] / np.maximum(eigenvalues, _FREE**2 * eigenvalues[-1])
    growth = float(inverted @ (vectors.T @ g))
    variance = float(inverted @ vectors[6])
    return 1.0 + growth / surface.radius, np.sqrt(variance) / surface.radius


def _step(A: Array, B: Array, surface: ModelSurface) -> float:
    """Approximate upper bound [m] of a model point's motion from pose `A` to `B` (4, 4)."""
    center = transform_points(A, surface.center) - transform_points(B, surface.center)
    turn = np.linalg.norm(A[:3, :3] - B[:3, :3]) / np.sqrt(2.0)
    return float(np.linalg.norm(center) + surface.radius * turn)
