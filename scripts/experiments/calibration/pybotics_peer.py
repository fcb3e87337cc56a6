"""Peer of the calibration benchmark: pybotics' forward kinematics with SciPy, in a Python without
this project.

    python experiments/calibration/pybotics_peer.py DATA.npz RESULT.npz

Residuals (touches about their point's mean, over the noise), prior and start are those of our fit.
SciPy's trust-region least squares takes its derivatives by differences, since pybotics has none.
Parameters: its MDH rows, the tool point.
"""

import sys
import time
from importlib import import_module

import numpy as np
import scipy
from scipy.optimize import least_squares


def main(data_file: str, result_file: str) -> None:
    """Runs one fit; reads the task from `data_file` and writes time and cost to `result_file`."""
    archive = np.load(data_file)
    q, starts, mdh, tool, sigma = (
        archive[name] for name in ("q", "starts", "mdh", "tool", "sigma")
    )
    noise = float(archive["noise"])
    robot = import_module("pybotics.robot").Robot.from_parameters(mdh)
    robot.tool.matrix = tool
    tool_vector = np.array(robot.tool.vector)
    mean = np.concatenate([robot.kinematic_chain.vector, tool_vector[:3]])
    calls = 0

    def centred(x: np.ndarray) -> np.ndarray:
        robot.kinematic_chain.vector = x[:-3]
        robot.tool.vector = np.concatenate([x[-3:], tool_vector[3:]])
        tips = np.array([robot.fk(row)[:3, 3] for row in q])
        parts = np.split(tips, starts[1:])
        return np.concatenate([part - part.mean(axis=0) for part in parts])

    def residuals(x: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return np.concatenate([centred(x).ravel() / noise, (x - mean) / sigma])

    began = time.perf_counter()
    fit = least_squares(residuals, mean, x_scale=sigma, method="trf")
    took = time.perf_counter() - began
    parts = np.split(centred(fit.x), starts[1:])
    cost = sum(len(part) * float((part**2).sum()) for part in parts)
    np.savez(result_file, seconds=took, cost=cost, calls=calls, scipy=scipy.__version__)


if __name__ == "__main__":
    main(*sys.argv[1:])
