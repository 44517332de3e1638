"""Every public name says what a reader of its page needs, and its examples are run."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

import ergoqp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))

from public_names import NAMES, docstring_of, found  # noqa: E402

NUMBERS = re.compile(r"\bfloat\b|ndarray|ArrayLike|NDArray|\bArray\b")
"""Annotations of what has a unit."""
ARRAYS = re.compile(r"ndarray|ArrayLike|NDArray|\bArray\b")
"""Annotations of what has a shape."""
UNIT = re.compile(
    r"\[[^\]]+\]|\bdimensionless\b|\bshares?\b|\bflags?\b|\bunits?\b|\bbool\b|\bas (?:in|there)\b"
)
"""A unit in brackets, words of what has none, or a reference to where it is said."""
SHAPE = re.compile(
    r"\((?:[\w ]+,|[\w ]+(?:, [\w ]+)+)\)|\bof any shape\b|\bshapes\b|\bas (?:in|there)\b"
)
"""A shape such as ``(32,)`` or ``(n, 3)``."""
MADE_BY_THE_PACKAGE = {"ergoqp.Step"}
"""Classes whose constructor is nobody else's."""
ERRORS = {
    name
    for name, value in vars(ergoqp.errors).items()
    if inspect.isclass(value) and issubclass(value, Exception)
}
CHECKS = re.compile(r"\b(?:check_\w+|read_array|numbers_of|names_of|flag|path_of|sentences)\(")
"""Calls of `ergoqp.arguments` that raise an error of the package."""


def _own_members(value: type) -> Iterator[tuple[str, Any]]:
    for name, member in vars(value).items():
        if not name.startswith("_"):
            yield name, member


def _function(member: Any) -> Any:
    if isinstance(member, property):
        return member.fget
    if isinstance(member, cached_property):
        return member.func
    return getattr(member, "__func__", member)


def _entries(text: str) -> dict[str, str]:
    """Return what the sections ``Args`` and ``Attributes`` of a docstring say of each name."""
    entries: dict[str, str] = {}
    section = last = ""
    for line in text.splitlines():
        if re.fullmatch(r"\w+:", line):
            section = line[:-1]
        elif section in ("Args", "Attributes"):
            if entry := re.match(r"    \*{0,2}(\w+): (.*)", line):
                last = entry[1]
                entries[last] = entry[2]
            elif last and line.startswith("        "):
                entries[last] += " " + line.strip()
    return entries


def _annotations(value: Any) -> dict[str, str]:
    """Return the annotations of what a caller hands over."""
    if isinstance(value, type):
        fields = getattr(value, "__dataclass_fields__", None)
        if fields is not None:
            return {k: str(f.type) for k, f in fields.items() if not k.startswith("_")}
        value = value.__init__
    if not inspect.isfunction(value):
        return {}
    return {k: str(v) for k, v in value.__annotations__.items() if k not in ("return", "self")}


def _raised(function: Any) -> set[str]:
    """Return the package's errors that a function raises by itself."""
    if not inspect.isfunction(function) or function.__code__.co_filename == "<string>":
        return set()  # a dataclass's own constructor has no text
    text = textwrap.dedent(inspect.getsource(function))
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            names.add(getattr(node.exc.func, "id", ""))
    names &= ERRORS
    if not names and CHECKS.search(text):
        names = {"InputError"} if "ModelError" not in text else {"ModelError"}
    return names


def _told(name: str) -> list[str]:
    """Return what is missing on the page of a public name, in words."""
    value, text = found(name), docstring_of(name)
    missing = [] if text else ["has no docstring"]
    if ">>>" not in text:
        missing.append("has no example")
    if not (isinstance(value, type) or inspect.isfunction(value)):
        return missing
    full = text + "\n" + (inspect.getdoc(value.__init__) or "" if isinstance(value, type) else "")
    if name not in MADE_BY_THE_PACKAGE:
        missing += _untold(name, full, _annotations(value))
    makers = (
        [value]
        if inspect.isfunction(value)
        else [vars(value).get(maker) for maker in ("__init__", "__post_init__")]
    )
    for maker in makers:
        missing += _unnamed(name, full, maker)
    for member_name, member in _own_members(value) if isinstance(value, type) else ():
        function = _function(member)
        if not inspect.isfunction(function):
            continue
        where, doc = f"{name}.{member_name}", inspect.getdoc(member) or ""
        missing += [] if doc else [f"{where} has no docstring"]
        missing += _unnamed(where, doc, function)
        if "Args:" in doc:
            missing += _untold(where, doc, _annotations(function))
        elif ARRAYS.search(str(function.__annotations__)) and not SHAPE.search(doc):
            missing.append(f"{where} says no shape")
    return missing


def _untold(where: str, text: str, annotations: dict[str, str]) -> Iterator[str]:
    entries = _entries(text)
    for name, annotation in annotations.items():
        if not NUMBERS.search(annotation) or "Callable" in annotation:
            continue
        said = entries.get(name)
        if said is None:
            yield f"{where} says nothing of {name}"
            continue
        if not UNIT.search(said):
            yield f"{where} says no unit of {name}"
        if ARRAYS.search(annotation) and not SHAPE.search(said) and "dict" not in annotation:
            yield f"{where} says no shape of {name}"


def _unnamed(where: str, text: str, function: Any) -> Iterator[str]:
    for error in _raised(function):
        raised = text.partition("Raises:")[2]
        if error not in raised and "rror" not in raised:
            yield f"{where} does not name {error}"


@pytest.mark.parametrize("name", NAMES)
def test_what_a_page_says(name: str) -> None:
    missing = _told(name)
    assert not missing, "\n".join(missing)


def test_all_of_the_package_is_public() -> None:
    modules = {"__version__", "errors", "reba"}
    assert {f"ergoqp.{name}" for name in set(ergoqp.__all__) - modules} <= set(NAMES)
    assert {f"ergoqp.errors.{name}" for name in ERRORS} <= set(NAMES)
    assert {f"ergoqp.reba.{name}" for name in ergoqp.reba.__all__} <= set(NAMES)
    assert len(set(NAMES)) == len(NAMES)


def test_pages_import_public_names() -> None:
    public = {id(found(name)) for name in NAMES} | {id(ergoqp.reba), id(ergoqp.errors)}
    imported = re.compile(r"^from (ergoqp(?:\.\w+)*) import (.+)$", re.MULTILINE)
    pages = (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))
    unknown = [
        f"{page.name}: {module}.{name}"
        for page in pages
        for module, names in imported.findall(page.read_text(encoding="utf-8"))
        for name in names.split(", ")
        if id(getattr(importlib.import_module(module), name)) not in public
    ]
    assert not unknown


def _with_examples() -> list[str]:
    """Return the modules of the package with examples, and the public constants with one."""
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted((ROOT / "ergoqp").rglob("*.py"))
        if ">>> " in path.read_text(encoding="utf-8")
    ]
    constants = [name for name in NAMES if not callable(found(name))]
    return [*modules, *constants]


@pytest.mark.slow
@pytest.mark.parametrize("name", _with_examples())
def test_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if name in NAMES:
        text = docstring_of(name)
        tests = [doctest.DocTestParser().get_doctest(text, {}, name, None, 0)]
    else:
        module = importlib.import_module(name)
        tests = [
            test
            for test in doctest.DocTestFinder(recurse=True).find(module, extraglobs={})
            if test.examples
        ]
    runner, said = doctest.DocTestRunner(), []
    for test in tests:
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
