"""Shape helpers against closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad

from uuv.models import hydrodynamics as water
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3

RHO = 1000.0


def lamb_k_factors(e: float) -> tuple[float, float, float]:
    """k1 (along), k2 (across), k' (rotation across) of a prolate spheroid of eccentricity e (Lamb,
    art. 114, 115).
    """
    a0 = 2.0 * (1.0 - e**2) / e**3 * (0.5 * np.log((1.0 + e) / (1.0 - e)) - e)
    b0 = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * np.log((1.0 + e) / (1.0 - e))
    turn = e**4 * (b0 - a0) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (b0 - a0)))
    return a0 / (2.0 - a0), b0 / (2.0 - b0), turn


@pytest.mark.check("sphere: volume, added mass, drag", "rho V / 2; C_d pi r^2 / 2")
def test_sphere(within):
    body = water.sphere(0.2, water_density=RHO)
    volume = 4.0 / 3.0 * np.pi * 0.008
    within("volume", body.volume / volume - 1.0, 1e-15)
    added = body.added_mass / (RHO * volume / 2.0)
    within("added mass", added - np.diag([1.0] * 3 + [0.0] * 3), 2e-15)
    within("drag", body.quadratic_damping[0] / (0.5 * RHO * 0.47 * np.pi * 0.04) - 1.0, 1e-15)


@pytest.mark.check("spheroid: added mass", "Lamb's k factors, art. 114, 115")
@pytest.mark.parametrize("ratio", [1.01, 2.0, 5.0, 50.0])
def test_prolate_spheroid_has_lambs_factors(ratio, within):
    b = 0.1
    a = ratio * b
    body = water.ellipsoid([a, b, b], water_density=RHO)
    k1, k2, k_turn = lamb_k_factors(np.sqrt(1.0 - 1.0 / ratio**2))
    displaced = RHO * 4.0 / 3.0 * np.pi * a * b * b
    inertia = displaced * (a * a + b * b) / 5.0
    expected = [
        k1 * displaced,
        k2 * displaced,
        k2 * displaced,
        0.0,
        k_turn * inertia,
        k_turn * inertia,
    ]
    # Lamb's closed form itself cancels near a sphere.
    error = (body.added_mass.diagonal() - expected) / np.array([displaced] * 3 + [inertia] * 3)
    within("relative added mass", error, 5e-14)  # measured 6e-15
    within("off the diagonal", body.added_mass - np.diag(body.added_mass.diagonal()), 1e-15)


def lamb_rotation(axes: Array) -> Array:
    """(3,) [m^2] added inertia of an ellipsoid about its axes over the displaced mass (Lamb, art.
    115 (5)).
    """
    alphas = lamb_alphas(axes)
    b2, c2 = np.roll(axes, -1) ** 2, np.roll(axes, -2) ** 2
    slip = np.roll(alphas, -2) - np.roll(alphas, -1)
    return (b2 - c2) ** 2 * slip / (2.0 * (b2 - c2) - (b2 + c2) * slip) / 5.0


def lamb_alphas(axes: Array) -> Array:
    """(3,) Lamb's alpha_0, beta_0, gamma_0 (art. 114 (8)), by quadrature."""

    def alpha(i: int) -> float:
        def integrand(t: float) -> float:  # l = t / (1 - t), to make the range finite
            x = t / (1.0 - t)
            return 1.0 / ((axes[i] ** 2 + x) * np.sqrt(np.prod(axes**2 + x)) * (1.0 - t) ** 2)

        return float(np.prod(axes)) * quad(integrand, 0.0, 1.0, epsabs=1e-13, epsrel=1e-13)[0]

    return np.array([alpha(i) for i in range(3)])


def face_drag(width: float, height: float) -> float:
    """[m^5] integral of |r|^3 over a face of `width` along the axis of a spin and `height` across
    it.
    """
    return width * 2.0 * quad(lambda r: r**3, 0.0, height / 2.0)[0]


@pytest.mark.check("ellipsoid: added mass, drag", "Lamb's integrals, by quadrature; C_d pi b c / 2")
def test_ellipsoid_with_three_axes_against_lambs_integrals(within):
    axes = np.array([0.5, 0.3, 0.2])
    body = water.ellipsoid(axes, drag_coefficient=0.3, water_density=RHO)
    alphas = lamb_alphas(axes)
    displaced = RHO * 4.0 / 3.0 * np.pi * np.prod(axes)
    added = body.added_mass.diagonal() / displaced
    within("volume", RHO * body.volume / displaced - 1.0, 1e-15)
    within("translation", added[:3] / (alphas / (2 - alphas)) - 1.0, 1e-14)  # measured 9e-16
    within("rotation", added[3:] / lamb_rotation(axes) - 1.0, 3e-14)  # measured 3e-15
    area = np.pi * np.array([0.3 * 0.2, 0.5 * 0.2, 0.5 * 0.3])
    within("drag", body.quadratic_damping[:3] / (0.5 * RHO * 0.3 * area) - 1.0, 2e-15)
    within("drag of spin", body.quadratic_damping[3:], 0.0)


