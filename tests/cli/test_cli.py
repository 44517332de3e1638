"""The command line as a user meets it: what it prints, what it writes, and what it says about
mistakes."""

import csv
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import mistake

from ergoqp import __version__
from ergoqp.problem.load import problem_names


def test_version(ergoqp):
    outcome = ergoqp("--version")
    assert (outcome.status, outcome.out) == (0, f"ergoqp {__version__}\n")


@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",)])
def test_help(ergoqp, arguments):
    outcome = ergoqp(*arguments)
    assert outcome.status == 0
    assert "Examples:\n    ergoqp run screwing\n" in outcome.out
    assert "run " in outcome.out
    assert "score " in outcome.out


def test_help_of_the_commands(ergoqp):
    run = ergoqp("run", "--help").out
    for option in (
        "--from",
        "--at",
        "--out",
        "--seed",
        "--duration",
        "--person",
        "--unit-to-m",
        "--up",
        "--mapping",
    ):
        assert option in run
    for name in {*problem_names()} - {"forearm"}:
        assert name in run
    score = ergoqp("score", "--help").out
    for option in (
        "--load-kg",
        "--coupling",
        "--activity",
        "--shock",
        "--seated",
        "--one-leg",
        "--arm-supported",
    ):
        assert option in score


def test_help_is_quick():
    """No CasADi, MuJoCo or viser for a help text."""
    code = (
        "import sys, ergoqp.cli.main; print([m for m in ('casadi', 'mujoco', 'viser', 'scipy') if m"
        " in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


class TestRun:
    @pytest.mark.slow
    def test_at_an_awkward_place(self, ergoqp, tmp_path):
        outcome = ergoqp("run", "screwing", "--duration", "3", "--seed", "1")
        assert outcome.status == 0, outcome.err
        folder = tmp_path / "ergoqp-out" / "screwing"
        assert {path.name for path in folder.iterdir()} == {"run.json", "run.npz", "report.html"}
        summary = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        assert (summary["problem"], summary["seed"], summary["steps"]) == ("screwing", 1, 300)
        assert "starts at the worst of 40 random places: REBA" in outcome.out
        stayed = summary["reba_standing_still"]
        said = " ".join(outcome.out.split())
        assert (
            f", {stayed} had the object stayed where it was." in said
            or f" ({stayed} had it stayed)." in said
        )
        assert f"report.html  {Path('ergoqp-out') / 'screwing' / 'report.html'}" in outcome.out
        assert "\x1b" not in outcome.out + outcome.err
        assert outcome.err.splitlines() == [
            "looking for an awkward place ...",
            "closed loop, 3 s ...",
            "report ...",
        ]

    @pytest.mark.slow
    def test_from_the_worst_frame(self, ergoqp, demo, tmp_path):
        outcome = ergoqp(
            "run", "screwing", "--from", demo, "--duration", "2", "--out", tmp_path / "here"
        )
        assert outcome.status == 0, outcome.err
        summary = json.loads((tmp_path / "here" / "run.json").read_text(encoding="utf-8"))
        assert summary["recording"] == "demo.bvh"
        assert (
            f"starts at the worst-scored frame, {round(30 * summary['start_time_s'])} of 0 to 180"
            in outcome.out
        )
        assert "which scores 9, and comes to rest at" in " ".join(outcome.out.split())
        assert summary["reba_before"] == summary["reba_standing_still"]
        assert summary["person"]["stature_m"] == pytest.approx(1.72, abs=0.01)
        assert "The unit of length is taken as 0.01 m" in outcome.out

    @pytest.mark.slow
    def test_at_a_time(self, ergoqp, demo, tmp_path):
        outcome = ergoqp(
            "run",
            "screwing",
            "--from",
            demo,
            "--at",
            "0.21",
            "--duration",
            "0.5",
            "--out",
            tmp_path / "here",
        )
        assert outcome.status == 0, outcome.err
        summary = json.loads((tmp_path / "here" / "run.json").read_text(encoding="utf-8"))
        assert summary["start_time_s"] == pytest.approx(0.2)
        assert "starts at frame, 6 of 0 to 180" in outcome.out

    @pytest.mark.slow
    def test_what_the_recording_does_not_tell_is_seen_or_not(self, ergoqp, demo, tmp_path):
        text = Path(demo).read_text(encoding="utf-8").replace("nose", "extra")
        (tmp_path / "few.bvh").write_text(text, encoding="utf-8")
        arguments = ("run", "screwing", "--from", "few.bvh", "--duration", "0.2", "--out", "o")
        for option, unobserved in (((), []), (("--as-seen",), ["neck_twist"])):
            outcome = ergoqp(*arguments, *option)
            assert outcome.status == 0, outcome.err
            summary = json.loads((tmp_path / "o" / "run.json").read_text(encoding="utf-8"))
            assert list(summary["unobserved"]) == unobserved
        assert "--as-seen: got it" in mistake(ergoqp("run", "screwing", "--as-seen"))

    @pytest.mark.slow
    def test_problem_from_a_file(self, ergoqp, tmp_path):
        (tmp_path / "mine.toml").write_text(
            'title = "my own task"\n[response.ik]\nstance = "seated"\nhands = ["right"]\n'
            "[limits.workspace]\nlower = [0.3, -0.3, 0.6]\nupper = [0.6, 0.1, 1.2]\n"
            "[limits.tool_axis]\ndirection = [1, 0, 0]\nhalf_angle_deg = 40\n",
            encoding="utf-8",
        )
        outcome = ergoqp("run", "mine.toml", "--duration", "0.5", "--person", "1.6")
        assert outcome.status == 0, outcome.err
        summary = json.loads(
            (tmp_path / "ergoqp-out" / "mine" / "run.json").read_text(encoding="utf-8")
        )
        assert summary["title"] == "my own task"
        assert summary["person"]["stature_m"] == pytest.approx(1.6)

    @pytest.mark.slow
    def test_same_seed_same_start(self, ergoqp, tmp_path):
        starts = []
        for folder in ("a", "b"):
            assert (
                ergoqp("run", "desk", "--duration", "0.2", "--seed", "7", "--out", folder).status
                == 0
            )
            with np.load(tmp_path / folder / "run.npz") as arrays:
                starts.append(arrays["postures"])
        np.testing.assert_array_equal(*starts)

    @pytest.mark.slow
    def test_without_the_report_extra(self, ergoqp, tmp_path, monkeypatch):
        page = tmp_path / "ergoqp-out" / "desk" / "report.html"
        page.parent.mkdir(parents=True)
        page.write_text("of another run", encoding="utf-8")
        monkeypatch.setitem(sys.modules, "jinja2", None)
        outcome = ergoqp("run", "desk", "--duration", "0.2")
        assert outcome.status == 0, outcome.err
        assert (
            "report.html was not written: the report page needs the package 'jinja2'" in outcome.err
        )
        assert "[report]'`" in outcome.err
        assert not page.exists()
        assert page.with_name("run.json").is_file()
        assert "by moving the object" in outcome.out

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("nonsense",), "problem: got 'nonsense', allowed dentist, desk"),
            (("missing.toml",), "'missing.toml': no such file"),
            ((".",), "a directory"),
            (("screwing", "--at", "1"), "--at: got 1 s, but there is no recording"),
            (("screwing", "--up", "z"), "--up: got 'z', but there is no recording"),
            (
                ("screwing", "--unit-to-m", "0.01"),
                "--unit-to-m: got '0.01', but there is no recording",
            ),
            (
                ("screwing", "--mapping", "names.toml"),
                "--mapping: got 'names.toml', but there is no recording",
            ),
            (("screwing", "--person", "nobody.toml"), "nobody.toml"),
            (("screwing", "--person", "3.1"), "stature: got 3.1"),
            (("screwing", "--person", "nan"), "stature: got nan"),
            (("screwing", "--duration", "0"), "duration: got 0"),
            (("screwing", "--duration", "nan"), "duration: got nan"),
            (("screwing", "--duration", "1e9"), "duration: got 1000000000.0 s, allowed"),
            (("screwing", "--seed", "-1"), "seed: got -1"),
            (("screwing", "--seed", "x"), "--seed"),
            (("screwing", "--bogus"), "--bogus"),
            (
                ("screwing", "--bias-deg", "right_knee_flexin=4"),
                "allowed NAME=VALUE with a NAME of joints such as right_knee_flexion",
            ),
            (
                ("screwing", "--bias-deg", "right_knee_flexion=x"),
                "allowed a number after right_knee_flexion=",
            ),
            (("screwing", "--robot", "lagg=0.1"), "with a NAME of lag (the nearest), "),
            ((), "PROBLEM"),
        ],
    )
    def test_mistakes(self, ergoqp, arguments, words):
        assert words in mistake(ergoqp("run", *arguments))

    @pytest.mark.parametrize("at", ["-1", "99", "nan", "inf"])
    def test_no_such_time(self, ergoqp, demo, at):
        words = mistake(ergoqp("run", "screwing", "--from", demo, "--at", at))
        assert words.endswith("allowed 0.00 to 6.00 s")

    def test_all_mistakes_of_a_file_at_once(self, ergoqp, tmp_path):
        (tmp_path / "bad.toml").write_text(
            '[response.ik]\nstance = "flying"\n[task]\nload_kg = -1\n', encoding="utf-8"
        )
        outcome = ergoqp("run", "bad.toml")
        assert outcome.status == 2
        assert "response.ik.stance" in outcome.err
        assert "task.load_kg" in outcome.err
        assert "Traceback" not in outcome.err

    def test_nowhere_to_write(self, ergoqp, tmp_path):
        (tmp_path / "taken").write_text("a file", encoding="utf-8")
        assert "--out: cannot write 'taken'" in mistake(
            ergoqp("run", "desk", "--duration", "0.1", "--out", "taken")
        )


