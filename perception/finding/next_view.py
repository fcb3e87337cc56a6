"""Choice of the next view: the most informative view, given what the last view left unobserved.

Each candidate view is predicted with the model at the pose estimated so far. The information of a
view is that which a fit obtains from a noiseless scan: distances to the visible surface, and depth
edges. Foreground that was before the object in the last scan occludes the object in the candidate
view too. If two poses compete, the view is chosen in which they differ most.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from uuv.perception.clouds.scan import MIN_POINTS, Scan
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.fine_fit import GATES
from uuv.perception.registration.identification import Identification
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pairing import Pairing
from uuv.perception.registration.pose_covariance import turn_of_symmetry
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

# [rad] angles of the candidates about the vertical: 15, 30 and 45 deg
ARCS = (-0.26, 0.26, -0.52, 0.52, -0.79, 0.79)
RIVAL = 30.0  # [nat] difference of log likelihood, below which the next best pose competes
# approximate number of pixels of the grid on which views are predicted: depth edges need every
# third pixel of 640 x 480
_PIXELS = 40_000
_POINTS = 1500  # number of points of a predicted scan that are compared with the model
# [nat] largest contribution of one pixel: three standard deviations; more is as likely an outlier
_CERTAIN = 4.5
# [-] share of the best predicted value, above which views count as equal; the farthest of them is
# then chosen, since it shares the least of the errors and occlusions of the present view
_AS_GOOD = 0.67
# [1/m^2] information of a motion that is not observed: a standard deviation of 10 m
_FREE = 1e-2


def views_around(center: Array, up: Array, arcs: Sequence[float] = ARCS) -> list[Array]:
    """Motions (4, 4) about a vertical axis through an object's centre, which keep range, height and
    aim.

    Args:
        center: (3,) [m] of the object, in any frame.
        up: (3,) unit, upwards, in that frame.
        arcs: [rad] angles.
    """
    turns = [exp_so3(angle * up) for angle in arcs]
    return [pose(R, center - R @ center) for R in turns]


def ranked_views(found: Identification, views: Sequence[Array]) -> list[int]:
    """Indices of the candidate views, best first; empty if the views cannot be predicted.

    Args:
        found: The last identification, accepted or not.
        views: (4, 4) candidate poses X_SN of the sensor, in the frame S of that identification's
            scan.
    """
    if found.evidence is None or found.surface is None or not views:
        return []

    # Value of a view: log likelihood ratio between two competing poses, else a smaller uncertainty
    rivals = [h.X_sensor_target for h in found.hypotheses[1:2]]
    if not found.accepted and found.margin < RIVAL and rivals:
        worth = [telling_nats(found, rivals[0], X_SN) for X_SN in views]
    else:
        worth = [1.0 / predicted_sigma(found, X_SN) for X_SN in views]

    # The best view first; among views about as good, the farthest
    best = max(worth)
    far = [float(np.linalg.norm(X_SN[:3, 3])) for X_SN in views]
    return sorted(range(len(views)), key=lambda i: (worth[i] < _AS_GOOD * best, -far[i], -worth[i]))


def predicted_sigma(found: Identification, X_SN: Array) -> float:
    """Standard deviation [m] of the least certain twist after the last view and another one from
    `X_SN`.
    """
    assert found.surface is not None
    known = np.zeros((6, 6)) if found.covariance is None else found.covariance.information
    same = turn_of_symmetry(found.surface, np.asarray(found.X_sensor_target))

    # Information of both views, along the observable twists
    total = known + predicted_information(found, X_SN) + _FREE * np.eye(6)
    held = np.linalg.svd(np.vstack([same, np.zeros((1, 6))]))[2][len(same) :]
    return float(1.0 / np.sqrt(np.linalg.eigvalsh(held @ total @ held.T)[0]))


def predicted_information(found: Identification, X_SN: Array) -> Array:
    """Information (6, 6) [1/m^2] from a view at `X_SN` about twists around the model's centre
    in S.
    """
    evidence = found.evidence
    surface = found.surface
    assert evidence is not None
    assert surface is not None

    # The scan that the sensor would take from there
    grid = _grid(evidence.scan)
    X_NT = inverse(X_SN) @ found.X_sensor_target
    view = _seen(found, X_SN, X_NT, grid)
    mask = np.isfinite(view.depth)
    step = grid.pitch / evidence.scan.pitch
    sensor = replace(evidence.sensor, noise_length=max(1.0, evidence.sensor.noise_length / step))

    if mask.sum() < MIN_POINTS:
        return np.zeros((6, 6))

    # Information of the scan's points and edges, as in a fit
    predicted = Evidence.of(view, mask, 0.8 * surface.spacing, sensor, most=_POINTS)
    pairing = Pairing.of(predicted, surface, X_NT)
    if pairing is None:
        return np.zeros((6, 6))
    gate = GATES[-1] * surface.spacing

    # Transformed into the frame of the last scan
    turn = np.kron(np.eye(2), X_SN[:3, :3])
    return turn @ pairing.terms(X_NT, gate, pairing.nearest(X_NT, gate))[0][:6, :6] @ turn.T


def telling_nats(found: Identification, X_ST_rival: Array, X_SN: Array) -> float:
    """Expected log likelihood ratio [nat] of the estimated pose over a rival pose, in a view from
    `X_SN`.
    """
    evidence = found.evidence
    assert evidence is not None
    grid = _grid(evidence.scan)
    fitted, rival = (
        _seen(found, X_SN, inverse(X_SN) @ X, grid).depth
        for X in (np.asarray(found.X_sensor_target), X_ST_rival)
    )

    # Pixels where both poses show a surface: difference of depth over its standard deviation
    both = np.isfinite(fitted) & np.isfinite(rival)
    off = np.zeros(fitted.shape)
    off[both] = (
        0.5
        * ((fitted[both] - rival[both]) / evidence.sensor.sigma(0.5 * (fitted[both] + rival[both])))
        ** 2
    )

    # Pixels where only one pose shows a surface: outliers
    off[np.isfinite(fitted) ^ np.isfinite(rival)] = _CERTAIN

    # Neighbouring pixels share their errors
    independent = evidence.sensor.independent(grid.pitch / evidence.scan.pitch)
    return float(independent * np.minimum(off, _CERTAIN).sum())


def _grid(scan: Scan) -> Scan:
    """Whole picture of a sensor, thinned to about _PIXELS pixels."""
    step = max(1, round(float(np.sqrt(scan.depth.size / _PIXELS))))
    return scan.part((slice(None, None, step), slice(None, None, step)))


def _seen(found: Identification, X_SN: Array, X_NT: Array, grid: Scan) -> Scan:
    """Scan of the model at `X_NT` from `X_SN`, without the part that the last scan's foreground
    occludes.
    """
    evidence = found.evidence
    surface = found.surface
    assert evidence is not None
    assert surface is not None

    # Picture of the model, without surfaces too oblique for an echo
    rendered, cosine = surface.seen(X_NT, grid)
    points = np.array(rendered.points)
    with np.errstate(invalid="ignore"):
        points[~(cosine > np.cos(evidence.sensor.max_incidence))] = np.nan

    # Foreground of the last scan occludes the object here too
    before = transform_points(inverse(X_SN), _foreground(found, surface))
    row, column, inside = grid.pixels(before)
    near = np.full(grid.depth.shape, np.inf)
    np.minimum.at(near, (row[inside], column[inside]), before[inside, 2])
    with np.errstate(invalid="ignore"):
        points[near < points[..., 2]] = np.nan
    return replace(rendered, points=points)


def _foreground(found: Identification, surface: ModelSurface) -> Array:
    """Points (n, 3) [m] of the last scan, in S, that are before the object at its identified
    pose.
    """
    assert found.evidence is not None
    scan = found.evidence.scan
    step = max(1, round(float(np.sqrt(scan.depth.size / (2 * _PIXELS)))))
    part = scan.part((slice(None, None, step), slice(None, None, step)))

    depth = surface.depth(np.asarray(found.X_sensor_target), part)
    with np.errstate(invalid="ignore"):
        before = part.depth < depth - 0.1 * surface.radius
    return part.points[before]
