"""Small steps of the tool's motion, compiled, because they run at the rate of the tool's reference."""

import numba
import numpy as np


@numba.njit(cache=True)
def moved_on(X_WG, v_WG_W, w_WG_W, since, k, offset_W):
    """The pose (4, 4) of a tool that was at `X_WG` `since` [s] ago, turned and carried on by its velocities [m/s,
    rad/s], then displaced by `k` [m] along its axis, and by `offset_W` (3,) [m]."""
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
def blended(q, qd, q_last, offset, offset_rate, blend_time, most, dt):
    """Joint angles and speeds (n,) wanted where the arm should be at `q` with `qd`, `offset` (n,) [rad] away from which
    it was let in; the offset and its rate fade, critically damped, by one step `dt` [s]. No angle moves by more than
    `most` [rad] from `q_last`. Returns those two, and the offset and its rate that are left."""
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
