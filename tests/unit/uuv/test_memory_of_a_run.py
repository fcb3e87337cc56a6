"""A run that has ended leaves nothing behind."""

import gc
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from weakref import ref

import mujoco
import numpy as np

from depth_scenes import look
from uuv import assemble, jobs, run
from uuv.clouds.frames import camera_pose
from uuv.models.objects.targets import barrel
from uuv.perception.clouds.scan import Scan
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.spatial import exp_so3, transform_points
from uuv.sim.loop.recording import Recorder, Recording
from uuv.sim.loop.rollout import Rollout
from uuv.sim.plant.plant import Plant

KINDS = (Plant, Rollout, Recorder, Recording, Scan, Evidence, mujoco.MjSpec)


def alive() -> Counter[str]:
    """Number of instances of each of KINDS; a proxy of what is gone is none."""
    return Counter(
        type(instance).__name__
        for instance in gc.get_objects()
        if issubclass(type(instance), KINDS)
    )


@contextmanager
def without_collector() -> Iterator[None]:
    """Nothing but the counts of references frees memory here."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def test_a_run_leaves_nothing_behind_also_without_the_collector() -> None:
    def one_run(seed: int) -> list[ref[Any]]:
        done = run(assemble(jobs.open_water(seed=seed), full=True), longest=0.2)
        plant = done.assembly.plant
        return [ref(part) for part in (plant, plant.model, plant.data)]

    with without_collector():
        before = alive()
        parts = one_run(3) + one_run(4)
        assert [reference() for reference in parts] == [None] * 6
        assert alive() == before


def test_a_look_leaves_no_scan_behind() -> None:
    target = barrel()
    X_CT = camera_pose(np.array([0.3, -0.9, 0.8]))
    near = transform_points(X_CT, target.center) + np.array([0.05, -0.03, 0.04])
    R_CT = exp_so3([0.1, 0.2, -0.1]) @ X_CT[:3, :3]

    def one_look(seed: int) -> bool:
        scan = Scan.from_depth(look(target, X_CT, np.random.default_rng(seed)))
        return identify(scan, target, near, R_CT, seed=seed).accepted

    with without_collector():
        before = alive()
        assert one_look(1)
        assert one_look(2)
        assert alive() == before
