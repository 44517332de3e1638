"""Whether the step answers as it did at an earlier commit, to the last bit.

Run ``python -m tools.same --before COMMIT [--full]``.

The earlier commit is checked out beside this one as a worktree. Its step makes recordings for every
problem of ``problems/``: random walks with noise, unseen angles, lost poses, late frames, periods
that vary. Each recorded input holds the state too, so that it is one call of a pure function. The
same inputs then go through the step of both trees, on this machine:

- ``inputs``: how many in all; ``--full`` 10 000.
- ``differ.plain``, ``differ.compiled``, ``differ.exported``, ``differ.guided``: inputs after which
  any bit of any output is another: of the CasADi function, of the same through the C compiler, of
  the exported C, and of the step with a place given and a robot declared.
- ``twist_difference``, ``status_differ``: where bits differ, the largest difference of a twist
  [m/s, rad/s], and the inputs after which status or causes differ, over all these forms.
- ``recordings``, ``differ.scores``: recordings of the shared folder, and those whose exit status
  or ``scores.csv`` is another; every one is scored by ``ergoqp score`` of both trees.
- ``refused``: inputs that were answered with ``braking`` or ``invalid``; ``moving``: with a twist
  that is not zero. They say that the inputs reach the parts of the step.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.report import Report, run, shared_folder

ROOT: Final = Path(__file__).resolve().parents[1]
KINDS: Final = ("plain", "guided", "compiled", "exported")
ROBOT: Final = {
    "delay": 0.01,
    "lag": 0.02,
    "pose_noise": 1e-3,
    "pose_noise_deg": 0.2,
    "gain_error": 0.02,
}
CORE: Final = "ergoqp_core"
SOURCES: Final = ("src/ergoqp_core.c", "src/qp.c")
FLAGS: Final = (
    "-std=c99",
    "-O1",
    "-shared",
    "-fPIC",
    "-ffp-contract=off",
    "-Iinclude",
    "-Isrc",
    "-Idaqp/include",
)


def step_function(name: str, kind: str, folder: Path) -> Any:
    """Return one form of the step of a problem, in whichever tree this process has imported."""
    import casadi as ca

    import ergoqp

    problem = _problem(name, kind)
    make = getattr(problem, "step_function", None) or (
        lambda **given: ergoqp.step_function(problem, **given)
    )
    if kind != "exported":
        return make(compiled=kind == "compiled", **({"guided": True} if kind == "guided" else {}))
    export = folder / f"export_{os.getpid()}_{name}"
    subprocess.run(
        [sys.executable, "-m", "ergoqp", "export", name, "--out", str(export)],
        check=True,
        capture_output=True,
    )
    library = export / "core.so"
    command = ["gcc", *FLAGS, *SOURCES, "daqp/lib/libdaqpstat.a", "-lm", "-o", str(library)]
    subprocess.run(command, cwd=export, check=True)
    return ca.external(CORE, str(library))


def _problem(name: str, kind: str) -> Any:
    import ergoqp

    problem = ergoqp.load_problem(name)
    declares = kind == "guided" and len(problem.coordinates) == 32
    return problem.replace(robot=ergoqp.DeclaredRobot(**ROBOT)) if declares else problem


def record(name: str, kind: str, number: int, folder: Path) -> None:
    """Keep the inputs of random walks, each a row of all numbers."""
    from ergoqp.step import function as states
    from ergoqp.step.constants import stand_in
    from ergoqp.step.model import StepModel

    # Earlier commits have it under another name.
    at_start: Any = vars(states).get("state_at_start") or vars(states)["initial_state"]

    function = step_function(name, kind, folder)
    problem = _problem(name, kind)
    rng, n = np.random.default_rng(sum(map(ord, name))), len(problem.coordinates)
    model = StepModel(problem, kind == "guided")
    home, contact = np.asarray(stand_in(problem), dtype=float), problem.response.contact()
    sizes = {function.name_in(i): function.size_in(i) for i in range(function.n_in())}
    kept, refused, moving = [], 0, 0
    posture, pose, twist, state = home, np.eye(4), np.zeros(6), np.zeros(0)
    for step in range(number):
        if step % 100 == 0:
            posture = home + (
                rng.choice([0.05, 0.15, 0.3]) * rng.normal(size=n) if n == 32 else 0.0
            )
            pose, twist = np.array(contact(posture)[0]), np.zeros(6)
            state = np.array(at_start(model)).ravel()
        posture = posture + (0.002 * rng.normal(size=n) if n == 32 else 0.0)
        seen = posture + (np.radians(0.3) * rng.normal(size=n) if n == 32 else 0.0)
        odd = rng.random()
        dt = problem.dt * (1 if odd < 0.8 else rng.uniform(0.7, 1.5))
        if odd < 0.03:
            seen[rng.integers(n)] = np.nan
        observed = (rng.random(n) > 0.02).astype(float) if odd > 0.97 else np.ones(n)
        pose[:3, 3] += twist[:3] * dt
        pose[:3, :3] = Rotation.from_rotvec(twist[3:] * dt).as_matrix() @ pose[:3, :3]
        given = {
            "posture": seen,
            "observed": observed,
            "pose": np.full((4, 4), np.nan) if 0.1 < odd < 0.15 else pose,
            "has_pose": float(odd > 0.2),
            "executed": twist,
            "has_twist": float(0.3 < odd < 0.6),
            "dt": dt,
            "age": 0.0 if odd < 0.95 else rng.uniform(0, 0.2),
            "frame": 1.0,
            "enable": float(odd < 0.99),
            "ask": float(odd > 0.995),
            "state": state,
            "guide": _near(pose, rng),
            "guided": float(step % 100 > 20),
            "promise": 1.0,
        }
        row = np.concatenate([_column(given[key], size) for key, size in sizes.items()])
        kept.append(row)
        out = dict(zip(function.name_out(), function(*_arguments(row, function)), strict=True))
        twist, state = (np.array(out[key]).ravel() for key in ("twist", "next_state"))
        refused += int(float(out["status"]) >= 4)
        moving += bool(np.any(twist))
    np.savez(folder / f"in_{name}_{kind}.npz", rows=np.array(kept), refused=refused, moving=moving)


def _column(value: Any, size: tuple[int, int]) -> np.ndarray:
    full = np.broadcast_to(
        np.asarray(value, dtype=float).reshape(size, order="F")
        if np.size(value) > 1
        else float(value),
        size,
    )
    return np.ravel(full, order="F")


def _arguments(row: np.ndarray, function: Any) -> list[np.ndarray]:
    ends = np.cumsum([function.numel_in(i) for i in range(function.n_in())])[:-1]
    return [
        part.reshape(function.size_in(i), order="F") for i, part in enumerate(np.split(row, ends))
    ]


def _near(pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    place = pose.copy()
    place[:3, 3] += 0.05 * rng.normal(size=3)
    return place


def answer(name: str, kind: str, folder: Path, out: str) -> None:
    """Write all outputs for the recorded inputs of a problem."""
    function = step_function(name, kind, folder)
    recorded = folder / f"in_{name}_{'guided' if kind == 'guided' else 'plain'}.npz"
    rows = np.load(recorded)["rows"]
    results = [
        np.concatenate([np.array(part).ravel("F") for part in function(*_arguments(row, function))])
        for row in rows
    ]
    sizes = [function.numel_out(i) for i in range(function.n_out())]
    starts = dict(zip(function.name_out(), np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))
    places = [np.arange(starts[part], starts[part] + size) for part, size in _TOLD.items()]
    told = np.array(results)[:, np.concatenate(places)]
    np.savez(folder / f"{out}_{name}_{kind}.npz", results=np.array(results), told=told)


_TOLD: Final = {"twist": 6, "status": 1, "causes": 1}
"""What an answer says to its loop: name and size."""


def scored(tree: Path, path: Path, folder: Path) -> tuple[int, bytes]:
    """Return exit status and ``scores.csv`` of ``ergoqp score`` of a tree."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    command = [sys.executable, "-m", "ergoqp", "score", str(path), "--out", str(folder)]
    if path.is_dir():
        # Such folders were read by ergoqp itself, and are now by the reader of the example.
        command[5:5] = ["--rate", "120"]
        if (tree / "examples" / "own_terms" / "own_terms" / "poses.py").is_file():
            command[4] = str(_as_own_folder(path, folder / "own"))
            del command[5:7]
            own = f"{tree / 'examples' / 'own_terms'}{os.pathsep}{folder / 'own'}"
            environment["PYTHONPATH"] += os.pathsep + own
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True)
    scores = folder / "scores.csv"
    return done.returncode, scores.read_bytes() if scores.is_file() else b""


