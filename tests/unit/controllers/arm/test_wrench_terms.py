"""The terms of the arm's wrench: they add up, and each is what it says."""

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.wrench_terms import WrenchTerms
from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3


def motion(
    rng: np.random.Generator, n: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """State of the hull (24,) as for `newton_euler`, and joint motion."""
    R = exp_so3(rng.uniform(-0.5, 0.5, 3))
    hull = np.concatenate([R.ravel(), rng.uniform(-0.3, 0.3, 15)])
    return hull, rng.uniform(-1.0, 1.0, n), rng.uniform(-0.5, 0.5, n), rng.uniform(-2.0, 2.0, n)


def total(
    arm: ArmDynamics, hull: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    R = hull[:9].reshape(3, 3)
    nu = hull[9:15]
    nudot = hull[15:21]
    # `inverse` takes the acceleration of the origin, the block of numbers the rate of its
    # components.
    a = np.concatenate([nudot[:3] + np.cross(nu[3:], nu[:3]), nudot[3:]])
    return arm.inverse(
        q, qd, qdd, R_WB=R, nu_B=nu, a_B=a, v_current_W=hull[21:], wrench_tip_G=np.zeros(6)
    )[1]


def dry_twin() -> ArmDynamics:
    """The same arm in water without added mass and drag."""
    spec = models.load("uuv_puma")
    bare = {
        name: BodyHydrodynamics(volume=body.volume, center_of_buoyancy=body.center_of_buoyancy)
        for name, body in hydrodynamics.attached(spec).items()
    }
    hydrodynamics.attach(spec, bare)
    return ArmDynamics(spec.compile())


@pytest.mark.seeds(0, 1)
def test_terms_and_weight_make_the_whole(seed, within):
    rng = np.random.default_rng(seed)
    arm = ArmDynamics(models.load("uuv_puma").compile())
    dry = dry_twin()
    terms = WrenchTerms(arm)
    hull, q, qd, qdd = motion(rng, arm.n)
    still = np.zeros(arm.n)
    at_rest = np.concatenate([hull[:9], np.zeros(15)])
    whole, weight = total(arm, hull, q, qd, qdd), total(dry, at_rest, q, still, still)
    hydro, dynamic = terms.hydrodynamic(hull, q, qd, qdd), terms.dynamic(hull, q, qd, qdd)
    assert np.linalg.norm(hydro) > 0.1
    assert np.linalg.norm(dynamic) > 0.1
    within("sum of the terms [N, N m]", weight + hydro + dynamic - whole, 1e-9)
    within("added mass and drag [N, N m]", hydro - (whole - total(dry, hull, q, qd, qdd)), 1e-9)


def test_at_rest_in_still_water_there_is_neither(within):
    arm = ArmDynamics(models.load("uuv_puma").compile())
    terms = WrenchTerms(arm)
    hull, q, *_ = motion(np.random.default_rng(3), arm.n)
    hull[9:] = 0.0
    still = np.zeros(arm.n)
    within("hydrodynamic at rest [N, N m]", terms.hydrodynamic(hull, q, still, still), 1e-12)
    within("dynamic at rest [N, N m]", terms.dynamic(hull, q, still, still), 1e-12)


@pytest.mark.parametrize("error", [-1.0, np.nan, np.inf])
def test_a_share_that_leaves_no_water_is_refused(error):
    with pytest.raises(ConfigurationError, match=r"water_error: .*> -1"):
        ArmDynamics(models.load("uuv_puma").compile(), water_error=error)
