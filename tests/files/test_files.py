"""Files that anybody may have made: read, or refused in one sentence, and never at the price that
they claim."""

from __future__ import annotations

import os
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ergoqp.costs.load import load_cost
from ergoqp.errors import ErgoqpError, InputError, ModelError
from ergoqp.files.read import LARGEST, json_of, read_json, read_npz, read_toml
from ergoqp.learning.model_file import load_model, save_model
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.load import load_problem
from ergoqp.registry import data_folder


def npy(shape: str, data: bytes, kind: str = "<f8") -> bytes:
    """An array file with a header of one's own."""
    head = (
        f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode()
        + b"\n"
    )
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


def packed(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in entries.items():
            file.writestr(f"{name}.npy", data)
    return path


@pytest.mark.parametrize(
    "shape", ["(10000000000000,)", "(3, 10000000000)", "(-5,)", "(9223372036854775807, 2)"]
)
def test_an_array_that_claims_more_than_it_holds_is_refused_before_anything_is_allocated(
    tmp_path: Path, shape: str
) -> None:
    path = packed(tmp_path / "model.npz", header=npy(shape, b"\x00" * 80))
    tracemalloc.start()
    with pytest.raises(
        ModelError, match=r"model\.npz: is no \.npz file of numbers, or only a part of one"
    ):
        read_npz(path)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_a_file_that_unpacks_to_gigabytes_is_refused_by_its_directory(tmp_path: Path) -> None:
    path = packed(tmp_path / "model.npz", header=npy("(1,)", b"\x00" * 8))
    with zipfile.ZipFile(path, "a") as file:
        for number in range(3):
            file.writestr(f"w{number}.npy", b"")
    content = bytearray(path.read_bytes())
    # The directory says so; nothing of it is there.
    at = content.index(b"PK\x01\x02")
    content[at + 24 : at + 28] = (LARGEST + 1).to_bytes(4, "little")
    path.write_bytes(bytes(content))
    with pytest.raises(
        ModelError, match=rf"model\.npz: got {LARGEST + 1} bytes of arrays, allowed {LARGEST}"
    ):
        read_npz(path)


def test_what_was_saved_comes_back(tmp_path: Path) -> None:
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.asfortranarray(np.eye(3)),
        "c": np.array(["x", "yz"]),
        "d": np.array(3),
    }
    np.savez(tmp_path / "some.npz", **arrays)
    read = read_npz(tmp_path / "some.npz", ["a"])
    assert set(read) == set(arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(read[name], values)
    with pytest.raises(ModelError, match=r"some\.npz: got a, b, c, d, allowed only with e"):
        read_npz(tmp_path / "some.npz", ["e"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neural_sheet", "forearm_svr", "forearm_ladder"])
def test_models_with_a_part_that_is_none_or_missing_are_refused(tmp_path: Path, name: str) -> None:
    header, arrays = load_model(data_folder("models") / f"{name}.npz")
    for part in arrays:
        for broken in ("missing", "nan", "short"):
            values = dict(arrays)
            if broken == "missing":
                del values[part]
            elif broken == "nan":
                values[part] = np.full(arrays[part].shape, np.nan)
            else:
                values[part] = arrays[part][:-1] if arrays[part].ndim else np.zeros((2, 2))
            path = tmp_path / "model.npz"
            save_model(
                path, {key: value for key, value in header.items() if key != "format"}, values
            )
            with pytest.raises(ErgoqpError) as caught:
                load_cost(path)
            assert "\n" not in str(caught.value), (part, broken)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    for suffix, read in ((".npz", read_npz), (".toml", load_problem), (".json", Optimum.load)):
        path = tmp_path / f"pipe{suffix}"
        os.mkfifo(path)
        with pytest.raises(ErgoqpError):
            read(path)


def test_text_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    for content, said in (
        (b"{", "not JSON"),
        (b"\xff", "not text: byte 0"),
        (b"[" * 10**5, "lists within lists"),
        (b"NaN", "NaN"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=said):
            read_json(path, "optimum")
    path.write_bytes(b"\xef\xbb\xbf[1, Infinity]")
    assert read_json(path, "optimum") == [1, float("inf")]
    with pytest.raises(InputError, match=r"problem: file\.json: not a TOML file"):
        read_toml(path, "problem")
    assert json_of("1.5", "number") == 1.5


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 70])
def test_a_short_run_of_the_benchmark_finds_nothing_wrong(
    tmp_path: Path, first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The benchmark has a cache of its own.
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    files = pytest.importorskip(
        "benchmarks.files", reason="the benchmarks of the checkout are not importable here"
    )
    kinds = [make(tmp_path) for make in files.KINDS if make.__name__ != "optima"]
    for number in range(first, first + 70):
        rng = np.random.default_rng([number, 99])
        _, said, took, _, _ = files._read(kinds[number % len(kinds)], rng, tmp_path)
        assert said in ("", "said"), (number, said)
        assert took < 5


LONG_KEYS = {
    "plain": "a" + ".a" * 50_000 + " = 1",
    "spaced": "a" + " . a" * 50_000 + " = 1",
    "table": "x = 1\n[a" + ".a" * 50_000 + "]",
    "inline": "x = {a" + ".a" * 50_000 + " = 1}",
    "quoted": '"a b"' + '."a b"' * 20_000 + " = 1",
    "single": "'a b'" + ".'a b'" * 20_000 + " = 1",
}


@pytest.mark.parametrize("content", LONG_KEYS.values(), ids=LONG_KEYS)
def test_a_long_dotted_key_is_refused_at_once(tmp_path: Path, content: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(content)
    start = time.process_time()
    with pytest.raises(InputError, match=r"file.toml: got a key of more than 32 parts in line \d"):
        read_toml(path, "problem")
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    "content", ["a" * 900_000, "a " * 400_000, '"' * 900_000, "'\"" * 400_000, "-." * 400_000]
)
def test_the_search_for_long_keys_takes_no_time(tmp_path: Path, content: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(content)
    start = time.process_time()
    with pytest.raises(InputError):
        read_toml(path, "problem")
    assert time.process_time() - start < 2.0


def test_keys_and_texts_of_many_dots_are_read(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text("a" + ".b" * 31 + " = 1\nx = '" + "." * 200 + " 1.2.3. and so on. ' # ..... \n")
    assert read_toml(path, "problem")["x"].startswith("...")
