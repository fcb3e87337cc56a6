"""The surface of a seabed from a cloud: against [Konoplin 2019, eq. 4], planes in closed form, and
seeded terrains.
"""

import itertools

import mujoco
import numpy as np
import pytest

from uuv.controllers.planning.trajectories import speed_law
from uuv.models.site.seabed import KINDS, seabed
from uuv.perception.seabed.relief import relief
from uuv.perception.seabed.terrain import build_terrain, project
from uuv.perception.seabed.terrain_path import plan_seabed_work, profile, smooth_path
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError, UuvError
from uuv.sim.interfaces.spatial import exp_so3

UP = np.array([0.0, 0.0, 1.0])


def scattered(surface, n, rng, half=1.0):
    xy = rng.uniform(-half, half, (n, 2))
    return np.column_stack([xy, surface(xy)])


def tilted(xy):
    return 0.2 * xy[:, 0] - 0.1 * xy[:, 1] - 2.0


def intersections(B, z, vertices, triangles):
    """t (s,) by [Konoplin 2019, eq. 4], over all triangles; inf if none is met."""
    t = np.full(len(B), np.inf)
    V0, V1, V2 = vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]
    for i, b in enumerate(B):
        P = np.cross(-z, V2 - V0)
        Q = np.cross(b - V0, V1 - V0)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / np.einsum("ij,ij->i", P, V1 - V0)
            u = np.einsum("ij,ij->i", P, b - V0) * scale
            v = Q @ -z * scale
            at = np.einsum("ij,ij->i", Q, V2 - V0) * scale
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (at >= 0.0)
        t[i] = at[hit].min() if hit.any() else np.inf
    return t


def test_rays_are_those_of_the_closed_form(within):
    rng = np.random.default_rng(1)
    z = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
    terrain = build_terrain(scattered(tilted, 2000, rng) + rng.normal(0.0, 0.01, (2000, 3)), z)
    B = np.column_stack([rng.uniform(-0.5, 0.5, (200, 2)), np.zeros(200)])
    t, _ = terrain.under(B)
    within(
        "distance along the ray [m]",
        t - intersections(B, z, terrain.vertices, terrain.triangles),
        5e-6,
    )


@pytest.mark.parametrize("turn", [np.eye(3), exp_so3([0.4, -0.3, 1.0])])
def test_plane_is_kept_exactly_in_any_frame(within, turn):
    rng = np.random.default_rng(2)
    offset = np.array([3e3, -2e3, 50.0])  # as of a map
    cloud = scattered(tilted, 30_000, rng)  # more than vertices: averaged
    terrain = build_terrain(cloud @ turn.T + offset, turn[:, 2])
    B = np.column_stack([rng.uniform(-0.8, 0.8, (50, 2)), np.zeros(50)])
    projected = project(terrain, B @ turn.T + offset)
    A = (projected.A - offset) @ turn
    within("plane [m]", A[:, 2] - tilted(A), 2e-5)
    within("place [m]", A[:, :2] - B[:, :2], 1e-9)
    within("normal", projected.normal @ turn - np.array([-0.2, 0.1, 1.0]) / np.sqrt(1.05), 2e-2)
    patch = relief(terrain, projected.A[:1], 0.2)
    within("slope [rad]", patch.slope - np.arctan(np.hypot(0.2, 0.1)), 1e-5)
    within("roughness of a plane [m]", patch.roughness, 2e-5)