class TestScore:
    @pytest.mark.slow
    def test_files_and_table(self, ergoqp, demo, tmp_path):
        outcome = ergoqp(
            "score", demo, "--load-kg", "6", "--coupling", "1", "--arm-supported", "both"
        )
        assert outcome.status == 0, outcome.err
        folder = tmp_path / "ergoqp-out" / "demo"
        assert {path.name for path in folder.iterdir()} == {
            "scores.csv",
            "scores.json",
            "angles.csv",
            "angles.mot",
            "report.html",
        }
        with (folder / "scores.csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == 181
        summary = json.loads((folder / "scores.json").read_text(encoding="utf-8"))
        assert summary["max"] == max(int(row["reba"]) for row in rows)
        assert any("load of 6 kg +1" in sentence for sentence in summary["worst"]["reasons"])
        assert "coupling +1" in outcome.out
        assert "scores.csv   " in outcome.out

    @pytest.mark.slow
    def test_options_change_the_score(self, ergoqp, demo, tmp_path):
        means = []
        for name, options in {
            "plain": (),
            "load": ("--load-kg", "12", "--shock"),
            "seated": ("--seated",),
        }.items():
            assert ergoqp("score", demo, "--out", name, *options).status == 0
            means.append(
                json.loads((tmp_path / name / "scores.json").read_text(encoding="utf-8"))["mean"]
            )
        assert means[1] > means[0] >= means[2]

    def test_frames_that_show_no_posture_are_not_scored(self, ergoqp, demo, tmp_path):
        lines = Path(demo).read_text(encoding="utf-8").splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
        # The trunk of some frames is bent further back than anybody's.
        names = [line.split()[1] for line in lines if line.split()[0] in ("ROOT", "JOINT")]
        assert names[0] == "pelvis"
        for i in range(first + 20, first + 40):
            values = lines[i].split()
            values[3:6] = [str(float(each) - 80) for each in values[3:6]]
            lines[i] = " ".join(values)
        (tmp_path / "odd.bvh").write_text("\n".join(lines), encoding="utf-8")
        outcome = ergoqp("score", "odd.bvh", "--out", "odd")
        assert outcome.status == 0, outcome.err
        assert "161 of 181 scored" in outcome.out
        assert "20 of 181 frames are not scored" in outcome.out
        summary = json.loads((tmp_path / "odd" / "scores.json").read_text(encoding="utf-8"))
        assert summary["valid_frames"] == 161
        assert 20 in summary["not_scored"].values()
        assert summary["doubts"]["trunk beyond its range"] == 20
        with (tmp_path / "odd" / "scores.csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert [row["valid"] for row in rows] == ["1"] * 20 + ["0"] * 20 + ["1"] * 141
        assert all(bool(row["not_scored"]) == (row["valid"] == "0") for row in rows)
        assert not 20 <= summary["worst"]["frame"] < 40

    @pytest.mark.slow
    def test_part_of_a_recording_is_scored(self, ergoqp, demo, tmp_path):
        options = ("--window", "2:4", "--neutral", "vertical", "--up", "y")
        assert ergoqp("score", demo, "--out", "part", *options).status == 0
        summary = json.loads((tmp_path / "part" / "scores.json").read_text(encoding="utf-8"))
        assert summary["frames"] == 61
        # Upside down, no frame shows a trunk.
        assert ergoqp("score", demo, "--out", "rest", "--window", "2:", "--up", "-y").status == 3
        summary = json.loads((tmp_path / "rest" / "scores.json").read_text(encoding="utf-8"))
        assert summary["frames"] == 121
        assert any("although the head" in each for each in summary["assumptions"])

    @pytest.mark.slow
    def test_the_upper_arm_can_be_scored_by_its_elevation(self, ergoqp, demo, tmp_path):
        assert ergoqp("score", demo, "--upper-arm", "elevation", "--out", "by").status == 0
        summary = json.loads((tmp_path / "by" / "scores.json").read_text(encoding="utf-8"))
        assert any("deg raised" in sentence for sentence in summary["worst"]["reasons"])

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("--load-kg", "-1"), "load_kg"),
            (("--load-kg", "nan"), "load_kg"),
            (("--coupling", "4"), "coupling"),
            (("--activity", "-1"), "activity"),
            (("--up", "w"), "--up"),
            (("--window", "2"), "--window"),
            (("--window", "a:b"), "--window"),
            (("--window", "90:99"), "window"),
            (("--neutral", "99"), "neutral: got 99 s"),
            (("--neutral", "none.bvh"), "none.bvh"),
            (("--upper-arm", "none"), "--upper-arm"),
            (("--unit-to-m", "-1"), "unit_to_m"),
            (("--unit-to-m", "0.0001"), "unit"),
            (("--person", "0.4"), "stature"),
            (("--mapping", "none.toml"), "none.toml"),
            (("--arm-supported", "none"), "--arm-supported"),
        ],
    )
    def test_mistakes(self, ergoqp, demo, arguments, words):
        assert words in mistake(ergoqp("score", demo, *arguments))


