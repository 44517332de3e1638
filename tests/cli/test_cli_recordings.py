"""Recordings of other people's making on the command line: broken ones in one sentence, real ones
to the end."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import mistake

from ergoqp.human import Body
from ergoqp.human.person_file import given_person
from ergoqp.mocap.naming import centres_of

BROKEN = ["empty", "text", "truncated", "cut", "still", "no_frames", "huge", "nan", "spider"]


def broken_files(demo: Path) -> dict[str, str]:
    text = demo.read_text(encoding="utf-8")
    head, frames = text.split("MOTION", 1)
    lines = frames.splitlines()
    values = lines[3].split()
    return {
        "empty": "",
        "text": "Dear diary,\ntoday nothing moved.\n",
        "truncated": text[: len(head) // 2],
        "cut": text[: len(text) - len(text) // 3],
        "still": head,
        "no_frames": head + "MOTION\nFrames: 0\nFrame Time: 0.033\n",
        "huge": head + f"MOTION\nFrames: 999999999999\n{lines[2]}\n{lines[3]}\n",
        "nan": head + f"MOTION\nFrames: 1\n{lines[2]}\n{' '.join(['nan', *values[1:]])}\n",
        "spider": re.sub(
            r"(ROOT|JOINT) (\w+)", lambda found: f"{found[1]} leg_{found.start()}", text
        ),
    }


class TestBrokenRecordings:
    @pytest.mark.parametrize("name", BROKEN)
    @pytest.mark.parametrize("command", [("score",), ("run", "screwing", "--from")])
    def test_one_sentence(self, ergoqp, demo, tmp_path, name, command):
        (tmp_path / f"{name}.bvh").write_text(broken_files(demo)[name], encoding="utf-8")
        assert f"{name}.bvh" in mistake(ergoqp(*command, f"{name}.bvh"))
        # Names that nobody knows are written down, for their user to map.
        written = [path.name for path in tmp_path.glob("ergoqp-out/*/*")]
        assert written == (["mapping.toml"] if (name, command[0]) == ("spider", "score") else [])

    @pytest.mark.parametrize("command", [("score",), ("run", "screwing", "--from")])
    def test_no_file(self, ergoqp, tmp_path, command):
        assert "none.bvh" in mistake(ergoqp(*command, "none.bvh"))
        assert "no such file" in mistake(ergoqp(*command, "notes.txt"))
        (tmp_path / "folder.bvh").mkdir()
        assert "folder" in mistake(ergoqp(*command, "folder.bvh"))
        assert "folder" in mistake(ergoqp(*command, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["cmu_131_01_walk_max", "cmu_62_04_screwing_keyframes", "toolbox_freebvh", "xsens_motionbox"],
)
def test_score_shared_recordings(ergoqp, shared, name):
    outcome = ergoqp("score", shared / "mocap" / "bvh" / f"{name}.bvh")
    assert outcome.status == 0, outcome.err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cmu_62_04_screwing_keyframes", "xsens_motionbox"])
def test_run_from_shared_recordings(ergoqp, shared, name):
    outcome = ergoqp(
        "run", "screwing", "--from", shared / "mocap" / "bvh" / f"{name}.bvh", "--duration", "2"
    )
    assert outcome.status == 0, outcome.err
    assert "starts at the worst-scored frame" in outcome.out


class TestOptions:
    """What a file does not say, said on the command line."""

    def table(self, path, header=True):
        pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (90, 1))
        centres = centres_of(Body(), pelvis, np.zeros((90, 32)))
        names = list(centres)
        rows = np.stack(list(centres.values()), axis=1).reshape(90, -1)
        head = " ".join(f"{name}.{axis}" for name in names for axis in "xyz")
        np.savetxt(path, rows, "%.5f", header=head if header else "", comments="")
        return names

    def test_a_table_without_names_and_times(self, ergoqp, tmp_path):
        names = self.table(tmp_path / "take.txt", header=False)
        assert "(columns)" in mistake(ergoqp("score", "take.txt"))
        columns = ("--columns", ",".join(names))
        assert "(rate)" in mistake(ergoqp("score", "take.txt", *columns))
        outcome = ergoqp("score", "take.txt", *columns, "--rate", "30")
        assert outcome.status == 0, outcome.err
        assert "There are 30 frames per second, as stated." in outcome.out
        assert "rate: got -1" in mistake(ergoqp("score", "take.txt", *columns, "--rate", "-1"))

    def test_names_that_nobody_knows(self, ergoqp, tmp_path):
        self.table(tmp_path / "take.csv")
        text = (tmp_path / "take.csv").read_text()
        head, rows = text.split("\n", 1)
        head = head.replace("right_", "R_x").replace("left_", "L_x").replace("neck", "hals9")
        (tmp_path / "take.csv").write_text(f"{head}\n{rows}")
        said = mistake(ergoqp("score", "take.csv", "--rate", "30", "--out", "out"))
        assert "mapping.toml" in said
        written = (tmp_path / "out" / "mapping.toml").read_text()
        assert 'pelvis = "pelvis"' in written
        assert '# neck = ""' in written
        # It is not written over when it is handed back and lacks what is needed.
        (tmp_path / "out" / "mapping.toml").write_text('pelvis = "pelvis"\n')
        handed = ("--rate", "30", "--out", "out", "--mapping", "out/mapping.toml")
        said = mistake(ergoqp("score", "take.csv", *handed))
        assert "the upper trunk cannot be placed" in said
        assert said.endswith('with lines such as neck = "theirs" (mapping)')
        assert (tmp_path / "out" / "mapping.toml").read_text() == 'pelvis = "pelvis"\n'

    def test_two_people(self, ergoqp, tmp_path):
        self.table(tmp_path / "take.csv")
        head, *rows = (tmp_path / "take.csv").read_text().splitlines()
        both = [" ".join(f"{who}:{name}" for who in "AB" for name in head.split())]
        both += [f"{row} {row}" for row in rows]
        (tmp_path / "take.csv").write_text("\n".join(both) + "\n")
        said = mistake(ergoqp("score", "take.csv", "--rate", "30"))
        assert "got 2 people (A, B)" in said
        outcome = ergoqp("score", "take.csv", "--rate", "30", "--subject", "B")
        assert outcome.status == 0, outcome.err
        assert "The person is 'B'." in outcome.out
        assert "got 'C'" in mistake(ergoqp("score", "take.csv", "--rate", "30", "--subject", "C"))

    def test_a_person_that_is_kept(self, ergoqp, tmp_path):
        self.table(tmp_path / "take.csv")
        outcome = ergoqp("score", "take.csv", "--rate", "30", "--save-person", "anna.toml")
        assert outcome.status == 0, outcome.err
        assert given_person(tmp_path / "anna.toml").stature == pytest.approx(1.75, abs=1e-3)
        assert ergoqp("score", "take.csv", "--rate", "30", "--person", "anna.toml").status == 0

    @pytest.mark.parametrize("option", ["--subject", "--thing", "--columns", "--rate", "--trust"])
    def test_options_of_recordings_need_one(self, ergoqp, option):
        assert f"{option}: got" in mistake(ergoqp("run", "screwing", option, "30"))

    def test_sides_that_are_trusted(self, ergoqp, tmp_path):
        self.table(tmp_path / "take.csv")
        head, rows = (tmp_path / "take.csv").read_text().split("\n", 1)
        turned = {"right_": "left_", "left_": "right_"}
        head = re.sub("right_|left_", lambda side: turned[side[0]], head)
        (tmp_path / "take.csv").write_text(f"{head}\n{rows}")
        assert "(trust sides)" in mistake(ergoqp("score", "take.csv", "--rate", "30"))
        outcome = ergoqp("score", "take.csv", "--rate", "30", "--trust", "names, sides")
        assert outcome.status == 0, outcome.err
        assert "are taken as named, as stated, although" in " ".join(outcome.out.split())
        said = mistake(ergoqp("score", "take.csv", "--rate", "30", "--trust", "side"))
        assert "trust: got ('side',), allowed a list of names, sides, angles" in said

    def test_a_thing_that_is_not_there(self, ergoqp, tmp_path):
        self.table(tmp_path / "take.csv")
        said = mistake(ergoqp("score", "take.csv", "--rate", "30", "--thing", "box"))
        assert "thing: got 'box', allowed None: the recording has no object" in said
