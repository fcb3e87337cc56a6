"""Last steps of registration: Gauss-Newton on the pixels of the depth image and the depth edges.

ICP compares a thinned scan, smoothed by cubes and by its own normals. After ICP, every pixel that
shows the object is compared with the rendered model, as in the likelihood.
"""

import numpy as np

from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.fine_fit import GATES, IcpFit
from uuv.perception.registration.likelihood import OCCLUDER, log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import Pairing, PairRows
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points

_STEPS = 3  # largest number of Gauss-Newton steps
_LONGEST = 3.0  # [spacings] largest step: with few pixels a longer one leads astray
_PIXELS = 10_000  # approximate number of pixels of the object that are compared
_OUTSIDE = 3.0  # [sigma] difference beyond which a pixel shows something else
_STEEP = np.cos(np.deg2rad(75.0))  # cosine of incidence, below which a depth is not compared


def polished(
    evidence: Evidence, surface: ModelSurface, fit: IcpFit, likelihood: float
) -> tuple[Array, float]:
    """Refine a pose as long as the scan becomes likelier.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        fit: Result of ICP; its free twists are not changed.
        likelihood: [nat] log likelihood at its pose.

    Returns:
        The pose (4, 4) and its log likelihood [nat].
    """
    X_ST = fit.X_ST
    for _ in range(_STEPS):
        rows = pixel_rows(evidence, surface, X_ST)
        if fit.pairing is not None:
            rows = PairRows.joined(rows, fit.pairing.edge_rows(X_ST, GATES[-1] * surface.spacing))

        # Gauss-Newton step in the directions that are not free
        J = rows.J[:, :6]
        H = J.T @ (rows.weight[:, None] * J)
        g = J.T @ (rows.weight * rows.distance)
        held = np.linalg.svd(np.vstack([fit.free, np.zeros((1, 6))]))[2][len(fit.free) :]
        A = held @ H @ held.T
        step = held.T @ np.linalg.solve(A + 1e-9 * (np.trace(A) + 1.0) * np.eye(len(A)), held @ g)
        step *= min(1.0, _LONGEST * surface.spacing / max(float(np.linalg.norm(step)), 1e-12))

        # A step is taken as long as it makes the scan likelier
        center = transform_points(X_ST, surface.center)
        R = exp_so3(step[3:] / surface.radius)
        moved = pose(R, center + step[:3] - R @ center) @ X_ST
        likelier = log_likelihood(evidence, surface, moved)
        if likelier <= likelihood:
            break
        X_ST, likelihood = moved, likelier
    return X_ST, likelihood


def polished_rows(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> PairRows | None:
    """Pairs of pixels and depth edges at a refined pose `X_ST`; None if the model is out of
    view.
    """
    pairing = Pairing.of(evidence, surface, X_ST)
    if pairing is None:
        return None
    edges = pairing.edge_rows(X_ST, GATES[-1] * surface.spacing)
    return PairRows.joined(pixel_rows(evidence, surface, X_ST), edges)


def pixel_rows(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> PairRows:
    """Depth differences of scan and model at `X_ST`, one row per pixel; the unknowns are those of
    `Pairing.terms`.
    """
    window = evidence.scan.window(transform_points(X_ST, surface.hull), 0.0, _PIXELS)
    scan = evidence.scan.part(window)

    # Rendered model
    rays = scan.rays
    X_TS = np.linalg.inv(X_ST)
    hit = surface.scene.cast(X_TS[:3, 3], rays @ X_TS[:3, :3].T)
    z = np.where(np.isfinite(hit["t"]), hit["t"], np.nan).astype(np.float64)
    sigma = evidence.noise.sigma(np.where(np.isfinite(z), z, 1.0))

    off = scan.depth - z
    n = hit["normal"].astype(np.float64) @ X_ST[:3, :3].T

    across = np.einsum("hwi,hwi->hw", n, rays)
    with np.errstate(invalid="ignore"):
        used = (np.abs(off) < np.minimum(_OUTSIDE * sigma, OCCLUDER)) & (
            np.abs(across) > _STEEP * np.linalg.norm(rays, axis=-1)
        )
    off = off[used]
    sigma = sigma[used]
    n = n[used]
    across = across[used]
    rays = rays[used]
    z = z[used]

    arm = (z[:, None] * rays - transform_points(X_ST, surface.center)) / surface.radius
    weight = evidence.noise.independent(window[0].step or 1) / sigma**2
    return PairRows(
        # A motion of the surface by v changes the depth along the ray d, scaled to z = 1, by n . v
        # / n . d.
        J=np.column_stack([n, np.cross(arm, n), np.einsum("ni,ni->n", arm, n)]) / across[:, None],
        weight=weight,
        slope=weight,
        distance=off,
        tangents=rays[:, :2],
        common=np.zeros(len(off)),
    )