class TestFaults:
    """A bug is not the user's mistake: another status, a short message, the traceback for who
    asks."""

    @pytest.fixture
    def fault(self, monkeypatch):
        def broken(*_, **__):
            raise ZeroDivisionError("a bug")

        monkeypatch.setattr("ergoqp.problem.load.load_problem", broken)
        monkeypatch.setattr("ergoqp.cli.run.load_person_problem", broken)

    @pytest.mark.usefixtures("fault")
    def test_short(self, ergoqp, monkeypatch):
        monkeypatch.delenv("ERGOQP_DEBUG", raising=False)
        outcome = ergoqp("run", "screwing")
        assert outcome.status == 1
        assert outcome.err.startswith(
            "ergoqp: internal fault, ZeroDivisionError: a bug; set ERGOQP_DEBUG=1"
        )
        assert "Traceback" not in outcome.err

    @pytest.mark.usefixtures("fault")
    def test_traceback_for_who_asks(self, ergoqp, monkeypatch):
        monkeypatch.setenv("ERGOQP_DEBUG", "1")
        outcome = ergoqp("run", "screwing")
        assert outcome.status == 1
        assert "Traceback" in outcome.err

    def test_interrupted(self, ergoqp, monkeypatch):
        def stop(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr("ergoqp.cli.run.load_person_problem", stop)
        assert ergoqp("run", "screwing").status == 130


@pytest.mark.slow
def test_as_a_process(tmp_path):
    """The installed command and ``python -m ergoqp`` give the status and the streams to the
    shell."""
    for command in (["ergoqp"], [sys.executable, "-m", "ergoqp"]):
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        }
        done = subprocess.run(
            [*command, "run", "nonsense"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.startswith("ergoqp: problem: got 'nonsense'")


@pytest.mark.slow
def test_output_without_unicode(tmp_path):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "ergoqp",
        "run",
        "desk",
        "--duration",
        "0.1",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_bar_on_a_terminal(ergoqp, monkeypatch):
    """On a terminal the work is shown by a bar that goes away."""

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm-256color")
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert ergoqp("run", "desk", "--duration", "0.5").status == 0
    assert "closed loop, 0.5 s" in terminal.getvalue()
    assert "100%" in terminal.getvalue()
    assert "\x1b" in terminal.getvalue()
