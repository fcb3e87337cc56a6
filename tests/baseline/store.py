"""The baseline's file: bands of each case's figures, and why it was written."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bands import Band

FILE = Path(__file__).with_name("figures.json")
_KEPT_REASONS = 20


def read() -> dict[str, dict[str, Band | None]]:
    """Bands by case and figure; None where no run gave a figure."""
    held = json.loads(FILE.read_text(encoding="utf-8"))["cases"]
    return {
        case: {name: None if band is None else Band(**band) for name, band in figures.items()}
        for case, figures in held.items()
    }


def write(cases: Mapping[str, Mapping[str, Band | None]], *, reason: str, date: str) -> None:
    """Write all bands, a figure a line, with the reason in front of earlier ones."""
    before = json.loads(FILE.read_text(encoding="utf-8"))["reasons"] if FILE.exists() else []
    reasons = [{"date": date, "reason": reason}, *before][:_KEPT_REASONS]
    parts = []
    for case, figures in cases.items():
        rows = ",\n".join(
            f"   {json.dumps(name)}: {json.dumps(_row(band))}" for name, band in figures.items()
        )
        parts.append(f"  {json.dumps(case)}: {{\n{rows}\n  }}")
    text = (
        f'{{\n "reasons": {json.dumps(reasons, indent=1)},\n "cases": {{\n'
        + ",\n".join(parts)
        + "\n }\n}\n"
    )
    FILE.write_text(text, encoding="utf-8")


def _row(band: Band | None) -> dict[str, Any] | None:
    if band is None:
        return None
    digits = 17 if band.spread == 0.0 else 7  # what no seed changes is held to rounding
    return {
        name: float(f"{v:.{digits}g}") if type(v) is float else v
        for name, v in asdict(band).items()
    }