def _as_own_folder(path: Path, site: Path) -> Path:
    """Return a copy of a folder of poses for the example's reader, which is registered there."""
    folder, package = site / "take.poses", site / "own_terms-0.dist-info"
    folder.mkdir(parents=True)
    package.mkdir()
    for table in path.glob("*.csv"):
        name = table.name.removeprefix("giver_").removesuffix("_pose_saved.csv")
        (folder / f"{name}.csv").write_bytes(table.read_bytes())
    (folder / "take.toml").write_text('rate = 120\norder = "xyzw"\n', encoding="utf-8")
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: own_terms\nVersion: 0\n")
    (package / "entry_points.txt").write_text(
        "[ergoqp.readers]\nposes = own_terms.poses:read_poses\n", encoding="utf-8"
    )
    return folder


def differing_scores(before: Path, scratch: Path) -> tuple[int, list[str]]:
    """Return how many recordings there are, and those that the trees do not score alike."""
    shared = shared_folder()
    if shared is None:
        return 0, []
    root = shared / "mocap"
    paths = sorted(path for path in root.glob("*/*") if path.parent.name != "kth_handover_giver")
    paths.append(root / "kth_handover_giver")
    found = []
    for number, path in enumerate(paths):
        answers = []
        for name, tree in (("before", before), ("after", ROOT)):
            folder = scratch / f"scores_{number}_{name}"
            folder.mkdir()
            answers.append(scored(tree, path, folder))
        if answers[0] != answers[1]:
            found.append(f"{path.name} ({answers[0][0]}, {answers[1][0]})")
    return len(paths), found


