"""Provenance of a result: options, versions, commit and model, which are equal for comparable
results.
"""

import hashlib
import platform
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from uuv.sim.runs.command_line import ROOMS

PACKAGES = (
    "uuv-arm",
    "mujoco",
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "open3d-cpu",
    "open3d",
    "embreex",
    "rerun-sdk",
)
HOME = Path(__file__).resolve().parents[2]  # names of the packages
_CODE = ("uuv", *ROOMS, "scripts", "pyproject.toml", "uv.lock")
_WHERE = ("out", "view", "workers", "anew", "json")  # options without effect on results


def provenance(scenario: str, options: Any, model: mujoco.MjModel | None = None) -> dict[str, Any]:
    """Provenance of a run; equal for every run of one command on one machine and code.

    "commit" and "dirty" are left out outside a git checkout of the project.

    Args:
        scenario: Name of the scenario.
        options: Its options, a dataclass or nested tables; those without effect on results are left
            out.
        model: Adds the model's digest.

    Returns:
        Scenario, options, versions, machine, commit and digest.
    """
    settings = options if isinstance(options, Mapping) else asdict(options)

    record: dict[str, Any] = {
        "scenario": scenario,
        "options": {
            name: _plain(setting) for name, setting in settings.items() if name not in _WHERE
        },
        "versions": versions(),
        "machine": _machine(),
        **commit(),
    }

    if model is not None:
        record["model_sha256"] = model_digest(model)
    return record


def provenance_rows(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Rows for the section of provenance of a page: settings, versions, commit and machine."""
    return {**settings, **versions(), **commit(), "machine": _machine()}


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the installed packages that a result may depend on."""
    return {
        "python": platform.python_version(),
        **{p: version for p in PACKAGES if (version := _version(p)) is not None},
    }


@cache
def commit() -> dict[str, Any]:
    """Commit of the checkout as {"commit": hash, "dirty": code differs}, or empty outside a
    checkout.
    """
    if shutil.which("git") is None or not (HOME / ".git").exists():
        return {}

    head = _git("rev-parse", "HEAD")
    changed = _git("status", "--porcelain", "--", *_CODE)
    if not head or changed is None:
        return {}
    return {"commit": head, "dirty": bool(changed)}


def model_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of the compiled model in MuJoCo's binary format; it depends on MuJoCo's version."""
    image = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, image)
    return hashlib.sha256(image.data).hexdigest()


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"


def _git(*words: str) -> str | None:
    try:
        answer = subprocess.run(
            ["git", "--no-optional-locks", *words],
            cwd=HOME,
            capture_output=True,
            text=True,
            check=True,
            timeout=10.0,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _plain(value: Any) -> Any:
    """`value` converted to JSON types."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted(_plain(entry) for entry in value)
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
