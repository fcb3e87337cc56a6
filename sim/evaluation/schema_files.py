"""Writes sim/schemas from the dataclasses of metrics: `./uvw run python -m
uuv.sim.evaluation.schema_files`.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from uuv.sim.evaluation import (
    friction_metrics,
    insertion_metrics,
    inspection_metrics,
    metrics,
    seabed_metrics,
)
from uuv.sim.evaluation.handling import collect_metrics, plug_metrics, turn_metrics

FOLDER = Path(__file__).resolve().parents[1] / "schemas"
GENERATED: Mapping[str, Callable[[], dict[str, Any]]] = {
    "metrics": metrics.schema,
    "insertion": insertion_metrics.schema,
    "inspection": inspection_metrics.schema,
    "seabed_work": seabed_metrics.schema,
    "friction": friction_metrics.schema,
    "collect": collect_metrics.schema,
    "turn": turn_metrics.schema,
    "plug": plug_metrics.schema,
}


def contents() -> dict[Path, str]:
    """Content of each generated file, by its path."""
    return {
        FOLDER / f"{name}.schema.json": json.dumps(make(), indent=2, ensure_ascii=False) + "\n"
        for name, make in GENERATED.items()
    }


if __name__ == "__main__":
    for file, text in contents().items():
        file.write_text(text, encoding="utf-8")
