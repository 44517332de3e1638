"""The order of bodies' quaternions is found, and those that are none are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_files import BODY, folder_of, read

from ergoqp.mocap.formats.bodies import read_bodies

POSED = "The quaternions are taken as "


def table(places: np.ndarray, turns: np.ndarray, head: str = "x,y,z,q0,q1,q2,q3") -> str:
    rows = [",".join(map(str, row)) for row in np.hstack([places, turns])]
    return "\n".join([head, *rows, ""])


def arm(order: list[int], generator: np.random.Generator, **lost: slice) -> dict[str, str]:
    """Tables of an upper arm, and of a forearm that hinges on it."""
    upper, hinge = Rotation.random(50, rng=generator), Rotation.random(50, rng=generator)
    place = generator.normal(size=(50, 3))
    below = place + upper.apply([0, 0, -0.3])
    turns = {"upper": upper.as_quat()[:, order], "fore": hinge.as_quat()[:, order]}
    for name, frames in lost.items():
        turns[name][frames] = 0
    return {"upper": table(place, turns["upper"]), "fore": table(below, turns["fore"])}


@pytest.mark.parametrize(
    ("order", "said"), [([0, 1, 2, 3], "x, y, z, w"), ([3, 0, 1, 2], "w, x, y, z")]
)
@pytest.mark.parametrize("lost", [{}, {"upper": slice(20)}, {"fore": slice(None)}])
def test_the_order_of_quaternions_is_found(
    order: list[int], said: str, lost: dict[str, slice], tmp_path: Path
) -> None:
    files = arm(order, np.random.default_rng(4), **lost)
    motion = read(read_bodies, folder_of(tmp_path, **files), rate=10)
    assert any(note.startswith(f"{POSED}{said}: a bone's neighbour") for note in motion.notes)
    upper = Rotation.random(50, rng=np.random.default_rng(4)).as_quat()
    seen = slice(20, None) if "upper" in lost else slice(None)
    assert motion.turns["upper"][seen] == pytest.approx(upper[seen], abs=1e-6)
    for name, frames in lost.items():
        assert np.isnan(motion.turns[name][frames]).all()
        assert np.isnan(motion.objects[name][frames, :3, :3]).all()


def test_bodies_that_do_not_turn_do_not_tell_their_order(tmp_path: Path) -> None:
    still = "x,y,z,q0,q1,q2,q3\n" + "1,2,3,0,0,0.6,0.8\n" * 9
    folder = folder_of(tmp_path, a=still, b=still.replace("1,2", "5,2"), c=still)
    motion = read(read_bodies, folder, rate=10)
    assert motion.notes[1] == (
        f"{POSED}x, y, z, w, because the movement does not show their order: with either order, a"
        " bone's neighbour moves in its axes by about 0 mm (if the file's unit is a metre)."
    )


def test_somebody_at_the_same_place_does_not_tell_the_order(tmp_path: Path) -> None:
    files = arm([3, 0, 1, 2], np.random.default_rng(4))
    files |= {f"{name} again": content for name, content in files.items()}
    motion = read(read_bodies, folder_of(tmp_path, **files), rate=10)
    assert motion.notes[1].startswith(f"{POSED}w, x, y, z: a bone's neighbour")


def test_each_table_may_tell_its_order(tmp_path: Path) -> None:
    last, first = (
        BODY.replace("q0,q1,q2,q3", "qx,qy,qz,qw"),
        "x,y,z,qw,qx,qy,qz\n1,2,3,0.8,0,0,.6\n",
    )
    rows = first + "1,2,3,1,0,0,0\n" * 2
    motion = read(read_bodies, folder_of(tmp_path, a=last, b=rows), rate=10)
    assert motion.turns["a"][1] == pytest.approx([0, 0, 0.6, 0.8])
    assert motion.turns["b"][0] == pytest.approx([0, 0, 0.6, 0.8])
    assert not any(note.startswith(POSED) for note in motion.notes)
    files = arm([3, 0, 1, 2], np.random.default_rng(4))
    fore = files["fore"].replace("q0,q1,q2,q3", "qw,qx,qy,qz")
    (tmp_path / "other").mkdir()
    folder = folder_of(tmp_path / "other", upper=files["upper"], fore=fore)
    motion = read(read_bodies, folder, rate=10)
    upper = Rotation.random(50, rng=np.random.default_rng(4)).as_quat()
    assert motion.turns["upper"] == pytest.approx(upper, abs=1e-6)


def test_one_body_does_not_tell_its_order(tmp_path: Path) -> None:
    motion = read(read_bodies, folder_of(tmp_path, box=BODY), rate=10)
    assert motion.notes[1] == (f"{POSED}x, y, z, w, because one body does not show their order.")


@pytest.mark.parametrize("number", ["1e30", "5", "0.2"])
def test_what_is_no_unit_quaternion_is_not_seen(number: str, tmp_path: Path) -> None:
    content = BODY.replace("1,2,3,0,0,0,1", f"1,2,3,0,0,0,{number}")
    motion = read(read_bodies, folder_of(tmp_path, a=content, b=BODY), rate=10)
    np.testing.assert_array_equal(np.isnan(motion.turns["a"][:, 0]), [True, False, True])
    assert motion.notes[2] == (
        f"Quaternions whose length is not 1 are not read: of a (2 of 3, {float(number):.3g} in the"
        " median)."
    )
