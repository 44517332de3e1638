"""What is kept in the user's cache is found again whole, or not at all."""

import numpy as np
import pytest

from ergoqp.files.cache import CacheEntry, digest_of


@pytest.fixture
def entry(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return CacheEntry("kind", digest_of({"n": 1, "of": np.arange(3)}))


def test_found_again(entry, tmp_path):
    assert entry.read(("a",)) is None
    entry.write(a=np.arange(3.0), b="text")
    assert entry.path.is_relative_to(tmp_path / "ergoqp" / "kind")
    kept = entry.read(("a", "b"))
    assert kept is not None
    np.testing.assert_array_equal(kept["a"], np.arange(3.0))
    assert str(kept["b"]) == "text"
    assert entry.read(("a", "missing")) is None


def test_half_a_file_is_none(entry):
    entry.write(a=np.arange(3.0))
    entry.path.write_bytes(entry.path.read_bytes()[:-30])
    assert entry.read(("a",)) is None


def test_nowhere_to_write_is_no_cache(entry, tmp_path):
    (tmp_path / "ergoqp").write_text("a file", encoding="utf-8")
    entry.write(a=np.arange(3.0))
    assert entry.read(("a",)) is None


def test_the_digest_tells_contents_apart():
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})
    assert digest_of([0.1]) == digest_of(np.array([0.1])) != digest_of([0.2])
