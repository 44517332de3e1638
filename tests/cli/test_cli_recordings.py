"""Recordings of other people's making on the command line: broken ones in one sentence, real ones
to the end."""

import re
from pathlib import Path

import pytest
from command_line import mistake

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
        assert "got no file" in mistake(ergoqp(*command, "notes.txt"))
        (tmp_path / "folder.bvh").mkdir()
        assert "folder" in mistake(ergoqp(*command, "folder.bvh"))
        assert "folder" in mistake(ergoqp(*command, tmp_path))


@pytest.mark.parametrize(
    "name",
    ["cmu_131_01_walk_max", "cmu_62_04_screwing_keyframes", "toolbox_freebvh", "xsens_motionbox"],
)
def test_score_shared_recordings(ergoqp, shared, name):
    outcome = ergoqp("score", shared / "mocap" / "bvh" / f"{name}.bvh")
    assert outcome.status == 0, outcome.err


@pytest.mark.parametrize("name", ["cmu_62_04_screwing_keyframes", "xsens_motionbox"])
def test_run_from_shared_recordings(ergoqp, shared, name):
    outcome = ergoqp(
        "run", "screwing", "--from", shared / "mocap" / "bvh" / f"{name}.bvh", "--duration", "2"
    )
    assert outcome.status == 0, outcome.err
    assert "starts at the worst-scored frame" in outcome.out
