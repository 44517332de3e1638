"""A walk through the text of the package: follow one object through the calls that are handed it.

Nothing is run. A call counts that is handed the object itself, what holds it (``.problem``,
``._problem``, ``._model``), or a `StepModel` made of it. Calls are taken in the order in which they
stand; what a function does with the object is followed when the walk first comes to it, and a class
is followed through all of its methods. A method of the object itself is no call that is handed it.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

HOLDERS: Final = ("problem", "_problem", "_model")
MAKERS: Final = ("StepModel",)


@dataclass
class Walk:
    """The way of one object from file to file.

    Attributes:
        files: of the package, by the names that they are imported by.
        levels: floor of each file, by the same names.
        stays: the files it came to, in order.
        up: how many of these are on a higher floor than the one before.
    """

    files: Mapping[str, Path]
    levels: Mapping[str, int]
    stays: list[str] = field(default_factory=list)
    up: int = 0
    _walked: set[tuple[str, str]] = field(default_factory=set)
    _trees: dict[str, ast.Module] = field(default_factory=dict)

    @property
    def again(self) -> int:
        """How many stays are in a file that was left before."""
        return len(self.stays) - len(set(self.stays))

    def enter(self, module: str, name: str, given: frozenset[str]) -> None:
        """Come into a function or class of a file, as the parameters `given`."""
        if not self.stays or self.stays[-1] != module:
            self.up += bool(self.stays) and self.levels[module] > self.levels[self.stays[-1]]
            self.stays.append(module)
        node = self._defined(module).get(name)
        if node is None or (module, name) in self._walked:
            return
        self._walked.add((module, name))
        followed = set(given)
        for each in sorted(_parts(node), key=lambda part: (part.lineno, part.col_offset)):
            if isinstance(each, ast.Assign):
                _assign(each, followed)
            elif isinstance(each, ast.Call):
                self._call(module, each, followed)

    def _call(self, module: str, call: ast.Call, followed: set[str]) -> None:
        handed = [i for i, part in enumerate(call.args) if _is_followed(part, followed)]
        named = [key.arg for key in call.keywords if key.arg and _is_followed(key.value, followed)]
        if not handed and not named:
            return
        found = self._callee(module, call.func)
        if found is None:
            return
        where, name, method = found
        node = self._defined(where).get(name)
        if node is None:
            return
        function = node
        if isinstance(node, ast.ClassDef):
            function = next(
                (part for part in node.body if getattr(part, "name", "") == (method or "__init__")),
                node,
            )
        names = list(named)
        if isinstance(function, ast.FunctionDef):
            first = function.args.args[int(isinstance(node, ast.ClassDef)) :]
            names += [first[i].arg for i in handed if i < len(first)]
        self.enter(where, name, frozenset(names))

    def _callee(self, module: str, func: ast.expr) -> tuple[str, str, str] | None:
        """Return (file, name, method) of what is called; None if it is not of the package."""
        method = ""
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name):
            func, method = func.value, func.attr
        if not isinstance(func, ast.Name):
            return None
        if func.id in self._defined(module):
            return module, func.id, method
        for node in self._tree(module).body:
            if isinstance(node, ast.ImportFrom) and node.module in self.files:
                for alias in node.names:
                    if (alias.asname or alias.name) == func.id:
                        return self._home(str(node.module), alias.name, method)
        return None

    def _home(self, module: str, name: str, method: str) -> tuple[str, str, str]:
        """Return where a name is defined that a package only hands on."""
        if name not in self._defined(module):
            for node in self._tree(module).body:
                if isinstance(node, ast.ImportFrom) and node.module in self.files:
                    names = [each.asname or each.name for each in node.names]
                    if name in names:
                        return self._home(str(node.module), name, method)
        return module, name, method

    def _tree(self, module: str) -> ast.Module:
        if module not in self._trees:
            self._trees[module] = ast.parse(self.files[module].read_text(encoding="utf-8"))
        return self._trees[module]

    def _defined(self, module: str) -> dict[str, ast.stmt]:
        kinds = (ast.FunctionDef, ast.ClassDef)
        return {node.name: node for node in self._tree(module).body if isinstance(node, kinds)}


def _parts(node: ast.AST) -> list[ast.Assign | ast.Call]:
    return [part for part in ast.walk(node) if isinstance(part, (ast.Assign, ast.Call))]


def _is_followed(node: ast.expr, followed: set[str]) -> bool:
    if isinstance(node, ast.Starred):
        node = node.value
    if isinstance(node, ast.Attribute):
        return node.attr in HOLDERS
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id in MAKERS
    return isinstance(node, ast.Name) and node.id in followed


def _assign(node: ast.Assign, followed: set[str]) -> None:
    """Follow the object under the names that it is given."""
    target, value = node.targets[0], node.value
    pairs = [(target, value)]
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        pairs = list(zip(target.elts, value.elts, strict=False))
    for name, given in pairs:
        if isinstance(name, ast.Name) and _is_followed(given, followed):
            followed.add(name.id)
