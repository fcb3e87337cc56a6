"""The code in the documents runs as it stands there."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import models
from models.vehicle import Vehicle
from sim.interfaces.messages import StateEstimate
from sim.interfaces.protocols import Controller
from untyped import untyped


def names_of(root: Path, word: str) -> dict[str, Any]:
    """What the one block of Python with `word` in it defines."""
    page = (root / "docs" / "concepts.md").read_text()
    (block,) = [block for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if word in block]
    names: dict[str, Any] = {}
    exec(compile(block, "docs/concepts.md", "exec"), names)
    return names


def test_the_force_law_of_the_documents_is_the_controllers(root):
    """And it takes 15 lines at most."""
    names = names_of(root, "class Integrator")
    model = models.load("uuv_puma").compile()
    made = names["integrating"](model, water_error=0.1)
    law = names["Integrator"]()
    assert law in made.tunings
    assert law.step(law.init(), 10.0, 4.0, 0.0, 0.5) == pytest.approx(3e-4)


def test_the_controller_of_the_documents_bears_the_arm(root):
    names = names_of(root, "class BearWeight")
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    made = names["BearWeight"](model)
    assert isinstance(made, Controller)
    n = vehicle.joints.size
    estimate = StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=vehicle.q_home,
        qd=np.zeros(n),
        tau=np.zeros(n),
    )
    _, command = made.step(made.init(estimate), estimate, untyped(SimpleNamespace(scan=False)))
    assert np.all(np.isfinite(command.joint_torque))
    assert 1.0 < np.abs(command.joint_torque).max() < 200.0
    assert not command.thrusters.any()
