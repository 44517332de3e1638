"""Problems that clients send: what their text may not do, and when they are served."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from service_lines import COMFORT, Lines
from service_running import Running, running

import ergoqp
from ergoqp.errors import ProblemError
from ergoqp.files.read import LONGEST_KEY
from ergoqp.problem import schema
from ergoqp.registry import GROUPS, data_folder
from ergoqp.service.loads import LONGEST_PROBLEM, MOST_LOADED, Text, own_terms
from ergoqp.service.served import Served, served

OVERHEAD = served("overhead").text
PERSON = "[response.ik]\n"
STEP: dict[str, Any] = {"posture": COMFORT, "standing": True}


@pytest.fixture(scope="module")
def running_service() -> Iterator[Running]:
    """A service whose loops ``screwing`` and ``desk`` are in one process, and ``overhead``."""
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(
            Path(folder) / "s", "screwing", "overhead", "desk", "--workers", "2", "--interpreted"
        ) as found,
    ):
        found.client().close()
        Lines.by_unix(found.folder).close()
        yield found
        log = found.log.read_text()
        assert "Traceback" not in log, log


@pytest.fixture
def lines(running_service: Running) -> Iterator[Lines]:
    with Lines.by_unix(running_service.folder) as found:
        yield found


def load(lines: Lines, name: str, text: str = OVERHEAD) -> dict[str, Any]:
    return lines.ask(load={"name": name, "problem": text})


def free(lines: Lines, loop: str) -> None:
    """Wait until nobody commands a loop."""
    until = time.monotonic() + 20
    while lines.ask(health={"loop": loop})["health"][loop]["commander"] is not None:
        assert time.monotonic() < until


def twist_of(lines: Lines, loop: str) -> list[float]:
    """Return the first twist of a loop, which is at rest afterwards."""
    twist = lines.ask(step={"loop": loop, **STEP})["twist"]
    lines.ask(step={"standing": True, "enable": False})
    return twist


class TestText:
    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "response: got nothing, required"),
            ("x = ", "not a TOML file"),
            ("x = 1\nx = 2", "not a TOML file"),
            (".".join("a" * (LONGEST_KEY + 1)) + " = 1", "parts in line 1"),
            ("a = " + "[" * 5000, "not a TOML file"),
            (PERSON + 'person = "me.toml"', "person: got a person file, allowed stature"),
            ('[response]\nik = {person = "/etc/passwd"}', "person: got a person file"),
            ('[response]\n"ik" = {"person" = ""}', "person: got a person file"),
            ('[response.gmr]\nmodel = "/x.npz"', "model: got '/x.npz', allowed the name"),
            ('[response.gmr]\nmodel = "../x"', "model: got '../x', allowed the name"),
            (PERSON + '[cost.learned]\nmodel = "x.npz"', "model: got 'x.npz', allowed the name"),
            (
                PERSON + '[limits.one_class_boundary]\nmodel = "a/b"',
                "model: got 'a/b', allowed the name",
            ),
            (PERSON + '[cost.learned]\nmodel = "nothing"', "model: got 'nothing'"),
            (PERSON + "[cost.learned]\nmodel = 5", "model: got 5"),
            (PERSON + "[limits.mine]\n", "limits.mine: got a term that is not ergoqp's"),
            (PERSON + "[cost]\nmine = {}", "cost.mine: got a term that is not ergoqp's"),
            ("response = 5", "response: got 5"),
            ("[response]\nik = 5", "response.ik: got 5"),
        ],
    )
    def test_what_is_refused(self, text, words):
        with pytest.raises(ProblemError) as error:
            Text("mine", text).load()
        assert words in str(error.value)

    def test_no_file_is_opened_but_those_of_the_package(self, monkeypatch, tmp_path):
        opened: list[Path] = []
        read = Path.open

        def spied(self: Path, *arguments: Any, **more: Any) -> Any:
            opened.append(self)
            return read(self, *arguments, **more)

        monkeypatch.setattr(Path, "open", spied)
        monkeypatch.setattr(Path, "read_bytes", lambda self: opened.append(self))
        text = served_text_of("screwing_learned")
        assert "model" in text
        opened.clear()
        Text("mine", text).load()
        # Names of terms are looked up in what is installed.
        found = {path.parent for path in opened if ".dist-info" not in str(path)}
        assert found == {data_folder("models")}

    def test_a_model_beside_the_text_is_not_found(self, monkeypatch, tmp_path):
        (tmp_path / "mine.npz").write_bytes(b"")
        monkeypatch.chdir(tmp_path)
        with pytest.raises(ProblemError, match="model: got 'mine'"):
            Text("x", PERSON + '[cost.learned]\nmodel = "mine"').load()

    def test_it_is_the_problem_of_the_file(self):
        expected = ergoqp.Stepper(ergoqp.load_problem("overhead")).step(np.array(COMFORT))
        problem = Text("mine", OVERHEAD).load().problem
        assert problem.name == "mine"
        assert (
            ergoqp.Stepper(problem).step(np.array(COMFORT)).twist.tolist()
            == expected.twist.tolist()
        )


def served_text_of(name: str) -> str:
    return (data_folder("problems") / f"{name}.toml").read_text()


class TestOwnTerms:
    @pytest.fixture(autouse=True)
    def term(self, monkeypatch):
        """A limit of a user, which may open the file that it is given."""

        def ceiling(height: float = 2.0, file: str = "") -> Any:
            return ergoqp.limits.HalfSpace and ergoqp.limits.WorkspaceBox(
                (-3, -3, 0), (3, 3, height)
            )

        names = {kind: ("ceiling", "other") if kind == "limit" else () for kind in GROUPS}
        monkeypatch.setattr(schema, "registered", names.__getitem__)
        monkeypatch.setattr(schema, "own_term", lambda kind, name: ceiling)

    def started(self, text: str) -> dict[tuple[str, str], frozenset[str]]:
        return own_terms([Served("a", text, None, ergoqp.load_problem("screwing"))])

    def test_only_those_that_the_service_was_started_with(self):
        text = PERSON + "[limits.ceiling]\nheight = 1.9"
        with pytest.raises(ProblemError, match="started with a problem that has it"):
            Text("mine", text).load()
        own = self.started(PERSON + "[limits.ceiling]\nheight = 2.5")
        assert Text("mine", text, own).load().problem.name == "mine"
        with pytest.raises(ProblemError, match=r"limits\.other: got a term"):
            Text("mine", PERSON + "[limits.other]", own).load()

    def test_only_the_texts_that_they_had(self):
        own = self.started(PERSON + '[limits.ceiling]\nfile = "hall.stl"')
        assert own == {("limits", "ceiling"): frozenset({"hall.stl"})}
        Text("mine", PERSON + '[limits.ceiling]\nheight = 1.8\nfile = "hall.stl"', own).load()
        with pytest.raises(ProblemError, match="got the text '/etc/passwd'"):
            Text("mine", PERSON + '[limits.ceiling]\nfile = "/etc/passwd"', own).load()


class TestService:
    def test_a_new_loop(self, running_service, lines):
        answer = load(lines, "mine")
        assert answer["loaded"] == answer["loop"] == answer["problem"] == "mine"
        assert answer["engine"] == "interpreted"
        assert set(answer["loops"]) >= {"screwing", "overhead", "desk", "mine"}
        with Lines.by_unix(running_service.folder) as other:
            expected = twist_of(other, "overhead")
        with Lines.by_unix(running_service.folder) as other:
            assert twist_of(other, "mine") == expected
        free(lines, "mine")
        with running_service.client("mine") as client:
            client.reset()
            assert client.step(np.array(COMFORT)).twist.tolist() == expected
            client.reset()
            client.step(np.array(COMFORT), enable=False)

    def test_its_process_loads_it_again(self, running_service, lines):
        load(lines, "again")
        before = running_service.worker("again")
        os.kill(before, signal.SIGKILL)
        until = time.monotonic() + 60
        while True:
            with running_service.client("again", timeout=1.0) as client:
                if client.description["health"]["pid"] != before:
                    break
            assert time.monotonic() < until
        assert len(twist_of(lines, "again")) == 6

    @pytest.mark.parametrize(
        ("name", "text", "words"),
        [
            ("bad", "dt = 3", "2 mistakes: dt: got 3"),
            ("bad", PERSON + 'person = "/etc/passwd"', "got a person file"),
            ("bad", PERSON + "[limits.mine]", "not ergoqp's"),
            ("bad", "x" * (LONGEST_PROBLEM + 1), f"allowed {LONGEST_PROBLEM}"),
            ("json", OVERHEAD, "got the name 'json'"),
            ("../bad", OVERHEAD, "got the name '../bad'"),
            ("a.sock", OVERHEAD, "got the name 'a.sock'"),
            ("", OVERHEAD, "got the name ''"),
        ],
    )
    def test_what_is_refused(self, running_service, lines, name, text, words):
        before = sorted(path.name for path in running_service.folder.iterdir())
        error = load(lines, name, text)["error"]
        assert words in error
        assert "\n" not in error
        assert sorted(path.name for path in running_service.folder.iterdir()) == before
        assert name not in lines.ask(health={})["health"]

    def test_the_log_holds_nothing_that_a_client_wrote(self, running_service, lines):
        load(lines, "bad", '"\\u001b[31mred" = 1\n')
        assert "red" not in running_service.log.read_text()

    def test_a_loop_that_is_commanded_is_not_replaced(self, running_service, lines):
        with Lines.by_unix(running_service.folder) as other:
            other.ask(step={"loop": "overhead", **STEP, "enable": False})
            words = load(lines, "overhead")["error"]
            assert words.startswith("loop overhead: commanded by process")
            assert words.endswith("nothing was replaced")
            assert "twist" in other.ask(step={"standing": True, "enable": False})
        free(lines, "overhead")

    def test_a_loop_that_was_left_moving_is_not_replaced(self, running_service, lines):
        with Lines.by_unix(running_service.folder) as other:
            other.ask(step={"loop": "overhead", "moving": True, "twist": [0.02, 0, 0, 0, 0, 0]})
        free(lines, "overhead")
        assert "was left moving" in load(lines, "overhead")["error"]
        # Once somebody reports that it stands, it is.
        with Lines.by_unix(running_service.folder) as other:
            other.ask(step={"loop": "overhead", **STEP, "enable": False})
        free(lines, "overhead")
        assert "loaded" in load(lines, "overhead", served_text_of("dentist"))
        assert lines.ask(describe={"loop": "overhead"})["title"] != served("overhead").problem.title

    def test_a_client_of_the_old_problem_is_told(self, running_service, lines):
        load(lines, "changes")
        with running_service.client("changes") as client:
            assert "loaded" in load(lines, "changes", served_text_of("desk"))
            client.reset()
            until = time.monotonic() + 30
            while "was replaced" not in (answer := client.step(np.array(COMFORT))).reason:
                assert not answer.fresh
                assert time.monotonic() < until, answer

    def test_a_bad_text_replaces_nothing(self, lines):
        load(lines, "stays")
        before = lines.ask(health={"loop": "stays"})
        assert "error" in load(lines, "stays", "dt = 3")
        assert lines.ask(health={"loop": "stays"}) == before

    def test_a_loop_beside_one_that_is_commanded_is_not_replaced(self, running_service, lines):
        before = running_service.worker("desk")
        with Lines.by_unix(running_service.folder) as other:
            stop = threading.Event()
            answers: list[dict[str, Any]] = []

            def command() -> None:
                answers.append(other.ask(step={"loop": "desk", **STEP}))
                while not stop.wait(0.01):
                    answers.append(other.ask(step={"posture": COMFORT}))

            thread = threading.Thread(target=command)
            thread.start()
            try:
                words = load(lines, "screwing")["error"]
            finally:
                stop.set()
                thread.join()
            assert words.startswith("loop screwing: it, or a loop beside it, is commanded")
            # The other loop went on all the time; a machine that is busy makes steps late.
            late = [each for each in answers if "error" in each]
            assert all("passed since the last twist" in each["error"] for each in late)
            assert len(late) < len(answers)
            other.ask(step={"standing": True, "enable": False})
        free(lines, "desk")
        # Their process stays, and is not asked to make room any more.
        time.sleep(1.0)
        assert running_service.worker("desk") == before
        assert "loaded" in load(lines, "screwing")
        assert set(lines.ask(health={})["health"]) >= {"screwing", "desk"}

    def test_one_at_a_time(self, running_service, lines):
        answers: list[dict[str, Any]] = []

        def ask() -> None:
            with Lines.by_unix(running_service.folder) as other:
                answers.append(load(other, "twice"))

        threads = [threading.Thread(target=ask) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        served_ones = [each for each in answers if "loaded" in each]
        refused = [each["error"] for each in answers if "error" in each]
        assert served_ones
        assert all("another problem is being loaded" in words for words in refused)

    def test_no_more_than_a_few(self, lines):
        for number in range(MOST_LOADED + 1):
            answer = load(lines, f"many{number}")
            if "error" in answer:
                break
        assert f"allowed {MOST_LOADED}" in answer["error"]
