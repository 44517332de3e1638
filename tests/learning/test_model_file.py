"""Model files: what was saved comes back, and anything else is refused in one sentence."""

import json
import zipfile

import numpy as np
import pytest

from ergoqp.costs.load import load_cost
from ergoqp.costs.quadratic import Quadratic
from ergoqp.errors import ModelError
from ergoqp.learning.model_file import FORMAT, load_model, save_model

HEADER = {"kind": "quadratic", "notes": {"made": "by a test"}}
ARRAYS = {"slopes": np.linspace(0, 1, 50), "whole": np.arange(6).reshape(2, 3)}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "model.npz"
    save_model(path, HEADER, ARRAYS)
    return path


def one_sentence(error):
    text = str(error.value)
    assert text.startswith("model.npz: ")
    assert "\n" not in text
    assert len(text) < 160


def test_comes_back_as_it_was(path):
    header, arrays = load_model(path)
    assert header == HEADER
    assert arrays.keys() == ARRAYS.keys()
    for name, values in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], values)
        assert arrays[name].dtype == values.dtype


def test_a_cut_file_is_refused_wherever_it_was_cut(path):
    whole = path.read_bytes()
    for length in (0, 1, 30, len(whole) // 2, len(whole) - 30, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(
            ModelError, match=r"is no \.npz file|not a model file|cannot be read"
        ) as error:
            load_model(path)
        one_sentence(error)


def test_a_changed_byte_never_goes_unnoticed(path):
    whole = path.read_bytes()
    for place in range(0, len(whole), 3):
        changed = bytearray(whole)
        changed[place] ^= 0x01 if place % 2 else 0xFF
        path.write_bytes(changed)
        try:
            header, arrays = load_model(path)
        except ModelError:
            continue
        # Some bytes of the zip, like the time of day, mean nothing.
        assert header == HEADER
        for name, values in ARRAYS.items():
            np.testing.assert_array_equal(arrays[name], values)


def rewrite(path, change):
    """Change the entries of a file, as somebody would who knows its form but not the checksum."""
    with np.load(path) as file:
        entries = {name: file[name] for name in file.files}
    header = json.loads(entries["header"].tobytes())
    change(header, entries)
    entries["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez_compressed(path, **entries)


@pytest.mark.parametrize(
    "change",
    [
        lambda header, entries: entries["slopes"].__setitem__(7, 1.5),
        lambda header, entries: header["notes"].update(made="by someone else"),
        lambda header, entries: entries.pop("whole"),
        lambda header, entries: entries.update(more=np.zeros(2)),
        lambda header, entries: entries.update(slopes=entries["slopes"].astype(np.float32)),
        lambda header, entries: entries.update(whole=entries["whole"].reshape(3, 2)),
    ],
    ids=["number", "header", "less", "more", "type", "shape"],
)
def test_the_checksum_covers_everything(path, change):
    rewrite(path, change)
    with pytest.raises(ModelError, match="was changed after it was saved") as error:
        load_model(path)
    one_sentence(error)


def test_other_files_are_refused(path):
    rewrite(path, lambda header, entries: header.update(format="another"))
    with pytest.raises(ModelError, match=f"another format; {FORMAT}"):
        load_model(path)
    for content in (b"some text\n", b"\x93NUMPY\x01\x00"):
        path.write_bytes(content)
        with pytest.raises(ModelError, match=r"no \.npz file|allowed only with header"):
            load_model(path)
    np.savez(path, slopes=np.zeros(3))
    with pytest.raises(ModelError, match=r"no \.npz file|allowed only with header"):
        load_model(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "hello")
    with pytest.raises(ModelError, match=r"no \.npz file|allowed only with header"):
        load_model(path)


def test_pickled_objects_are_not_read(path):
    np.savez(path, header=np.array([{"format": FORMAT}], dtype=object))
    with pytest.raises(ModelError, match=r"no \.npz file|allowed only with header"):
        load_model(path)


def test_a_missing_file_and_a_folder_are_named(path, tmp_path):
    path.unlink()
    with pytest.raises(ModelError, match=r"no such file") as error:
        load_model(path)
    one_sentence(error)
    path.mkdir()
    with pytest.raises(ModelError, match="is no file"):
        load_model(path)


def test_other_kinds_are_named(path):
    save_model(path, {"kind": "boundary"}, ARRAYS)
    with pytest.raises(ModelError, match="holds a model of kind 'boundary', allowed quadratic, "):
        load_cost(path)


def test_a_model_that_lacks_a_part_is_refused(path):
    header = {
        "kind": "quadratic",
        "coordinates": ["trunk_flexion"],
        "minimum": 1.0,
        "settings": {"constant": 1.0},
    }
    save_model(path, header, {"slopes": np.zeros(1)})
    with pytest.raises(
        ModelError, match=r"does not hold what a model of kind 'quadratic' needs .*curvatures"
    ):
        load_cost(path)
    save_model(path, header, {"slopes": np.zeros(2), "curvatures": np.zeros(2)})
    with pytest.raises(ModelError, match=r"quadratic: got slopes and curvatures of shapes"):
        load_cost(path)


def test_nothing_is_left_half_written(path, tmp_path, monkeypatch):
    before = path.read_bytes()

    def fail(file, **entries):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    cost = Quadratic(1.0, np.zeros(1), np.zeros(1), ["trunk_flexion"], 1.0)
    with pytest.raises(ModelError, match=r"model\.npz: cannot be written: No space left on device"):
        cost.save(path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["model.npz"]
    with pytest.raises(ModelError, match="cannot be written"):
        cost.save(tmp_path / "no_such_folder" / "model.npz")