@pytest.mark.check("cylinder: added mass, drag", "strip theory, slice by slice")
def test_cylinder_is_a_sum_of_slices(within):
    """Strip theory: every slice has the displaced mass across, none along; summed about the body
    origin.
    """
    start = np.array([0.1, -0.2, 0.3])
    end = np.array([0.5, 0.1, 0.2])
    r = 0.05
    body = water.cylinder(r, start, end, water_density=RHO)
    axis = (end - start) / np.linalg.norm(end - start)
    length = float(np.linalg.norm(end - start))
    x, weights = np.polynomial.legendre.leggauss(2)
    expected = np.zeros((6, 6))
    for node, weight in zip(x, weights, strict=True):
        p = start + (node + 1.0) / 2.0 * (end - start)
        S = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
        to_point = np.hstack([np.eye(3), -S])
        slice_mass = RHO * np.pi * r**2 * length * weight / 2.0
        expected += slice_mass * to_point.T @ (np.eye(3) - np.outer(axis, axis)) @ to_point
    within("added mass", body.added_mass - expected, 1e-14)
    within("volume", body.volume / (np.pi * r**2 * length) - 1.0, 1e-15)
    within("centre", body.center_of_buoyancy - (start + end) / 2.0, 1e-16)
    (strip,) = body.segments
    within("ends", [strip.start - start, strip.end - end], 0.0)
    within("normal drag", strip.normal / (0.5 * RHO * 1.1 * 2.0 * r) - 1.0, 1e-15)
    within("skin friction", strip.tangential / (0.5 * RHO * 0.02 * 2.0 * np.pi * r) - 1.0, 1e-15)


@pytest.mark.check("box: added mass", "DNV-RP-C205, table D-2")
def test_box_meets_the_table_of_dnv(within):
    """Cube 0.68, square prism twice as long 0.36 of its volume, thin square plate 0.579 pi/4
    a^3.
    """
    cube = water.box([0.5, 0.5, 0.5], water_density=RHO)
    within("cube", cube.added_mass.diagonal()[:3] / (RHO * 0.125) - 0.68, 1e-15)
    within("cube in rotation", cube.added_mass.diagonal()[3:], 1e-14)
    within(
        "prism",
        water.box([1.0, 0.5, 0.5], water_density=RHO).added_mass[0, 0] / (RHO * 0.25) - 0.36,
        1e-15,
    )
    plate = water.box([1e-6, 1.0, 1.0], water_density=RHO).added_mass[0, 0]
    # measured 5e-7, of the thickness of 1e-6
    within("plate", plate / (RHO * 0.579 * np.pi / 4.0) - 1.0, 5e-6)


@pytest.mark.check(
    "box of three edges: rotation, drag",
    "Lamb's integrals of the ellipsoid in it; speed cubed over its faces",
)
def test_box_in_rotation_and_its_drag(within):
    """About x, the faces that look along y and along z push back at the local speed of each strip,
    and so on.
    """
    edges = x, y, z = np.array([1.2, 0.7, 0.4])
    body = water.box(edges, drag_coefficient=0.9, water_density=RHO)
    within("volume", body.volume / (x * y * z) - 1.0, 1e-15)
    added = body.added_mass.diagonal()[3:] / (RHO * x * y * z)
    within("added inertia", added / lamb_rotation(edges / 2.0) - 1.0, 7e-15)  # measured 7e-16
    per_area = 0.5 * RHO * 0.9
    within(
        "drag",
        body.quadratic_damping[:3] / (per_area * np.array([y * z, x * z, x * y])) - 1.0,
        2e-15,
    )
    spin = [
        face_drag(x, z) + face_drag(x, y),
        face_drag(y, z) + face_drag(y, x),
        face_drag(z, y) + face_drag(z, x),
    ]
    within("spin drag", body.quadratic_damping[3:] / (per_area * np.array(spin)) - 1.0, 2e-15)


def test_moved_added_mass_keeps_the_energy(rng, within):
    L = rng.normal(size=(6, 6))
    A = L @ L.T
    R = exp_so3(rng.normal(size=3))
    p = rng.normal(size=3)
    v, w = rng.normal(size=3), rng.normal(size=3)
    twist_moved = np.concatenate([R.T @ (v + np.cross(w, p)), R.T @ w])
    here: Array = np.concatenate([v, w])
    energy = here @ water.moved_added_mass(A, R, p) @ here
    within(
        "relative energy", energy / (twist_moved @ A @ twist_moved) - 1.0, 1e-14
    )  # measured up to 1e-15


@pytest.mark.parametrize(
    "make",
    [
        lambda: water.sphere(0.0),
        lambda: water.ellipsoid([0.1, -0.1, 0.1]),
        lambda: water.box([0.1, 0.0, 0.1]),
        lambda: water.cylinder(-1.0, [0, 0, 0], [1, 0, 0]),
        lambda: water.cylinder(0.1, [1, 0, 0], [1, 0, 0]),
    ],
)
def test_shapes_are_checked(make):
    with pytest.raises(ConfigurationError):
        make()
