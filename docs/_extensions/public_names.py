"""The public names of ergoqp: what has a page in the reference, and what a test asks of each.

A name that is not listed here may change without notice.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
from typing import Any, Final

PUBLIC: Final[dict[str, tuple[str, ...]]] = {
    "The loop": (
        "ergoqp.load_problem",
        "ergoqp.Problem",
        "ergoqp.Control",
        "ergoqp.DeclaredRobot",
        "ergoqp.Frames",
        "ergoqp.calibrate_frames",
        "ergoqp.identification.calibrate.CalibratedFrames",
        "ergoqp.Stepper",
        "ergoqp.Step",
        "ergoqp.step.causes.Status",
        "ergoqp.step_function",
        "ergoqp.initial_state",
        "ergoqp.formulate",
        "ergoqp.Formulation",
        "ergoqp.Formulator",
        "ergoqp.replay",
        "ergoqp.benchmark_step",
        "ergoqp.step.timing.StepTimes",
        "ergoqp.step.timing.LARGEST_ITERATIONS",
        "ergoqp.Seeker",
        "ergoqp.seeking.SeekOptions",
        "ergoqp.seeking.Place",
        "ergoqp.seeking.next_place.Try",
        "ergoqp.export.folder.export_step",
    ),
    "The service": (
        "ergoqp.Client",
        "ergoqp.service.client.ServiceError",
        "ergoqp.service.schema.schema",
        "ergoqp.service.replayed.replay_record",
        "ergoqp.service.replayed.Replayed",
    ),
    "Postures and their score": (
        "ergoqp.JOINTS",
        "ergoqp.joints.INDEX",
        "ergoqp.reba.assess",
        "ergoqp.reba.combine",
        "ergoqp.reba.Assessment",
        "ergoqp.reba.Scores",
        "ergoqp.reba.Method",
        "ergoqp.reba.ACTION_LEVELS",
        "ergoqp.sheets.options.TaskOptions",
    ),
    "Costs": (
        "ergoqp.costs.cost.Cost",
        "ergoqp.costs.smooth_reba.SmoothReba",
        "ergoqp.costs.cost.LearnedCost",
        "ergoqp.costs.quadratic.Quadratic",
        "ergoqp.costs.gmr.Gmr",
        "ergoqp.costs.svr.Svr",
        "ergoqp.costs.one_class_ladder.OneClassLadder",
        "ergoqp.costs.neural.Neural",
        "ergoqp.costs.from_sklearn.from_sklearn",
        "ergoqp.costs.from_sklearn.SklearnCost",
        "ergoqp.costs.load.quality_of",
        "ergoqp.load_cost",
    ),
    "Labelled postures": (
        "ergoqp.datasets.data.DataSet",
        "ergoqp.datasets.postures.posture_data",
        "ergoqp.datasets.postures.interval_labels",
        "ergoqp.datasets.postures.posture_stream",
        "ergoqp.datasets.data.read_data",
        "ergoqp.coordinates.Coordinates",
    ),
    "Limits": (
        "ergoqp.limits.Limit",
        "ergoqp.limits.Rows",
        "ergoqp.limits.LimitContext",
        "ergoqp.limits.limit.straight_margins",
        "ergoqp.limits.TwistLimit",
        "ergoqp.limits.AXES",
        "ergoqp.limits.JointLimit",
        "ergoqp.limits.WorkspaceBox",
        "ergoqp.limits.AxisCone",
        "ergoqp.limits.KeepOut",
        "ergoqp.limits.keep_out.Region",
        "ergoqp.limits.HalfSpace",
        "ergoqp.limits.Box",
        "ergoqp.limits.Ball",
        "ergoqp.limits.ArmLength",
        "ergoqp.limits.OneClassBoundary",
        "ergoqp.learning.one_class.OneClass",
    ),
    "Responses": (
        "ergoqp.responses.Response",
        "ergoqp.responses.IkResponse",
        "ergoqp.responses.LinearResponse",
    ),
    "Solvers": (
        "ergoqp.solvers.QpSolver",
        "ergoqp.solvers.SOLVERS",
        "ergoqp.solvers.solver_named",
        "ergoqp.solvers.installed_solvers",
        "ergoqp.solvers.open_session",
        "ergoqp.solvers.session.Session",
        "ergoqp.solvers.session.QpAnswer",
        "ergoqp.solvers.session.Qp",
        "ergoqp.solvers.session.judge",
        "ergoqp.compare",
        "ergoqp.comparison.compare.Comparison",
    ),
    "The person": (
        "ergoqp.human.Body",
        "ergoqp.human.FRACTIONS",
        "ergoqp.human.Kinematics",
        "ergoqp.human.FRAMES",
        "ergoqp.human.person_file.given_person",
        "ergoqp.human.person_file.write_person",
        "ergoqp.identify",
        "ergoqp.identification.Identified",
        "ergoqp.identification.loops.Resting",
    ),
    "Recordings": (
        "ergoqp.load_recording",
        "ergoqp.fit_postures",
        "ergoqp.mocap.Recording",
        "ergoqp.mocap.READERS",
        "ergoqp.mocap.recording.JointMotion",
        "ergoqp.mocap.naming.CENTRES",
        "ergoqp.mocap.naming.LANDMARKS",
        "ergoqp.mocap.naming.centres_of",
    ),
    "Places": (
        "ergoqp.optimise",
        "ergoqp.placing.optimum.Optimum",
        "ergoqp.placing.optimum.StartResult",
        "ergoqp.lab.population.population",
        "ergoqp.lab.population.best_of_population",
        "ergoqp.lab.population.Found",
        "ergoqp.lab.population.variant",
        "ergoqp.lab.group.best_for_group",
        "ergoqp.lab.group.GroupOptimum",
        "ergoqp.lab.group.Member",
        "ergoqp.lab.group_search.GroupPerson",
    ),
    "Simulation": (
        "ergoqp.simulate",
        "ergoqp.simulation.run.Run",
        "ergoqp.simulation.people.kinds",
        "ergoqp.simulation.people.person_of_kind",
        "ergoqp.rest.person_protocol.Person",
        "ergoqp.rest.person_protocol.Holding",
        "ergoqp.lab.people.soft.SoftPerson",
        "ergoqp.rest.person_protocol.SensorModel",
        "ergoqp.rest.model_person.sample_person",
        "ergoqp.rest.best_place.awkward_start",
        "ergoqp.simulation.robot.RobotKind",
        "ergoqp.simulation.check.Checker",
    ),
    "The whole body": (
        "ergoqp.whole_body.WholeBody",
        "ergoqp.whole_body.WholeBodyStep",
        "ergoqp.whole_body.Robot",
        "ergoqp.whole_body.load_robot",
        "ergoqp.whole_body.Scene",
        "ergoqp.whole_body.loop.run_whole_body",
    ),
    "Errors": (
        "ergoqp.errors.ErgoqpError",
        "ergoqp.errors.InputError",
        "ergoqp.errors.OutOfReachError",
        "ergoqp.errors.ProblemError",
        "ergoqp.errors.RecordingError",
        "ergoqp.errors.NothingScoredError",
        "ergoqp.errors.UnknownNamesError",
        "ergoqp.errors.ModelError",
        "ergoqp.errors.MissingExtraError",
        "ergoqp.errors.WorkersError",
        "ergoqp.native.compiled.CompilerError",
    ),
}
"""Names by group, as they are imported."""

NAMES: Final = tuple(name for names in PUBLIC.values() for name in names)


def found(name: str) -> Any:
    """Import what a public name means."""
    module, _, last = _place(name).rpartition(".")
    return getattr(importlib.import_module(module), last)


def docstring_of(name: str) -> str:
    """Return the docstring of a public name; that of a constant stands below it in its file."""
    value = found(name)
    if isinstance(value, type) or callable(value):
        return inspect.getdoc(value) or ""
    module, _, last = _place(name).rpartition(".")
    return inspect.cleandoc(_below(module, last))


def _place(name: str) -> str:
    # `ergoqp.reba` is a module that the package gives by a shorter name.
    return name.replace("ergoqp.reba.", "ergoqp.sheets.reba.")


def _below(module: str, name: str) -> str:
    """Return the text below the assignment of a constant, where it is made."""
    tree = ast.parse(inspect.getsource(importlib.import_module(module)))
    for node, after in itertools.pairwise(tree.body):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                if alias.asname == name:
                    return _below(node.module, alias.name)
        target = node.target if isinstance(node, ast.AnnAssign) else None
        if (
            isinstance(target, ast.Name)
            and target.id == name
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            return str(after.value.value)
    return ""
