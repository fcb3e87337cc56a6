"""The manifold's holes as rays meet them, its mesh by its volume, and the sampler's mount by its
deflection.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.objects.manifold import SIDES, SIZE, manifold
from uuv.models.tools import sampler
from uuv.models.tools.sampler import SAMPLER, STIFFNESS
from uuv.models.vehicle import Vehicle
from uuv.models.vehicles import uuv_puma
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

HOLES = [(0.02, 0.08, 0.002), (0.0185, 0.05, 0.0), (0.03, 0.1, 0.005)]  # radius, depth, chamfer [m]


def ray(model: mujoco.MjModel, data: mujoco.MjData, start: Array, way: Array) -> float:
    return mujoco.mj_ray(model, data, start, way, None, 1, -1, np.zeros(1, dtype=np.int32))


def placed(
    radius: float, depth: float, chamfer: float, X_WT: Array
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    manifold(radius, depth, chamfer).target.add_to(spec, X_WT)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize(("radius", "depth", "chamfer"), HOLES)
@pytest.mark.parametrize("name", ["a", "b"])
def test_rays_find_radius_depth_and_chamfer(radius, depth, chamfer, name, within):
    rng = np.random.default_rng(3)
    X_WT = pose(exp_so3(rng.normal(scale=0.4, size=3)), rng.normal(size=3))
    model, data = placed(radius, depth, chamfer, X_WT)
    X_WH = manifold(radius, depth, chamfer).hole(name).pose(X_WT)
    corner = 1.0 / np.cos(np.pi / SIDES)  # the polygon is widest there

    def across(z: float) -> Array:
        p = X_WH[:3, :3] @ [0.0, 0.0, z] + X_WH[:3, 3]
        turns = np.linspace(0.0, 2.0 * np.pi, 97)
        return np.array(
            [ray(model, data, p, X_WH[:3, :3] @ [np.cos(t), np.sin(t), 0.0]) for t in turns]
        )

    for z in (1.01 * chamfer + 1e-4, 0.5 * depth, 0.99 * depth):
        ranges = across(z)
        within("least radius [m]", ranges.min() - radius, 1e-9)
        within("largest radius [m]", ranges.max() - radius * corner, 1e-4 * radius)
    if chamfer:
        for share in (0.2, 0.5, 0.8):
            wide = radius + (1.0 - share) * chamfer
            ranges = across(share * chamfer)
            within("chamfer's least radius [m]", ranges.min() - wide, 1e-9)
            within("chamfer's largest radius [m]", ranges.max() - wide * corner, 1e-4 * radius)
    for aside in (0.0, 0.7 * radius):
        start = X_WH[:3, :3] @ [aside, 0.0, -0.2] + X_WH[:3, 3]
        within("depth [m]", ray(model, data, start, X_WH[:3, 2]) - 0.2 - depth, 1e-9)
    start = X_WH[:3, :3] @ [radius + chamfer + 1e-3, 0.0, -0.2] + X_WH[:3, 3]
    within("face [m]", ray(model, data, start, X_WH[:3, 2]) - 0.2, 1e-9)


def _polygon(sides: int) -> float:
    """Area of the polygon in the unit circle."""
    return 0.5 * sides * np.sin(2.0 * np.pi / sides)


@pytest.mark.parametrize(("radius", "depth", "chamfer"), HOLES)
def test_volume_of_the_mesh(radius, depth, chamfer, within):
    """By the divergence theorem, pipes and block counted each: closed, and wound outward
    everywhere.
    """
    target = manifold(radius, depth, chamfer).target
    a, b, c = target.vertices[target.triangles].transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    wide = radius + chamfer
    bore = radius**2 * (depth - chamfer) + chamfer * (radius**2 + radius * wide + wide**2) / 3.0
    pipes = 0.045**2 * 0.5 + 0.03**2 * 0.26 + 0.04**2 * 0.13
    expected = float(np.prod(SIZE)) - 2.0 * _polygon(96) * bore + _polygon(48) * pipes
    within("volume, relative", (volume - expected) / expected, 1e-12)
    # The face lies in z = 0 and adds nothing to the volume: its area.
    normal = (
        0.5
        * np.cross(b - a, c - a)[
            np.abs(target.vertices[target.triangles][:, :, 2]).max(axis=1) == 0.0, 2
        ]
    )
    assert (normal > 0.0).all()
    within(
        "area of the face [m^2]",
        normal.sum() - (SIZE[0] * SIZE[1] - 2.0 * _polygon(96) * wide**2),
        1e-14,
    )
    edges = np.sort(target.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
    assert (np.unique(edges, axis=0, return_counts=True)[1] <= 2).all()


@pytest.mark.parametrize(
    ("hole", "said"),
    [
        ((0.05, 0.08, 0.002), "below"),
        ((0.02, 0.2, 0.002), "depth"),
        ((0.02, 0.001, 0.002), "depth"),
    ],
)
def test_a_hole_that_does_not_fit_is_refused(hole, said):
    with pytest.raises(ConfigurationError, match=said):
        manifold(*hole)
    with pytest.raises(ConfigurationError, match="'a', 'b'"):
        manifold().hole("c")


def test_the_sampler_gives_way_by_its_springs(within):
    """A steady force on the tip of a vehicle held still moves the tube by F / k in every direction,
    and no joint.
    """
    rng = np.random.default_rng(3)
    spec = uuv_puma.build("sampler")
    model = spec.compile()
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 1)
    vehicle = Vehicle.of(model)
    tube = model.body("pad").id
    # Everything but the mount is made too heavy to move.
    water = hydrodynamics.attached(spec)
    within(
        "weight in water, relative",
        1025.0 * sum(b.volume for b in water.values()) / model.body_mass.sum() - 1,
        1e-12,
    )
    springs = [model.joint(name).dofadr[0] for name in ("mount_x", "mount_y", "pad")]
    model.dof_armature[[d for d in range(model.nv) if d not in springs]] = 1e9
    mujoco.mj_forward(model, data)
    tip = data.site("tip").xpos.copy()
    axis = data.site("tip").xmat.reshape(3, 3)[:, 2].copy()
    within("tip at the dome's end [m]", data.site("pad_face").xpos - tip, 1e-12)
    mount = data.xpos[tube]
    within("length [m]", (tip - mount) @ axis - SAMPLER.length, 1e-12)
    force = rng.normal(size=3)
    force *= 40.0 / np.linalg.norm(force)
    if force @ axis > 0.0:
        force = -force  # it comes out less far than it goes in
    for _ in range(1000):
        mujoco.mj_applyFT(
            model, data, force, np.zeros(3), data.xipos[tube], tube, data.qfrc_applied
        )
        mujoco.mj_step(model, data)
        data.qfrc_applied[:] = 0.0
    moved = data.site("pad_face").xpos - data.site("tip").xpos
    within("deflection, relative", (moved - force / STIFFNESS) * STIFFNESS / 40.0, 1e-3)
    assert float(model.geom_size[model.geom("pad").id][0]) == SAMPLER.radius
    assert vehicle.joint_names == ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")


def test_a_sampler_wants_a_pad():
    with pytest.raises(ConfigurationError, match="'pad'"):
        sampler.fit(models.load("bluerov2_heavy"))


@pytest.mark.parametrize(("radius", "depth", "chamfer"), HOLES)
def test_beside_each_hole_a_short_path_lies_on_the_face(radius, depth, chamfer):
    """Of 40 mm along x at even steps, its middle 15 mm beyond the chamfer's edge; the tool into the
    face.
    """
    block_of_holes = manifold(radius, depth, chamfer)
    for name, hole in block_of_holes.holes.items():
        path = block_of_holes.target.paths[f"beside_{name}"]
        np.testing.assert_allclose(
            np.diff(path.p, axis=0),
            np.tile([0.04 / (len(path.p) - 1), 0.0, 0.0], (len(path.p) - 1, 1)),
        )
        np.testing.assert_allclose(
            path.p.mean(axis=0),
            hole.p_T + np.array([0.0, radius + chamfer + 0.015, 0.0]),
            atol=1e-12,
        )
        np.testing.assert_allclose(path.a, np.tile([0.0, 0.0, -1.0], (len(path.p), 1)))
        np.testing.assert_allclose(path.b, np.tile([1.0, 0.0, 0.0], (len(path.p), 1)))
