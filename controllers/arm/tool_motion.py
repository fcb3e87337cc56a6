"""Tool and joint reference between the supervisor's steps: extrapolation and blending, compiled for their rate."""

import numba
import numpy as np


@numba.njit(cache=True)
def extrapolated(X_WG, v_WG_W, w_WG_W, since, k, offset_W):
    """Extrapolate a tool pose by its velocities, then displace it along its axis and by an offset.

    Args:
        X_WG: (4, 4) tool pose `since` ago.
        v_WG_W: (3,) [m/s] velocity of its origin, W.
        w_WG_W: (3,) [rad/s] angular velocity, W.
        since: [s] age of `X_WG`.
        k: [m] displacement along the tool axis.
        offset_W: (3,) [m] further displacement, W.

    Returns:
        The pose (4, 4).
    """
    angle = since * np.sqrt(w_WG_W[0] ** 2 + w_WG_W[1] ** 2 + w_WG_W[2] ** 2)
    s = 1.0 - angle**2 / 6.0 if angle < 1e-6 else np.sin(angle) / angle  # Rodrigues
    c = 0.5 - angle**2 / 24.0 if angle < 1e-6 else (1.0 - np.cos(angle)) / angle**2
    x, y, z = since * w_WG_W[0], since * w_WG_W[1], since * w_WG_W[2]
    out = X_WG.copy()
    for j in range(3):
        a, b, d = X_WG[0, j], X_WG[1, j], X_WG[2, j]
        along = c * (x * a + y * b + z * d)
        kept = 1.0 - c * angle**2
        out[0, j] = kept * a + s * (y * d - z * b) + along * x
        out[1, j] = kept * b + s * (z * a - x * d) + along * y
        out[2, j] = kept * d + s * (x * b - y * a) + along * z
    for i in range(3):
        out[i, 3] += since * v_WG_W[i] + k * out[i, 2] + offset_W[i]
    return out


@numba.njit(cache=True)
def bumpless(q, qd, q_last, offset, offset_rate, blend_time, most, dt):
    """Bumpless transfer to a new joint reference: a remaining offset decays, critically damped.

    Args:
        q: (n,) [rad] angles of the reference.
        qd: (n,) [rad/s] speeds of the reference.
        q_last: (n,) [rad] angles wanted in the last step.
        offset: (n,) [rad] remaining offset from the reference.
        offset_rate: (n,) [rad/s] its rate.
        blend_time: [s] time constant of the decay.
        most: [rad] largest change of an angle in this step.
        dt: [s] of this step.

    Returns:
        Angles and speeds wanted, remaining offset and its rate, (n,) each.
    """
    n = q.shape[0]
    wanted, speed, left, rate = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    fade = np.exp(-dt / blend_time)
    for j in range(n):
        pull = (offset_rate[j] + offset[j] / blend_time) * dt
        rate[j] = fade * (offset_rate[j] - pull / blend_time)
        left[j] = fade * (offset[j] + pull)
        wanted[j] = min(max(q[j] + left[j], q_last[j] - most), q_last[j] + most)
        speed[j] = qd[j] + rate[j]
    return wanted, speed, left, rate
