"""Motion between two pictures of a small stereo camera: direct alignment of intensity and depth.

The key picture's pixels are carried into the present one by depth and a trial motion. Two residuals
are minimised by Gauss-Newton with Huber weights: intensity, which observes motion across a textured
surface [Lucas 1981], and the distance from the present surface along its normal, which observes its
shape [Chen 1992]. [Kerl 2013] combines the two. The rotation between the pictures is known from
attitude reference and encoders, and enters as a prior. Intensity is relative to its local mean, so
that lamp and backscatter of the water have no effect. Only gradients well above the camera's noise
are used: on a plain surface noise must not look like texture.

The normal equations show which translations the view observes. Along the generator of a barrel
without texture the information is zero.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, exp_so3

LEVELS = (2.5, 0.8)  # [px] blur of the intensity for each level, coarse to fine
ITERATIONS = (8, 12)  # largest number of iterations for each level
HUBER = 1.345  # [-] standard deviations beyond which a residual has less weight
# [-] least gradient of a pixel whose intensity is used, relative to that of noise
LEAST_GRADIENT = 4.0
DEPTH_BLUR = 2.0  # [px] blur of the inverse depth
# [px] blur of the inverse depth for normals, since noise in them would look like shape
NORMAL_BLUR = 10.0
MEAN_BLUR = 8.0  # [px] size of the local mean
LEAST_PIXELS = 300  # least number of pixels with depth in both pictures
MOST_REJECTED = 0.5  # largest share of residuals beyond three standard deviations of the noise
SETTLED = 2e-6  # [m] step at which the iteration ends
WEAKEST = 2e-3  # [m] standard deviation of a direction, from which on it counts as not observed


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureNoise:
    """Errors of the camera, as far as they are known."""

    intensity: float  # of full scale, white, per pixel
    inverse_depth: float  # [1/m] standard deviation, per pixel
    correlation: float  # [px] of the errors of the depth


@dataclass(frozen=True, slots=True, eq=False)
class PreparedPicture:
    """A picture, prepared for alignment."""

    levels: tuple[np.ndarray, ...]  # each (3, h, w): contrast, its gradients along x and y [1/px]
    # per level: standard deviation of contrast and of its gradient
    noise: tuple[tuple[float, float], ...]
    inverse_depth: np.ndarray  # (h, w) [1/m], smoothed; NaN where not known
    normals: np.ndarray  # (h, w, 3) unit, towards the camera
    K: tuple[float, float, float]  # [px] focal, principal point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """Motion of the camera between two pictures."""

    p_KC: Array  # (3,) [m] position of the present camera in the key camera's axes
    R_KC: Array  # (3, 3)
    # (3, 3) [1/m^2] of the position, key axes, by the residuals' own scatter; 0 if not observed
    information_K: Array
    pixels: int  # number of pixels with depth in both pictures
    settled: bool  # True: the iteration converged, and the residuals are as small as noise


def prepare(
    intensity: np.ndarray, depth: np.ndarray, hidden: np.ndarray, focal: float, noise: PictureNoise
) -> PreparedPicture:
    """Blur, differentiate and mask a picture.

    Args:
        intensity: (h, w), full scale 1.
        depth: (h, w) [m], NaN without a measurement.
        hidden: (h, w) bool: pixels that the vehicle's own tool hides, which are never used.
        focal: [px]; the principal point is the middle.
        noise: Errors of the camera.
    """
    height, width = depth.shape

    known = np.isfinite(depth) & ~hidden
    image = intensity.astype(np.float64)

    # Contrast: intensity relative to its local mean
    share = ndimage.gaussian_filter((~hidden).astype(np.float64), MEAN_BLUR)
    mean = ndimage.gaussian_filter(np.where(hidden, 0.0, image), MEAN_BLUR) / np.maximum(
        share, 1e-3
    )
    mean = np.maximum(mean, 3.0 * noise.intensity)
    contrast = np.where(hidden, 0.0, image / mean - 1.0)
    brightness = float(np.median(mean[~hidden])) if (~hidden).any() else 1.0

    # Contrast and gradients of each level, with their noise
    levels = []
    noises = []
    for blur in LEVELS:
        smooth = ndimage.gaussian_filter(contrast, blur)
        gy, gx = np.gradient(smooth)
        levels.append(np.stack([smooth, gx, gy]))
        # White noise through a Gaussian of width s: 1 / (2 s sqrt(pi)), its derivative 1 / (2 s^2
        # sqrt(2 pi)).
        white = noise.intensity / brightness
        noises.append(
            (white / (2.0 * blur * np.sqrt(np.pi)), white / (2.0 * blur**2 * np.sqrt(2.0 * np.pi)))
        )

    # Inverse depth, and normals of the smoother one
    measured = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0)
    inverse = _smooth(measured, known, DEPTH_BLUR)
    wv, wu = np.gradient(_smooth(measured, known, NORMAL_BLUR))
    v, u = np.indices(depth.shape)
    cx, cy = 0.5 * (width - 1), 0.5 * (height - 1)

    # A plane is linear in the inverse depth w(u, v): its normal is (f w_u, f w_v, w - (u - cx) w_u
    # - (v - cy) w_v).
    normals = -np.stack([focal * wu, focal * wv, inverse - (u - cx) * wu - (v - cy) * wv], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return PreparedPicture(tuple(levels), tuple(noises), inverse, normals, (focal, cx, cy))


def align(
    key: PreparedPicture,
    now: PreparedPicture,
    X_KC: Array,
    rotation_sigma: float,
    noise: PictureNoise,
) -> Alignment | None:
    """Align two pictures.

    Args:
        key: The earlier picture.
        now: The present picture.
        X_KC: (4, 4) predicted pose of the present camera in the key camera's axes.
        rotation_sigma: [rad] standard deviation of its rotation, per axis.
        noise: Errors of the camera.

    Returns:
        The motion; None if the pictures have too few pixels in common.
    """
    R = np.array(X_KC[:3, :3].T)  # R_CK
    t = -R @ X_KC[:3, 3]
    predicted = R.copy()
    start = t.copy()
    normal_matrix = np.zeros((6, 6))
    pixels = 0
    settled = False
    bad = 1.0

    # number of pixels that share one error of the depth
    cells = 1.0 + noise.correlation**2 + 2.0 * np.pi * DEPTH_BLUR**2
    for level, most in enumerate(ITERATIONS):
        # Noise of contrast, and the gradient that stands out of it
        sigma_i = max(np.hypot(now.noise[level][0], key.noise[level][0]), 1e-6)
        least = (LEAST_GRADIENT * max(now.noise[level][1], key.noise[level][1])) ** 2
        scale_i = 3.0 * sigma_i
        scale_d = 3.0 * noise.inverse_depth

        settled = False
        for _ in range(most):
            H, g, count, residuals_i, residuals_d = normal_equations(
                key.levels[level],
                key.inverse_depth,
                key.normals,
                now.levels[level],
                now.inverse_depth,
                np.array(now.K),
                R,
                t,
                np.array([scale_i, scale_d, HUBER, least]),
            )

            pixels = int(count)
            if pixels < LEAST_PIXELS:
                return None

            # Scales by the residuals' median, never below the noise
            scale_i = _scale(residuals_i, sigma_i)
            scale_d = _scale(residuals_d, 0.2 * noise.inverse_depth)
            bad = float(np.mean(np.abs(residuals_d) > 3.0 * noise.inverse_depth))

            # Neighbouring pixels share one error, so each has its share of the weight.
            H = H / cells
            g = g / cells

            # Gauss-Newton step with priors
            turn = _rotation_vector(R @ predicted.T)
            step = _step(H, g, turn, t - start, rotation_sigma)
            turned = exp_so3(step[3:])
            R = turned @ R
            t = turned @ t + step[:3]
            normal_matrix = H
            if np.abs(step[:3]).max() < SETTLED:
                settled = True
                break

    information_C = _information(normal_matrix, rotation_sigma)
    R_KC = R.T
    return Alignment(
        p_KC=-R_KC @ t,
        R_KC=R_KC,
        information_K=R_KC @ information_C @ R_KC.T,
        pixels=pixels,
        settled=settled and bad <= MOST_REJECTED,
    )


def _scale(residuals: Array, least: float) -> float:
    """Standard deviation of residuals (n,) by their median, at least `least`."""
    if not len(residuals):
        return least
    return max(1.4826 * float(np.median(np.abs(residuals))), least)


def _step(H: Array, g: Array, turn: Array, moved: Array, rotation_sigma: float) -> Array:
    """Gauss-Newton step (6,) of translation [m] and rotation [rad], with priors.

    The rotation is known, and a direction that is not observed keeps the prediction.

    Args:
        H: (6, 6) normal matrix.
        g: (6,) its right side.
        turn: (3,) [rad] rotation from the prediction.
        moved: (3,) [m] translation from the prediction.
        rotation_sigma: [rad] standard deviation of the predicted rotation, per axis.
    """
    A = H.copy()
    b = g.copy()
    A[3:, 3:] += 1.0 / rotation_sigma**2 * np.eye(3)
    b[3:] += 1.0 / rotation_sigma**2 * turn
    A[:3, :3] += np.eye(3) / WEAKEST**2
    b[:3] += moved / WEAKEST**2
    return np.asarray(-np.linalg.solve(A, b), dtype=np.float64)


def _information(H: Array, rotation_sigma: float) -> Array:
    """Information (3, 3) [1/m^2] on the position, the rotation marginalised.

    Directions that are hardly observed count as unobserved.
    """
    A = H.copy()
    A[3:, 3:] += np.eye(3) / rotation_sigma**2
    information = A[:3, :3] - A[:3, 3:] @ np.linalg.solve(A[3:, 3:], A[3:, :3])

    eigenvalues, axes = np.linalg.eigh(information)
    eigenvalues[eigenvalues < WEAKEST**-2] = 0.0
    return (axes * eigenvalues) @ axes.T


def _smooth(values: np.ndarray, known: np.ndarray, blur: float) -> np.ndarray:
    """Gaussian mean (h, w) of the known values; NaN where they are few."""
    weight = ndimage.gaussian_filter(known.astype(np.float64), blur)
    smooth = ndimage.gaussian_filter(values, blur) / np.maximum(weight, 1e-6)
    return np.where(known & (weight >= 0.3), smooth, np.nan)


def _rotation_vector(R: Array) -> Array:
    """Rotation vector (3,) [rad] of a small rotation."""
    antisymmetric = 0.5 * (R - R.T)
    return np.array([antisymmetric[2, 1], antisymmetric[0, 2], antisymmetric[1, 0]])


@kernel
def normal_equations(key, key_inverse, normals, now, now_inverse, K, R, t, scales):
    """Gauss-Newton normal equations of intensity and depth, for a small motion of the points in C.

    Args:
        key: (3, h, w) contrast of the key picture and its gradients.
        key_inverse: (h, w) [1/m] inverse depth of the key picture.
        normals: (h, w, 3) normals of the key picture.
        now: (3, h, w) of the present picture.
        now_inverse: (h, w) [1/m] its inverse depth.
        K: (3,) [px] focal, principal point.
        R: (3, 3) R_CK.
        t: (3,) [m] key camera in C.
        scales: (4,) standard deviation of contrast, of inverse depth [1/m], Huber's bound, least
            squared gradient.

    Returns:
        H (6, 6), g (6,), pixels with depth in both, residuals of contrast, residuals of inverse
        depth.
    """
    height, width = key_inverse.shape
    f, cx, cy = K
    H = np.zeros((6, 6))
    g = np.zeros(6)
    J = np.empty(6)
    residuals_i = np.empty(height * width)
    residuals_d = np.empty(height * width)
    ni = 0
    nd = 0

    for v in range(height):
        for u in range(width):
            w = key_inverse[v, u]
            if not w > 0.0:
                continue

            # Point of the key in the present camera
            px, py, pz = (u - cx) / (f * w), (v - cy) / (f * w), 1.0 / w
            x = R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]
            y = R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]
            z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
            if z <= 1e-3:
                continue

            # Its pixel, with bilinear weights of the four around it
            a = f * x / z + cx
            b = f * y / z + cy
            i, j = int(np.floor(a)), int(np.floor(b))
            if i < 0 or j < 0 or i + 1 >= width or j + 1 >= height:
                continue
            s, q = a - i, b - j
            c00, c01, c10, c11 = (1.0 - s) * (1.0 - q), s * (1.0 - q), (1.0 - s) * q, s * q

            # Inverse depth measured at that pixel
            measured = (
                c00 * now_inverse[j, i]
                + c01 * now_inverse[j, i + 1]
                + c10 * now_inverse[j + 1, i]
                + c11 * now_inverse[j + 1, i + 1]
            )
            if not measured > 0.0:
                continue

            # Depth: distance from the present surface along the normal, in units of the inverse
            # depth's error there.
            n0 = (
                R[0, 0] * normals[v, u, 0] + R[0, 1] * normals[v, u, 1] + R[0, 2] * normals[v, u, 2]
            )
            n1 = (
                R[1, 0] * normals[v, u, 0] + R[1, 1] * normals[v, u, 1] + R[1, 2] * normals[v, u, 2]
            )
            n2 = (
                R[2, 0] * normals[v, u, 0] + R[2, 1] * normals[v, u, 1] + R[2, 2] * normals[v, u, 2]
            )
            if n0 == n0:
                # Along the ray the surface is at 1 / measured; the distance along the normal is
                # n . ray (z - 1 / measured).
                ray = (n0 * x + n1 * y + n2 * z) / z
                if abs(ray) > 0.2:
                    # [1/m^2] inverse depth per distance along the normal
                    unit = 1.0 / (ray * z * z)
                    error = (z - 1.0 / measured) * ray * unit
                    J[0], J[1], J[2] = n0 * unit, n1 * unit, n2 * unit
                    J[3], J[4], J[5] = y * J[2] - z * J[1], z * J[0] - x * J[2], x * J[1] - y * J[0]
                    residuals_d[nd] = error
                    nd += 1
                    _add(H, g, J, error, scales[1], scales[2])

            # Gradients at that pixel; intensity is used if both pictures have texture
            gx = (
                c00 * now[1, j, i]
                + c01 * now[1, j, i + 1]
                + c10 * now[1, j + 1, i]
                + c11 * now[1, j + 1, i + 1]
            )
            gy = (
                c00 * now[2, j, i]
                + c01 * now[2, j, i + 1]
                + c10 * now[2, j + 1, i]
                + c11 * now[2, j + 1, i + 1]
            )
            if gx * gx + gy * gy < scales[3] or key[1, v, u] ** 2 + key[2, v, u] ** 2 < scales[3]:
                continue

            # Mean of both gradients: second order in the motion [Malis 2004].
            gx = 0.5 * (gx + key[1, v, u])
            gy = 0.5 * (gy + key[2, v, u])

            intensity = (
                c00 * now[0, j, i]
                + c01 * now[0, j, i + 1]
                + c10 * now[0, j + 1, i]
                + c11 * now[0, j + 1, i + 1]
            )
            error = intensity - key[0, v, u]
            J[0], J[1] = gx * f / z, gy * f / z
            J[2] = -(J[0] * x + J[1] * y) / z
            J[3], J[4], J[5] = y * J[2] - z * J[1], z * J[0] - x * J[2], x * J[1] - y * J[0]
            residuals_i[ni] = error
            ni += 1
            _add(H, g, J, error, scales[0], scales[2])
    return H, g, nd, residuals_i[:ni], residuals_d[:nd]


@kernel
def _add(H, g, J, error, sigma, huber):
    """Add one residual with its Huber weight."""
    away = abs(error) / sigma
    weight = (1.0 if away <= huber else huber / away) / sigma**2
    for i in range(6):
        g[i] += weight * J[i] * error
        for k in range(6):
            H[i, k] += weight * J[i] * J[k]
