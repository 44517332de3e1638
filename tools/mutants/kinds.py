"""Small mistakes in the code, one at a time, that `tools.mutants` tries to hide from tests.

Most kinds are those of cosmic-ray: an operator or a comparison exchanged, a number one more or
less, a condition turned round, a loop that never runs, a decorator gone, an exception not caught.
Three are added that it does not have: a statement dropped, a branch turned round, and a number of
the sheet's data changed.
"""

from __future__ import annotations

import ast
import hashlib
import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

_KINDS: Final = (
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "NumberReplacer",
    "ReplaceContinueWithBreak",
    "ReplaceBreakWithContinue",
    "AddNot",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ExceptionReplacer",
    "RemoveDecorator",
    "ZeroIterationForLoop",
    "ReplaceUnaryOperator",
    *(
        f"ReplaceBinaryOperator_{a}_{b}"
        for a, b in itertools.permutations(("Add", "Sub", "Mul", "Div"), 2)
    ),
    *(
        f"ReplaceBinaryOperator_{a}_{b}"
        for a, b in (("Pow", "Mul"), ("BitOr", "BitAnd"), ("BitAnd", "BitOr"))
    ),
    *(
        f"ReplaceComparisonOperator_{a}_{b}"
        for a, b in itertools.permutations(("Lt", "LtE", "Gt", "GtE"), 2)
    ),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in itertools.permutations(("Eq", "NotEq"), 2)),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in itertools.permutations(("Is", "IsNot"), 2)),
)
"""Beginnings of the names of cosmic-ray's operators that are used.

Those that would end in a TypeError at once, such as a shift of a floating-point number, are not:
killing them says nothing.
"""


@dataclass(frozen=True)
class Mutant:
    """A mistake that can be put into a file.

    Attributes:
        path: of the file, from the project's folder.
        line: number of the line, from 1.
        was: the line as it is, stripped.
        kind: of the mistake.
        column: of the mistake in the line.
        code: the file as it is.
        make: returns the file with the mistake; None: it cannot be made.
    """

    path: str
    line: int
    was: str
    kind: str
    column: int
    code: str
    make: Callable[[], str | None]

    @property
    def name(self) -> str:
        """What stays the same wherever in the file the line stands."""
        return f"{self.path}: {self.was} [{self.kind} at {self.column}]"

    @property
    def rank(self) -> str:
        """Place in the order of taking mutants: random, and the same when other lines change."""
        return hashlib.sha256(self.name.encode()).hexdigest()

    def source(self) -> str | None:
        """Return the whole file with the mistake.

        It is None if that is the same program, as in an annotation, or no program at all.
        """
        made = self.make()
        if made is None or self.path.endswith(".toml"):
            return made
        try:
            return None if _program(made) == _program(self.code) else made
        except SyntaxError:
            return None


def mutants_of(root: Path, path: str) -> list[Mutant]:
    """Return one mutant per place of a file where something can be mistaken.

    Each is chosen among those that the place allows.
    """
    code = (root / path).read_text(encoding="utf-8")
    lines = code.splitlines()
    found: dict[tuple[int, int], list[Mutant]] = {}
    for (line, column), kind, make in (
        _numbers(code) if path.endswith(".toml") else (*_of_cosmic_ray(code), *_of_our_own(code))
    ):
        was = lines[line - 1]
        mutant = Mutant(
            path, line, was.strip(), kind, column - (len(was) - len(was.lstrip())), code, make
        )
        found.setdefault((line, column), []).append(mutant)
    return [min(choice, key=lambda mutant: mutant.rank) for choice in found.values()]


Site = tuple[tuple[int, int], str, Callable[[], str | None]]
"""(line and column), kind, what makes the mistake."""


def _of_cosmic_ray(code: str) -> Iterator[Site]:
    tree = get_ast(code)
    nodes = list(ast_nodes(tree))
    for name in operator_names():
        if not name.partition("/")[2].startswith(_KINDS):
            continue
        operator = get_operator(name)()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, start in enumerate(places):
            yield start, name.partition("/")[2], partial(mutate_code, code, operator, occurrence)


def _of_our_own(code: str) -> Iterator[Site]:
    """Yield statements dropped, and conditions turned round."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.AugAssign | ast.Raise) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        ):
            yield (node.lineno, node.col_offset), "drop", partial(_replaced, code, node, "pass")
        elif isinstance(node, ast.IfExp):
            test = f"(not ({ast.get_source_segment(code, node.test)}))"
            yield (
                (node.test.lineno, node.test.col_offset),
                "turn",
                partial(_replaced, code, node.test, test),
            )


def _replaced(code: str, node: ast.expr | ast.stmt, text: str) -> str:
    lines = code.splitlines(keepends=True)
    assert node.end_lineno is not None
    first, last = lines[node.lineno - 1].encode(), lines[node.end_lineno - 1].encode()
    # What stands on several lines leaves as many, so that all other lines keep their numbers.
    fill = "\n" * (node.end_lineno - node.lineno) if text == "pass" else ""
    joined = first[: node.col_offset] + text.encode() + last[node.end_col_offset :] + fill.encode()
    return "".join(lines[: node.lineno - 1]) + joined.decode() + "".join(lines[node.end_lineno :])


def _numbers(code: str) -> Iterator[Site]:
    """Yield data with one number changed by one, either way."""
    offset = 0
    for number, line in enumerate(code.splitlines(keepends=True), 1):
        for match in re.finditer(r"(?<![\w.\"-])\d+(\.\d+)?(?![\w.\"])", line.split("#")[0]):
            start, end = offset + match.start(), offset + match.end()
            for step in (1, -1):
                text = f"{float(match[0]) + step:.{1 if '.' in match[0] else 0}f}"
                yield (
                    (number, match.start()),
                    f"{step:+d}",
                    partial("".join, (code[:start], text, code[end:])),
                )
        offset += len(line)


class _Bare(ast.NodeTransformer):
    """Takes away what no result depends on: annotations, docstrings, and what `zip` asserts."""

    def visit_keyword(self, node: ast.keyword) -> ast.AST:
        if node.arg == "strict":
            node.value = ast.Constant(None)
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self._without_docstring(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        return self._without_docstring(node)

    def visit_Module(self, node: ast.Module) -> ast.AST:
        return self._without_docstring(node)

    def _without_docstring(self, node: ast.FunctionDef | ast.ClassDef | ast.Module) -> ast.AST:
        kept = [
            child
            for child in node.body
            if not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant))
        ]
        node.body = kept or [ast.Pass()]
        return self.generic_visit(node)


def _program(code: str) -> str:
    return ast.dump(_Bare().visit(ast.parse(code)))