def child(tree: Path, folder: Path, *arguments: str) -> None:
    """Run this file in a process that imports the package of a tree."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    subprocess.run(
        [sys.executable, str(Path(__file__)), str(folder), *arguments],
        cwd=tree,
        env=environment,
        check=True,
    )


def measure(report: Report, before: str, kinds: tuple[str, ...]) -> None:
    """Measure all figures of this file."""
    names = sorted(path.stem for path in (ROOT / "problems").glob("*.toml"))
    number = -(-report.pick(1_000, 10_000) // len(names))
    with tempfile.TemporaryDirectory() as scratch:
        folder, earlier = Path(scratch), Path(scratch) / "before"
        subprocess.run(
            ["git", "worktree", "add", "-q", "--detach", str(earlier), before], cwd=ROOT, check=True
        )
        try:
            for name in names:
                for kind in {"plain", *kinds} & {"plain", "guided"}:
                    child(ROOT, folder, "record", name, kind, str(number))
                for kind in kinds:
                    for out, tree in (("before", earlier), ("after", ROOT)):
                        child(tree, folder, "answer", name, kind, out)
            recordings, other = differing_scores(earlier, folder) if report.full else (0, [])
        finally:
            subprocess.run(
                ["git", "worktree", "remove", "--force", str(earlier)], cwd=ROOT, check=True
            )
        report.figure("inputs", number * len(names))
        for key in ("refused", "moving"):
            report.figure(
                key, sum(int(np.load(folder / f"in_{name}_plain.npz")[key]) for name in names)
            )
        report.figure("recordings", recordings, "with --full only")
        report.figure("differ.scores", len(other), ", ".join(other))
        for kind in kinds:
            differ = {
                name: differing(folder, name, f"before_{kind}", f"after_{kind}") for name in names
            }
            report.figure(
                f"differ.{kind}",
                sum(differ.values()),
                ", ".join(f"{n}: {d}" for n, d in differ.items() if d),
            )
        apart = [_apart(folder, name, kind) for name in names for kind in kinds]
        report.figure("twist_difference", max(twist for twist, _ in apart), "of all forms")
        report.figure("status_differ", sum(count for _, count in apart), "of all forms")


def differing(folder: Path, name: str, *answers: str) -> int:
    """Return the number of inputs after which two answers, ``OUT_KIND`` each, are not the same."""
    one, other = (_kept(folder, name, answer)["results"] for answer in answers)
    return sum(a.tobytes() != b.tobytes() for a, b in zip(one, other, strict=True))


def _kept(folder: Path, name: str, answer: str) -> Any:
    out, kind = answer.split("_")
    return np.load(folder / f"{out}_{name}_{kind}.npz")


def _apart(folder: Path, name: str, kind: str) -> tuple[float, int]:
    """Return the largest difference of a twist, and how many statuses or causes differ."""
    one, other = (_kept(folder, name, f"{out}_{kind}")["told"] for out in ("before", "after"))
    return float(np.abs(one - other)[:, :6].max()), int((one != other)[:, 6:].any(axis=1).sum())


def main() -> None:
    """Run the command line."""
    if len(sys.argv) > 2 and sys.argv[2] == "record":
        record(sys.argv[3], sys.argv[4], int(sys.argv[5]), Path(sys.argv[1]))
    elif len(sys.argv) > 2 and sys.argv[2] == "answer":
        answer(sys.argv[3], sys.argv[4], Path(sys.argv[1]), sys.argv[5])
    else:
        parser = argparse.ArgumentParser(add_help=False)
        parser.add_argument("--before", default="HEAD", help="the commit to compare with")
        parser.add_argument("--kinds", default=",".join(KINDS), help="which forms of the step")
        own, others = parser.parse_known_args()
        run(
            lambda report: measure(report, own.before, tuple(own.kinds.split(","))),
            str(__doc__).splitlines()[0],
            others,
        )


if __name__ == "__main__":
    main()
