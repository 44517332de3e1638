"""Problems of one structure, with every number of the problem file drawn anew."""

from __future__ import annotations

import tomllib
from copy import deepcopy
from dataclasses import fields
from typing import Any

import numpy as np

from ergoqp.problem.load import problem_from_dict
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control
from ergoqp.registry import data_folder

KINDS = ("plain", "robot", "regions", "seated", "points")
"""The kinds: a person, with a declared robot, with regions and frames, seated, and two points."""

ROBOT = {
    "delay": 0.02,
    "lag": 0.05,
    "gain_error": 0.03,
    "pose_delay": 0.01,
    "pose_noise": 0.001,
    "pose_noise_deg": 0.2,
    "longest_hold": 0.05,
    "pose_from_posture": 0.03,
    "pose_from_posture_deg": 7.0,
}
REGIONS = [
    {"name": "ball", "ball": {"centre": [0.9, 0.3, 1.0], "radius": 0.1}},
    {"name": "box", "box": {"lower": [0.7, 0.2, 0.6], "upper": [0.9, 0.4, 0.9]}},
    {"name": "plane", "half_space": {"normal": [0.1, 0.2, 1.0], "offset": 0.45}},
]
FRAMES = {"offset": [0.01, -0.01, 0.02], "spread": 0.05, "spread_deg": 10.0}
PERSON = {
    "weights": {"trunk_flexion": 4.0, "elbow_flexion": 0.5},
    "balance": 60.0,
    "relaxation_time": 1.0,
    "damping": 0.02,
    "attention": 8.0,
}
JOINTS = {
    "ranges_deg": {"trunk_flexion": [-10.0, 70.0], "right_elbow_flexion": [5.0, 120.0]},
    "rate_deg": 80.0,
    "yield_zone_deg": 1.5,
    "tolerance_deg": 2.0,
    "recovery_time": 1.0,
    "recover": True,
}
METHOD = {"trunk_bent_deg": 20.0, "wrist_deviation_deg": 10.0}


def kind_of(name: str) -> dict[str, Any]:
    """Return the tables of one of the `KINDS`, with its numbers."""
    base = {"seated": "dentist", "points": "forearm"}.get(name, "screwing")
    raw = tomllib.loads((data_folder("problems") / f"{base}.toml").read_text(encoding="utf-8"))
    defaults = Control()
    raw["control"] = {
        each.name: getattr(defaults, each.name)
        for each in fields(Control)
        if each.name != "average"
    }
    if name == "points":
        return raw
    raw["response"]["ik"] |= deepcopy(PERSON) | {"stature": 1.75}
    raw["cost"] = {"smooth_reba": {"taus_deg": [1.8, 12.0], "weights": [0.8, 0.2]}}
    raw["task"]["method"] = dict(METHOD)
    raw["limits"]["joints"] = deepcopy(JOINTS)
    raw["control"]["average"] = 0.05
    raw |= {"robot": dict(ROBOT)} if name == "robot" else {}
    raw |= {"frames": dict(FRAMES)} if name == "regions" else {}
    if name == "regions":
        raw["limits"]["keep_out"] = deepcopy(REGIONS)
    return raw


def drawn(name: str, seed: int) -> Problem:
    """Return a problem of a kind in which every number is up to 8 % larger or smaller."""
    rng = np.random.default_rng(seed)
    raw = _scaled(kind_of(name), rng)
    raw["dt"] = 0.01 * rng.uniform(1.0, 1.15)
    if name != "points":
        task, shares = raw["task"], raw["cost"]["smooth_reba"]
        task["load_kg"] = float(rng.choice([0.0, 3.0, 7.0, 15.0]))
        task["coupling"], task["activity"] = (int(rng.integers(0, 4)) for _ in range(2))
        task["shock"] = bool(rng.integers(0, 2))
        first = rng.uniform(0.6, 0.9)
        shares["weights"] = [first, 1 - first]
    return problem_from_dict(raw, "drawn", data_folder("problems"))


def _scaled(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, dict):
        return {key: _scaled(each, rng) for key, each in value.items()}
    if isinstance(value, list):
        return [_scaled(each, rng) for each in value]
    return value * rng.uniform(0.92, 1.08) if type(value) is float else value


def postures(problem: Problem, seed: int, count: int = 20) -> np.ndarray:
    """Return postures (count, n) around comfort [rad, m]."""
    usual = np.asarray(getattr(problem.response, "comfort", np.zeros(32)), dtype=float)
    if len(usual) != 32:
        usual = np.array([0.1, -0.2, 1.2, 0.3, -0.2, 1.3])
    return usual + 0.15 * np.random.default_rng(seed).normal(size=(count, len(usual)))
