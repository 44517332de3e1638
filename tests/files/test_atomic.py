"""Files that are written are there whole or not at all."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ergoqp.files.atomic import atomic_directory, atomic_write, write_text_atomic


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """No file can grow beyond so many bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_is_written_takes_the_place_of_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("before")
    with atomic_write(path) as scratch:
        assert scratch.suffix == ".html"
        scratch.write_text("after")
        assert path.read_text() == "before"
    write_text_atomic(tmp_path / "link", "x" * 10)
    assert [each.name for each in sorted(tmp_path.iterdir())] == ["link", "page.html"]
    assert path.read_text() == "after"


def test_what_a_link_leads_to_is_written(tmp_path: Path) -> None:
    link = tmp_path / "link.json"
    link.symlink_to(tmp_path / "real.json")
    write_text_atomic(link, "new")
    assert link.is_symlink()
    assert (tmp_path / "real.json").read_text() == "new"


def test_on_a_full_disk_nothing_is_left_and_what_was_there_stays(tmp_path: Path) -> None:
    path, numbers = tmp_path / "run.json", tmp_path / "run.npz"
    path.write_text("before")
    with room_for(1000):
        with pytest.raises(OSError, match="too large") as told:
            write_text_atomic(path, "x" * 5000)
        with pytest.raises(OSError, match=r"run\.npz"), atomic_write(numbers) as scratch:
            np.savez(scratch, values=np.zeros(1000))
    assert told.value.filename == str(path)
    assert [each.name for each in tmp_path.iterdir()] == ["run.json"]
    assert path.read_text() == "before"


def test_a_folder_that_is_not_there_is_told_by_the_name_that_was_meant(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as told:
        write_text_atomic(tmp_path / "none" / "a.json", "x")
    assert told.value.filename == str(tmp_path / "none" / "a.json")


def test_what_ends_the_writing_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with atomic_write(tmp_path / "a.txt") as scratch:
            scratch.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_is_filled_whole_or_not_at_all(tmp_path: Path, there: bool) -> None:
    folder = tmp_path / "export"

    def fill(text: str, size: int) -> None:
        with atomic_directory(folder) as scratch:
            (scratch / "src").mkdir()
            (scratch / "README").write_text(text)
            (scratch / "src" / "step.c").write_text("x" * size)

    def found() -> list[str]:
        return sorted(
            str(each.relative_to(tmp_path)) for each in tmp_path.rglob("*") if each.is_file()
        )

    if there:
        folder.mkdir()
        (folder / "README").write_text("before")
        (folder / "mine").write_text("kept")
    before = found()
    with room_for(1000), pytest.raises(OSError, match="too large") as told:
        fill("after", 5000)
    assert told.value.filename == str(folder)
    assert found() == before
    fill("after", 500)
    mine = ["export/mine"] if there else []
    assert found() == ["export/README", *mine, "export/src/step.c"]
    assert (folder / "README").read_text() == "after"


def test_what_stands_in_the_way_is_named_before_anything_is_changed(tmp_path: Path) -> None:
    folder = tmp_path / "export"
    (folder / "src" / "step.c").mkdir(parents=True)
    (folder / "README").write_text("before")

    def fill() -> None:
        with atomic_directory(folder) as scratch:
            (scratch / "src").mkdir()
            (scratch / "README").write_text("after")
            (scratch / "src" / "step.c").write_text("x")

    with pytest.raises(OSError, match="File exists") as told:
        fill()
    assert str(told.value.filename) == str(folder / "src" / "step.c")
    assert (folder / "README").read_text() == "before"
    assert sorted(each.name for each in folder.iterdir()) == ["README", "src"]


def test_a_folder_that_is_there_is_filled_from_within(tmp_path: Path) -> None:
    """It may be a disk of its own, from which nothing can be moved in one go, in a folder that
    cannot be written."""
    folder = tmp_path / "mounted"
    folder.mkdir()
    with atomic_directory(folder) as scratch:
        assert scratch.parent == folder
        (scratch / "step.c").write_text("x")
    assert [each.name for each in folder.iterdir()] == ["step.c"]


def test_many_threads_write_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda number: write_text_atomic(path, f"{number}" * 1000), range(10, 99)))
    assert len(set(path.read_text()[i : i + 2] for i in range(0, 2000, 2))) == 1
    assert [each.name for each in tmp_path.iterdir()] == ["run.json"]
