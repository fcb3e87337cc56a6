"""The code in the documents runs as it stands there."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import models
from models.vehicle import Vehicle
from scenarios import assemble, barrel
from sim.interfaces.messages import Command, StateEstimate
from sim.interfaces.protocols import Controller
from untyped import untyped


def names_of(root: Path, word: str) -> dict[str, Any]:
    """What the one block of Python with `word` in it defines."""
    page = (root / "docs" / "concepts.md").read_text()
    (block,) = [block for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if word in block]
    names: dict[str, Any] = {"__name__": "of_the_documents"}
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


def test_the_fault_of_the_documents_reaches_the_thruster(root, monkeypatch):
    """The commands pass, but for the one thruster, whose own is multiplied."""
    monkeypatch.setitem(sys.modules, "of_the_documents", ModuleType("of_the_documents"))  # dataclasses look there
    names = names_of(root, "class SwingingPlant")
    fault = names["Swinging"](thruster="heave_front")
    plant = assemble(replace(barrel(quick=True), perturbations=(fault,))).loop.plant
    given = np.linspace(0.1, 0.6, 6)
    sent = []
    monkeypatch.setattr(type(untyped(plant).plant), "step", lambda _, command: sent.append(command.thrusters))
    for time in (0.0, 0.125):
        plant.step(Command(time=time, joint_torque=np.zeros(6), thrusters=given, scan=False))
    factor = np.where(np.array(untyped(plant).plant.vehicle.thruster_names) == "heave_front", 1.3, 1.0)
    np.testing.assert_allclose(sent, [given, factor * given], rtol=1e-12)
