"""What a result was made by: options, versions, commit, model; what two results must share to be comparable."""

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

PACKAGES = ("uuv-arm", "mujoco", "numpy", "scipy", "numba", "llvmlite", "open3d-cpu", "open3d", "embreex", "rerun-sdk")
HOME = Path(__file__).resolve().parents[2]  # of the rooms
_CODE = ("models", "sim", "controllers", "perception", "calib", "scripts", "pyproject.toml", "uv.lock")
_WHERE = ("out", "view", "workers", "anew")  # options that do not change what is done


def provenance(scenario: str, options: Any, model: mujoco.MjModel | None = None) -> dict[str, Any]:
    """Scenario, options as given (a dataclass; without those that change no figure), versions, machine, commit.

    With `model`, its digest. "commit" and "dirty" are left out outside a git checkout of the project. It is the same
    for every run of one command on one machine and code.
    """
    made: dict[str, Any] = {
        "scenario": scenario,
        "options": {name: _plain(value) for name, value in asdict(options).items() if name not in _WHERE},
        "versions": versions(),
        "machine": f"{platform.system()} {platform.machine()}",
        **commit(),
    }
    if model is not None:
        made["model_sha256"] = model_digest(model)
    return made


@cache
def versions() -> dict[str, str]:
    """Of Python, and of the packages that a result may depend on and that are there."""
    return {"python": platform.python_version(), **{p: found for p in PACKAGES if (found := _version(p)) is not None}}


@cache
def commit() -> dict[str, Any]:
    """{"commit": hash, "dirty": whether the code differs from it} of the checkout; empty where there is none."""
    if shutil.which("git") is None or not (HOME / ".git").exists():
        return {}
    head = _git("rev-parse", "HEAD")
    changed = _git("status", "--porcelain", "--", *_CODE)
    if not head or changed is None:
        return {}
    return {"commit": head, "dirty": bool(changed)}


def model_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of the compiled model, as MuJoCo would save it; another one with another version of MuJoCo."""
    image = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, image)
    return hashlib.sha256(image.data).hexdigest()


def _git(*words: str) -> str | None:
    try:
        told = subprocess.run(
            ["git", "--no-optional-locks", *words], cwd=HOME, capture_output=True, text=True, check=True, timeout=10.0
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _plain(value: Any) -> Any:
    """`value` as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted(_plain(each) for each in value)
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