DENSE = pytest.mark.long(
    guarded_by="tests/unit/perception/seabed/test_terrain.py::test_targets_lie_on_the_true_surface"
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("points", [3_000, pytest.param(60_000, marks=DENSE)])
@pytest.mark.seeds(1)
def test_targets_lie_on_the_true_surface(kind, points, seed):
    """1 cm and 0.5 % of the range for 95 % of the targets, with noise and outliers.

    Those are judged together: on one terrain with small rocks the share falls to 94 % where points
    lie 7 cm apart.
    """
    for seeds in ([7], [[seed, k] for k in range(6 if points < 10_000 else 1)]):
        share_of_rays, close = [], []
        for seed_of in seeds:
            rng = np.random.default_rng(seed_of)
            ground = seabed(kind, rng, center_W=(1.0, -2.0, -30.0))
            terrain = build_terrain(_cloud(ground, points, rng))
            B = (
                np.column_stack([rng.uniform(-1.7, 1.7, (400, 2)), np.full(400, 2.0)])
                + ground.center_W
            )
            t, _ = terrain.under(B)
            share_of_rays.append(np.isfinite(t).mean())
            off = np.abs(B[:, 2] - t - ground.height(B))[np.isfinite(t)]
            close.append(np.mean(off <= 0.01 + 0.005 * 2.0))
        assert np.mean(share_of_rays) > 0.99
        assert np.mean(close) > 0.95  # 60 terrains with rocks: 0.973, one of them 0.011 up or down


def _cloud(ground, points, rng, noise=0.01):
    xy = rng.uniform(-2.0, 2.0, (points, 2)) + ground.center_W[:2]
    z = ground.height(xy) + noise * rng.standard_normal(points)
    wild = rng.random(points) < 0.03
    z[wild] += rng.uniform(-0.5, 0.5, wild.sum())
    return np.column_stack([xy, z])


def test_quality_map_says_how_far_off_the_surface_is():
    rng = np.random.default_rng(3)
    terrain = build_terrain(
        scattered(tilted, 20_000, rng) + [0, 0, 1] * rng.normal(0, 0.02, (20_000, 1))
    )
    assert 0.85 < terrain.noise / 0.02 < 1.15
    inner = np.abs(terrain.vertices[:, :2]).max(axis=1) < 0.9
    off = (terrain.vertices[:, 2] - tilted(terrain.vertices))[inner]
    assert 0.6 < off.std() / np.sqrt(np.mean(terrain.sigma[inner] ** 2)) < 1.6
    assert off.std() < 0.6 * 0.02  # and noise was taken off


def test_profile_lies_in_its_planes_and_on_the_surface(within):
    rng = np.random.default_rng(4)
    terrain = build_terrain(_cloud(seabed("ripples", rng), 20_000, rng, noise=0.005))
    A = project(terrain, [[-0.5, -0.3, 1.0], [0.4, -0.1, 1.0], [0.3, 0.6, 1.0]]).A
    cut = profile(terrain, A)
    corners = np.flatnonzero(cut.target)
    within("targets are in it [m]", cut.T[corners] - A, 1e-9)
    for first, last in itertools.pairwise(corners):
        leg = cut.T[first : last + 1]
        way = np.cross([0.0, 0.0, 1.0], leg[-1] - leg[0])
        within("off the plane [m]", (leg - leg[0]) @ way / np.linalg.norm(way), 1e-9)
        assert np.all(np.diff((leg - leg[0]) @ (leg[-1] - leg[0])) > 0.0)  # in order
        assert len(leg) > 20
    t, _ = terrain.under(cut.T + UP)
    within("off the mesh [m]", t - 1.0, 1e-5)
    within("axes across each other", np.einsum("ij,ij->i", cut.a, cut.n), 1e-12)
    assert np.all(cut.a[:, 2] < -0.5)
    path = smooth_path(cut)
    near = np.linalg.norm(path.p[:, None] - A[None], axis=2).min(axis=0)
    within("spline passes the targets [m]", near, 2e-3)
    within(
        "even steps [m]", np.linalg.norm(np.diff(path.p, axis=0), axis=1) - np.diff(path.s), 1e-4
    )
    law = speed_law(path, 0.05, 0.02)
    rate = np.abs(np.diff(law.speed**2) / 2.0 / np.diff(law.s))
    within("rate of change of the speed over its limit [m/s^2]", max(0.0, rate.max() - 0.02), 1e-9)
    times = np.linspace(-1.0, law.time[-1] + 1.0, 4001)
    s, v = np.array([law.at(t) for t in times]).T
    within("speed is the rate of s [m/s]", np.gradient(s, times)[1:-1] - v[1:-1], 2e-3)
    assert v.max() <= 0.05
    assert (s[0], s[-1]) == (0.0, path.s[-1])


def test_plane_of_the_profile_at_a_known_slope(within):
    terrain = build_terrain(scattered(tilted, 5000, np.random.default_rng(5)))
    cut = profile(terrain, project(terrain, [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]).A)
    normal = np.array([-0.2, 0.1, 1.0]) / np.sqrt(1.05)
    within("a_j", cut.a + normal, 1e-4)
    x = np.array([1.0, 0.0, 0.0]) - (normal[0]) * normal
    within("n_j", cut.n - x / np.linalg.norm(x), 1e-4)


def test_bad_clouds_are_refused_in_one_line():
    rng = np.random.default_rng(6)
    good = scattered(tilted, 3000, rng)
    B = [[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0]]

    def refused(cloud, *words, targets=B, kind: type[UuvError] = PerceptionError):
        with pytest.raises(kind) as caught:
            plan_seabed_work(cloud, targets)
        assert "\n" not in str(caught.value)
        for word in words:
            assert word in str(caught.value), str(caught.value)

    plan_seabed_work(good, B)
    at = good[:, :2]
    refused(good[np.linalg.norm(at - [0.4, 0.0], axis=1) > 0.2], "B_2", "hole")
    refused(good[np.abs(at[:, 0]) > 0.2], "between A_1 and A_2", "hole")
    t = np.linspace(0.0, 1.0, 500)
    refused(np.column_stack([t, 2.0 * t, 0.1 * t]), "line")
    refused(np.column_stack([0.0 * t, 0.0 * t, t]), "line")
    refused(np.zeros((500, 3)), "line")
    refused(np.vstack([good, scattered(tilted, 3000, rng) + 0.15 * UP]), "two surfaces")
    near = scattered(tilted, 6000, rng)
    near = near[np.linalg.norm(near[:, :2] - [0.4, 0.0], axis=1) < 0.3] + 0.2 * UP
    refused(np.vstack([good, near]), "A_2", "two surfaces")
    bad = good.copy()
    bad[17, 1] = np.nan
    refused(bad, "1 of 3000", "point 18")
    refused(good[:20], "20 points")
    refused(np.zeros((0, 3)), "0 points")
    refused(good[:, :2], "(N, 3)", kind=ConfigurationError)
    refused(good, "B_1", "below the surface", targets=[[0.0, 0.0, -3.0]])
    refused(scattered(lambda xy: 1.5 * xy[:, 0] - 3.0, 3000, rng), "slope")
    refused(scattered(lambda xy: 0.1 * np.sin(30 * xy[:, 0]) - 2.0, 9000, rng), "roughness")
    refused(good, "finite", targets=[[0.0, np.nan, 0.0]], kind=ConfigurationError)
    refused(
        good,
        "same horizontal position",
        targets=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]],
        kind=ConfigurationError,
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_ray_of_mujoco_meets_the_height_that_is_told(within, kind):
    rng = np.random.default_rng(8)
    ground = seabed(kind, rng, center_W=(0.5, -0.3, -4.0), half=1.0)
    spec = mujoco.MjSpec()
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    p = np.column_stack([rng.uniform(-0.9, 0.9, (100, 2)), np.full(100, 3.0)]) + ground.center_W
    hit = np.zeros(1, dtype=np.int32)
    down = np.array([0.0, 0.0, -1.0])
    z = [at[2] - mujoco.mj_ray(model, data, at, down, None, 1, -1, hit) for at in p]
    within("height [m]", z - ground.height(p), 2e-6)
    assert np.ptp(ground.height(p)) > 2e-3
    assert np.isnan(ground.height([[9.0, 0.0]])).all()


def test_same_seed_same_seabed_and_the_mesh_is_the_height_field(within):
    first, again = (seabed("rocks", np.random.default_rng(9), half=1.0) for _ in range(2))
    assert np.array_equal(first.heights, again.heights)
    assert len(first.rocks) >= 6
    vertices, triangles = first.mesh()
    middle = vertices[triangles].mean(axis=1)
    within("middles of the triangles [m]", middle[:, 2] - first.height(middle), 1e-12)
    spec = mujoco.MjSpec()
    first.add_to(spec, "mesh")
    assert spec.compile().nmesh == 1
