"""The tracker follows an object that rests, notices one that is moved, and says by how much."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects.targets import barrel
from uuv.perception.finding.object_tracker import ObjectTracker, TrackerState
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage, StateEstimate
from uuv.sim.interfaces.spatial import Array, pose

VIEW = camera_pose(np.array([0.2, -1.0, 0.7]))
STILL, MOVED = 6, 2  # frames


@pytest.fixture(scope="module")
def surface() -> ModelSurface:
    return ModelSurface.of(barrel())


def frame(X_CT: Array, seed: int) -> DepthImage:
    return replace(look(barrel(), X_CT, np.random.default_rng(seed), floor=False), X_BC=np.eye(4))


def estimate() -> StateEstimate:
    zeros = np.zeros(3)
    return StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=zeros,
        w_WB_B=zeros,
        a_WB_B=zeros,
        q=zeros,
        qd=zeros,
        tau=zeros,
    )


FARTHER = pytest.mark.long(
    guarded_by="tests/unit/perception/test_object_tracker.py::test_a_push_is_noticed_in_two_frames_and_measured"
)


@pytest.mark.parametrize("shift", [0.01, pytest.param(0.05, marks=FARTHER)])
def test_a_push_is_noticed_in_two_frames_and_measured(surface, shift, within):
    tracker = ObjectTracker(surface, VIEW)
    state = tracker.init()
    motion = None
    way = np.array([0.6, 0.0, 0.8])
    for k in range(STILL + MOVED):
        at = VIEW if k < STILL else pose(p=shift * way) @ VIEW
        state, motion = tracker.step(state, estimate(), frame(at, k))
        assert state.last is not None
        if motion is None:
            assert k < 3
        elif k < STILL:
            assert not motion.moved
    assert motion is not None
    assert motion.moved
    off = motion.twist_W[:3] - shift * way
    within("motion [m]", off, 0.004)  # 1.5 mm
    sigma = np.sqrt(np.linalg.eigvalsh(motion.covariance_W[:3, :3])[-1])
    assert 0.001 < sigma < 0.005


def test_out_of_view(surface):
    tracker = ObjectTracker(surface, pose(p=[30.0, 0.0, 2.0]))
    state, motion = tracker.step(tracker.init(), estimate(), frame(VIEW, 0))
    assert motion is None
    assert state.last is None


def test_bad_input(surface):
    tracker = ObjectTracker(surface, VIEW)
    with pytest.raises(ConfigurationError, match="expected a DepthImage, got str"):
        tracker.step(tracker.init(), estimate(), cast("DepthImage", "frame"))
    with pytest.raises(ConfigurationError, match="drift"):
        ObjectTracker(surface, VIEW, drift=-1.0)
    with pytest.raises(ConfigurationError, match="X_WT"):
        ObjectTracker(surface, np.eye(3))
    assert isinstance(tracker.init(), TrackerState)
