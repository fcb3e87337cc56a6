"""Import rules: no circle, lazy imports counted; nothing over the product; a layer for each part of
a room.
"""

import ast
import tomllib

import pytest

from source_tree import ROOMS, ROOT, circles, imported_by, imports, modules

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]
CONTAINERS = ("uuv", *(f"uuv.{room}" for room in ROOMS))


def contract_of(container: str) -> dict:
    """The contract that orders the parts of a package."""
    (contract,) = [contract for contract in CONTRACTS if contract.get("containers") == [container]]
    return contract


def parts_of(container: str) -> set[str]:
    """Modules and packages at the top of a package."""
    depth = container.count(".") + 1
    inside = [name.split(".") for name in modules() if name.startswith(f"{container}.")]
    return {name[depth] for name in inside}


def without_layer(container: str, parts: set[str]) -> set[str]:
    """Parts that stand in no layer of the package's contract."""
    contract = contract_of(container)
    layered = [part.strip() for layer in contract["layers"] for part in layer.split("|")]
    assert len(layered) == len(set(layered)), "a part has one layer"
    return parts - {*layered, *contract.get("exhaustive_ignores", [])}


def test_all_modules_are_seen():
    assert {
        "uuv",
        "uuv.scenario",
        "uuv.sim.plant.plant",
        "experiments.faults.faults",
    } <= modules().keys()
    assert "uuv.sim.sensors.proprioception" in imports()["uuv.scenario"], (
        "an import inside a function"
    )
    assert "uuv.perception.clouds.scan" in imports()["uuv.scenario"], "an import for type checkers"


def test_there_is_no_circle():

    assert circles(imports()) == []


def test_a_circle_is_told():
    names = dict.fromkeys(("uuv.a", "uuv.b", "uuv.c", "uuv.d"))
    sources = {
        "uuv.a": "def lazy():\n    from uuv.b import thing",
        "uuv.b": "if TYPE_CHECKING:\n    from uuv import c",
        "uuv.c": "import uuv.a, uuv.d",
        "uuv.d": "import numpy",
    }
    graph = {
        name: frozenset(imported_by(ast.walk(ast.parse(text)), names))
        for name, text in sources.items()
    }
    assert circles(graph) == [["uuv.a", "uuv.b", "uuv.c"]]


def test_nothing_of_the_product_imports_an_experiment():
    for module, others in imports().items():
        if module.partition(".")[0] == "uuv":
            assert not [other for other in others if other.partition(".")[0] == "experiments"], (
                module
            )


def test_subjects_of_experiments_do_not_import_each_other():
    for module, others in imports().items():
        subject = module.split(".")[:2]
        if subject[0] == "experiments":
            strange = [other for other in others if other.startswith("experiments.")]
            assert not [other for other in strange if other.split(".")[:2] != subject], module


@pytest.mark.parametrize("container", CONTAINERS)
def test_each_part_of_a_room_has_a_layer(container: str):
    assert contract_of(container)["exhaustive"] is True
    assert parts_of(container), container
    assert without_layer(container, parts_of(container)) == set()
    assert without_layer(container, parts_of(container) | {"newcomer"}) == {"newcomer"}
